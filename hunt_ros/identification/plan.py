"""
What to measure next: the profile that teaches the most a minute, under a bounded risk.

Actions are short pieces of a profile: holds, and reversals that the amplitude triggers. Each is
run ahead over draws of what is known (`foresight`); the one with the largest
expected drop of the logarithms of the deviations a second is taken, if the chance that hunting
begins unwanted stays within its bound, and the next is chosen from where that one ends. Looking
two actions ahead gains nothing measurable.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.profile import Hold, Profile, Sweep
from hunt_ros.errors import ConfigError, IdentificationError
from hunt_ros.identification.foresight import AMPLITUDE, BELOW, ESCAPED, TIME, Foresight, Move
from hunt_ros.identification.posterior import Posterior
from hunt_ros.identification.result import Identification
from hunt_ros.samples import as_json, key, rounded
from hunt_ros.settings import Settings, setting

__all__ = ['Plan', 'PlanSettings', 'plan']

Array = NDArray[np.float64]

#: Stochastic paths.
_PATHS = 160
#: Where hunting grows by itself, places in the hysteresis region at which to watch, and where
#: hunting dies out, on the way from v_n (0) to v_c (1); the places where A_u is wanted.
_TOP, _WATCHED, _BOTTOM, _WANTED = 1.15, (0.36, 0.55, 0.74), -0.1, (0.36, 0.74)
#: No speed below this part of v_n, however wide the hysteresis.
_SLOWEST = 0.1
#: The first sweep: its rate, m/s^2, and how far it goes, down relative to its top and up relative
#: to the fastest speed so far.
_FIRST_RATE, _FIRST_LOW, _FIRST_HIGH = 0.05, 0.75, 1.2
#: Time in which to watch where the motion goes, the longest wait for an amplitude, and the
#: shortest action, s.
_WATCH_S, _PATIENCE_S, _LEAST_S = 12.0, 40.0, 1.0
#: Amplitudes of triggers in those at the fold: grown, fallen, hunting; quiet again.
_GROWN, _FALLEN, _HUNTING, _QUIET_AGAIN = 0.3, 0.7, 1.15, 0.1
#: Share by which the deviation of a quantity must fall, for the run to teach anything.
_LEARNT = 0.01
#: A gain of the logarithms of the deviations in a minute that is not worth running the rig for.
_NOTHING = 1e-3
#: What a profile does most of the time.
_DOES = {
    'hold': 'holds where the growth rate is least known',
    'reversal': 'crosses the middle amplitudes again and again, which show the law',
}


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


@dataclass(frozen=True)
class Action:
    """
    A piece of a profile, run ahead.

    Parameters
    ----------
    kind : 'hold' or 'reversal'
    words : str
        What it does.
    moves : tuple of Move
        As the drive runs it, and what each step is for.
    duration_s, gain_per_minute, escape_chance : float
        Expected, s; drop of the logarithms of the deviations, summed over the quantities, 1/min;
        chance that hunting has begun unwanted by its end.
    states, information : ndarray
        At its end, and what it tells (`Foresight.follow`).
    """

    kind: str
    words: str = field(metadata=key('action'))
    moves: tuple[Move, ...] = field(repr=False, metadata=key(''))
    duration_s: float
    gain_per_minute: float
    escape_chance: float
    states: Array = field(repr=False, metadata=key(''))
    information: Array = field(repr=False, metadata=key(''))


@dataclass(frozen=True)
class Prediction:
    """
    A quantity: how well it is known, and how well at best after the profile.

    The deviation after it is a bound (Cramer-Rao): that of a motion whose noise is white, of known
    intensity and the same at all amplitudes, with a law of the form that was identified.

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

    def told(self, std: float) -> str:
        """Return a deviation with its unit."""
        number, unit = (1e6 * std, 'um') if self.unit == 'm' else (std, self.unit)
        return f'{rounded((number,), number)[0][0]} {unit}'


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
    duration_ci95_s : tuple of float
        95 % interval over the laws that the data allow, s.
    escape : float or None
        Chance that hunting begins unwanted; None where too little is known to say.
    quantities : sequence of Prediction
        Empty where too little is known.
    steps : sequence of Action
        The actions taken, in their order.
    """

    profile: Profile = field(metadata=key(''))
    reason: str
    duration_s: float
    longest_s: float
    duration_ci95_s: tuple[float, float]
    escape: float | None = field(default=None, metadata=key('escape_chance'))
    quantities: Sequence[Prediction] = ()
    steps: Sequence[Action] = ()

    def to_json(self) -> dict[str, Any]:
        """Return what `hunt plan --json` writes."""
        return {**as_json(self), 'profile': self.profile.to_yaml()}


def plan(known: Identification, settings: PlanSettings | None = None) -> Plan:
    """
    Plan the next profile.

    Parameters
    ----------
    known : Identification
        From what was measured so far.
    settings : PlanSettings, optional
        What it may cost.

    Returns
    -------
    Plan
        A first sweep where v_n or v_c is not known yet.

    Raises
    ------
    ConfigError
        If the ceiling leaves nothing to run.
    IdentificationError
        If nothing within the bounds teaches anything.

    References
    ----------
    MacKay, D. J. C. (1992), Neural Computation 4, 590-604: choosing data by expected information.
    """
    settings = settings or PlanSettings()
    ceiling = settings.speed_ceiling_mps or known.speeds[1]
    slowest = min(settings.start_speed_mps or known.speeds[0], known.speeds[0])
    if ceiling <= slowest:
        raise ConfigError(
            f'plan: expected a fastest speed above the slowest, {slowest:g} m/s, got {ceiling:g}:'
            ' give that of the rig (speed_ceiling_mps)'
        )
    if settings.start_speed_mps > ceiling:
        raise ConfigError(
            f'plan: start_speed_mps must not be above the ceiling, {ceiling:g} m/s,'
            f' got {settings.start_speed_mps:g}'
        )
    unknown = [name for name in ('v_c', 'v_n') if getattr(known, name) is None]
    if known.posterior is None or unknown:
        return _first_sweep(known, settings, slowest, ceiling, unknown)
    return _Planner(known, known.posterior, settings, slowest, ceiling).plan()


def _first_sweep(
    known: Identification,
    settings: PlanSettings,
    slowest: float,
    ceiling: float,
    unknown: Sequence[str],
) -> Plan:
    """Sweep through all speeds: where little is known a greedy choice is a useless hold."""
    ceiling = min(ceiling, _FIRST_HIGH * known.speeds[1])
    lowest = min(slowest, _FIRST_LOW * ceiling)
    way, budget = 2.0 * (ceiling - lowest), settings.budget_s
    times = max(int(budget * _FIRST_RATE / way), 1)
    sweep = Sweep(lowest, ceiling, _rounded(max(_FIRST_RATE, way / budget)))
    profile = Profile((sweep,) * times, 'plan')
    said = known.unknown.get(unknown[0], '') if unknown else ''
    reason = (
        f'without {" and ".join(unknown) or "a law"} nothing better can be planned than a sweep to'
        f' {ceiling:.3g} m/s{said and f": {said}"}'
    )
    lasts = profile.duration_s
    return Plan(profile, reason, lasts, lasts, (lasts, lasts))


class _Planner:
    """The greedy choice of actions, from where the rig is to the end of the budget."""

    def __init__(
        self,
        known: Identification,
        posterior: Posterior,
        settings: PlanSettings,
        slowest: float,
        ceiling: float,
    ) -> None:
        self._known, self._settings, self._ceiling = known, settings, ceiling
        self._v_c, self._v_n = map(float, posterior.chosen[:2])
        floor = _SLOWEST * self._v_n
        self._bottom = min(max(self._beyond(_BOTTOM), floor), ceiling)
        self._home = min(slowest, max(self._beyond(-0.4), floor))
        self._start = settings.start_speed_mps or slowest
        self._wanted = self._where(settings.speeds_mps)
        self._foresight = Foresight(
            posterior, self._wanted, self._home, ceiling, _PATHS, settings.seed
        )
        self._fold = self._foresight.fold_amplitude

    def _beyond(self, share: float) -> float:
        """Return a speed by its share of the way from v_n to v_c, m/s."""
        return self._v_n + share * (self._v_c - self._v_n)

    def _unstable(self, speeds: Sequence[float]) -> Array:
        return self._known.branch('unstable', speeds)[0]

    def _where(self, asked: tuple[float, ...]) -> tuple[float, ...]:
        """Return the speeds at which the unstable amplitude is wanted; there must be one."""
        speeds = asked or tuple(_rounded(self._beyond(share), 3) for share in _WANTED)
        there = np.isfinite(self._unstable(speeds))
        if asked and not there.all():
            raise ConfigError(
                'plan: speeds_mps: no unstable amplitude is known at'
                f' {speeds[int(np.argmin(there))]:g} m/s, expected'
                f' speeds between v_n = {self._v_n:.4g} and v_c = {self._v_c:.4g} m/s'
            )
        return tuple(speed for speed, known in zip(speeds, there, strict=True) if known)

    def plan(self) -> Plan:
        """Choose actions until the budget is used."""
        settings, foresight = self._settings, self._foresight
        states = foresight.start(self._start, settings.start_amplitude_m)
        information = foresight.nothing
        taken: list[Action] = []
        while best := next(filter(self._allowed, self._rated(states, information)), None):
            states, information = best.states, information + best.information
            taken.append(best)
        quantities = self._predicted(information)
        if not any(one.std_after < (1.0 - _LEARNT) * one.std for one in quantities):
            raise IdentificationError(
                f'plan: nothing within {settings.budget_s:g} s, {self._ceiling:g} m/s and a chance'
                f' of {settings.max_escape:g} of unwanted hunting teaches anything'
            )
        begin, home = self._move(self._start), self._move(self._home)
        moves = [begin, *(move for one in taken for move in one.moves), home]
        profile = Profile(tuple(move.step for move in moves), 'plan')
        shortest, longest = np.percentile(states[:, TIME], [2.5, 97.5])
        return Plan(
            profile,
            _reason(taken),
            float(states[:, TIME].mean()),
            profile.duration_s,
            (float(shortest), float(longest)),
            float(states[:, ESCAPED].mean()),
            quantities,
            taken,
        )

    def _rated(self, states: Array, information: Array) -> list[Action]:
        """Run all actions ahead, the best first; those that the budget has no time for are out."""
        elapsed = states[:, TIME].mean()
        before = np.log(self._foresight.spread(information))
        rated = []
        hunts = bool(np.median(states[:, AMPLITUDE]) > BELOW * self._fold)
        for kind, words, moves in self._actions(hunts):
            after, told = self._foresight.follow(states, moves)
            end, escaped = float(after[:, TIME].mean()), float(after[:, ESCAPED].mean())
            lasted = end - float(elapsed)
            # What ends at once for most teaches by the few that it does not end for.
            most = np.median(after[:, TIME] - states[:, TIME]) >= _LEAST_S
            if most and end <= self._settings.budget_s:
                drop = before - np.log(self._foresight.spread(information + told))
                found = lasted, 60.0 * float(drop.sum()) / lasted, escaped, after, told
                rated.append(Action(kind, words, moves, *found))
        return sorted(rated, key=lambda one: -one.gain_per_minute)

    def _allowed(self, one: Action) -> bool:
        """Return True where it is worth its time and its risk is within the bound."""
        within = one.escape_chance <= self._settings.max_escape
        return within and one.gain_per_minute >= _NOTHING

    def _actions(self, hunts: bool) -> Iterator[tuple[str, str, tuple[Move, ...]]]:
        """Kind, words and moves of all that makes sense where the rig is: hunting, or not."""
        places = [v for v in map(self._beyond, _WATCHED) if v <= self._ceiling]
        tops = [min(self._beyond(_TOP), self._ceiling)] * (self._ceiling > self._v_c)
        fold, bottom = self._fold, self._bottom
        above, below = _HUNTING * fold, _QUIET_AGAIN * fold
        fall = self._move(bottom, _PATIENCE_S, below=_FALLEN * fold)
        rise = [self._move(top, _PATIENCE_S, above=_GROWN * fold) for top in tops]
        turn = (*(() if hunts else rise), fall)
        for v in (bottom, *places, *tops):
            yield _action('hold', self._move(v, _WATCH_S, wanted=v >= self._v_c))
        yield _action('reversal', *turn)
        for v in places:
            yield _action('reversal', *turn, self._move(v, _WATCH_S, False, above, below))

    def _move(
        self,
        speed: float,
        hold_s: float = 0.0,
        wanted: bool = True,
        above: float = 0.0,
        below: float = 0.0,
    ) -> Move:
        """Return a step with numbers as a person would write them, never above the ceiling."""
        step = Hold(
            min(_rounded(speed), self._ceiling),
            hold_s,
            until_above_m=_rounded(above, 3),
            until_below_m=_rounded(below, 3),
        )
        return Move(step, wanted)

    def _predicted(self, information: Array) -> list[Prediction]:
        """Return what is known of each quantity now, and will be after the profile."""
        names = ['v_c', 'v_n', *(f'A_u({speed:g} m/s)' for speed in self._wanted)]
        units = ['m/s', 'm/s', *(['m'] * len(self._wanted))]
        values = [self._v_c, self._v_n, *self._unstable(self._wanted).tolist()]
        stds = self._foresight.deviations.tolist(), self._foresight.spread(information).tolist()
        return [Prediction(*row) for row in zip(names, units, values, *stds, strict=True)]


def _action(kind: str, *moves: Move) -> tuple[str, str, tuple[Move, ...]]:
    """Return an action with the words that its steps give it."""
    return kind, ', then '.join(_words(move.step) for move in moves), moves


def _words(step: Hold) -> str:
    words = f'{step.speed_mps:.2f} m/s for {step.duration_s:g} s'
    ends = [
        f'{way} {1e3 * amplitude:.2g} mm'
        for way, amplitude in (('above', step.until_above_m), ('below', step.until_below_m))
        if amplitude
    ]
    return words + (f' or until {" or ".join(ends)}' if ends else '')


def _reason(taken: Sequence[Action]) -> str:
    """Say what the profile does most of the time."""
    lasts = {kind: sum(one.duration_s for one in taken if one.kind == kind) for kind in _DOES}
    return f'it {_DOES[max(lasts, key=lasts.__getitem__)]}'


def _rounded(value: float, digits: int = 4) -> float:
    """As a person would write it."""
    return float(f'{value:.{digits}g}')
