"""
What to measure next: the profile that teaches the most a minute, under a bounded risk.

Actions are short pieces of a profile: holds, sweeps, reversals that the amplitude triggers,
kicks. Each is run ahead over draws of what is known (`foresight`); the one with the largest
expected drop of the logarithms of the deviations a second is taken, if the chance that hunting
begins unwanted stays within its bound, and the next is chosen from where that one ends. Looking
two actions ahead gains nothing measurable.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.profile import Hold, Profile, Ramp, Sweep
from hunt_ros.errors import ConfigError, IdentificationError
from hunt_ros.identification.foresight import QUIET, Ensemble, Foresight, Stretch
from hunt_ros.identification.plan_result import Action, Plan, Prediction, Rated
from hunt_ros.identification.plan_settings import PlanSettings
from hunt_ros.identification.posterior import Posterior
from hunt_ros.identification.result import Identification

__all__ = ['Plan', 'PlanSettings', 'plan']

Array = NDArray[np.float64]

#: Paths that rank the actions, and those that bound the risk.
_RANKING, _PATHS = 32, 160
#: Share of the bound on the risk that is free from the beginning.
_FREE = 0.3
#: Places in the hysteresis region at which to watch, and between which A_u is wanted.
_WATCHED = (0.2, 0.36, 0.5, 0.62, 0.74)
_WANTED = (0.36, 0.74)
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
        width = self._v_c - self._v_n
        self._low = min(slowest, self._v_n - 0.4 * width)
        self._wanted = self._where(settings.speeds_mps)
        self._foresight = Foresight(
            posterior, self._wanted, self._low, ceiling, _PATHS, settings.seed
        )
        self._fold = self._foresight.fold_amplitude
        self._start = settings.start_speed_mps or slowest
        places = [self._v_n + share * width for share in _WATCHED]
        self._places = [speed for speed in places if speed <= ceiling]
        unstable = known.branch('unstable', self._places)[0] if self._places else np.zeros(0)
        self._unstable = np.where(np.isfinite(unstable), unstable, self._fold)

    def _where(self, asked: tuple[float, ...]) -> tuple[float, ...]:
        """Return the speeds at which the unstable amplitude is wanted; there must be one."""
        width = self._v_c - self._v_n
        speeds = asked or tuple(_rounded(self._v_n + share * width) for share in _WANTED)
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
        taken: list[Rated] = []
        ranking: list[Rated] = []
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
        home = Ramp(_rounded(self._low), _RATE)
        begin = Ramp(_rounded(self._start), _RATE)
        steps = [step for one in taken for step in one.action.steps]
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

    def _rank(self, state: Ensemble, information: Array, left_s: float) -> list[Rated]:
        """Run all actions ahead on a few paths, the best first."""
        few = state.part(_RANKING)
        before = np.log(self._foresight.spread(information))
        rated = []
        for action in self._actions(few):
            after, told = self._foresight.follow(few, action.stretches)
            lasted = float((after.time - few.time).mean()) + action.cost_s
            if lasted <= 0.0 or lasted > left_s:
                continue
            gain = before - np.log(self._foresight.spread(information + told))
            escape = float(after.escaped.mean())
            rated.append(Rated(action, lasted, 60.0 * float(gain.sum()) / lasted, escape))
        return sorted(rated, key=lambda one: -one.gain_per_minute)

    def _first_within(
        self, state: Ensemble, rated: Sequence[Rated]
    ) -> tuple[Rated, Ensemble, Array] | None:
        """Take the best action whose risk, on all paths, is within its bound."""
        settings = self._settings
        for one in rated:
            if one.gain_per_minute < _NOTHING:
                break
            if not settings.kicks and one.action.kind == 'kick':
                continue
            after, told = self._foresight.follow(state, one.action.stretches)
            # Some of the bound is free at once, all of it at the end.
            used = float(after.time.mean()) / settings.budget_s
            escape = float(after.escaped.mean())
            if escape <= settings.max_escape * min(_FREE + (1.0 - _FREE) * used, 1.0):
                after.time[:] += one.action.cost_s
                return (
                    Rated(one.action, one.duration_s, one.gain_per_minute, escape),
                    after,
                    told,
                )
        return None

    def _actions(self, state: Ensemble) -> list[Action]:
        """All actions that make sense where the rig is."""
        v_n, v_c, fold = self._v_n, self._v_c, self._fold
        hunts = float(np.median(state.amplitude)) > QUIET * fold
        width = v_c - v_n
        tops = [v for v in (v_c + 0.1 * width, v_c + 0.25 * width) if v <= self._ceiling]
        tops = tops or ([self._ceiling] if self._ceiling > v_c else [])
        lows = (v_n - 0.06 * width, v_n - 0.25 * width)
        bottoms = [min(max(v, 0.1 * v_n), self._ceiling) for v in lows]
        places = self._places
        falls = [self._fall(low, share * fold) for low in bottoms for share in _FALLEN]
        rises = [self._rise(top, share * fold) for top in tops for share in _GROWN]
        watches = [self._watch(place) for place in places]
        found = [self._wait(place) for place in (*bottoms[:1], *places, *tops)]
        for top in tops:
            found.append(self._sweep(bottoms[-1], top))
        if hunts:
            found += falls
            found += [_joined(fall, watch) for fall in falls for watch in watches]
        else:
            found += [*rises, *watches]
            found += [_joined(rise, fall) for rise in rises for fall in falls]
            found += [
                _joined(rise, fall, watch)
                for rise in rises[:1] + rises[2:3]
                for fall in falls[:2]
                for watch in watches
            ]
            found += [
                self._kick(place, share * float(size))
                for place, size in zip(places, self._unstable, strict=True)
                for share in _KICKS
            ]
        return found

    def _wait(self, speed: float) -> Action:
        return Action(
            'hold',
            f'hold {speed:.2f} m/s for {_WAIT_S:g} s',
            (Hold(_rounded(speed), _WAIT_S, _RATE),),
            (Stretch(speed, _RATE, _WAIT_S, wanted=speed >= self._v_c),),
        )

    def _sweep(self, low: float, high: float) -> Action:
        words = f'sweep up to {high:.2f} and down to {low:.2f} m/s'
        return Action(
            'sweep',
            words,
            (Ramp(_rounded(high), _RATE), Ramp(_rounded(low), _RATE)),
            (Stretch(high, _RATE, wanted=True), Stretch(low, _RATE, wanted=True)),
        )

    def _rise(self, speed: float, amplitude: float) -> Action:
        words = f'up to {speed:.2f} m/s until {_mm(amplitude)}'
        level = _rounded(amplitude, 3)
        return Action(
            'reversal',
            words,
            (Hold(_rounded(speed), _PATIENCE_S, _RATE, until_above_m=level),),
            (Stretch(speed, _RATE, _PATIENCE_S, above=level, wanted=True),),
        )

    def _fall(self, speed: float, amplitude: float) -> Action:
        words = f'down to {speed:.2f} m/s until {_mm(amplitude)}'
        level = _rounded(amplitude, 3)
        return Action(
            'reversal',
            words,
            (Hold(_rounded(speed), _PATIENCE_S, _RATE, until_below_m=level),),
            (Stretch(speed, _RATE, _PATIENCE_S, below=level, wanted=True),),
        )

    def _watch(self, speed: float) -> Action:
        low, high = (_rounded(share * self._fold, 3) for share in (_QUIET_AGAIN, _HUNTING))
        words = f'watch {_WATCH_S:g} s at {speed:.2f} m/s where it goes'
        step = Hold(_rounded(speed), _WATCH_S, _RATE, until_above_m=high, until_below_m=low)
        return Action('reversal', words, (step,), (Stretch(speed, _RATE, _WATCH_S, high, low),))

    def _kick(self, speed: float, size: float) -> Action:
        high = _rounded(_HUNTING * self._fold, 3)
        note = f'kick the wheelset by {_mm(size)} now'
        stay_s = self._settings.rearm_s + _WATCH_S
        steps = (
            Ramp(_rounded(speed), _RATE),
            Hold(_rounded(speed), stay_s, _RATE, until_above_m=high, note=note),
        )
        ahead = Stretch(speed, _RATE), Stretch(speed, _RATE, _WATCH_S, high, kick=size)
        words = f'at {speed:.2f} m/s {note}, and watch {_WATCH_S:g} s'
        return Action('kick', words, steps, ahead, self._settings.rearm_s)

    def _predicted(self, information: Array) -> list[Prediction]:
        """Return what is known of each quantity now, and will be after the action."""
        names = ['v_c', 'v_n', *(f'A_u({speed:g} m/s)' for speed in self._wanted)]
        unstable = self._known.branch('unstable', self._wanted)[0]
        values = [self._v_c, self._v_n, *map(float, unstable)]
        before, after = self._foresight.deviations, self._foresight.spread(information)
        units = ['m/s', 'm/s', *(['m'] * len(self._wanted))]
        return [
            Prediction(name, unit, value, float(std), float(then))
            for name, unit, value, std, then in zip(
                names, units, values, before, after, strict=True
            )
        ]

    def _reason(self, taken: Sequence[Rated], quantities: Sequence[Prediction]) -> str:
        """Say what the profile does most of the time, and what for."""
        kinds: dict[str, float] = {}
        for one in taken:
            kinds[one.action.kind] = kinds.get(one.action.kind, 0.0) + one.duration_s
        words = {
            'hold': 'holds where the growth rate is least known',
            'sweep': 'sweeps through hunting and back',
            'reversal': 'crosses the middle amplitudes again and again, which show the law',
            'kick': 'kicks the wheelset near the unstable branch',
        }[max(kinds, key=lambda kind: kinds[kind])]
        most = max(quantities, key=lambda one: one.std / max(one.std_after, 1e-300))
        return (
            f'it {words}: the deviation of {most.name} should fall from {_size(most.std, most)}'
            f' to {_size(most.std_after, most)}'
        )


def _joined(*parts: Action) -> Action:
    """One action after the other, rated as one."""
    return Action(
        'reversal',
        ', then '.join(part.words for part in parts),
        tuple(step for part in parts for step in part.steps),
        tuple(stretch for part in parts for stretch in part.stretches),
    )


def _rounded(value: float, digits: int = 4) -> float:
    """As a person would write it."""
    return float(f'{value:.{digits}g}')


def _mm(amplitude: float) -> str:
    return f'{1e3 * amplitude:.2g} mm'


def _size(value: float, quantity: Prediction) -> str:
    return f'{1e6 * value:.2g} um' if quantity.unit == 'm' else f'{value:.2g} {quantity.unit}'
