"""What a plan may cost; light to import, for the command line declares its options from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hunt_ros.errors import ConfigError
from hunt_ros.settings import Settings, setting


@dataclass(frozen=True)
class PlanSettings(Settings):
    """
    What the plan may cost; the fields say what they are.

    Raises
    ------
    ConfigError
        For a value out of its range.
    """

    budget_s: float = setting(600.0, 'time of the profile', unit='s', low=10.0, high=86_400.0)
    max_escape: float = setting(
        0.05, 'largest chance that hunting begins where it is not meant to', low=0.0, high=1.0
    )
    speed_ceiling_mps: float = setting(
        0.0,
        'fastest speed (0: that of the rig, else the fastest recorded)',
        unit='m/s',
        low=0.0,
        high=1e3,
    )
    speeds_mps: tuple[float, ...] = setting(
        (), 'where the unstable amplitude is wanted (none: at 36 % and 74 % of v_n to v_c)',
        unit='m/s',
    )  # fmt: skip
    kicks: bool = setting(False, 'somebody stands by to kick the wheelset')
    rearm_s: float = setting(10.0, 'time that a kick costs', unit='s', low=0.0, high=200.0)
    start_speed_mps: float = setting(
        0.0, 'speed of the rig now (0: the slowest recorded)', unit='m/s', low=0.0, high=1e3
    )
    start_amplitude_m: float = setting(
        0.0, 'amplitude of the rig now (0: quiet)', unit='m', low=0.0, high=1.0
    )
    seed: int = setting(0, 'of everything random', low=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for speed in self.speeds_mps:
            if not 0.0 < speed < math.inf:
                raise ConfigError(f'speeds_mps: {speed!r} is not above 0 m/s')
