"""A sensor at the end of its range, or standing still, is told from a motion that turns round."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made import changed, record_of
from records_made import sweep

from hunt_ros.errors import IdentificationError
from hunt_ros.identification import identify
from hunt_ros.identification.record.stops import end_of_range, measuring
from hunt_ros.samples import Record, Series

RATE = 200.0


def motion(seed, seconds=60.0, hz=2.8, size=6e-4, roughness=3e-5, noise=5e-6):
    """Quiet, then a limit cycle; with a roughness line and noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    amplitude = size / (1.0 + np.exp(-(t - 0.4 * seconds))) + 1e-5
    hunting = amplitude * np.cos(2.0 * np.pi * hz * t + rng.uniform(0.0, 6.0))
    line = roughness * np.cos(2.0 * np.pi * 2.43 * hz * t)
    return hunting + line + noise * rng.standard_normal(t.size)


def record(lateral, **others):
    return record_of(np.arange(lateral.size) / RATE, 'one', lateral=lateral, **others)


def quantised(values, step):
    return values if step == 0.0 else np.round(values / step) * step


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    hz=st.floats(0.7, 8.0),
    size=st.floats(5e-5, 2e-3),
    roughness=st.floats(0.0, 2e-4),
    noise=st.sampled_from([0.0, 1e-6, 2e-5]),
    step=st.sampled_from([0.0, 1e-6, 5e-6]),
)
def test_whole_motion_is_never_called_saturated(seed, hz, size, roughness, noise, step):
    values = quantised(motion(seed, 60.0, hz, size, roughness, noise), step)
    for sign in (1.0, -1.0):
        assert not end_of_range(sign * values).any()


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    hz=st.floats(0.7, 6.0),
    size=st.floats(5e-4, 2e-3),
    depth=st.floats(0.15, 0.6),
    step=st.sampled_from([0.0, 1e-6, 5e-6]),
    sides=st.sampled_from(['above', 'below', 'both']),
)
def test_flat_tops_are_taken_out_on_either_side_and_nothing_else(
    seed, hz, size, depth, step, sides
):
    whole = motion(seed, 60.0, hz, size)
    end = (1.0 - depth) * size
    low, high = (-np.inf if sides == 'above' else -end), (np.inf if sides == 'below' else end)
    clipped = quantised(np.clip(whole, low, high), step)
    warnings: list[str] = []
    left = measuring(record(clipped), warnings)['lateral'].values
    outside = (whole < low - step) | (whole > high + step)
    assert np.isnan(left[outside]).all()
    assert 'saturated' in warnings[0]
    # Well before the first flat top nothing is touched.
    first = int(np.argmax(outside)) - int(12.0 * RATE / hz)
    assert np.isfinite(left[: max(first, 0)]).all()


def test_noise_behind_the_end_of_the_range_does_not_hide_it():
    rng = np.random.default_rng(3)
    whole = motion(3)
    clipped = np.clip(whole, -3.5e-4, 3.5e-4) + 1e-6 * rng.standard_normal(whole.size)
    warnings: list[str] = []
    left = measuring(record(clipped), warnings)['lateral'].values
    assert np.isnan(left[np.abs(whole) > 3.5e-4]).mean() > 0.95
    assert len(warnings) == 1


def test_spikes_and_a_quiet_offset_are_no_end_of_the_range():
    rng = np.random.default_rng(4)
    spiked = motion(4)
    hit = rng.random(spiked.size) < 0.01
    spiked[hit] += rng.choice([-3e-3, 3e-3], int(hit.sum()))
    resting = motion(5)
    resting[:2000] = 9e-4 + 2e-6 * rng.standard_normal(2000)
    for values in (spiked, resting):
        for sign in (1.0, -1.0):
            assert not end_of_range(sign * values).any()


def test_a_stuck_sensor_is_taken_out_for_as_long_as_it_is_stuck():
    stuck = motion(6)
    stuck[3000:5000] = stuck[3000]
    yaw = 5.0 * motion(6)
    warnings: list[str] = []
    left = measuring(record(stuck, yaw=yaw), warnings)
    assert np.flatnonzero(np.isnan(left['lateral'].values)).tolist() == list(range(3000, 5000))
    assert np.isfinite(left['yaw'].values).all()
    assert 'lateral is stuck' in warnings[0]


def test_a_held_reading_is_no_stuck_sensor():
    # A slow sensor behind a fast recorder repeats each of its readings.
    held = np.repeat(motion(7)[::20], 20)
    warnings: list[str] = []
    measuring(record(held), warnings)
    assert not warnings


def test_motion_that_dies_out_below_the_resolution_is_measured_all_the_same():
    t = np.arange(12_000) / RATE
    dying = np.round(2e-4 * np.exp(-0.2 * t) * np.cos(17.6 * t) / 1e-6) * 1e-6
    warnings: list[str] = []
    measuring(record(dying), warnings)
    assert not warnings


def test_drop_outs_stay_where_they_are():
    values = np.clip(motion(8), -3e-4, 3e-4)
    values[100:120] = np.nan
    left = measuring(record(values), [])['lateral'].values
    assert np.isnan(left[100:120]).all()
    assert np.isfinite(left[:100]).all()


def test_a_record_of_nothing_but_stops_is_refused_by_name():
    whole = np.cos(5.0 * np.pi * np.arange(12_000) / RATE)
    values = np.clip(whole + 1e-3 * np.random.default_rng(9).standard_normal(12_000), -0.1, 0.1)
    with pytest.raises(IdentificationError, match=r'saturated.*nothing of it is left'):
        measuring(record(values), [])


@pytest.mark.parametrize('sides', [(-4.5e-4, 4.5e-4), (-np.inf, 4.5e-4)])
def test_what_is_said_of_a_clipped_recording_is_true_or_not_said(sides):
    held = []
    for seed in range(3):
        loop = sweep(seed)
        whole = identify(loop)
        result = identify([changed(loop, lateral=lambda y: np.clip(y, *sides))])
        assert any('saturated' in line for line in result.warnings)
        for name in ('v_c', 'v_n'):
            said, known = getattr(result, name), getattr(whole, name)
            assert said is None or (said.low <= known.high and known.low <= said.high)
        # The end of the sensor's range is no limit cycle: that is foretold from the growth below
        # it, as badly as its interval says, or not at all.
        assert not any(state.amplitude > 4e-4 for state in result.steady_states)
        truth = {p.speed: p.stable for p in whole.branches if p.stable}
        foretold = [p for p in result.branches if p.stable and p.speed > 7.0]
        ends = {
            end: np.interp(
                [p.speed for p in foretold], list(truth), [getattr(s, end) for s in truth.values()]
            )
            for end in ('low', 'high')
        }
        held.append(
            all(
                point.stable.low <= high and low <= point.stable.high
                for point, low, high in zip(foretold, ends['low'], ends['high'], strict=True)
            )
        )
        assert not foretold or any('is a forecast: no amplitude' in w for w in result.warnings)
        assert not any('is a forecast: no amplitude' in line for line in whole.warnings)
    assert sum(held) >= 2


@pytest.mark.parametrize('step', [0.0, 2e-6])
def test_spikes_are_left_out_and_a_kick_and_gaps_are_not(step):
    rng = np.random.default_rng(4)
    lateral = motion(4)
    kicked = np.arange(lateral.size) / RATE - 12.0
    lateral += np.where(kicked > 0.0, 1e-3 * np.exp(-kicked) * np.sin(17.6 * kicked), 0.0)
    lateral = quantised(lateral, step)
    said = []
    kept = np.ones(lateral.size, dtype=bool)
    kept[rng.integers(0, lateral.size, 200)] = False  # samples that never came
    whole = record(lateral)['lateral']
    gaps = Record({'lateral': Series(whole.stamps_ns[kept], whole.values[kept])}, 'one')
    assert measuring(gaps, said)['lateral'] is gaps['lateral']
    places = 100 + 300 * np.arange(30)
    spiky = lateral.copy()
    spiky[places] += rng.choice([-1.0, 1.0], 30) * rng.uniform(2e-3, 1e-2, 30)
    cleaned = measuring(record(spiky), said)['lateral'].values
    assert said == ['one: lateral has 30 spikes of one sample: left out']
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(cleaned)), places)
