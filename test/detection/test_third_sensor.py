"""An axle-box acceleration beside displacement and yaw: one more name in `channels`."""

from __future__ import annotations

import numpy as np
import pytest
from fed import Fed
from made import SECOND, changed, held

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect, doubts
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import Kick, simulate
from hunt_ros.dynamics.simulation.settings import Roughness, SimulationSettings
from hunt_ros.samples import Record, Series

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
