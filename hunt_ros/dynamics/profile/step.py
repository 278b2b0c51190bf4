"""
What a step of a speed profile is: it turns itself into *legs* by what it sees of the motion.

A leg goes to a speed, and stays there; it may end early by what the detector sees, and a step
may choose its next leg by it, so that a see-saw is no special case. What runs a profile knows
legs only.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar

from hunt_ros.settings import Settings, setting


@dataclass(frozen=True)
class Motion:
    """
    What a profile may react to: the motion as the detector sees it, and the form in force.

    Parameters
    ----------
    amplitude_m : float
        Amplitude of the hunting motion; NaN: unknown.
    v_n, v_c : float
        Critical speeds of the normal form in force, m/s; NaN: unknown.
    fold_amplitude_m : float
        Amplitude of the limit cycle at v_n; NaN: unknown.
    held_mps, held_s : float
        Speed that is held, m/s, and for how long, s; the latter NaN where nobody judges it.
    margin : float
        There, unstable amplitude over amplitude with 95 %; 0: it hunts; NaN: unknown.
    escape_chance : float
        There, chance that noise starts hunting within ten minutes; NaN: unknown.
    forecast_mps : float
        Lower end of the 95 % interval of the forecast of v_c; NaN: there is none.
    """

    amplitude_m: float = math.nan
    v_n: float = math.nan
    v_c: float = math.nan
    fold_amplitude_m: float = math.nan
    held_mps: float = math.nan
    held_s: float = math.nan
    margin: float = math.nan
    escape_chance: float = math.nan
    forecast_mps: float = math.nan

    def with_form(self, before: Motion) -> Motion:
        """Return it with the form of another one where it tells none."""
        kept = {
            name: getattr(before, name)
            for name in ('v_n', 'v_c', 'fold_amplitude_m')
            if math.isnan(getattr(self, name))
        }
        return replace(self, **kept) if kept else self


@dataclass(frozen=True)
class Leg:
    """
    Go to a speed, and stay there.

    Parameters
    ----------
    speed_mps : float
        Where to.
    rate_mps2 : float
        How fast, positive; inf: as fast as the drive may.
    hold_s : float
        How long to stay.
    above_m, below_m : float
        Ends as soon as the amplitude is above, or below, this; NaN: not.
    until : callable, optional
        Ends as soon as this is true of the motion.
    note : str
        Told to the operator when it begins.
    last : bool
        The profile ends with it.
    """

    speed_mps: float
    rate_mps2: float = math.inf
    hold_s: float = 0.0
    above_m: float = math.nan
    below_m: float = math.nan
    until: Callable[[Motion], bool] | None = None
    note: str = ''
    last: bool = False

    def cut(self, motion: Motion) -> bool:
        """Return True where it ends early, by what the detector sees."""
        if motion.amplitude_m > self.above_m or motion.amplitude_m < self.below_m:
            return True
        return self.until is not None and self.until(motion)


class Scene:
    """
    What a step sees while it runs.

    Attributes
    ----------
    motion : Motion
        Now.
    elapsed_s : float
        Since the step began.
    """

    def __init__(self, motion: Motion, elapsed_s: float = 0.0) -> None:
        self.motion, self.elapsed_s = motion, elapsed_s


@dataclass(frozen=True)
class Step(Settings, ABC):
    """A step of a profile; its fields are the keys of the YAML."""

    #: Whether it goes on where it was stopped.
    resumable: ClassVar[bool] = True
    _: KW_ONLY
    note: str = setting('', 'told to the operator when the step begins')

    @abstractmethod
    def legs(self, scene: Scene) -> Iterator[Leg]:
        """Iterate over the legs; the next one is asked for when the one before is over."""

    def plan(self) -> list[Leg]:
        """Return the legs, longest case, without a detector: what the step may ask for."""
        return list(self.legs(Scene(Motion())))

    def begin_mps(self, motion: Motion) -> float:
        """Return where the roller runs when a profile begins with this step, m/s."""
        return next(self.legs(Scene(motion))).speed_mps

    def missing(self, motion: Motion) -> str:
        """Return '' or what the step has to know of the detector, and does not."""
        return ''

    @property
    def reacts(self) -> bool:
        """True where the detector decides how the step goes."""
        return False
