"""Which sensor the decisions judge, as the detector tells it, and what a third one adds."""

from __future__ import annotations

import numpy as np
import pytest
from fed import Fed
from made import SECOND, changed, dead, forced_mode, held, record_of, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect, doubts
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import Kick, simulate
from hunt_ros.dynamics.simulation.settings import Roughness, SimulationSettings
from hunt_ros.estimation.tracker_config import REFERENCE_HZ
from hunt_ros.samples import Record, Series


@pytest.mark.parametrize('dead_from', [0.0, 2.0, 14.0])
def test_with_the_mode_shape_yaw_alone_gives_the_lateral_amplitude(
    recorded, shaped, dead_from
) -> None:
    record = recorded(7.2, 25.0, kicks=[(9.0, 330e-6)])
    truth = detect(HuntingDetector(normal_form=shaped), dead(record, 'yaw')).estimates
    detector = HuntingDetector(normal_form=shaped)
    rows = detect(detector, dead(record, 'lateral', dead_from)).estimates
    last = rows['stamp_ns'] > 18_000_000_000
    error = rows['lateral_amplitude'][last] / truth['lateral_amplitude'][last] - 1.0
    assert abs(error.mean()) < 0.02  # the roughness makes it beat
    assert np.abs(error).max() < 0.15
    assert detector.status.state is State.LIMIT_CYCLE
    assert detector.status.alarm
    assert detector.status.level is Level.STALE
    assert any('through the mode shape' in reason for reason in detector.status.reasons)


@pytest.mark.parametrize('speed', [7.2, 7.9])
def test_a_lateral_amplitude_that_nothing_tells_is_unknown(recorded, true_form, speed) -> None:
    # Two seconds of quiet running tell the ratio of the sensors badly, or not at all.
    for seed in range(4):
        record = recorded(speed, 20.0, [(4.0, 700e-6)], seed)
        truth = detect(HuntingDetector(normal_form=true_form), record).estimates
        one = dead(record, 'lateral', 2.0)
        detector = HuntingDetector(normal_form=true_form)
        rows = detect(detector, one).estimates
        late = rows['stamp_ns'] > 12_000_000_000
        found, std = rows['lateral_amplitude'][late], rows['lateral_amplitude_std'][late]
        told = np.isfinite(found)
        off = np.abs(found - truth['lateral_amplitude'][late])[told]
        assert (off < 3.0 * std[told]).all()
        assert (std[told] < found[told]).all()
        assert detector.status.state is State.LIMIT_CYCLE, 'by yaw, where lateral is unknown'
        both = dead(one, 'yaw', 14.0)
        rows = detect(HuntingDetector(normal_form=true_form), both).estimates
        late = rows['stamp_ns'] > 15_000_000_000
        found, std = rows['lateral_amplitude'][late], rows['lateral_amplitude_std'][late]
        assert not (std > 1e-2).any(), 'the death of the other one does not bring it back'
        last = rows['state'][rows['stamp_ns'] <= 14_000_000_000][-1]
        assert (rows['state'][late] == last).all(), 'nor does it end or begin anything'


def test_where_lateral_is_missing_for_a_while_yaw_is_judged(recorded) -> None:
    record = recorded(7.2, 40.0, kicks=[(20.0, 330e-6)])
    series = record['lateral']
    seconds = series.stamps_ns * 1e-9
    values = np.where((seconds > 12.0) & (seconds < 32.0), np.nan, series.values)
    gap = changed(record, lateral=values)
    detector = HuntingDetector()
    output = detect(detector, gap)
    rows = output.estimates
    seconds = rows['stamp_ns'] * 1e-9
    in_yaw = (rows['doubts'] & doubts.IN_YAW) != 0
    assert in_yaw[(seconds > 14.0) & (seconds < 32.0)].all()
    assert not in_yaw[(seconds < 12.0) | (seconds > 33.0)].any()
    assert 'limit_cycle' in words(output)
    assert not {'decaying', 'quiet'} & set(words(output)), 'another channel ends no hunting'
    first = next(e for e in output.events if e.event in ('escaping', 'limit_cycle'))
    assert first.stamp_ns < 31e9
    assert detector.status.state is State.LIMIT_CYCLE


def test_a_lateral_sensor_that_comes_late_is_judged_from_then_on(recorded, true_form) -> None:
    record = recorded(7.2, 12.0)
    series = record['lateral']
    values = np.where(series.stamps_ns < 5_000_000_000, np.nan, series.values)
    late = changed(record, lateral=values)
    rows = detect(HuntingDetector(normal_form=true_form), late).estimates
    known = np.flatnonzero(np.isfinite(rows['lateral_amplitude']))[0]
    assert np.isnan(rows['margin'][:known]).all()
    assert np.isfinite(rows['margin'][known + 300 :]).all()
    # Until then yaw is judged, whose noise is learnt within the first seconds: in some records
    # it is disturbed at first. It never hunts.
    assert (rows['state'] <= State.DISTURBED).all()


def test_a_lateral_sensor_that_shows_but_noise_does_not_hide_a_cycle_that_yaw_shows() -> None:
    late = []
    for seed in range(18):
        rng = np.random.default_rng([9, seed])
        hz, noise = (0.9, 2.84, 6.0)[seed % 3], rng.uniform(0.02, 0.1)
        periods = np.arange(0.0, 60.0, 1.0 / 80.0)
        size = 1.0 / (1.0 + np.exp(-rng.uniform(0.8, 2.0) * (periods - 30.0)))
        turning = size * np.cos(2.0 * np.pi * periods + rng.uniform(0.0, 6.0))
        lateral, yaw = noise * rng.normal(size=(2, periods.size))
        record = record_of(periods / hz, lateral=1e-4 * lateral, yaw=1e-3 * (turning + yaw))
        config = DetectorConfig(channels=('lateral', 'yaw'), hunting_frequency_hz=hz)
        events = detect(HuntingDetector(config), record).events
        said = [e.stamp_ns for e in events if e.level is Level.ERROR][:1] or [record.end_ns]
        steady = float(periods[np.argmax(size > 0.9)])
        if (said[0] - record.start_ns) * 1e-9 * hz > steady + 5.0 * REFERENCE_HZ:
            late.append(seed)
    assert len(late) <= 2, f'nine of ten are said within 5 s of the reference rig, not {late}'


def test_quiet_motion_beside_a_lateral_offset_that_wanders_does_not_hunt() -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        seconds = np.arange(0.0, 90.0, 0.005)
        motion = forced_mode(rng, seconds.size, 0.005, 0.6, 1.2e-5, 3.0)
        offset = 2e-3 * np.sin(2.0 * np.pi * seconds / 60.0)
        lateral = motion.real + offset + 2e-6 * rng.normal(size=seconds.size)
        yaw = (5.0 * np.exp(1.4j) * motion).real + 1e-5 * rng.normal(size=seconds.size)
        record = record_of(seconds, lateral=lateral, yaw=yaw, speed=8.5)
        detector = HuntingDetector(DetectorConfig(channels=tuple(record)))
        assert not (detect(detector, record).estimates['level'] == Level.ERROR).any(), seed


# --- an axle-box acceleration beside displacement and yaw: one more name in `channels` ---------

RATE, DEAD_NS = 500.0, 20_000_000_000
NOISE = {'lateral': 2e-5, 'yaw': 8e-5, 'axle_box': 5e-3}


@pytest.fixture(scope='module')
def simulated() -> Record:
    """A rig that is hit at 8 s and hunts; sensors without noise, and an axle-box acceleration."""
    settings = SimulationSettings(
        sample_rate_hz=RATE, broadband=8e-6, roughness=Roughness((50e-6, 20e-6))
    )
    blow = Kick(8.0, lateral_m=4e-4)
    record = simulate(paper_rig(), settings, held(7.2), 30.0, [blow], seed=4)
    lateral = record['lateral']
    acceleration = np.gradient(np.gradient(lateral.values)) * RATE**2
    return Record({**record, 'axle_box': Series(lateral.stamps_ns, acceleration)})


def noisy(record: Record, seed: int = 0, share: float = 1.0) -> Record:
    rng = np.random.default_rng(seed)
    noise = {name: share * std * rng.normal(size=len(record[name])) for name, std in NOISE.items()}
    return changed(record, **{name: record[name].values + one for name, one in noise.items()})


@pytest.fixture(scope='module')
def truth(simulated) -> np.ndarray:
    """The amplitude of the limit cycle as displacement and yaw without noise show it, m."""
    config = DetectorConfig(channels=('lateral', 'yaw', 'roller', 'speed'))
    rows = detect(HuntingDetector(config), noisy(simulated, 99, 0.02)).estimates
    return rows['lateral_amplitude']


def error(rows: np.ndarray, truth: np.ndarray, since_s: float) -> float:
    """Return the r.m.s. error of the amplitude from then on, relative."""
    late = rows['stamp_ns'] > since_s * 1e9
    ratio = rows['lateral_amplitude'][late] / truth[: rows.size][late] - 1.0
    return float(np.sqrt(np.mean(ratio**2)))


@pytest.mark.parametrize('others', [('yaw',), ()])
def test_it_carries_on_where_the_displacement_sensor_dies(simulated, truth, others) -> None:
    record = noisy(simulated)
    record = changed(record, lateral=record['lateral'].between(0, record.start_ns + DEAD_NS))
    config = DetectorConfig(
        channels=('lateral', *others, 'axle_box', 'roller', 'speed'),
    )
    detector = HuntingDetector(config)
    rig = Fed(detector)
    heard = {name: record[name] for name in detector.channels}
    list(rig.play(heard, range(0, 30 * SECOND + 1, SECOND // 10)))
    rows = rig.output.estimates
    assert rows['stamp_ns'][-1] > 29_000_000_000
    late = rows['stamp_ns'] > DEAD_NS + 2_000_000_000
    assert error(rows, truth, 1e-9 * DEAD_NS + 2.0) < 0.05
    assert not (rows['doubts'][late] & (doubts.FROM_YAW | doubts.IN_YAW)).any()
    assert (rows['state'][late] >= State.ESCAPING).all()
    assert (rows['state'][late][100:] == State.LIMIT_CYCLE).all()
    assert (rows['level'][late] == Level.STALE).all()  # a sensor is missing, and it is said
    assert any(words.startswith('lateral: silent') for words in detector.status.reasons)
