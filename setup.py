"""Install hunt_ros: with colcon as an ament_python package, or with pip into a plain venv."""

from glob import glob
from pathlib import Path
from runpy import run_path

from setuptools import find_packages, setup

NAME = 'hunt_ros'
HERE = Path(__file__).parent / NAME
SUITE = run_path(str(HERE / 'suite.py'))


def ros(rclpy: str, messages: str, interfaces: str) -> list[str]:
    """
    Return the wheels of one distribution of ROS.

    The versions are exact: without them pip takes those of the newest distribution.
    """
    return [
        f'ros-rclpy[fastrtps]=={rclpy}',
        *(
            f'ros-{name}=={messages}'
            for name in ('std-msgs', 'geometry-msgs', 'sensor-msgs', 'diagnostic-msgs', 'std-srvs')
        ),
        *(f'ros-{name}=={interfaces}' for name in ('lifecycle-msgs', 'rosgraph-msgs')),
    ]


# All tests run on Jazzy, those of the nodes on Kilted too (`make test-kilted`).
JAZZY = ros('7.1.6', '5.3.6', '2.0.3')
KILTED = ros('9.1.2', '5.5.1', '2.3.0')

setup(
    name=NAME,
    version=run_path(str(HERE / '__init__.py'))['__version__'],
    description='Live monitoring of hunting motion on a railway roller rig',
    maintainer='hunt_ros maintainers',
    maintainer_email='maintainers@example.org',
    license='Apache-2.0',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    python_requires='>=3.10',
    install_requires=[
        'setuptools',
        'numpy>=1.24',
        'scipy>=1.10',
        'PyYAML>=6.0',
        'rich>=13',
        'matplotlib>=3.6',
        'mcap>=1.2',
        'rosbags>=0.10',
        'lz4>=4.3',
        'zstandard>=0.22',
        'filterpy>=1.4.5',  # the textbook filter beside the tracker in `hunt check`
    ],
    extras_require={
        'ros': JAZZY,
        'ros-kilted': KILTED,
        'fast': ['numba>=0.59'],
        'matlab73': ['pymatreader>=1.0'],
        'tdms': ['npTDMS>=1.9'],
        'modbus': ['pymodbus>=3.10,<4', 'pyserial>=3.5'],
        'serial': ['pyserial>=3.5'],
        'nidaqmx': ['nidaqmx>=1.0'],
        'cluster': ['distributed>=2024.1'],
        'dashboard': ['tornado>=6.3'],
        'completion': ['argcomplete>=2.0'],
        'bench': ['pysindy>=2.0'],
        'docs': ['mkdocs-material>=9.5,<10', 'mkdocstrings[python]>=0.27'],
        'test': [
            'pytest>=7.4',
            'pytest-xdist>=3.5',
            'hypothesis>=6.98',
            'playwright>=1.45',  # drives a Chromium that is installed
            # Exactly these: another version of a checker finds other things.
            'ruff==0.17.5',
            'mypy==2.4.1',
            'import-linter==2.16',
            'codespell==2.4.3',
        ],
        'colcon': ['colcon-common-extensions', 'colcon-ros', 'setuptools<80'],
    },
    # The machine code is there once `hunt compile` has run: `make wheel` ships it.
    package_data={
        f'{NAME}.dashboard': ['static/*'],
        f'{NAME}.nodes.support': ['*.xml'],
        NAME: ['machine_code/all.*', f'machine_code/{NAME}.*'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', sorted(glob('config/*.*'))),
        (f'share/{NAME}/config/sros2', ['config/sros2/policy.xml']),
        (f'share/{NAME}/launch', sorted(glob('launch/*.launch.py'))),
    ],
    zip_safe=True,
    entry_points={
        'console_scripts': [
            'hunt = hunt_ros.cli.main:main',
            *(f'{node} = {NAME}.nodes.entry:{node}' for node in (*SUITE['NODES'], SUITE['SUITE'])),
        ],
        # Name of a driver: the module that has its classes (docs/drivers.md).
        'hunt_ros.drivers': [
            'simulated = hunt_ros.drivers.simulated',
            'modbus = hunt_ros.drivers.modbus',
            'serial_line = hunt_ros.drivers.serial_line',
            'nidaqmx = hunt_ros.drivers.nidaqmx',
            'topic = hunt_ros.nodes.topic_driver',
        ],
    },
)
