"""What a verb writes is there whole or not at all; what it prints passes any pipe and terminal."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from made import python

from hunt_ros.bag import BagWriter, read_record, write_record
from hunt_ros.bag.record_writer import serialise
from hunt_ros.cli.main import main, parser_of
from hunt_ros.cli.replay import read
from hunt_ros.cli.support.live_replay import _player
from hunt_ros.errors import HuntError
from hunt_ros.files import write_whole
from hunt_ros.samples import Record, Series
from hunt_ros.sensors import CHANNEL_FIELDS

STAMPS = 10**18 + np.arange(500) * 10_000_000


def test_a_disk_that_refuses_leaves_what_was_there(tmp_path: Path, monkeypatch) -> None:
    file = tmp_path / 'form.yaml'
    file.write_text('good')
    write = Path.write_bytes

    def half(path: Path, raw: bytes) -> int:
        write(path, raw[: len(raw) // 2])
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(Path, 'write_bytes', half)
    with pytest.raises(HuntError, match='No space left'):
        write_whole(file, 'a new one' * 100)
    assert file.read_text() == 'good'
    assert [path.name for path in tmp_path.iterdir()] == ['form.yaml']


def test_a_pipe_is_written_to_and_a_link_stays_one(tmp_path: Path) -> None:
    """As root, `--json /dev/null` put a regular file in the place of the device."""
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    with open(os.open(pipe, os.O_RDWR), 'rb') as reader:
        write_whole(pipe, 'told')
        assert pipe.is_fifo()
        assert reader.read(4) == b'told'
    (tmp_path / 'disk').mkdir()
    file, link = tmp_path / 'disk' / 'form.yaml', tmp_path / 'newest.yaml'
    link.symlink_to(file)
    for text in ('one', 'two'):
        write_whole(link, text)
        assert link.is_symlink()
        assert file.read_text() == text
    with pytest.raises(HuntError, match='directory'):
        write_whole(tmp_path / 'disk', 'three')
    assert [path.name for path in (tmp_path / 'disk').iterdir()] == ['form.yaml']


def test_every_file_of_a_verb_goes_through_the_one_door() -> None:
    """A verb that writes in place loses what stood there when the disk is full."""
    root = Path(__file__).parents[2] / 'hunt_ros'
    found = [
        f'{path.name}:{number}'
        for path in [*(root / 'cli').glob('*.py'), root / 'cli/support/output.py',
                     *(root / 'report').rglob('*.py')]
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if '.write_text(' in line and path.name != 'demo.py'
    ]  # fmt: skip
    assert found == []


@pytest.fixture
def daq(tmp_path: Path) -> Path:
    """A foreign recording with a decoy: a topic `lateral` that stands still."""
    with BagWriter(tmp_path / 'daq') as bag:
        for topic, values in (
            ('/daq/lateral_1', 0.1 * np.sin(np.arange(500.0))),
            ('/rig/lateral', np.zeros(500)),
            ('/daq/moving', np.full(500, 7.0)),
        ):
            channel = 'speed' if 'moving' in topic else 'lateral'
            key = bag.topic(topic, CHANNEL_FIELDS[channel][0])
            rows = serialise(channel, Series(STAMPS, values))
            for at, raw in zip(STAMPS.tolist(), rows, strict=True):
                bag.write(key, at, bytes(raw))
    (tmp_path / 'rig.yaml').write_text(
        '/**:\n  ros__parameters:\n    sources:\n'
        '      - lateral=/daq/lateral_1.position[0]*0.001\n      - speed=/daq/moving\n'
    )
    return tmp_path / 'daq'


@pytest.mark.parametrize(
    'words',
    [
        ['--rig', 'rig.yaml'],
        ['--rig', 'rig.yaml', '--channel', 'speed=6.5'],
        ['--channel', 'lateral=/daq/lateral_1.position[0]*0.001', '--channel', 'speed=7'],
    ],
)
def test_a_live_replay_plays_what_the_offline_one_reads(daq, monkeypatch, words) -> None:
    monkeypatch.chdir(daq.parent)
    arguments = parser_of('replay').parse_args(['replay', str(daq), '--live', *words])
    offline = read(arguments)
    live = read_record(daq, _player(arguments)['channels'])
    assert set(live) == set(offline)
    for name, series in offline.items():
        np.testing.assert_array_equal(live[name].values, series.values)


def test_a_terminal_without_the_signs_of_a_name_prints_all_the_same(tmp_path: Path) -> None:
    record = Record({'lateral': Series(STAMPS, np.sin(np.arange(500.0)))}, '', {'rig': 'ä ☃'})
    bag = write_record(tmp_path / 'ke ä ☃', record)
    words = ['-m', 'hunt_ros.cli.main', 'info', bag]
    ended = python(*words, code=1, PYTHONIOENCODING='ascii')
    assert 'Traceback' not in ended.stderr
    assert 'ke ? ?' in ended.stdout


def test_a_closed_pipe_is_no_failure(tmp_path: Path) -> None:
    series = {name: Series(STAMPS, np.full(500, 1e-3)) for name in ('lateral', 'speed')}
    bag = write_record(tmp_path / 'run', Record(series))
    words = [sys.executable, '-u', '-m', 'hunt_ros.cli.main', 'export', bag, tmp_path / 'run.csv']
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.close()
        assert child.wait(60) == 0


@pytest.mark.parametrize('spare', [0.02, 0.5, 0.99, 0.999])
@pytest.mark.parametrize('verb', ['import', 'info', 'export', 'simulate'])
def test_a_disk_that_is_full_costs_one_line_and_leaves_nothing(
    tmp_path: Path, capsys, verb: str, spare: float
) -> None:
    """No file may become larger than this share of what it would be, as on a full disk."""
    bag, out = tmp_path / 'bag', tmp_path / 'out'
    rng = np.random.default_rng(1)
    write_record(bag, Record({'lateral': Series(STAMPS, 1e-3 * rng.standard_normal(500))}))
    words = {
        'import': ['import', str(bag), str(out / 'a')],
        'info': ['info', str(bag), '--repair', str(out / 'a')],
        'export': ['export', str(bag), str(out / 'a.csv')],
        'simulate': ['simulate', str(out / 'a'), '--duration', '2'],
    }[verb]
    out.mkdir()
    assert main(words) == 0
    largest = max(path.stat().st_size for path in out.rglob('*') if path.is_file())
    shutil.rmtree(out)
    out.mkdir()
    capsys.readouterr()
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(spare * largest), usual[1]))
    try:
        assert main(words) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    (line,) = capsys.readouterr().err.splitlines()
    assert 'File too large' in line
    assert not list(out.iterdir()), 'nothing half-written'
