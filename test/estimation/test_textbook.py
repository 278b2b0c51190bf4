"""The tracker beside filterpy's filter, as `hunt check` compares them."""

from __future__ import annotations

import numpy as np
import pytest
from made import record_of
from signals_made import hunting_signal

from hunt_ros.estimation.textbook import compared_amplitudes
from hunt_ros.samples import Record, Series


def read(signal) -> Record:
    return record_of(1e-9 * signal.stamps, lateral=signal.lateral, roller=signal.angle)


@pytest.mark.parametrize('frequency', [2.3, 2.84, 3.4])
def test_both_see_a_limit_cycle_beside_a_line_as_large(frequency) -> None:
    signal = hunting_signal(0, duration=20.0, rate=200.0, frequency=frequency, roughness=2e-4)
    assert compared_amplitudes(read(signal), 2.84) == pytest.approx((2e-4, 2e-4), rel=0.03)


def test_a_long_silence_is_no_minute_to_look_at() -> None:
    signal = hunting_signal(0, duration=20.0, rate=200.0, roughness=2e-4)
    whole = read(signal)
    later = {name: Series(one.stamps_ns + 10**18, 0.5 * one.values) for name, one in whole.items()}
    both = {
        name: Series(
            np.append(one.stamps_ns, later[name].stamps_ns),
            np.append(one.values, later[name].values),
        )
        for name, one in whole.items()
    }
    assert compared_amplitudes(Record(both), 2.84) == compared_amplitudes(whole, 2.84)


def test_where_nothing_is_steady_there_is_nothing_to_compare() -> None:
    quiet = read(hunting_signal(0, duration=20.0, rate=200.0, amplitude=0.0))
    growing = read(hunting_signal(0, duration=20.0, rate=200.0, growth=0.3))
    empty = Record({'yaw': Series(np.zeros(0), np.zeros(0))})
    assert [compared_amplitudes(one, 2.84) for one in (quiet, growing, empty)] == [None] * 3
