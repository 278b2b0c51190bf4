"""
The package as an ament_python package: colcon builds it, tests it, and its programs run.

Everything happens in a scratch copy of the files under version control, so that what
builds is what a clone holds, and nothing is left behind in the work tree.
"""

from __future__ import annotations

import ast
import configparser
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name

import pytest
from made import declared, python
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
COLCON = Path(sys.executable).with_name('colcon')
NAME = 'hunt_ros'

#: Released in Jazzy and in Kilted: `jazzy/distribution.yaml`, `kilted/distribution.yaml` of
#: ros/rosdistro, 2026-08-22.
OF_ROS = {
    'rclpy', 'builtin_interfaces', 'std_msgs', 'std_srvs', 'geometry_msgs', 'sensor_msgs',
    'diagnostic_msgs', 'rosgraph_msgs', 'rcl_interfaces', 'launch',
    'launch_ros', 'ros2launch', 'ament_index_python',
}  # fmt: skip
#: What a key of rosdep brings on Ubuntu 24.04: `rosdep/python.yaml` of ros/rosdistro, 2026-08-22.
#: With the version of packages.ubuntu.com (noble). No key for which rosdep calls pip: what depends
#: on one cannot be released. There is a key python3-numba too, whose package 24.04 has not.
ROSDEP = {
    'python3-setuptools': {'setuptools': '68.1.2'},
    'python3-numpy': {'numpy': '1.26.4'},
    'python3-scipy': {'scipy': '1.11.4'},
    'python3-matplotlib': {'matplotlib': '3.6.3'},
    'python3-rich': {'rich': '13.7.1'},
    'python3-yaml': {'PyYAML': '6.0.1'},
    'python3-serial': {'pyserial': '3.5'},
    'python3-tornado': {'tornado': '6.4.0'},
    'python3-pymodbus': {'pymodbus': '3.6.9'},
    'python3-pytest': {'pytest': '7.4.4'},
    'python3-hypothesis': {'hypothesis': '6.98.15'},
}
#: Extras that a lab PC has no use for: ROS is there, and these check or measure the package.
NOT_THERE = {'ros', 'ros-kilted', 'test', 'bench', 'docs', 'colcon'}


def console_scripts() -> dict[str, str]:
    """Name and target of each console script, as setup.py declares them."""
    parts = (entry.partition('=') for entry in declared()['entry_points']['console_scripts'])
    return {name.strip(): target.strip() for name, _, target in parts}


def package() -> ElementTree.Element:
    return ElementTree.parse(ROOT / 'package.xml').getroot()


def test_the_manifest_names_every_ros_package_that_is_imported() -> None:
    suffixes = ('_msgs', '_srvs', '_interfaces', '_python')
    imported = {'ros2launch'}  # what `ros2 launch` is
    for path in [*(ROOT / NAME).rglob('*.py'), *(ROOT / 'launch').glob('*.py')]:
        for statement in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(statement, ast.ImportFrom) and not statement.level:
                imported.add(str(statement.module).partition('.')[0])
            elif isinstance(statement, ast.Import):
                imported |= {alias.name.partition('.')[0] for alias in statement.names}
    of_ros = {name for name in imported if name.endswith(suffixes) or 'launch' in name}
    declared = {element.text for element in package().iter('exec_depend')}
    assert of_ros | {'rclpy'} <= declared


def by_pip() -> set[str]:
    """What docs/lab-pc.md says that rosdep does not bring."""
    text = (ROOT / 'docs/lab-pc.md').read_text(encoding='utf-8')
    (paragraph,) = re.findall(r'Not from rosdep.*?\n\n', text, re.S)
    return set(re.findall(r'`([\w-]+)`', paragraph))


def test_every_dependency_of_the_manifest_is_a_key_of_rosdep_and_stands_there_once() -> None:
    depends = [str(node.text) for node in package() if node.tag.endswith('depend')]
    assert set(depends) <= OF_ROS | set(ROSDEP)
    assert len(depends) == len(set(depends))
    assert 'python3-numba' not in depends, 'rosdep would not install any: it is not in 24.04'


def test_rosdep_brings_every_requirement_or_the_page_of_the_lab_pc_says_that_pip_does() -> None:
    given = declared()
    texts = [*given['install_requires']]
    texts += [text for name in set(given['extras_require']) - NOT_THERE
              for text in given['extras_require'][name]]  # fmt: skip
    depends = {str(node.text) for node in package().iter('exec_depend')}
    brought = {name: version for key in depends for name, version in ROSDEP.get(key, {}).items()}
    missing = set()
    for requirement in map(Requirement, texts):
        version = brought.get(requirement.name)
        if version is None or version not in requirement.specifier:
            missing.add(requirement.name)
    assert missing == by_pip()


def test_rosdep_brings_what_colcon_tests_with() -> None:
    depends = {str(node.text) for node in package().iter('test_depend')}
    for requirement in map(Requirement, declared()['extras_require']['test']):
        for key in depends:
            version = ROSDEP[key].get(requirement.name, '')
            assert not version or version in requirement.specifier, requirement


def test_manifest_setup_and_package_agree_on_the_version_of_the_newest_changes() -> None:
    import hunt_ros

    heading = r'^(\d+\.\d+\.\d+)(?: \(\d{4}-\d\d-\d\d\))?\n-+$'
    newest = re.search(heading, (ROOT / 'CHANGELOG.rst').read_text(), re.M)
    assert newest is not None
    versions = {package().findtext('version'), hunt_ros.__version__, declared()['version']}
    assert versions == {newest.group(1)}


#: What rosdep does not bring, and nothing that guards the rig may need.
ABSENT = ('rosbags', 'lz4', 'zstandard', 'filterpy', 'mcap', 'numba')


def run_without(*lines: str, absent: tuple[str, ...] = ABSENT) -> subprocess.CompletedProcess[str]:
    """Run lines of Python where these libraries are not installed."""
    missing = f'import sys; sys.modules.update(dict.fromkeys({absent}))'
    return python('-c', '\n'.join((missing, *lines)), cwd=ROOT, code=None)


@pytest.mark.ros
def test_what_guards_the_rig_needs_nothing_but_what_the_manifest_names() -> None:
    nodes = (
        'hunting_detector',
        'roller_speed',
        'support.sensor',
        'alarm_outputs',
        'rig_simulator',
    )
    done = run_without(*(f'import hunt_ros.nodes.{node}' for node in nodes))
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize('words', [['info', 'bags/kick_decays'], ['simulate', '/nowhere/run']])
def test_a_verb_that_needs_more_says_in_one_line_what_pip_installs(words: list[str]) -> None:
    done = run_without('from hunt_ros.cli.main import main', f'sys.exit(main({words}))')
    assert done.returncode == 2
    (said,) = done.stderr.splitlines()
    assert re.fullmatch(rf'hunt {words[0]}: \w+ is not installed: pip install [\w ]+', said)
    assert {'rosbags', 'mcap', 'lz4', 'zstandard'} <= set(said.split())


@pytest.mark.ros
@pytest.mark.parametrize(
    ('node', 'library'), [('bag_recorder', 'rosbags'), ('dashboard', 'tornado')]
)
def test_a_node_that_needs_more_says_in_one_line_what_pip_installs(
    node: str, library: str
) -> None:
    line = f'from hunt_ros.nodes.entry import start; start({node!r})'
    done = run_without(line, absent=(library,))
    assert done.returncode == 2
    *_, said = done.stderr.splitlines()
    assert re.fullmatch(rf'{node}: \w+ is not installed: pip install [\w ]+', said)
    assert library in said.split()
    assert 'Traceback' not in done.stderr


def test_scripts_go_where_ros2_run_looks() -> None:
    config = configparser.ConfigParser()
    config.read(ROOT / 'setup.cfg')
    assert config['install']['install_scripts'] == f'$base/lib/{NAME}'
    assert config['develop']['script_dir'] == f'$base/lib/{NAME}'
    assert (ROOT / 'resource' / NAME).is_file()


@pytest.mark.parametrize('script', sorted(console_scripts()))
def test_every_console_script_points_at_something_that_can_be_called(script: str) -> None:
    assert callable(resolve_name(console_scripts()[script]))


def clean_environment() -> dict[str, str]:
    """Environment without what the ROS wheels put into this process (they re-execute Python)."""
    hidden = {'LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'PYTHONPATH'}
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    environment['PATH'] = f'{COLCON.parent}{os.pathsep}{environment["PATH"]}'
    environment['OMP_NUM_THREADS'] = '1'
    return environment


def call(*words: str, where: Path, timeout: float = 600.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        words,
        cwd=where,
        env=clean_environment(),
        capture_output=True,
        text=True,
        timeout=timeout,
    )


@pytest.fixture(scope='module')
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Make a colcon workspace holding the tracked files, built."""
    if not COLCON.exists():
        pytest.skip('colcon is not installed (extra colcon)')
    if shutil.which('git') is None or not (ROOT / '.git').exists():
        pytest.skip('not a git clone: what is tracked cannot be known')
    workspace = tmp_path_factory.mktemp('workspace')
    copy = workspace / 'src' / NAME
    listed = subprocess.run(
        ['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in filter(None, listed.stdout.split('\0')):
        # A golden bag is a megabyte, and no build looks at it.
        if name.startswith('bags/') or not (ROOT / name).is_file():
            continue
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copy / name)
    built = call('colcon', 'build', '--event-handlers', 'console_direct+', where=workspace)
    assert built.returncode == 0, built.stdout + built.stderr
    assert 'WARNING' not in built.stderr, built.stderr
    yield workspace
    shutil.rmtree(workspace, ignore_errors=True)


@pytest.mark.packaging
def test_colcon_takes_it_for_an_ament_package_and_installs_every_part(workspace: Path) -> None:
    listed = call('colcon', 'list', where=workspace)
    assert listed.stdout.split() == [NAME, f'src/{NAME}', '(ros.ament_python)']
    share = workspace / 'install' / NAME / 'share'
    assert (share / 'ament_index/resource_index/packages' / NAME).is_file()
    assert (share / NAME / 'package.xml').is_file()
    tracked = workspace / 'src' / NAME
    for folder, pattern in (('config', '*.*'), ('launch', '*.launch.py')):
        for path in (tracked / folder).rglob(pattern):
            assert (share / NAME / path.relative_to(tracked)).is_file(), path.name


@pytest.mark.packaging
def test_every_executable_is_where_ros2_run_looks(workspace: Path) -> None:
    programs = workspace / 'install' / NAME / 'lib' / NAME
    for script in console_scripts():
        assert os.access(programs / script, os.X_OK), script


@pytest.mark.packaging
def test_the_installed_program_runs_from_the_installed_package(workspace: Path) -> None:
    program = workspace / 'install' / NAME / 'lib' / NAME / 'hunt'
    where_is_it = f"python -c 'import {NAME}; print({NAME}.__file__)'"
    script = f'. install/setup.sh && {program} --version && {where_is_it}'
    done = call('sh', '-c', script, where=workspace)
    assert done.returncode == 0, done.stderr
    version, where = done.stdout.split('\n')[:2]
    assert version == f'{NAME} {package().findtext("version")}'
    assert Path(where).resolve().is_relative_to((workspace / 'install').resolve())


@pytest.mark.packaging
@pytest.mark.slow
def test_colcon_test_finds_and_passes_the_tests(workspace: Path) -> None:
    # A cut through the suite: colcon must find pytest, the files and the package. The
    # whole suite is what runs this very test.
    done = call(
        'colcon',
        'test',
        '--return-code-on-test-failure',
        '--pytest-args',
        'test/test_samples.py',
        'test/dynamics/test_identified.py',
        where=workspace,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    results = call('colcon', 'test-result', '--all', where=workspace)
    found = re.search(r'(\d+) tests?, 0 errors?, 0 failures?', results.stdout)
    assert found, results.stdout
    assert int(found.group(1)) > 50


def test_the_image_has_what_rosdep_and_pip_bring() -> None:
    """No engine of containers is at hand: what stands in the file is compared."""
    text = (ROOT / 'Dockerfile').read_text(encoding='utf-8')
    depends = {str(node.text) for node in package().iter('exec_depend')}
    wanted = {key for key in depends & set(ROSDEP) if key != 'python3-setuptools'}
    assert wanted <= set(re.findall(r'python3-[a-z]+', text))
    (install,) = re.findall(r'pip install --no-cache-dir (\'setuptools.*)', text)
    assert {'rosbags', 'mcap', 'lz4', 'zstandard', 'numba', 'filterpy'} <= set(install.split())
