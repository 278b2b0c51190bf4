"""The launch file on the real `launch`: the suite comes up, judges its rig, and ends cleanly."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

for needed in ('rclpy', 'launch', 'launch_ros', 'ament_index_python'):
    pytest.importorskip(needed, reason='comes with ROS 2: no wheel has it')

from ament_index_python.packages import (  # noqa: E402
    PackageNotFoundError,
    get_package_share_directory,
)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402

from hunt_ros.bag import read_record  # noqa: E402
from test.nodes.test_start_and_end import FORM, RIG, loud_lines  # noqa: E402

#: What `ros2 launch` does with a file and NAME:=VALUE.
LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

file, *given = sys.argv[1:]
source = PythonLaunchDescriptionSource(file)
arguments = [tuple(each.split(':=', 1)) for each in given]
service = LaunchService()
included = IncludeLaunchDescription(source, launch_arguments=arguments)
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""


@pytest.fixture(scope='module')
def share() -> Path:
    """Return where colcon has put the launch file."""
    try:
        return Path(get_package_share_directory('hunt_ros'))
    except PackageNotFoundError:
        pytest.skip('hunt_ros is not built by colcon, or its set-up is not sourced')


@pytest.mark.slow
@pytest.mark.parametrize('one_process', ['false', 'true'])
def test_the_launched_suite_judges_the_simulated_rig_and_ends_cleanly(
    graph, machine, share: Path, one_process: str
) -> None:
    (graph.folder / 'rig.yaml').write_text(RIG.format(port=graph.port))
    heard = graph.collect(DiagnosticArray, 'hunting/status')
    log = graph.folder / 'launch.log'
    words = [str(share / 'launch' / 'rig.launch.py'), f'rig:={graph.folder / "rig.yaml"}']
    words += [f'normal_form:={FORM}', f'one_process:={one_process}']
    with log.open('w') as out:
        launched = subprocess.Popen(
            [sys.executable, '-c', LAUNCH, *words],
            stdout=out, stderr=subprocess.STDOUT, cwd=graph.folder, start_new_session=True,
        )  # fmt: skip
    try:
        graph.spin_until(lambda: heard and heard[-1].status[0].level == DiagnosticStatus.OK, 60.0)
        # At 20 a second: the first minute.
        graph.spin_until(lambda: len(heard) > 1200, 150.0)
    finally:
        os.killpg(launched.pid, signal.SIGINT)  # as a terminal does
        code = machine.wait_for(launched, 60.0)
    said = log.read_text()
    assert code == 0, said
    before, _, _ = said.partition('[WARNING] [launch]')
    assert loud_lines(before) == []
    started = re.findall(r'\[([a-z_]+-\d+)\]: process started', said)
    ended = re.findall(r'\[([a-z_]+-\d+)\]: process has finished cleanly', said)
    assert len(started) == (2 if one_process == 'true' else 7)  # the speed node is always apart
    assert sorted(ended) == sorted(started), said
    (recording,) = (graph.folder / 'recordings').iterdir()
    assert set(read_record(recording)) >= {'lateral', 'yaw', 'roller', 'speed'}
