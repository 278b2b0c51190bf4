"""The identifier is told of the rig by parameters."""

from __future__ import annotations

import pytest

from hunt_ros.errors import ConfigError
from hunt_ros.identification import IdentificationSettings
from hunt_ros.nodes.normal_form_identifier import IdentifierConfig


def test_the_parameters_of_the_rig_reach_the_identification() -> None:
    assert IdentifierConfig().identification() == IdentificationSettings()
    told = IdentifierConfig(
        length_scale_m=0.75,
        time_scale_s=0.1,
        hunting_frequency_hz=1.3,
        lines=(1.0, 1.7),
        roller_diameter_m=1.1,
        wheel_diameter_m=0.9,
        prior_v_c=(60.0, 2.0),
    )
    assert told.identification() == IdentificationSettings(
        length_scale=0.75,
        time_scale=0.1,
        frequency_hz=1.3,
        lines=(1.0, 1.7),
        roller_diameter_m=1.1,
        wheel_diameter_m=0.9,
        prior_v_c=(60.0, 2.0),
    )
    assert IdentifierConfig(lines=(0.0,)).identification().lines == ()


@pytest.mark.parametrize(
    'wrong', [{'prior_v_c': (60.0,)}, {'wheel_diameter_m': 0.9}, {'lines': (-1.0,)}]
)
def test_what_says_nothing_of_a_rig_is_refused(wrong) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong)).partition('_')[0]):
        IdentifierConfig(**wrong)
