"""What is kept of a recording: the same result, and only what is new is read."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.bag import read_record, write_record
from hunt_ros.cli.main import main
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile.speed_profile import SpeedProfile
from hunt_ros.dynamics.simulation import SimulationSettings, simulate
from hunt_ros.errors import HuntError
from hunt_ros.identification import IdentificationSettings, identify
from hunt_ros.identification.work.kept import Kept
from hunt_ros.identification.work.places import Here
from hunt_ros.samples import Record


def reading(log: Path, bag: Path) -> Record:
    """Read a recording, and note that it was read."""
    with log.open('a') as file:
        file.write(f'{bag.name}\n')
    return read_record(bag)


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Three short staircases of the simulated rig."""
    folder = tmp_path_factory.mktemp('bags')
    up = np.arange(6.0, 8.9, 0.4)
    profile = SpeedProfile.staircase(*up, *up[-2::-1], hold_s=12.0)
    settings = SimulationSettings(sample_rate_hz=100.0, broadband=2e-5)
    return [
        write_record(folder / f'run{seed}', simulate(paper_rig(), settings, profile, seed=seed))
        for seed in range(3)
    ]


@pytest.fixture
def read(tmp_path):
    """Names of the recordings that have been read since it was asked for last."""
    log = tmp_path / 'read'

    def since() -> list[str]:
        names = log.read_text().split() if log.exists() else []
        log.unlink(missing_ok=True)
        return names

    since.log = log
    return since


def test_a_further_recording_is_the_only_one_that_is_read(bags, read, tmp_path):
    sources = [partial(reading, read.log, bag) for bag in bags]
    settings = IdentificationSettings(work_folder=str(tmp_path / 'kept'))
    identify(sources[:2], settings)
    assert sorted(read()) == ['run0', 'run1']
    found = identify([sources[2], *sources[:2]], settings)  # wherever it stands among them
    assert read() == ['run2']
    plain = identify([read_record(bags[k]) for k in (2, 0, 1)])
    assert found.to_json() == plain.to_json()
    # What only the fit takes changes nothing of it.
    identify(
        sources,
        IdentificationSettings(work_folder=settings.work_folder, prior_v_c=(8.0, 0.1), seed=3),
    )
    assert not read()


def test_what_has_changed_is_read_again(bags, read, tmp_path):
    sources = [partial(reading, read.log, bag) for bag in bags[:2]]
    settings = IdentificationSettings(work_folder=str(tmp_path / 'kept'))
    first = identify(sources, settings).to_json()
    read()
    (file,) = bags[0].glob('*.mcap')
    os.utime(file, ns=(0, 0))
    assert identify(sources, settings).to_json() == first
    assert read() == ['run0']
    # Other settings are other work, and a damaged file is none.
    identify(
        sources, IdentificationSettings(work_folder=settings.work_folder, minimum_hold_s=10.0)
    )
    assert sorted(read()) == ['run0', 'run1']
    for kept in Path(settings.work_folder).iterdir():
        kept.write_bytes(kept.read_bytes()[:-20])
    assert identify(sources, settings).to_json() == first
    assert sorted(read()) == ['run0', 'run1']


def test_samples_that_somebody_holds_are_not_kept(bags, tmp_path):
    records = [read_record(bag) for bag in bags[:2]]
    folder = tmp_path / 'kept'
    found = identify(records, IdentificationSettings(work_folder=str(folder)))
    assert found.to_json() == identify(records).to_json()
    assert not list(folder.iterdir())


def test_what_nobody_can_tell_from_another_is_not_kept(bags, tmp_path):
    class Reader:
        def __init__(self, path: Path) -> None:
            self.path = path

        def read(self) -> Record:
            return read_record(self.path)

    def kept(source) -> bool:
        workers = Kept(Here(), tmp_path)
        return bool(workers.map(identify, [source])[0].key)

    assert not kept(lambda: read_record(bags[0]))
    assert not kept(Reader(bags[0]).read)
    assert not kept(partial(read_record, tmp_path / 'nowhere'))
    assert not kept(partial(read_record, 300 * 'x'))
    assert kept(partial(read_record, bags[0]))
    keys = {Kept(Here(), tmp_path).map(identify, [partial(read_record, b)])[0].key for b in bags}
    assert len(keys) == len(bags)


def test_a_folder_that_goes_away_or_that_others_may_write(bags, tmp_path):
    folder = tmp_path / 'kept'
    workers = Kept(Here(), folder)
    handles = workers.map(np.square, [2.0])
    folder.rmdir()
    assert workers.collect(handles) == [4.0]
    assert workers.collect([], lambda part: None) == []
    folder.mkdir()
    folder.chmod(0o777)
    with pytest.raises(HuntError, match='is not yours alone'):
        Kept(Here(), folder)


def test_the_verb_gives_the_same_and_says_where_nothing_can_be_kept(bags, tmp_path, capsys):
    words = ['identify', *map(str, bags)]
    keep = ['--work-folder', str(tmp_path / 'kept')]
    for name, more in (('plain', []), ('first', keep), ('again', keep)):
        assert main([*words, *more, '--json', str(tmp_path / name)]) == 0
    texts = {(tmp_path / name).read_text() for name in ('plain', 'first', 'again')}
    assert len(texts) == 1
    capsys.readouterr()
    assert main([*words, '--work-folder', str(tmp_path / 'plain')]) == 2
    assert 'is no folder that can be written' in capsys.readouterr().err


def test_work_is_done_once_and_told(tmp_path):
    done: list[float] = []

    def told(work):
        told_of: list[float] = []
        workers = Kept(Here(), tmp_path)
        handles = workers.map(np.square, [1.0, 2.0, 3.0])
        sums = workers.map(work, handles, [1.0] * 3)
        assert workers.collect(sums, told_of.append) == [2.0, 5.0, 10.0]
        return told_of

    def add(one: float, other: float) -> float:
        done.append(one)
        return one + other

    first = told(add)
    assert first == sorted(first)
    assert first[-1] == 1.0
    assert told(add)[-1] == 1.0
    assert done == [1.0, 4.0, 9.0]


def test_a_folder_that_is_none_is_refused(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(HuntError, match='file is no folder'):
        Kept(Here(), tmp_path / 'file')
