"""The demo ends every process and leaves a readable recording at Ctrl-C."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hunt_ros.bag import read_record

pytest.importorskip('rclpy', reason='the extra ros is not installed')
pytestmark = [pytest.mark.ros, pytest.mark.slow]


def _children(pid: int) -> list[int]:
    found = []
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = path.read_text().rpartition(')')[2].split()
        except OSError:
            continue  # it ended meanwhile
        if int(fields[1]) == pid:
            found.append(int(path.parent.name))
    return found


@pytest.mark.skipif(not Path('/proc/self/stat').exists(), reason='looks for processes in /proc')
@pytest.mark.parametrize(('pace', 'least_bytes'), [('10', 400_000), ('1', 250_000)])
def test_ctrl_c_ends_every_process_and_leaves_a_readable_recording(
    tmp_path, machine, domain, pace, least_bytes
) -> None:
    root = Path(__file__).resolve().parents[2]
    words = [sys.executable, '-m', 'hunt_ros.cli.main', 'demo', '--out', str(tmp_path)]
    words += ['--pace', pace]
    with (tmp_path / 'out').open('w') as out:
        demo = subprocess.Popen(words, stdout=out, stderr=out, cwd=root)
    files = lambda: list(tmp_path.glob('demo_*/*.active/*.mcap'))  # noqa: E731
    deadline = machine.deadline(90.0)
    while not any(path.stat().st_size > least_bytes for path in files()):
        assert not deadline.passed, f'no recording {deadline}: {(tmp_path / "out").read_text()}'
        time.sleep(0.2)
    children = _children(demo.pid)
    assert len(children) == 8, 'seven nodes and the console'
    demo.send_signal(signal.SIGINT)
    assert machine.wait_for(demo, 40.0) == 130
    assert not [pid for pid in children if Path(f'/proc/{pid}').exists()]
    (folder,) = tmp_path.glob('demo_*')
    assert not list(folder.glob('*.active')), 'the recording was closed properly'
    (bag,) = folder.glob('hunt_*')
    record = read_record(bag)
    assert len(record['lateral']) > 100
    assert set(record) == {'lateral', 'yaw', 'roller', 'speed'}
