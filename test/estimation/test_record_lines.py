"""Lines of whole records: the hunting is no forced line."""

from __future__ import annotations

import pytest

from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.dynamics.simulation import Kick, simulate
from hunt_ros.dynamics.simulation.settings import Roughness, SensorModel, SimulationSettings
from hunt_ros.estimation.record_lines import RecordLines, motion_of


@pytest.mark.parametrize('speed', [6.8, 7.4])
@pytest.mark.parametrize('roughness', [(), (2e-5,)], ids=['smooth', 'rough'])
@pytest.mark.parametrize('kicks', [[], [Kick(120.0, 6e-4)]], ids=['quiet', 'kicked'])
def test_in_a_record_most_of_which_is_one_speed_the_hunting_is_not_forced(
    speed, roughness, kicks
) -> None:
    """In way it is a line as it is in time: what it does at other speeds tells them apart."""
    profile = Profile([Corners((0.0, 5.0, 45.0, 240.0), (0.5, 0.5, speed, speed))])
    settings = SimulationSettings(
        sample_rate_hz=200.0,
        initial_speed=0.5,
        broadband=8e-6,
        roughness=Roughness(roughness),
        lateral_sensor=SensorModel(noise=5e-6),
    )
    record = simulate(paper_rig(), settings, profile, 240.0, kicks, seed=1)
    lines = RecordLines([motion_of(record)])
    assert lines.forced() == []
    if kicks:
        assert lines.hunting_hz == pytest.approx(2.84, rel=0.03)
