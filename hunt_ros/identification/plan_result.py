"""What a plan hands back: the profile, why, what it would teach and risk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from hunt_ros.dynamics.profile import Profile, Step
from hunt_ros.identification.foresight import Stretch


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
        return dict(vars(self))


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
