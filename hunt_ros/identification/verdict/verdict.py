"""
What a fit allows to say: every number has conditions, and is given where all of them hold.

Nothing is reported because a fit returned it. What is not given has the first of its conditions
that failed as its reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds, SteadyState
from hunt_ros.dynamics.growth_law import GrowthLaw
from hunt_ros.dynamics.identified import EXISTS
from hunt_ros.dynamics.normal_form import COEFFICIENTS
from hunt_ros.identification.bracket import Bracket, contradicts, refutations
from hunt_ros.identification.fit import FittedLaw
from hunt_ros.identification.four_point import FourPoint, recipe
from hunt_ros.identification.posterior import Posterior
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.record.plateaus import Run
from hunt_ros.identification.result import GIVEN, PAPERS, FitSummary, Identification, percent
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.uncertainty import critical_speed_bound, draw_laws, linear_growth_std
from hunt_ros.identification.verdict.lack_of_fit import LackOfFit, lack_of_fit
from hunt_ros.identification.verdict.reasons import reasons, resolved, unknown_of
from hunt_ros.samples import Uncertain

#: Logarithm of a noise intensity, in units of A_ref^2 / s, below which there is none to see.
_UNSEEN = -30.0
#: Share of draws rejected from which it is said.
_MANY = 0.5
#: RMS misfit of the limit cycle from which a law is no normal form of the rig.
_FAR_OFF = 0.05
#: Difference of recordings, relative, from which they are not of one rig as it stands.
_DISAGREE = 0.1
#: Relative range of speeds below which a record is one at one speed.
_ONE_SPEED = 0.02
#: Largest relative deviation of v_c that still is knowledge of it; at which the sign of a
#: coefficient is known; at which quiet motion alone tells the time scale.
_VAGUE_SPEED, _VAGUE, _VAGUE_D1 = 0.1, 0.5, 0.3
#: A limit cycle so many times larger than what was measured was not seen.
_BEYOND = 1.1
#: Share of the largest amplitude below which motion shows linear growth.
_SMALL = 0.3
#: Cycles of free motion below which a record is too short for anything.
_FEWEST_STEPS = 12

#: What must hold for what: conditions in the order in which they are asked.
_LINEAR = ('speeds', 'believed', 'rises', 'critical', 'small')
_CUBIC = (*_LINEAR, 'time', 'passage', 'cubic')
#: The fold is seen where hunting ends: it needs no small motion near v_c.
_ONSET = ('speeds', 'believed', 'rises', 'time', 'passage')
_SHAPE = (*_ONSET, 'cubic')
_FOLD = (*_SHAPE, 'subcritical', 'limited', 'agree', 'fits')
_NEEDS: Mapping[str, tuple[str, ...]] = {
    'v_c': _LINEAR,
    **dict.fromkeys(('coefficients.D1', 'coefficients.D7'), (*_LINEAR, 'time', 'agree', 'fits')),
    **dict.fromkeys(
        ('coefficients.D4', 'coefficients.D10', 'coefficients.D15', 'branches'),
        (*_CUBIC, 'agree', 'fits'),
    ),
    'criticality': _SHAPE,
    'supercritical_probability': ('speeds', 'critical', *_ONSET, 'small'),
    'hysteresis_below': ('speeds', 'critical', *_ONSET, 'small', 'agree', 'fits'),
    'normal_form': (*_CUBIC, 'limited', 'agree', 'fits'),
    **dict.fromkeys(('v_n', 'fold_amplitude_m'), _FOLD),
    'disturbance_m': (*_FOLD, 'small'),
    'hysteresis_width': ('speeds', 'critical', *_FOLD, 'small'),
}


@dataclass(frozen=True, eq=False)
class Evidence:
    """Everything the verdict is drawn from."""

    fitted: FittedLaw
    runs: Sequence[Run]
    bracket: Bracket
    observed: ObservedCriticalSpeeds

    @property
    def names(self) -> list[str]:
        """Names of the recordings."""
        return list(dict.fromkeys(run.envelope.source for run in self.runs))

    @property
    def envelopes(self) -> list[Envelope]:
        """Envelopes of all runs."""
        return [run.envelope for run in self.runs]

    @property
    def moved(self) -> list[tuple[str, int, int]]:
        """Ways to and from hunting, and kicks: source, and first and last stamp, ns."""
        kicks = [*self.bracket.kicks, *(kick for run in self.runs for kick in run.kicks)]
        ways = [
            (event.source, event.start_ns, event.end_ns)
            for event in self.bracket.events
            if event.kind in ('grew', 'died')
        ]
        return ways + [(source, at, at) for source, at in kicks]

    @property
    def states(self) -> list[SteadyState]:
        """Steady states of all runs."""
        return [state for run in self.runs for state in run.states]

    @property
    def hunting(self) -> list[SteadyState]:
        """Steady states on the limit cycle."""
        threshold = self.observed.threshold
        return [state for state in self.states if threshold and state.amplitude > threshold]

    def along(self, name: str) -> NDArray[np.float64]:
        """Return one trace of all envelopes in a row."""
        return np.concatenate([getattr(one, name) for one in self.envelopes])

    def forcing(self, speed: float) -> float:
        """Noise intensity D of small motion at a speed, m^2/s; NaN where none is seen."""
        return float(_intensity(self.fitted, self.fitted.noise, speed))

    @property
    def speeds(self) -> tuple[float, float]:
        """Lowest and highest speed of the data, m/s."""
        speed = self.along('speed')
        return float(speed.min()), float(speed.max())


def conclude(
    evidence: Evidence, settings: IdentificationSettings, warnings: list[str]
) -> Identification:
    """
    Draw the conclusions of a fit.

    Parameters
    ----------
    evidence : Evidence
        Fitted laws and what was seen in the records.
    settings : IdentificationSettings
        For scales, speed errors and the seed.
    warnings : list of str
        What was said so far; grows.

    Returns
    -------
    Identification
        Every null of its JSON has its reason.
    """
    best = evidence.fitted
    misfit = lack_of_fit(best, evidence.names)
    failed = _misfits(evidence, misfit, warnings)
    lacks = [failed[name] for name in ('believed', 'rises', 'agree') if name in failed]
    lacks += [misfit.words] * misfit.flagged
    drawn, noise, rejected = draw_laws(best, settings, misfit.stretch, _admissible(evidence))
    if rejected > _MANY:
        warnings.append(
            f'{100.0 * rejected:.0f} % of the laws around the fit are of no rig, or contradict'
            ' what was seen: the intervals are those of the others'
        )
    posterior = Posterior(
        best.law,
        drawn,
        _intensity(best, noise, best.law.critical_speed or best.law.scales.speed),
        evidence.speeds,
        settings.prior_v_c[0] if settings.prior_v_c else None,
    )
    if not (misfit.flagged or failed.keys() & {'believed', 'agree'}):
        evidence = replace(evidence, bracket=evidence.bracket.where(posterior.coexist))
    failed |= _unsupported(best, posterior, evidence, settings, warnings)
    why = {
        name: next((failed[need] for need in needs if need in failed), '')
        for name, needs in _NEEDS.items()
    }
    speed_std = settings.speed_resolution_mps / math.sqrt(12.0)
    given = {
        name: None if why[name] else number
        for name, number in posterior.numbers(speed_std).items()
    }
    form = None if why['normal_form'] else posterior.identified(speed_std)
    criticality = None if why['criticality'] else best.law.criticality
    if (bracket := evidence.bracket).coexistence:
        criticality = 'subcritical'
    likely = None if why['supercritical_probability'] else posterior.supercritical
    if criticality == 'subcritical':
        why['hysteresis_below'] = 'the rig is subcritical: it has a hysteresis'
    below = None if why['hysteresis_below'] else posterior.hysteresis_below(speed_std)
    observed, no_hysteresis = resolved(evidence.observed, criticality)
    four = recipe(form, evidence.hunting, evidence.moved, warnings)
    result = Identification(
        normal_form=form,
        v_c=given['v_c'],
        v_n=given['v_n'],
        hysteresis_width=given['hysteresis_width'],
        coefficients={name: given[f'coefficients.{name}'] for name in COEFFICIENTS},
        criticality=criticality,
        supercritical_probability=0.0 if bracket.coexistence else likely,
        hysteresis_below=below,
        length_scale=settings.length_unit,
        time_scale=settings.time_unit,
        scales_from={
            'length': GIVEN if settings.length_scale_m else PAPERS,
            'time': GIVEN if settings.time_scale_s else PAPERS,
        },
        speeds=evidence.speeds,
        branches=() if why['branches'] else posterior.branch_points(),
        steady_states=tuple(evidence.states),
        observed=observed,
        disturbance=None if why['disturbance_m'] else posterior.disturbance(evidence.observed),
        four_point=four if isinstance(four, FourPoint) else None,
        fit=_summary(evidence, misfit, lacks),
        envelopes=tuple(evidence.envelopes),
        frequency_hz=_frequency(evidence),
        fold_amplitude=given['fold_amplitude_m'],
        notices=tuple(warnings),
        posterior=posterior,
        bracket=bracket,
    )
    told = reasons(bracket, why, four if isinstance(four, str) else '', no_hysteresis)
    return replace(result, unknown=unknown_of(result.to_json(), told))


def _admissible(evidence: Evidence) -> Callable[[GrowthLaw], bool] | None:
    """
    Whether a law drawn can be this rig's: None where not even the one chosen can.

    Growth from rest rises with the speed over the data, and what was seen stands.
    """
    chosen, seen = evidence.fitted.law, tuple(evidence.bracket.why.values())
    speeds = chosen.detuning(np.linspace(*evidence.speeds, 9))

    def admissible(law: GrowthLaw) -> bool:
        """Return True for a law that a rig can have."""
        rises = all(law.linear_slope(u) > 0.0 for u in speeds.tolist())
        return rises and not any(contradicts(law, evidence.forcing, event) for event in seen)

    return admissible if admissible(chosen) else None


def _intensity(best: FittedLaw, noise: NDArray[np.float64], speed: float) -> NDArray[np.float64]:
    """Noise intensity D at a speed, of one noise or many, m^2/s; NaN where none is seen."""
    level = noise[..., 2] + float(best.law.detuning(speed)) * noise[..., 0]
    seen = (level > _UNSEEN) & np.isfinite(best.fit.information).all()
    with np.errstate(over='ignore'):  # of a law that runs away
        return 0.5 * best.law.scales.amplitude**2 * np.exp(np.where(seen, level, math.nan))


def _misfits(evidence: Evidence, misfit: LackOfFit, warnings: list[str]) -> dict[str, str]:
    """Conditions that a law fails by what it misses: 'believed', 'rises', 'agree', 'fits'."""
    failed: dict[str, str] = {}
    for name, astray in (('believed', _astray(evidence)), ('rises', _turning(evidence))):
        if astray and not failed:
            failed[name] = astray
            warnings.append(f'lack of fit: {astray}')
    if against := _disagreement(evidence):
        failed['agree'] = against
        warnings.append(against)
    if misfit.flagged:
        lacks = f'lack of fit: {misfit.words}'
        chance = f'p = {misfit.p:.1g}' if misfit.p >= 0.001 else 'p < 0.001'
        wide = f'intervals are {misfit.stretch:.2g} times as wide'
        if misfit.held and misfit.share > _FAR_OFF:
            failed['fits'] = lacks
            wide = 'no fold is claimed'
        warnings.append(f'{lacks} ({chance}); {wide}')
    return failed


def _disagreement(evidence: Evidence) -> str:
    """Say which recordings show amplitudes or critical speeds too far apart; '' where none do."""
    if not evidence.fitted.fit.converged:
        return ''  # nothing is read from it, what recordings have of their own neither
    for k, what in ((0, 'amplitudes'), (2, 'critical speeds')):
        own = evidence.fitted.fit.own[:, k]
        low, high = int(np.argmin(own)), int(np.argmax(own))
        if own[high] - own[low] > _DISAGREE:
            return (
                f'runs contradict each other: the {what} of {evidence.names[high]} are'
                f' {math.exp(own[high] - own[low]):.2f} times those of {evidence.names[low]}'
            )
    return ''


def _astray(evidence: Evidence) -> str:
    """Why nothing is read from a law; '' where it is believed."""
    best = evidence.fitted
    if not best.fit.converged:
        return (
            'the fit of the law has not converged (a gain of the log likelihood of'
            f' {best.fit.remaining:.2g} is still in reach): nothing is read from it'
        )
    if refuted := refutations(best.law, evidence.forcing, evidence.bracket):
        return f'the law contradicts what was seen: {refuted[0]}'
    return ''


def _turning(evidence: Evidence) -> str:
    """Where growth ends again inside the data: that is a parabola's, and no rig's; '' if not."""
    other, (low, high) = evidence.fitted.law.other_root, evidence.speeds
    if other is not None and low < other < high:
        return (
            'the linear growth rate of the law falls through zero again at'
            f' {other:.3g} m/s, inside the speeds of the data'
        )
    return ''


def _unsupported(
    best: FittedLaw,
    posterior: Posterior,
    evidence: Evidence,
    settings: IdentificationSettings,
    warnings: list[str],
) -> dict[str, str]:
    """
    Return the conditions that the data fail, with the reasons.

    A critical speed needs several speeds, a time scale needs free motion, an unstable branch
    needs amplitudes on both sides of it.
    """
    law, (low, high), amplitude = best.law, evidence.speeds, evidence.along('amplitude')
    moved = bool(evidence.moved)
    hunts = evidence.observed.threshold is not None
    failed: dict[str, str] = {}
    speed = float(np.median(evidence.along('speed')))
    if not high - low > _ONE_SPEED * speed:
        growth = _growth_there(best, speed)
        failed['speeds'] = (
            f'one speed only ({speed:.3g} m/s; {growth}): v_c and the coefficients cannot be known'
        )
    elif int(np.isfinite(amplitude).sum()) < _FEWEST_STEPS:
        failed['speeds'] = 'too short: fewer than a few dozen hunting cycles'
    if reason := _no_critical_speed(law, posterior):
        rest = evidence.bracket.v_c if not hunts else None
        seen = '' if rest is None else f'only rest was seen, which puts v_c above {rest:.4g} m/s: '
        failed['critical'] = seen + reason
    elif not settings.prior_v_c and (reason := _no_small_motion(law, evidence, hunts)):
        failed['small'] = reason
    D1 = posterior.number('D1')
    told = D1 is not None and D1.std < _VAGUE_D1 * abs(D1.value)
    if not (moved or settings.prior_D1 or told):
        failed['time'] = 'no free transient: D1 cannot be known; give prior_D1 of the rig'
    elif hunts and not moved:
        warnings.append('no free transient: the time scale rests on the prior or on quiet motion')
    soft = 0.0 if evidence.bracket.coexistence else posterior.supercritical
    if not hunts:
        failed['passage'] = (
            'all amplitudes are of one kind: no passage between quiet and hunting, so that the'
            ' nonlinear coefficients cannot be known'
        )
    elif soft is None:
        failed['passage'] = 'hardly any of the laws that the data allow has a v_c, at which D4 is'
    elif 1.0 - EXISTS < soft < EXISTS:
        failed['cubic'] = f'{percent(1.0 - soft)} subcritical: the sign of D4 is not determined'
    if law.criticality == 'supercritical':
        failed['subcritical'] = (
            'the law has no fold, against what was seen'
            if evidence.bracket.coexistence
            else 'a supercritical rig has no fold and no unstable branch'
        )
    elif not moved:
        failed['subcritical'] = 'no free transient: none passed by the unstable branch'
    size, sizes = _limit(law, high), np.array([_limit(x, high) for x in posterior.drawn])
    endless = float(np.mean(~np.isfinite(sizes))) if sizes.size else 1.0
    if law.criticality != 'supercritical' and not (
        math.isfinite(size) and endless <= 1.0 - EXISTS
    ):
        failed['limited'] = (
            f'nothing ends the growth at v_c in {100.0 * endless:.0f} % of the laws that the data'
            f' allow{"" if math.isfinite(size) else ", the likeliest among them"}: no normal form'
            ' is given'
        )
    v_c, top = law.critical_speed, float(np.nanmax(amplitude))
    if v_c is not None and not failed.keys() & {'speeds', 'critical'} and not low <= v_c <= high:
        end = f'end at {high:.3g} m/s' if v_c > high else f'begin at {low:.3g} m/s'
        warnings.append(f'v_c = {v_c:.3g} m/s is a forecast: the data {end}')
    fold, (ended, seen_from) = posterior.number('v_n'), evidence.bracket.v_n
    folds = not failed.keys() & set(_FOLD)
    if folds and fold and ended is None and fold.value < (seen_from or 0.0):
        warnings.append(
            f'v_n = {fold.value:.4g} m/s is a forecast: the limit cycle was seen from'
            f' {seen_from:.4g} m/s on, and not to end'
        )
    shaped = law.criticality != 'supercritical' and not failed.keys() & set(_CUBIC)
    ends = float(np.fmax(low, posterior.chosen[1]))
    largest = np.nanmax(law.steady_amplitudes(np.linspace(ends, high, 41))[1], initial=0.0)
    if shaped and largest > _BEYOND * top:
        warnings.append(
            f'the limit cycle (to {1e3 * largest:.2g} mm) is a forecast: no amplitude above'
            f' {1e3 * top:.2g} mm was measured'
        )
    return failed


def _growth_there(best: FittedLaw, speed: float) -> str:
    """Linear growth rate at one speed, where the motion shows its sign; or that it does not."""
    u = float(best.law.detuning(speed))
    rate, std = float(best.law.linear(u)), linear_growth_std(best, u)
    if not std < _VAGUE * abs(rate):
        return 'this motion does not show its linear growth rate'
    return f'linear growth rate {rate:.2g} +/- {std:.1g} 1/s'


def _no_critical_speed(law: GrowthLaw, posterior: Posterior) -> str:
    """Why v_c is not known: it must exist, in most draws, near the data, and not vaguely."""
    v_c, (low, high), (lowest, highest) = law.critical_speed, posterior.speeds, posterior.reach
    if v_c is None:
        return 'the linear growth rate nowhere rises through zero: v_c is not known'
    if not lowest <= v_c <= highest:
        return (
            f'v_c would lie far {"above" if v_c > high else "below"} the speeds of the data'
            f' ({low:.3g} to {high:.3g} m/s): it is not given'
        )
    number = posterior.number('v_c')
    if number is None or number.std > _VAGUE_SPEED * v_c:
        return 'v_c is not determined by these data'
    return ''


def _no_small_motion(law: GrowthLaw, evidence: Evidence, hunts: bool) -> str:
    """Why v_c is not known: no motion so small that it shows linear growth was seen near it."""
    speed, amplitude = evidence.along('speed'), evidence.along('amplitude')
    most = _SMALL * np.nanmax(amplitude) if hunts else np.inf
    small, v_c = speed[amplitude < most], law.critical_speed
    if not hunts and v_c is not None and v_c < float(speed.min()):
        return (
            f'v_c would lie at {v_c:.3g} m/s, below the speeds of the data, and all amplitudes are'
            ' of one kind: whether they are rest or a limit cycle cannot be told'
        )
    if not small.size:
        return (
            'no small motion was seen: the limit cycle does not show where rest becomes unstable'
        )
    low, high = float(small.min()), float(small.max())
    reach = 0.5 * (high - low)
    if v_c is None or low - reach <= v_c <= high + reach:
        return ''
    return (
        f'v_c would lie near {v_c:.2g} m/s, and small motion was seen between {low:.3g} and'
        f' {high:.3g} m/s only: elsewhere only the limit cycle, which does not show where rest'
        ' becomes unstable'
    )


def _limit(law: GrowthLaw, fastest: float) -> float:
    """Amplitude of the stable limit cycle at v_c, or where the data end before, m; or NaN."""
    at = fastest if law.critical_speed is None else min(law.critical_speed, fastest)
    return float(law.steady_amplitudes(at)[1][0])


def _summary(evidence: Evidence, misfit: LackOfFit, lacks: Sequence[str]) -> FitSummary:
    """Return how the best law was fitted, and how well it fits."""
    best = evidence.fitted
    inside = best.fit.innovations
    used = (inside[:, 0] * np.exp(0.5 * inside[:, 2]))[inside[:, 2] != 0.0]
    rms = float(np.sqrt(np.mean(used**2))) if used.size else math.nan
    return FitSummary(
        law=best.law.name,
        segments=int(best.fit.problem.path.starts.sum()),
        residual_rms=best.law.scales.amplitude * rms,
        lack_of_fit=bool(lacks),
        lack_of_fit_because=tuple(lacks),
        lack_of_fit_p=misfit.p,
        converged=best.fit.converged,
        v_c_bound=critical_speed_bound(best),
    )


def _frequency(evidence: Evidence) -> Uncertain:
    """Hunting frequency: the frame's, weighted by the power of the mode, and its spread."""
    frequency, power = evidence.along('frequency'), evidence.along('amplitude') ** 2
    power = np.nan_to_num(power)
    mean = float(np.average(frequency, weights=power if power.sum() > 0.0 else None))
    spread = float(np.sqrt(np.mean((frequency - mean) ** 2)))
    return Uncertain(mean, max(spread, 0.01))
