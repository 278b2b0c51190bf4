"""Clips of a recording: what a window holds, which windows there are, and what may fail."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.bag import Bag, clips, read_record
from hunt_ros.bag.clips import MOST_S, Clip, Clips, clips_of, recording_of
from hunt_ros.bag.inspection import inspect
from hunt_ros.bag.record_writer import serialise
from hunt_ros.bag.recording import Recording, RecordingLimits
from hunt_ros.errors import BagError, HuntError
from hunt_ros.samples import NANOSECONDS, Series
from hunt_ros.sensors import CHANNEL_FIELDS

_START = 1_700_000_000 * NANOSECONDS


def at(seconds: float) -> int:
    return _START + round(seconds * NANOSECONDS)


@pytest.fixture
def running(tmp_path: Path):
    """Return a recording of 100 s at 100 Hz that goes on, in files of 20 s."""
    recording = Recording(
        tmp_path / 'run', RecordingLimits(split_s=20.0, least_free_mib=1.0), notes={'rig': 'R'}
    )
    stamps = _START + np.arange(10_000, dtype=np.int64) * (NANOSECONDS // 100)
    sine = np.sin((stamps - _START) * 1e-9)
    keys, rows = [], []
    for name, values in (('lateral', 1e-3 * sine), ('speed', 7.0 + 0.1 * sine)):
        keys.append(recording.topic(f'/rig/{name}', CHANNEL_FIELDS[name][0]))
        rows.append(serialise(name, Series(stamps, values)))
    for stamp, *several in zip(stamps.tolist(), *rows, strict=True):
        for key, row in zip(keys, several, strict=True):
            recording.offer(key, stamp, row.tobytes())
    while recording.state.waiting_bytes:
        pass
    recording.note('parameters', {'/rig/a': 'x: 1'})
    yield recording
    if recording.state.running:
        recording.stop()


def test_a_clip_of_a_simulated_rig_has_the_seconds_since_its_start_in_its_name() -> None:
    clip = Clip(Path('run'), 'hunting', 179_600_000_000, 0, 0)
    assert clip.path.name == 'clip_run_180s_hunting.mcap'
    assert recording_of(clip.path) == 'run'


@pytest.mark.parametrize('goes_on', [True, False])
def test_a_clip_is_a_sound_recording_of_its_window(running: Recording, goes_on: bool) -> None:
    if not goes_on:
        running.stop()
    # What lies on both sides of the beginning of a file.
    path = Clip(running.path, 'hunting', at(50.0), at(35.0), at(65.0)).cut()
    assert path.name.startswith('clip_run_2023')
    assert path.name.endswith('_hunting.mcap')
    assert clips_of(running.path) == [path]
    clip, whole = read_record(path), read_record(running.path)
    for name in whole:
        inside = whole[name].between(at(35.0), at(65.0))
        found = clip[name].between(at(35.0), at(65.0))
        np.testing.assert_array_equal(found.stamps_ns, inside.stamps_ns)
        np.testing.assert_array_equal(found.values, inside.values)
    assert clip.notes['rig'] == 'R'
    assert {problem.kind for problem in inspect(path).problems} <= {'missing_channel'}
    with Bag(path) as bag:
        assert not bag.problems


def test_what_the_disk_refuses_leaves_no_clip_and_a_sound_recording(
    running: Recording, monkeypatch
) -> None:
    path, fsync = running.stop(), os.fsync

    def refuse(number: int) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', refuse)
    with pytest.raises(HuntError, match='No space'):
        Clip(path, 'hunting', at(50.0), at(20.0), at(80.0)).cut()
    monkeypatch.setattr(os, 'fsync', fsync)
    assert [each.name for each in path.parent.iterdir()] == ['run']
    assert len(read_record(path)['lateral']) == 10_000


def test_a_window_of_which_nothing_is_recorded_is_said(running: Recording) -> None:
    with pytest.raises(BagError, match='nothing in it'):
        Clip(running.path, 'hunting', at(500.0), at(470.0), at(530.0)).cut()
    assert not clips_of(running.path)


def test_clips_are_of_their_own_recording_and_none_of_the_folder(running: Recording) -> None:
    path = running.stop()
    second = path.rename(path.with_name('run_1'))  # begun in the second of another one
    own = Clip(second, 'hunting', at(50.0), at(35.0), at(65.0)).cut()
    assert not clips_of(path)
    assert clips_of(second) == [own]
    with pytest.raises(BagError, match='it holds run_1: name them one by one'):
        Bag(path.parent)


def test_what_an_event_calls_its_alarm_names_no_other_folder(running: Recording) -> None:
    path = Clip(running.path, 'alarm_../\0x', at(50.0), at(35.0), at(65.0)).cut()
    assert path.name.endswith('_alarm_____x.mcap')
    assert clips_of(running.path) == [path]


def windows(several: Clips) -> list[tuple[float, float]]:
    due = several.due(at(1e6), None)
    return [((c.first_ns - _START) / 1e9, (c.last_ns - _START) / 1e9) for c in due]


@pytest.mark.parametrize(
    ('alarms_s', 'expected'),
    [
        ([100.0], [(70.0, 130.0)]),
        ([100.0, 110.0, 159.0], [(70.0, 189.0)]),
        ([100.0, 161.0], [(70.0, 130.0), (131.0, 191.0)]),
    ],
)
def test_windows_that_overlap_are_one_clip(alarms_s, expected) -> None:
    several = Clips()
    assert all(several.take(Path('run'), at(second), 'hunting') for second in alarms_s)
    assert windows(several) == expected


@pytest.mark.parametrize('every_s', [5.0, 59.0, 100.0])
def test_alarms_without_end_fill_no_disk(every_s: float) -> None:
    several, taken = Clips(), []
    for second in np.arange(0.0, 3600.0, every_s).tolist():
        taken.append(several.take(Path('run'), at(second), 'hunting'))
    assert taken[0]
    assert not all(taken)
    assert sum(last - first for first, last in windows(several)) <= MOST_S
    for clip in several.due(at(1e6), None):
        clip.tries = 0
    assert several.take(Path('run'), at(8000.0), 'hunting'), 'another hour has its own share'


def test_a_clip_is_due_when_its_end_is_recorded_or_nothing_more_comes() -> None:
    several = Clips()
    several.take(Path('run'), at(100.0), 'hunting')
    assert not several.due(at(130.0), Path('run'))
    assert several.due(at(130.1 + clips._WRITTEN_S), Path('run'))
    assert several.due(at(101.0), Path('another'))


def test_what_falls_silent_as_the_suite_ends_has_no_clip() -> None:
    several = Clips()
    several.take(Path('run'), at(100.0), 'yaw_silent')
    assert not several.due(at(104.0), None)
    several.take(Path('other'), at(200.0), 'yaw_silent')
    assert several.due(at(220.0), None)
