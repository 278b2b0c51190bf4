"""A minute of one kick that stays: what it leaves open is not normal."""

from __future__ import annotations

from dataclasses import replace

import pytest
from made import rig_settings

from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.dynamics.simulation import Kick, SensorModel, simulate
from hunt_ros.identification import identify

UP_AND_BACK = Corners((0.0, 6.0, 35.0, 41.0, 55.0), (6.0, 7.2, 7.2, 6.0, 6.0))


@pytest.mark.parametrize('seed', [13, 108, 117, 363, 365])
def test_one_kick_bounds_no_critical_speed_and_shows_where_hunting_ends(seed):
    """Where rest ends at 8 m/s, of which a minute at 7.2 m/s and below says nothing."""
    settings = replace(
        rig_settings(100.0, roughness=[20e-6]), lateral_sensor=SensorModel(5e-6, 2.0**-21)
    )
    profile = Profile((UP_AND_BACK,))
    kicks = [Kick(15.0, lateral_m=320e-6)]
    result = identify([simulate(paper_rig(), settings, profile, kicks=kicks, seed=seed)])
    assert result.v_c is None
    assert result.v_n.low < 6.433 < result.v_n.high
