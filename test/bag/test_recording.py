"""A live recording loses nothing it does not count, and blocks nobody."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from bags_made import written
from rosbags.highlevel import AnyReader

from hunt_ros.bag import Bag, read_record
from hunt_ros.bag import recording as room
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.bag.record_writer import serialise
from hunt_ros.bag.recording import Recording, RecordingLimits
from hunt_ros.errors import BagError, ConfigError
from hunt_ros.samples import Series
from hunt_ros.sensors import JOINT_STATE

BEGIN_NS = 10**18
STAMPS = BEGIN_NS + np.arange(20_000) * 1_000_000
MESSAGES = [bytes(row) for row in serialise('lateral', Series(STAMPS, np.arange(20_000.0)))]


def offer_all(recording: Recording, count: int = 20_000) -> int:
    key = recording.topic('/rig/lateral', JOINT_STATE)
    return sum(
        recording.offer(key, at, message)
        for at, message in zip(STAMPS[:count].tolist(), MESSAGES[:count], strict=True)
    )


def test_everything_offered_is_in_the_closed_recording(tmp_path: Path) -> None:
    recording = Recording(tmp_path / 'run', notes={'rig': 'a'})
    assert offer_all(recording) == 20_000
    path = recording.stop()
    record = read_record(path)
    np.testing.assert_array_equal(record['lateral'].values, np.arange(20_000.0))
    assert record.notes == {'rig': 'a'}
    with AnyReader([path]) as reader:  # and rosbags agrees
        assert [c.topic for c in reader.connections] == ['/rig/lateral']
        assert reader.message_count == 20_000
    state = recording.state
    assert (state.messages, state.dropped_count, state.problem) == (20_000, 0, '')
    assert not state.running


def test_a_full_buffer_drops_and_counts_and_never_waits(tmp_path: Path, monkeypatch) -> None:
    gate = threading.Event()
    original = room.BagWriter.write

    def slow(self, *message) -> None:
        gate.wait()
        original(self, *message)

    monkeypatch.setattr(room.BagWriter, 'write', slow)
    recording = Recording(tmp_path / 'run', RecordingLimits(buffer_mib=0.1))
    taken = offer_all(recording)
    state = recording.state
    assert 0 < taken < 20_000
    assert state.waiting_bytes <= 0.1 * 2**20
    assert state.dropped == {'/rig/lateral': 20_000 - taken}
    gate.set()
    values = read_record(recording.stop())['lateral'].values
    np.testing.assert_array_equal(values, np.arange(float(taken)))


def test_split_by_size_and_by_time_keeps_every_message(tmp_path: Path) -> None:
    sized = Recording(tmp_path / 'sized', RecordingLimits(split_mib=0.25))
    offer_all(sized)
    timed = Recording(tmp_path / 'timed', RecordingLimits(split_s=5.0))
    offer_all(timed)
    for recording in (sized, timed):
        path = recording.stop()
        assert len(list(path.glob('*.mcap'))) >= 3
        np.testing.assert_array_equal(read_record(path)['lateral'].values, np.arange(20_000.0))
    with Bag(tmp_path / 'timed') as bag:
        spans = [file.span_ns for file in bag.files if file.span_ns]
        assert all(last - first <= 5_000_000_000 for first, last in spans)


def test_a_disk_that_fills_ends_the_recording_closed_and_says_so(
    tmp_path: Path, monkeypatch, machine
) -> None:
    recording = Recording(tmp_path / 'run')
    offer_all(recording, 100)
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(room.shutil, 'disk_usage', lambda path: usage._replace(free=1000))
    machine.until(lambda: recording.state.problem)
    assert not recording.state.running
    assert 'free on the disk' in recording.state.problem
    key = recording.topic('/rig/lateral', JOINT_STATE)
    assert not recording.offer(key, BEGIN_NS, MESSAGES[0])
    assert recording.state.dropped_count == 1
    assert len(read_record(recording.stop())['lateral']) == 100


def test_what_no_file_can_hold_ends_the_recording_closed_and_says_so(
    tmp_path: Path, machine
) -> None:
    recording = Recording(tmp_path / 'run')
    offer_all(recording, 100)
    recording.offer(recording.topic('/rig/lateral', JOINT_STATE), -5, MESSAGES[0])
    offer_all(recording, 10_000)
    machine.until(lambda: not recording.state.running)
    state = recording.state
    assert state.problem.startswith('error: ')
    assert len(read_record(recording.stop())['lateral']) == state.messages == 100
    assert state.dropped_count == 10_001, 'those that were taken and not written as well'


def test_a_disk_that_refuses_to_write_leaves_whole_chunks(tmp_path: Path) -> None:
    """A real full disk: a file size limit of the system stands in for it."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:  # the limit is for the process, so it has one of its own
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        McapWriter.compress, McapWriter.compression = bytes, ''
        recording = Recording(tmp_path / 'run')
        key = recording.topic('/rig/lateral', JOINT_STATE)
        for at, message in zip(STAMPS.tolist(), MESSAGES, strict=True):
            recording.offer(key, at, message)
            time.sleep(0.0001)
            if recording.state.problem:
                break
        try:
            recording.stop()
        except BagError as error:
            os.write(writer, str(error).encode())
        os._exit(0)
    os.close(writer)
    os.waitpid(child, 0)
    with os.fdopen(reader, 'rb') as pipe:
        assert 'not closed' in pipe.read().decode()
    values = read_record(tmp_path / 'run.active')['lateral'].values
    assert values.size > 500
    np.testing.assert_array_equal(values, np.arange(float(values.size)))


def test_a_disk_without_room_for_the_beginning_is_left_as_it_was(tmp_path: Path) -> None:
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, limit[1]))
    try:
        with pytest.raises(BagError, match='File too large'):
            Recording(tmp_path / 'run')
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert not list(tmp_path.iterdir())


def test_what_was_taken_is_soon_in_the_file_whatever_becomes_of_the_process(
    tmp_path: Path, machine
) -> None:
    recording = Recording(tmp_path / 'run')
    assert offer_all(recording, 100) == 100
    left = tmp_path / 'run.active'
    machine.until(lambda: written(left, '/rig/lateral') == 100)
    np.testing.assert_array_equal(read_record(left)['lateral'].values, np.arange(100.0))
    recording.stop()


def test_limits_and_names_are_checked_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match='chunk_s'):
        RecordingLimits(chunk_s=2.0)
    (tmp_path / 'run').mkdir()
    with pytest.raises(BagError, match='exists already'):
        Recording(tmp_path / 'run')
    free = shutil.disk_usage(tmp_path).free / 2**20
    with pytest.raises(BagError, match='free on the disk'):
        Recording(tmp_path / 'other', RecordingLimits(least_free_mib=min(free * 2, 1e7)))
    assert not (tmp_path / 'other.active').exists()
