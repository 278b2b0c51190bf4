"""What a plan hands back: the profile, why, what it would teach and risk; and what it may cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from hunt_ros.dynamics.profile import Profile, Step
from hunt_ros.errors import ConfigError
from hunt_ros.identification.foresight import Stretch


@dataclass(frozen=True)
class PlanSettings:
    """
    What the plan may cost.

    Parameters
    ----------
    budget_s : float
        Time of the profile, s.
    max_escape : float
        Largest chance that hunting begins where that is not what the profile is for.
    speed_ceiling_mps : float
        Fastest speed, m/s; 0: the fastest of the recordings.
    speeds_mps : tuple of float
        Where the unstable amplitude is wanted, m/s; none: at 36 % and 74 % of the way from
        v_n to v_c.
    kicks : bool
        Whether somebody stands by to kick the wheelset.
    rearm_s : float
        Time that a kick costs, s.
    start_speed_mps, start_amplitude_m : float
        Where the rig is, m/s and m; 0: quiet at the slowest speed of the recordings.
    seed : int
        Of everything random.

    Raises
    ------
    ConfigError
        For a value out of its range.
    """

    budget_s: float = 600.0
    max_escape: float = 0.05
    speed_ceiling_mps: float = 0.0
    speeds_mps: tuple[float, ...] = ()
    kicks: bool = False
    rearm_s: float = 10.0
    start_speed_mps: float = 0.0
    start_amplitude_m: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        _require('budget_s', self.budget_s, 10.0 <= self.budget_s <= 86_400.0, '10 to 86400 s')
        _require('max_escape', self.max_escape, 0.0 <= self.max_escape <= 1.0, 'within 0..1')
        for name in ('speed_ceiling_mps', 'rearm_s', 'start_speed_mps', 'start_amplitude_m'):
            value = getattr(self, name)
            _require(name, value, 0.0 <= value < math.inf, 'zero or more')
        for speed in self.speeds_mps:
            _require('speeds_mps', speed, 0.0 < speed < math.inf, 'positive')


def _require(name: str, value: object, fine: bool, expected: str) -> None:
    if not fine:
        raise ConfigError(f'plan: {name} must be {expected}, got {value}')


@dataclass(frozen=True)
class Action:
    """
    A piece of a profile.

    Parameters
    ----------
    kind : 'hold', 'sweep', 'reversal' or 'kick'
    words : str
        What it does.
    steps : tuple of Step
        As the drive runs it.
    stretches : tuple of Stretch
        As it is run ahead.
    """

    kind: str
    words: str
    steps: tuple[Step, ...] = field(repr=False)
    stretches: tuple[Stretch, ...] = field(repr=False)
    cost_s: float = 0.0


@dataclass(frozen=True)
class Rated:
    """
    An action, run ahead.

    Parameters
    ----------
    action : Action
    duration_s : float
        Expected, s.
    gain_per_minute : float
        Drop of the logarithms of the deviations, summed over the quantities, 1/min.
    escape : float
        Chance that hunting has begun unwanted by its end.
    """

    action: Action
    duration_s: float
    gain_per_minute: float
    escape: float

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `actions` or `steps`."""
        return {
            'kind': self.action.kind,
            'action': self.action.words,
            'duration_s': self.duration_s,
            'gain_per_minute': self.gain_per_minute,
            'escape_chance': self.escape,
        }


@dataclass(frozen=True)
class Prediction:
    """
    A quantity: how well it is known, and how well it should be after the profile.

    Parameters
    ----------
    name, unit : str
    value, std, std_after : float
    """

    name: str
    unit: str
    value: float
    std: float
    std_after: float

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `quantities`."""
        return {
            'name': self.name,
            'unit': self.unit,
            'value': self.value,
            'std': self.std,
            'std_after': self.std_after,
        }


@dataclass(frozen=True)
class Plan:
    """
    The next profile, and why.

    Parameters
    ----------
    profile : Profile
        For the drive.
    reason : str
        A sentence.
    duration_s, longest_s : float
        Expected, and where no amplitude ends a step early, s.
    escape : float or None
        Chance that hunting begins unwanted; None where too little is known to say.
    quantities : sequence of Prediction
        Empty where too little is known.
    steps : sequence of Rated
        The actions taken, in their order.
    actions : sequence of Rated
        All actions from where the rig is now, the best first.
    """

    profile: Profile
    reason: str
    duration_s: float
    longest_s: float
    escape: float | None = None
    quantities: Sequence[Prediction] = ()
    steps: Sequence[Rated] = ()
    actions: Sequence[Rated] = ()

    def to_json(self) -> dict[str, Any]:
        """Return what `hunt plan --json` writes."""
        return {
            'reason': self.reason,
            'duration_s': self.duration_s,
            'longest_s': self.longest_s,
            'escape_chance': self.escape,
            'quantities': [one.to_json() for one in self.quantities],
            'steps': [one.to_json() for one in self.steps],
            'actions': [one.to_json() for one in self.actions],
            'profile': self.profile.to_yaml(),
        }
