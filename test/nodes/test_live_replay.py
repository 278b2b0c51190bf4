"""Two replays beside each other, and one whose process was stopped."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from hunt_ros.bag import write_record
from hunt_ros.nodes.support.conversions import to_ns
from hunt_ros.samples import Record, Series

pytestmark = pytest.mark.ros


def _bag(folder: Path, seconds: float) -> Path:
    stamps = 1_700_000_000_000_000_000 + 5_000_000 * np.arange(round(200 * seconds))
    series = {name: Series(stamps, 1e-9 * np.arange(stamps.size)) for name in ('lateral', 'speed')}
    return write_record(folder / 'bag', Record(series))


def test_a_replay_refuses_another_and_a_stopped_one_goes_on_where_it_was(graph) -> None:
    bag = _bag(graph.folder, 600.0)
    lateral = graph.collect(JointState, 'lateral')
    first = graph.start('live_replay', bag=bag)
    graph.spin_until(lambda: lateral)
    graph.start('live_replay', bag=bag)
    assert graph.wait('live_replay') == 2
    assert first.poll() is None, 'the one that plays goes on'

    stopped_s = 8.0
    first.send_signal(signal.SIGSTOP)
    graph.spin(stopped_s)
    heard, begin = len(lateral), time.monotonic()
    first.send_signal(signal.SIGCONT)
    graph.spin_until(lambda: len(lateral) > heard + 700)
    stamps = [to_ns(message.header.stamp) for message in lateral]
    assert stamps == sorted(stamps)
    # A busy machine holds it up a little, and that is made up for: the stop is not.
    played_s = (stamps[-1] - stamps[heard - 1]) / 1e9
    assert played_s < time.monotonic() - begin + 0.6 * stopped_s
    first.kill()
    first.wait()
