"""The second opinion agrees at any rate of the rows, and not with a filter that is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from made import record_of
from numpy.typing import NDArray

from hunt_ros.detection import DetectorConfig, HuntingDetector, State, detect, doubts
from hunt_ros.detection.configuration import with_frequency
from hunt_ros.detection.second_opinion import SecondOpinion
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.simulation import RollerRig, Roughness, SimulationSettings
from hunt_ros.errors import ConfigError
from hunt_ros.samples import Record, Series


def disagreement(frequency_hz: float, rows_hz: float, rate_hz: float, noise: float) -> float:
    """Return the share of the rows after ten seconds of a steady motion that disagree."""
    t = (np.arange(round(30.0 * rate_hz)) + 1) / rate_hz
    rng = np.random.default_rng(2)
    values = 1e-3 * np.cos(2.0 * np.pi * frequency_hz * t) + noise * rng.standard_normal(t.size)
    config = DetectorConfig(
        channels=('lateral',),
        output_rate_hz=rows_hz,
        hunting_frequency_hz=frequency_hz,
    )
    detector = HuntingDetector(config)
    rows = detect(detector, record_of(t, lateral=values)).estimates
    late = rows['stamp_ns'] > 10e9
    assert detector.status.state is State.LIMIT_CYCLE
    return float(((rows['doubts'][late] & doubts.DISAGREE) != 0).mean())


@pytest.mark.parametrize(
    ('frequency_hz', 'rows_hz', 'rate_hz'),
    [
        (2.84, 100.0, 1000.0),
        (30.0, 100.0, 1000.0),
        (2.84, 20.0, 20.0),
        # The mean over a row takes a quarter off the amplitude.
        (4.0, 10.0, 200.0),
        (7.6, 20.0, 200.0),
    ],
)
def test_a_steady_motion_is_agreed_on(frequency_hz: float, rows_hz: float, rate_hz: float) -> None:
    assert disagreement(frequency_hz, rows_hz, rate_hz, 2e-5) == 0.0


@pytest.mark.parametrize('rate', [1.0, 2.0, 3.0, 7.0])
def test_rows_too_slow_for_the_hunting_are_refused(rate: float) -> None:
    with pytest.raises(ConfigError, match='output_rate_hz'):
        DetectorConfig(output_rate_hz=rate)
    slow = DetectorConfig(output_rate_hz=rate, hunting_frequency_hz=0.38 * rate)
    HuntingDetector(slow)


@pytest.mark.parametrize('gap_s', [1.0, 3.0])
@pytest.mark.parametrize('offset_m', [0.0, 0.03])
def test_a_gap_in_quiet_running_shows_no_motion(gap_s, offset_m, recorded) -> None:
    """Tens of micrometres of lines, and a sensor that reads 30 mm at rest, are no hunting."""
    for seed in range(1, 5):
        record = recorded(5.0, 20.0, seed=seed)
        parts = {}
        for name, series in record.items():
            seconds = 1e-9 * (series.stamps_ns - record.start_ns)
            there = (seconds < 12.0) | (seconds > 12.0 + gap_s)
            values = series.values + (offset_m if name == 'lateral' else 0.0)
            parts[name] = Series(series.stamps_ns[there], values[there])
        rows = detect(HuntingDetector(), Record(parts)).estimates
        seconds = 1e-9 * (rows['stamp_ns'] - record.start_ns)
        quiet = rows['noise_floor'][seconds < 12.0][-1]
        behind = rows[seconds > 12.0 + gap_s]
        assert np.isfinite(behind['lateral_envelope']).any()
        assert np.nanmax(behind['lateral_amplitude']) < 6.0 * quiet
        assert np.nanmax(behind['lateral_envelope']) < 6.0 * quiet
        assert np.nanmax(rows['lateral_envelope']) < 1e-4  # at the start, neither


def opinion_on(
    readings: NDArray[np.float64], line_hz: float, said: tuple[float, float, float]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return envelope, disagreement and vanished lines from 20 s on, beside one steady filter."""
    config = with_frequency(DetectorConfig(hunting_frequency_hz=4.0))
    rows_ns = (np.arange(readings.size) + 1) * config.period_ns
    told = [np.full(rows_ns.size, value) for value in (*said, 0.0)]
    angle, turning = 2.0 * np.pi * line_hz * rows_ns * 1e-9, np.full(rows_ns.size, line_hz)
    opinion = SecondOpinion(config, (1.0,))
    told_by = opinion.update(rows_ns, rows_ns, readings, angle, turning, tuple(told))
    envelope, disagree, gone = (each[2000:] for each in told_by)
    return envelope, disagree, gone


@pytest.mark.parametrize('amplitude', [3e-4, 3e-5])
def test_a_filter_whose_line_and_hunting_cancel_is_contradicted(amplitude: float) -> None:
    """All that moves is the line: 0.1 mm at 6.4 Hz; the filter says that it hunts at 6 Hz."""
    t = 0.01 * np.arange(1, 4001)
    noise = 1e-6 * np.random.default_rng(1).standard_normal(t.size)
    readings = 1e-4 * np.cos(2.0 * np.pi * 6.4 * t) + noise
    envelope, disagree, _ = opinion_on(readings, 6.4, (amplitude, 0.01 * amplitude, 6.0))
    assert envelope.max() < 1e-5
    assert disagree.all()


def test_a_filter_that_takes_the_motion_for_noise_is_contradicted() -> None:
    """Motion of no one frequency, 0.5 to 8 Hz: the filter says 0.024 +- 0.114 mm."""
    spectrum = np.fft.rfft(np.random.default_rng(1).standard_normal(6000))
    hertz = np.fft.rfftfreq(6000, 0.01)
    motion = np.fft.irfft(np.where((hertz > 0.5) & (hertz < 8.0), spectrum, 0.0), 6000)
    readings = 8e-4 * motion / motion.std()
    envelope, disagree, _ = opinion_on(readings, 11.0, (2.4e-5, 1.14e-4, 4.0))
    assert disagree[envelope > 6e-4].all()
    assert (envelope > 6e-4).mean() > 0.5


@pytest.mark.parametrize('period_s', [0.0, 4.0, 16.0, 60.0])
@pytest.mark.parametrize('loses', [False, True])
def test_lines_have_vanished_where_nothing_is_left_and_not_where_they_beat(
    period_s: float, loses: bool
) -> None:
    """A line of 20 um at 7.4 Hz, one beside it that nobody knows, and quiet motion of 4 um."""
    t = 0.01 * np.arange(1, 8001)
    rng = np.random.default_rng(1)
    readings = 2e-5 * np.cos(2.0 * np.pi * 7.4 * t) + 4e-6 * np.cos(2.0 * np.pi * 4.0 * t)
    if period_s:
        readings += 2e-5 * np.cos(2.0 * np.pi * (7.4 + 1.0 / period_s) * t)
    if loses:
        readings[t > 40.0] = 0.0
    readings += 1e-6 * rng.standard_normal(t.size)
    *_, gone = opinion_on(readings, 7.4, (4e-6, 1e-6, 4.0))
    assert gone[t[2000:] > 43.0].all() == loses
    assert not gone[t[2000:] <= 40.0].any()
    assert gone.any() == loses


def test_lines_of_a_roller_that_stops_have_not_vanished() -> None:
    t = 0.01 * np.arange(1, 8001)
    hertz = np.clip(7.4 - 2.0 * np.clip(t - 40.0, 0.0, None), 0.0, None)
    turns = np.cumsum(0.01 * hertz)
    noise = 1e-6 * np.random.default_rng(1).standard_normal(t.size)
    readings = np.where(hertz > 0.0, 2e-5 * np.cos(2.0 * np.pi * turns), 0.0) + noise
    rows_ns = np.arange(1, 8001) * 10_000_000
    opinion = SecondOpinion(with_frequency(DetectorConfig()), (1.0,))
    told = tuple(np.full(t.size, value) for value in (1e-6, 1e-6, 2.84, 0.0))
    angle = 2.0 * np.pi * turns
    *_, gone = opinion.update(rows_ns, rows_ns, readings, angle, hertz, told)
    assert not gone.any()


@pytest.mark.parametrize('speed', [6.0, 6.6, 7.2])
def test_lines_that_the_track_disturbs_vanish_with_the_target(speed: float) -> None:
    """A line is never steady on a rig: broadband roughness of 8 um beside lines of 20 um."""
    roughness = Roughness(amplitudes=(20e-6,))
    rig = RollerRig(RigParameters(), SimulationSettings(200.0, speed, roughness, 8e-6), 1)
    rig.advance(4000)
    block = rig.advance(6000)
    stamps_ns = block.stamps_ns - block.stamps_ns[0] + 5_000_000
    readings = np.where(stamps_ns < 25e9, block.lateral, 0.0)
    readings += 5e-6 * np.random.default_rng(1).standard_normal(readings.size)
    config = with_frequency(DetectorConfig(output_rate_hz=20.0))
    rows_ns = np.arange(1, 601) * config.period_ns
    angle = np.interp(rows_ns, stamps_ns, block.roller_angle)
    turning = np.interp(rows_ns, stamps_ns, block.speed) / (0.3 * np.pi)
    told = tuple(np.full(rows_ns.size, value) for value in (1e-6, 1e-6, 2.84, 0.0))
    opinion = SecondOpinion(config, (1.0, 2.0))
    *_, gone = opinion.update(rows_ns, stamps_ns, readings, angle, turning, told)
    assert not gone[rows_ns <= 25e9].any()
    assert gone[(rows_ns > 25e9) & (rows_ns <= 27e9)].any(), 'within 2 s'
