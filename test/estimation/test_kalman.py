"""The hunting tracker on signals whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from signals_made import hunting_signal

from hunt_ros.errors import HuntError
from hunt_ros.estimation.kalman import HuntingTracker
from hunt_ros.estimation.tracker_config import Shaft, TrackerConfig

BOTH, LATERAL = (0, 1), (0,)


def relative_error(rows, phasor):
    return rows['lateral_amplitude'] / np.abs(phasor) - 1.0


@pytest.mark.parametrize('sensors', [BOTH, LATERAL])
@pytest.mark.parametrize('frequency', [2.27, 2.84, 3.41])
def test_steady_amplitude_is_unbiased_with_the_frequency_20_percent_off(frequency, sensors):
    means = []
    for seed in range(4):
        signal = hunting_signal(seed, frequency=frequency)
        rows, phasor = signal.track(HuntingTracker(), sensors)
        late = relative_error(rows, phasor)[400:]
        assert np.abs(late).max() < 0.035
        means.append(late.mean())
        assert abs(rows['frequency_hz'][-1] - frequency) < 0.05
    assert abs(np.mean(means)) < 0.004


@pytest.mark.parametrize('ratio', [4.6 * np.exp(2.6j), 0.7j, -300.0 + 40.0j])
def test_the_shape_of_the_mode_is_learnt_on_any_rig(ratio):
    scale = abs(ratio) / 4.6
    signal = hunting_signal(2, ratio=ratio)
    signal.yaw = (ratio * signal.phasor).real + 1e-4 * scale * np.random.default_rng(0).normal(
        size=signal.yaw.size
    )
    rows, _ = signal.track(HuntingTracker())
    learnt = rows['yaw_ratio'][-1] * np.exp(1j * rows['yaw_lag'][-1])
    assert abs(learnt - ratio) < 4.0 * rows['yaw_ratio_std'][-1]
    assert abs(learnt - ratio) < 0.05 * abs(ratio)


def test_units_do_not_matter():
    signal = hunting_signal(3, kick_at=5.0, kick=2e-4, second=2e-4)
    rows, _ = signal.track(HuntingTracker())
    signal.lateral = signal.lateral * 2.0**13  # e.g. volts; a power of two is exact
    signal.yaw = signal.yaw * 2.0**-6
    scaled, _ = signal.track(HuntingTracker())
    for name in ('lateral_amplitude', 'lateral_amplitude_std', 'lateral_roughness'):
        np.testing.assert_allclose(scaled[name], rows[name] * 2.0**13, rtol=1e-6)
    np.testing.assert_allclose(scaled['growth_rate'], rows['growth_rate'], atol=1e-6)


@pytest.mark.parametrize(
    ('sensors', 'noise', 'window'),
    [(BOTH, 5e-6, 0.24), (LATERAL, 5e-6, 0.285), (BOTH, 2e-5, 0.33), (LATERAL, 2e-5, 0.375)],
)
def test_soon_after_a_kick_the_amplitude_is_known_to_5_percent(sensors, noise, window):
    errors = []
    for seed in range(12):
        signal = hunting_signal(
            seed, duration=8.0, amplitude=2e-5, kick_at=7.0037, kick=2e-4, second=2e-4, noise=noise
        )
        rows, phasor = signal.track(HuntingTracker(), sensors)
        after = rows['stamp_ns'] * 1e-9 > 7.0037 + window
        errors.append(relative_error(rows, phasor)[after])
    # Root mean square over kicks, at every time from the window on.
    assert np.sqrt(np.mean(np.square(errors), axis=0)).max() < 0.05


@pytest.mark.parametrize('forcing', [0.0, 2e-11])
def test_standard_deviations_are_honest(forcing):
    amplitude, growth, frequency = [], [], []
    for seed in range(16):
        signal = hunting_signal(
            seed,
            duration=10.0,
            amplitude=3e-5,
            kick_at=7.0,
            kick=2e-4,
            second=2e-4,
            noise=5e-6,
            forcing=forcing,
        )
        rows, phasor = signal.track(HuntingTracker())
        at = [690, 710, 715, 720, 730, 750, 800, 900]
        error = rows['lateral_amplitude'] - np.abs(phasor)
        amplitude.append((error / rows['lateral_amplitude_std'])[at])
        growth.append((rows['growth_rate'] / rows['growth_rate_std'])[at])
        frequency.append(((rows['frequency_hz'] - 2.84) / rows['frequency_hz_std'])[at])
    for name, z in (('amplitude', amplitude), ('growth', growth), ('frequency', frequency)):
        pooled = np.sqrt(np.mean(np.square(z)))
        # On the safe side: the second mode is the one that is guessed, which the tracker doubts.
        assert 0.25 < pooled < 1.4, name
        assert np.mean(np.abs(z) > 3.0) < 0.05, name


def test_a_roughness_line_leaves_no_trace_in_the_amplitude():
    signal = hunting_signal(0, amplitude=0.0, roughness=1.22e-4, noise=5e-6)
    rows, _ = signal.track(HuntingTracker())
    late = rows[400:]
    assert np.sqrt(np.mean(late['lateral_amplitude'] ** 2)) < 1e-6
    np.testing.assert_allclose(late['lateral_roughness'], 1.22e-4, rtol=0.02)
    np.testing.assert_allclose(late['yaw_roughness'], 3.66e-4, rtol=0.05)
    assert np.std(late['lateral_clean']) < 5e-6


def test_a_quickly_decaying_mode_is_not_taken_for_hunting():
    for seed in range(6):
        signal = hunting_signal(
            seed, duration=6.0, amplitude=1e-5, kick_at=5.0, second=3e-4, noise=5e-6
        )
        rows, phasor = signal.track(HuntingTracker())
        settled = rows['stamp_ns'] > 5.3e9
        error = rows['lateral_amplitude'] - np.abs(phasor)
        # 6 % of it is left by then, and the filter says how much it may have taken.
        assert np.abs(error[settled]).max() < 1.2e-5
        assert (np.abs(error) < 5.0 * rows['lateral_amplitude_std'])[settled].all()


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 1000), lost=st.floats(0.0, 0.3), low=st.floats(100.0, 2000.0))
def test_missing_samples_irregular_stamps_and_a_change_of_rate_cost_little(seed, lost, low):
    rng = np.random.default_rng(seed)
    steps = np.concatenate(
        [
            np.full(3000, 1_000_000),  # 1 kHz
            np.full(int(3 * low), int(1e9 / low)),  # any rate
            rng.integers(100_000, 4_000_000, 1500),  # irregular
        ]
    )
    signal = hunting_signal(seed, stamps=np.cumsum(steps).astype(np.int64), noise=1e-5)
    signal.lateral[rng.random(signal.lateral.size) < lost] = np.nan
    signal.yaw[rng.random(signal.yaw.size) < lost] = np.nan
    rows, phasor = signal.track(HuntingTracker())
    error = relative_error(rows, phasor)[300:]
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert np.abs(error).max() < 0.06


def test_a_sensor_may_die_and_come_back():
    signal = hunting_signal(4, duration=12.0, noise=5e-6)
    dead = slice(4000, 8000)
    signal.lateral[dead] = np.nan
    rows, phasor = signal.track(HuntingTracker())
    error = np.abs(relative_error(rows, phasor))
    assert error[350:395].max() < 0.03
    assert error[400:1200].max() < 0.08  # the yaw sensor carries it
    assert error[850:].max() < 0.03


def test_a_stuck_sensor_is_not_measuring():
    signal = hunting_signal(6, noise=5e-6)
    signal.lateral[5000:] = signal.lateral[5000]
    rows, phasor = signal.track(HuntingTracker())
    assert np.abs(relative_error(rows, phasor)[-200:]).max() < 0.1


def test_a_stuck_or_absent_sensor_alone_gives_nothing():
    stamps = np.arange(1, 4001) * 1_000_000
    for values in (np.full(4000, 3e-3), np.full(4000, np.nan)):
        rows = HuntingTracker().update(
            stamps,
            np.zeros(4000, np.int8),
            values,
            np.full(4000, np.nan),
            np.full(4000, np.nan),
            stamps[9::10],
        )
        for name in rows.dtype.names[1:]:
            assert np.isnan(rows[name]).all(), name


@pytest.mark.parametrize('growth', [0.5, -0.3, 0.2])
def test_sign_of_growth_is_known_near_the_bound_when_the_speed_changes(growth):
    times = []
    for seed in range(9):
        signal = hunting_signal(seed, duration=9.0, kick_at=7.0, growth=growth)
        signal.speed[signal.stamps > 7_000_000_000] *= 1.15
        rows, _ = signal.track(HuntingTracker(), LATERAL)
        sure = np.abs(rows['growth_rate']) > 3.0 * rows['growth_rate_std']
        right = sure & (np.sign(rows['growth_rate']) == np.sign(growth))
        after = rows['stamp_ns'] > 7_000_000_000
        assert not np.any(sure & ~right & after)
        times.append(rows['stamp_ns'][right & after][0] * 1e-9 - 7.0)
    # Where sqrt(24 noise^2 dt / A^2 T^3), its Cramer-Rao bound, is a third of it (Kay, 1993).
    bound = (24.0 * (3.0 * 2e-5 / 2e-4 / growth) ** 2 * 1e-3) ** (1.0 / 3.0)
    assert np.median(times) < 1.5 * bound + 0.01


def test_rate_of_the_amplitude_is_growth_times_amplitude():
    rows, phasor = hunting_signal(0, growth=0.25, noise=5e-6).track(HuntingTracker())
    late = rows[500:]
    truth = 0.25 * np.abs(phasor)[500:]
    np.testing.assert_allclose(late['lateral_amplitude_rate'], truth, rtol=0.25)


@pytest.mark.parametrize(
    ('block', 'message'),
    [
        (([1], [2], [1.0], [0.0], [1.0], []), 'sensors 0 to 1'),
        (([1], [0], [1.0], [0.0], [1.0], [5, 5]), 'must increase'),
    ],
)
def test_a_block_that_makes_no_sense_is_refused_and_nothing_is_taken_in(block, message):
    tracker, fresh = HuntingTracker(), HuntingTracker()
    with pytest.raises(HuntError, match=message):
        tracker.update(*block)
    (rows, _), (expected, _) = (hunting_signal(0, 2.0).track(one) for one in (tracker, fresh))
    assert rows.tobytes() == expected.tobytes()


@pytest.mark.parametrize('size', [1e-3, 1.0, 1e30])
def test_a_burst_of_nonsense_is_got_over_and_the_other_sensor_goes_on(size):
    signal = hunting_signal(9, duration=15.0, noise=5e-6)
    burst = slice(6000, 7000)
    signal.lateral[burst] += size * np.random.default_rng(0).normal(size=1000)
    rows, phasor = signal.track(HuntingTracker())
    assert np.abs(relative_error(rows, phasor)[1250:]).max() < 0.05
    yaw = np.abs(rows['yaw_amplitude'] / np.abs(signal.ratio * phasor) - 1.0)
    if size >= 1.0:  # no motion: the sensor was started anew
        assert yaw[400:].max() < 0.05


def test_speed_and_angle_that_are_no_numbers_do_no_harm():
    signal = hunting_signal(10, duration=12.0, noise=5e-6, roughness=1e-5)
    for at, value in ((5000, np.nan), (5500, np.inf), (6000, 0.0), (6500, -7.0), (7000, 1e300)):
        signal.speed[at : at + 500] = value
    signal.angle[8000:9000] = np.nan
    rows, phasor = signal.track(HuntingTracker())
    error = np.abs(relative_error(rows, phasor))
    assert error[400:795].max() < 0.06
    assert error[800:900].max() < 0.25  # the line is there, and no angle to know it by
    assert error[1100:].max() < 0.03


# --- a second mode that is not the one guessed -----------------------------------------------

#: Eigenvalues of a second mode that is guessed to have 3.3 Hz and a decay of 9.4 1/s.
TRUE = [complex(-decay, 2.0 * np.pi * hz) for hz, decay in [(3.3, 5.0), (2.2, 9.4), (4.5, 12.0)]]
KICK_S = 4.0


def scores(sensors, since):
    """Error over std of the amplitude at times since a kick, over modes and seeds; clipped."""
    found = []
    for pole in TRUE:
        for seed in range(8):
            signal = hunting_signal(
                seed,
                5.5,
                500.0,
                amplitude=2e-5,
                kick_at=KICK_S,
                kick=2e-4,
                second=2e-4,
                second_pole=pole,
                noise=5e-6,
            )
            rows, phasor = signal.track(HuntingTracker(), sensors)
            at = np.round((KICK_S + np.array(since)) * 100).astype(int) - 1
            error = rows['lateral_amplitude'][at] - np.abs(phasor[at])
            found.append(np.clip(error / rows['lateral_amplitude_std'][at], -5.0, 5.0))
    return np.sqrt(np.mean(np.square(found), axis=0))


@pytest.mark.parametrize(('sensors', 'most'), [((0,), 3.0), ((0, 1), 2.0)], ids=['y', 'both'])
def test_the_amplitude_after_a_kick_is_as_sure_as_it_says(sensors, most):
    """Of 40 seeds each it is 2.1 with one sensor, at 0.15 s, and 1.0 with both."""
    since = (0.15, 0.2, 0.3, 0.4)
    assert scores(sensors, since).max() < most


def test_the_doubt_dies_with_the_second_mode():
    signal = hunting_signal(0, 7.0, 500.0, amplitude=2e-4, kick_at=KICK_S, kick=1e-4, noise=5e-6)
    rows, _ = signal.track(HuntingTracker())
    std = rows['lateral_amplitude_std']
    assert std[419] > 1.5 * std[389]
    assert std[-1] < 1.2 * std[389]


# --- known lines of any orders, and an angle that is known only by a speed ---------------------

NOISE, LINE = 5e-6, 2e-4


def _track(
    tracker, orders, scale=1.0, seconds=30.0, rate=200.0, hunting=0.0, seed=0, unknown_s=0.0
):
    """Run a tracker over lines of `orders` at 6.4 Hz, the angle told wrong by `scale`."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    angle = 40.0 * time
    value = hunting * np.cos(2.0 * np.pi * 2.84 * time) + NOISE * rng.standard_normal(time.size)
    for order in orders:
        value += LINE * np.cos(order * angle + order)
    stamps = 1 + np.round(time * 1e9).astype(np.int64)
    sensor = np.zeros(time.size, dtype=np.int8)
    output = np.arange(10_000_000, int(stamps[-1]), 10_000_000)
    speed = np.full(time.size, 6.0)
    told = np.where(time < unknown_s, np.nan, scale * angle)
    return tracker.update(stamps, sensor, value, told, speed, output)


@pytest.mark.parametrize('scale', [1.0, 1.005, 0.993])
@pytest.mark.parametrize('hunting', [0.0, 3e-4])
def test_the_phase_of_a_line_is_tracked_where_only_the_speed_is_known(scale, hunting) -> None:
    tracker = HuntingTracker(TrackerConfig(shafts=(Shaft((1.0, 2.0), 0.01),)))
    rows = _track(tracker, (1.0, 2.0), scale, hunting=hunting)[500:]
    assert abs(rows['lateral_amplitude'] - hunting).max() < 4.0 * NOISE
    np.testing.assert_allclose(rows['lateral_roughness'], LINE, rtol=0.1)


def test_a_third_line_is_an_entry_of_the_list() -> None:
    orders = (1.0, 1.7, 4.42)
    known = HuntingTracker(TrackerConfig(shafts=(Shaft(orders),)))
    assert _track(known, orders)['lateral_amplitude'][500:].max() < 4.0 * NOISE
    partly = HuntingTracker(TrackerConfig(shafts=(Shaft(orders[:1]),)))
    assert _track(partly, orders)['lateral_amplitude'][500:].max() > 8.0 * NOISE


@pytest.mark.parametrize('hunting', [0.0, 3e-4])
def test_a_line_that_was_followed_before_its_angle_was_known_leaves_no_frequency(hunting) -> None:
    for seed in range(4):
        tracker = HuntingTracker(TrackerConfig(shafts=(Shaft((1.0, 2.0)),)))
        rows = _track(tracker, (1.0, 2.0), hunting=hunting, seed=seed, unknown_s=4.0)[600:]
        assert abs(rows['frequency_hz'] - 2.84).max() < 0.7
        assert abs(rows['lateral_amplitude'] - hunting).max() < 4.0 * NOISE


@pytest.mark.parametrize('line_hz', [2.7, 2.84, 3.0])
def test_a_line_that_ceases_leaves_no_hunting_that_cancels_it(line_hz) -> None:
    rows = _beside(line_hz, lambda t: np.where(t < 30.0, LINE, 0.0), lambda t: 0.0 * t)
    assert rows['lateral_amplitude'][3500:].max() < 0.1 * LINE
    assert rows['lateral_roughness'][3500:].max() < 0.1 * LINE


@pytest.mark.parametrize('line_hz', [2.7, 3.0])
def test_hunting_that_beats_with_a_line_is_not_given_to_it(line_hz) -> None:
    rows = _beside(line_hz, lambda t: 0.0 * t + LINE, lambda t: 0.0 * t + 1.5 * LINE)[2000:]
    np.testing.assert_allclose(rows['lateral_amplitude'], 1.5 * LINE, rtol=0.15)


def test_a_line_that_nobody_knows_does_not_hold_the_frequency_when_hunting_begins() -> None:
    # At 3.9 to 5.5 Hz it is all that there is to follow, until the hunting grows.
    def grows(t: np.ndarray) -> np.ndarray:
        return LINE * np.minimum(5e-3 * np.exp(0.3 * np.maximum(t - 50.0, 0.0)), 1.0)

    rows = _beside(
        4.0 + np.minimum(np.arange(2450) / 35.0, 50.0) * 0.03,
        lambda t: 0.0 * t + 0.03 * LINE,
        grows,
        rate=35.0,
        noise=0.005 * LINE,
        known=False,
    )
    truth = grows(np.array([60.0, 63.0, 66.0, 69.0]))
    np.testing.assert_allclose(
        rows['lateral_amplitude'][[6000, 6300, 6600, 6900]], truth, rtol=0.2
    )


def _beside(line_hz, line, hunting, rate=200.0, noise=0.02 * LINE, known=True) -> np.ndarray:
    """Run a tracker over a line and hunting at 2.84 Hz of amplitudes that go with time, s."""
    time = np.arange(round(70.0 * rate)) / rate
    angle = np.cumsum(2.0 * np.pi * np.broadcast_to(line_hz, time.size)) / rate
    value = line(time) * np.cos(angle) + hunting(time) * np.cos(2.0 * np.pi * 2.84 * time)
    value += noise * np.random.default_rng(0).standard_normal(time.size)
    tracker = HuntingTracker(TrackerConfig(shafts=(Shaft((1.0,)),) if known else ()))
    stamps = 1 + np.round(time * 1e9).astype(np.int64)
    output = np.arange(10_000_000, int(stamps[-1]), 10_000_000)
    told = angle if known else np.nan
    return tracker.update(stamps, np.zeros(time.size, np.int8), value, told, 6.0, output)
