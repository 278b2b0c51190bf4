"""
What to measure next: the profile that teaches the most a minute, under a bounded risk.

Actions are short pieces of a profile: holds, sweeps, reversals that the amplitude triggers,
kicks. Each is run ahead over draws of what is known (`foresight`); the one with the largest
expected drop of the logarithms of the deviations a second is taken, if the chance that hunting
begins unwanted stays within its bound, and the next is chosen from where that one ends. Looking
two actions ahead gains nothing measurable.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.profile import Hold, Profile, Ramp, Sweep
from hunt_ros.errors import ConfigError, IdentificationError
from hunt_ros.identification.foresight import QUIET, Ensemble, Foresight, Move
from hunt_ros.identification.plan_settings import PlanSettings
from hunt_ros.identification.posterior import Posterior
from hunt_ros.identification.result import Identification
from hunt_ros.samples import as_json, key

__all__ = ['Plan', 'PlanSettings', 'plan']

Array = NDArray[np.float64]

#: Paths that rank the actions, and those that bound the risk.
_RANKING, _PATHS = 32, 160
#: Share of the bound on the risk that is free from the beginning.
_FREE = 0.3
#: Places in the hysteresis region at which to watch, and between which A_u is wanted.
_WATCHED = (0.2, 0.36, 0.5, 0.62, 0.74)
_WANTED = (0.36, 0.74)
#: Speeds beyond v_c, and below v_n, on the way from v_n (0) to v_c (1).
_TOPS, _BOTTOMS = (1.1, 1.25), (-0.06, -0.25)
#: No speed below this part of v_n, however wide the hysteresis.
_SLOWEST = 0.1
#: Rate of a set point, m/s^2; of the first sweep, and how far it goes: down, relative to its top,
#: and up, relative to the fastest speed so far.
_RATE, _FIRST_RATE, _FIRST_LOW, _FIRST_HIGH = 0.2, 0.05, 0.75, 1.2
#: Time in which to watch where the motion goes, to wait at a speed, and the longest wait for an
#: amplitude, s.
_WATCH_S, _WAIT_S, _PATIENCE_S = 12.0, 15.0, 40.0
#: Amplitudes of triggers in those at the fold: grown, fallen, quiet again, hunting.
_GROWN, _FALLEN, _QUIET_AGAIN, _HUNTING = (0.3, 1.2), (0.7, 0.4), 0.1, 1.15
#: Sizes of kicks in the unstable amplitude.
_KICKS = (0.8, 1.0)
#: Share by which the deviation of a quantity must fall, for the run to teach anything.
_LEARNT = 0.01
#: A gain of the logarithms of the deviations in a minute that is not worth running the rig for.
_NOTHING = 1e-3
#: What a profile does most of the time.
_DOES = {
    'hold': 'holds where the growth rate is least known',
    'sweep': 'sweeps through hunting and back',
    'reversal': 'crosses the middle amplitudes again and again, which show the law',
    'kick': 'kicks the wheelset near the unstable branch',
}


@dataclass(frozen=True)
class Action:
    """
    A piece of a profile.

    Parameters
    ----------
    kind : 'hold', 'sweep', 'reversal' or 'kick'
    words : str
        What it does.
    moves : tuple of Move
        As the drive runs it, and what each step is for.
    duration_s, gain_per_minute, escape_chance : float
        Known once it was run ahead: expected, s; drop of the logarithms of the deviations,
        summed over the quantities, 1/min; chance that hunting has begun unwanted by its end.
    """

    kind: str
    words: str = field(metadata=key('action'))
    moves: tuple[Move, ...] = field(repr=False, metadata=key(''))
    duration_s: float = math.nan
    gain_per_minute: float = math.nan
    escape_chance: float = math.nan


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
    steps : sequence of Action
        The actions taken, in their order.
    actions : sequence of Action
        All actions from where the rig is now, the best first.
    """

    profile: Profile = field(metadata=key(''))
    reason: str
    duration_s: float
    longest_s: float
    escape: float | None = field(default=None, metadata=key('escape_chance'))
    quantities: Sequence[Prediction] = ()
    steps: Sequence[Action] = ()
    actions: Sequence[Action] = ()

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
    low, high = known.speeds
    ceiling = settings.speed_ceiling_mps or high
    slowest = min(settings.start_speed_mps or low, low)
    if ceiling <= slowest:
        raise ConfigError(
            f'plan: speed_ceiling_mps must be above the slowest speed, {slowest:g} m/s,'
            f' got {ceiling:g}'
        )
    if settings.start_speed_mps and settings.start_speed_mps > ceiling:
        raise ConfigError(
            f'plan: start_speed_mps must not be above the ceiling, {ceiling:g} m/s,'
            f' got {settings.start_speed_mps:g}'
        )
    v_c, v_n, posterior = known.v_c, known.v_n, known.posterior
    if posterior is None or v_c is None or v_n is None:
        unknown = [name for name in ('v_c', 'v_n') if getattr(known, name) is None]
        return _first_sweep(known, settings, slowest, ceiling, unknown)
    return _Planner(known, posterior, settings, slowest, ceiling).plan()


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
    rate = max(_FIRST_RATE, 2.0 * (ceiling - lowest) / settings.budget_s)
    sweep = Sweep(lowest, ceiling, _rounded(rate))
    times = max(int(settings.budget_s * rate / (2.0 * (ceiling - lowest))), 1)
    profile = Profile((sweep,) * times, 'plan')
    said = known.unknown.get(unknown[0], '') if unknown else ''
    reason = (
        f'{" and ".join(unknown) or "the law"} must be known before anything better can be'
        f' planned: a sweep to {ceiling:.3g} m/s shows where hunting begins and ends'
        + (f' ({said})' if said else '')
    )
    rest = known.bracket.v_c
    if rest is not None and ceiling <= rest:
        reason = (
            f'rest was seen up to {rest:.3g} m/s already: a sweep to {ceiling:.3g} m/s shows the'
            ' damping below, not where hunting begins'
        )
    return Plan(profile, reason, profile.duration_s, profile.duration_s)


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
        assert known.v_c is not None
        assert known.v_n is not None
        self._known, self._settings, self._ceiling = known, settings, ceiling
        self._v_c, self._v_n = known.v_c.value, known.v_n.value
        self._low = min(slowest, max(self._beyond(-0.4), _SLOWEST * self._v_n))
        self._wanted = self._where(settings.speeds_mps)
        self._foresight = Foresight(
            posterior, self._wanted, self._low, ceiling, _PATHS, settings.seed
        )
        self._fold = self._foresight.fold_amplitude
        self._start = settings.start_speed_mps or slowest
        self._places = [v for v in map(self._beyond, _WATCHED) if v <= ceiling]

    def _beyond(self, share: float) -> float:
        """Return a speed by its share of the way from v_n to v_c, m/s."""
        return self._v_n + share * (self._v_c - self._v_n)

    def _speed(self, speed: float) -> float:
        """Return a speed as a person would write it, and never above the ceiling, m/s."""
        return min(_rounded(speed), self._ceiling)

    def _where(self, asked: tuple[float, ...]) -> tuple[float, ...]:
        """Return the speeds at which the unstable amplitude is wanted; there must be one."""
        speeds = asked or tuple(_rounded(self._beyond(share)) for share in _WANTED)
        there = np.isfinite(self._known.branch('unstable', speeds)[0])
        if asked and not there.all():
            speed = speeds[int(np.argmin(there))]
            raise ConfigError(
                f'plan: speeds_mps: no unstable amplitude is known at {speed:g} m/s, expected'
                f' speeds between v_n = {self._v_n:.4g} and v_c = {self._v_c:.4g} m/s'
            )
        return tuple(speed for speed, known in zip(speeds, there, strict=True) if known)

    def plan(self) -> Plan:
        """Choose actions until the budget is used."""
        foresight, settings = self._foresight, self._settings
        state = foresight.start(self._start, settings.start_amplitude_m)
        information = foresight.nothing
        taken: list[Action] = []
        ranking: list[Action] = []
        while True:
            elapsed = float(state.time.mean())
            rated = self._rank(state, information, settings.budget_s - elapsed)
            ranking = ranking or rated
            found = self._first_within(state, rated)
            if found is None:
                break
            best, state, told = found
            information = information + told
            taken.append(best)
        quantities = self._predicted(information)
        if not any(one.std_after < (1.0 - _LEARNT) * one.std for one in quantities):
            raise IdentificationError(
                f'plan: nothing within {settings.budget_s:g} s, {self._ceiling:g} m/s and a chance'
                f' of {settings.max_escape:g} of unwanted hunting teaches anything'
            )
        begin, home = (Ramp(self._speed(v), _RATE) for v in (self._start, self._low))
        steps = [move.step for one in taken for move in one.moves]
        profile = Profile((begin, *steps, home), 'plan')
        return Plan(
            profile,
            self._reason(taken, quantities),
            float(state.time.mean()),
            profile.duration_s,
            float(state.escaped.mean()),
            quantities,
            taken,
            ranking,
        )

    def _rank(self, state: Ensemble, information: Array, left_s: float) -> list[Action]:
        """Run all actions ahead on a few paths, the best first."""
        few = state.part(_RANKING)
        before = np.log(self._foresight.spread(information))
        rated = []
        for action in self._actions(float(np.median(few.amplitude)) > QUIET * self._fold):
            after, told = self._foresight.follow(few, action.moves)
            lasted = float((after.time - few.time).mean())
            if lasted <= 0.0 or lasted > left_s:
                continue
            gain = before - np.log(self._foresight.spread(information + told))
            found = lasted, 60.0 * float(gain.sum()) / lasted, float(after.escaped.mean())
            rated.append(Action(action.kind, action.words, action.moves, *found))
        return sorted(rated, key=lambda one: -one.gain_per_minute)

    def _first_within(
        self, state: Ensemble, rated: Sequence[Action]
    ) -> tuple[Action, Ensemble, Array] | None:
        """Take the best action whose risk, on all paths, is within its bound."""
        settings = self._settings
        for one in rated:
            if one.gain_per_minute < _NOTHING:
                break
            if not settings.kicks and one.kind == 'kick':
                continue
            after, told = self._foresight.follow(state, one.moves)
            # Some of the bound is free at once, all of it at the end.
            used = float(after.time.mean()) / settings.budget_s
            escape = float(after.escaped.mean())
            if escape <= settings.max_escape * min(_FREE + (1.0 - _FREE) * used, 1.0):
                return replace(one, escape_chance=escape), after, told
        return None

    def _actions(self, hunts: bool) -> Iterator[Action]:
        """All actions that make sense where the rig is: on the limit cycle, or not."""
        places, fold, slowest = self._places, self._fold, _SLOWEST * self._v_n
        above = [v for v in map(self._beyond, _TOPS) if v <= self._ceiling]
        tops = above or [self._ceiling] * (self._ceiling > self._v_c)
        bottoms = [min(max(self._beyond(x), slowest), self._ceiling) for x in _BOTTOMS]
        falls = [self._until(v, share * fold, False) for v in bottoms for share in _FALLEN]
        rises = [self._until(v, share * fold, True) for v in tops for share in _GROWN]
        watches = [self._watch(v) for v in places]
        yield from (self._wait(v) for v in (*bottoms[:1], *places, *tops))
        yield from (self._sweep(bottoms[-1], v) for v in tops)
        if hunts:
            yield from falls
            yield from (_joined(*pair) for pair in product(falls, watches))
            return
        yield from rises
        yield from watches
        yield from (_joined(*pair) for pair in product(rises, falls))
        # Of the triggers one a top: the rest of these is worth as much.
        triples = product(rises[:: len(_GROWN)], falls[: len(_FALLEN)], watches)
        yield from (_joined(*triple) for triple in triples)
        unstable = self._known.branch('unstable', places)[0] if places else np.zeros(0)
        sizes = np.where(np.isfinite(unstable), unstable, fold).tolist()
        for (v, size), share in product(zip(places, sizes, strict=True), _KICKS):
            yield self._kick(v, share * size)

    def _hold(
        self,
        speed: float,
        hold_s: float,
        wanted: bool,
        above: float = 0.0,
        below: float = 0.0,
        kick: float = 0.0,
        note: str = '',
    ) -> Move:
        step = Hold(
            self._speed(speed),
            hold_s,
            _RATE,
            until_above_m=_rounded(above, 3),
            until_below_m=_rounded(below, 3),
            note=note,
        )
        return Move(step, wanted, kick)

    def _wait(self, speed: float) -> Action:
        words = f'hold {speed:.2f} m/s for {_WAIT_S:g} s'
        return Action('hold', words, (self._hold(speed, _WAIT_S, speed >= self._v_c),))

    def _sweep(self, low: float, high: float) -> Action:
        words = f'sweep up to {high:.2f} and down to {low:.2f} m/s'
        ramps = (Move(Ramp(self._speed(v), _RATE), wanted=True) for v in (high, low))
        return Action('sweep', words, tuple(ramps))

    def _until(self, speed: float, amplitude: float, up: bool) -> Action:
        words = f'{"up" if up else "down"} to {speed:.2f} m/s until {_mm(amplitude)}'
        above, below = (amplitude, 0.0) if up else (0.0, amplitude)
        return Action('reversal', words, (self._hold(speed, _PATIENCE_S, True, above, below),))

    def _watch(self, speed: float) -> Action:
        words = f'watch {_WATCH_S:g} s at {speed:.2f} m/s where it goes'
        above, below = _HUNTING * self._fold, _QUIET_AGAIN * self._fold
        return Action('reversal', words, (self._hold(speed, _WATCH_S, False, above, below),))

    def _kick(self, speed: float, size: float) -> Action:
        note, above = f'kick the wheelset by {_mm(size)} now', _HUNTING * self._fold
        ready = self._hold(speed, self._settings.rearm_s, False, note='get ready to kick')
        kick = self._hold(speed, _WATCH_S, False, above, kick=size, note=note)
        words = f'at {speed:.2f} m/s {note}, and watch {_WATCH_S:g} s'
        return Action('kick', words, (ready, kick))

    def _predicted(self, information: Array) -> list[Prediction]:
        """Return what is known of each quantity now, and will be after the action."""
        names = ['v_c', 'v_n', *(f'A_u({speed:g} m/s)' for speed in self._wanted)]
        units = ['m/s', 'm/s', *(['m'] * len(self._wanted))]
        values = [self._v_c, self._v_n, *self._known.branch('unstable', self._wanted)[0].tolist()]
        stds = self._foresight.deviations.tolist(), self._foresight.spread(information).tolist()
        return [Prediction(*row) for row in zip(names, units, values, *stds, strict=True)]

    def _reason(self, taken: Sequence[Action], quantities: Sequence[Prediction]) -> str:
        """Say what the profile does most of the time, and what for."""
        kinds = dict.fromkeys(_DOES, 0.0)
        for one in taken:
            kinds[one.kind] += one.duration_s
        words = _DOES[max(kinds, key=lambda kind: kinds[kind])]
        most = max(quantities, key=lambda one: one.std / max(one.std_after, 1e-300))
        return (
            f'it {words}: the deviation of {most.name} should fall from {_size(most.std, most)}'
            f' to {_size(most.std_after, most)}'
        )


def _joined(*parts: Action) -> Action:
    """One action after the other, rated as one."""
    words = ', then '.join(part.words for part in parts)
    return Action('reversal', words, tuple(move for part in parts for move in part.moves))


def _rounded(value: float, digits: int = 4) -> float:
    """As a person would write it."""
    return float(f'{value:.{digits}g}')


def _mm(amplitude: float) -> str:
    return f'{1e3 * amplitude:.2g} mm'


def _size(value: float, quantity: Prediction) -> str:
    return f'{1e6 * value:.2g} um' if quantity.unit == 'm' else f'{value:.2g} {quantity.unit}'
