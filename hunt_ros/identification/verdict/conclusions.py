"""What a fit allows to say: numbers with intervals, guards, and the reasons for silence."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds, SteadyState
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.bracket import Bracket, contradicts, refutations
from hunt_ros.identification.fit import FittedLaw
from hunt_ros.identification.four_point import FourPoint, at_detunings, four_point
from hunt_ros.identification.growth_law import GrowthLaw, GrowthScales
from hunt_ros.identification.posterior import Posterior
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.record.observed import resolved
from hunt_ros.identification.record.segments import Segment
from hunt_ros.identification.result import GIVEN, PAPERS, FitSummary, Identification
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.silence import unknown_of
from hunt_ros.identification.uncertainty import critical_speed_bound, draw_laws, robust_covariance
from hunt_ros.identification.verdict.guards import support_of
from hunt_ros.identification.verdict.lack_of_fit import (
    contradictions,
    misfit_of,
    missed_transients,
)
from hunt_ros.identification.verdict.pure_error import LackOfFit
from hunt_ros.identification.verdict.quantities import Quantities
from hunt_ros.identification.verdict.reasons import reasons_of
from hunt_ros.samples import Record, Uncertain

#: Logarithm of a noise intensity, in units of A_ref^2 / s, below which there is none to see.
_UNSEEN = -30.0
#: Largest deviation of the logarithm of a noise intensity that is drawn: a factor of three.
_VAGUE_NOISE = 1.1
#: Share of draws rejected from which it is said.
_MANY = 0.5
#: RMS misfit of the limit cycle from which a law is no normal form of the rig.
_FAR_OFF = 0.05


@dataclass(frozen=True, eq=False)
class Evidence:
    """Everything the conclusions are drawn from."""

    laws: Sequence[FittedLaw]
    scales: GrowthScales
    states: Sequence[SteadyState]
    bracket: Bracket
    observed: ObservedCriticalSpeeds
    segments: Sequence[Segment]
    envelopes: Sequence[Envelope]
    records: Sequence[Record]

    @property
    def speeds(self) -> tuple[float, float]:
        """Lowest and highest speed of the data, m/s."""
        speed = np.concatenate([envelope.speed for envelope in self.envelopes])
        return float(speed.min()), float(speed.max())

    @property
    def hunting(self) -> list[SteadyState]:
        """Steady states on the limit cycle."""
        threshold = self.observed.threshold
        if threshold is None:
            return []
        return [state for state in self.states if state.amplitude > threshold]


def conclude(
    evidence: Evidence,
    settings: IdentificationSettings,
    warnings: list[str],
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
        Every null of its JSON is named by a warning.
    """
    laws = evidence.laws
    best = laws[0]
    trust = _trust(best, evidence, warnings)
    drawn, rejected = draw_laws(
        laws, settings, len(evidence.envelopes), trust.stretch, _admissible(evidence)
    )
    if rejected > _MANY:
        warnings.append(
            f'{100.0 * rejected:.0f} % of the laws around the fit are of no rig, or contradict'
            ' what was seen: the intervals are those of the others'
        )
    posterior = Posterior.of(
        best.law, drawn, evidence.speeds, _intensity(best, len(drawn), settings.seed)
    )
    numbers = Quantities(posterior, settings)
    support = support_of(best, posterior, evidence.segments, evidence.envelopes, settings)
    warnings += support.reasons
    fold = support.nonlinear and not trust.no_fold
    identified = numbers.identified(best.law.name) if support.complete else None
    if identified is not None and trust.no_form:
        warnings.append('the misfit is too large for a normal form: none is given')
        identified = None
    cubic = support.cubic and not trust.no_form
    four, no_recipe = _recipe(identified, evidence, warnings)
    unknown: dict[str, Uncertain | None] = dict.fromkeys(COEFFICIENTS)
    criticality = best.law.criticality if support.cubic and not trust.astray else None
    bracket = evidence.bracket
    if criticality == 'supercritical' and bracket.coexistence is not None:
        # Rest was no longer than the slow growth of a law that fits: it shows no coexistence.
        bracket = replace(bracket, coexistence=None)
    elif bracket.coexistence is not None:
        criticality = 'subcritical'
    observed, no_hysteresis = resolved(evidence.observed, criticality)
    result = Identification(
        normal_form=identified,
        v_c=numbers.critical_speed() if support.critical and not trust.astray else None,
        v_n=numbers.fold() if fold else None,
        hysteresis_width=numbers.width() if fold else None,
        coefficients=unknown if trust.no_form else numbers.coefficients(support),
        criticality=criticality,
        length_scale=settings.length_unit,
        time_scale=settings.time_unit,
        scales_from={
            'length': PAPERS if settings.length_scale is None else GIVEN,
            'time': PAPERS if settings.time_scale is None else GIVEN,
        },
        speeds=evidence.speeds,
        branches=numbers.branches() if cubic else (),
        steady_states=tuple(evidence.states),
        observed=observed,
        disturbance=numbers.disturbance(evidence.observed) if fold else None,
        four_point=four,
        fit=_summary(laws, evidence, trust),
        segments=tuple(evidence.segments),
        envelopes=tuple(evidence.envelopes),
        records=tuple(evidence.records),
        frequency_hz=_frequency(evidence),
        fold_amplitude=numbers.fold_amplitude() if fold else None,
        posterior=posterior,
        bracket=bracket,
    )
    why = reasons_of(result, support, trust.no_fold, no_recipe, no_hysteresis)
    return replace(
        result,
        notices=tuple(line for line in warnings if line not in why.values()),
        unknown=unknown_of(result.to_json(), why),
    )


def _admissible(evidence: Evidence) -> Callable[[GrowthLaw], bool] | None:
    """
    Whether a law drawn can be this rig's: None where not even the one chosen can.

    Growth from rest rises with the speed over the data, and what was seen stands.
    """
    chosen, seen = evidence.laws[0].law, tuple(evidence.bracket.why.values())
    speeds = chosen.detuning(np.linspace(*evidence.speeds, 9))

    def admissible(law: GrowthLaw) -> bool:
        rises = all(law.linear_slope(u) > 0.0 for u in speeds.tolist())
        return rises and not any(contradicts(law, event) for event in seen)

    return admissible if admissible(chosen) else None


def _intensity(best: FittedLaw, count: int, seed: int) -> NDArray[np.float64]:
    """Draws of the noise intensity D at the critical speed, m^2/s; NaN where none is seen."""
    by_speed, _, level = best.noise[:3]
    v_c = best.law.critical_speed
    level += 0.0 if v_c is None else by_speed * float(best.law.detuning(v_c))
    size = 0.5 * best.law.scales.amplitude**2 * math.exp(level)
    if level < _UNSEEN or not np.isfinite(best.fit.information).all():
        return np.full(count, math.nan)
    variance = np.linalg.pinv(best.fit.information, rcond=1e-13, hermitian=True)[-3, -3]
    spread = min(math.sqrt(max(float(variance), 0.0)), _VAGUE_NOISE)
    normal = np.random.default_rng([seed, count]).standard_normal(count)
    return np.asarray(size * np.exp(spread * normal))


@dataclass(frozen=True)
class _Trust:
    """How far a law is to be believed: its misfit, and what must not be said for it."""

    misfit: LackOfFit
    quintic: LackOfFit
    astray: str
    against: str

    @property
    def lacks(self) -> list[str]:
        """Why the law does not fit; empty where it does."""
        missed = f'lack of fit of the law ({100.0 * self.misfit.share:.1f} %)'
        lacks = [missed if self.misfit.flagged else '', self.astray, self.against]
        return [lack for lack in lacks if lack]

    @property
    def no_fold(self) -> str:
        """Why no fold is claimed; '' where one may be."""
        return self.lacks[0] if self.lacks else ''

    @property
    def no_form(self) -> bool:
        """Whether not even a normal form is given."""
        return bool(self.astray or self.against) or (
            self.misfit.flagged and self.misfit.share > _FAR_OFF
        )

    @property
    def stretch(self) -> float:
        """Factor on the intervals: a misfit is a systematic error, in its proportion."""
        return 1.0 + (min(self.misfit.share / 0.01, 10.0) if self.no_fold else 0.0)


def _trust(best: FittedLaw, evidence: Evidence, warnings: list[str]) -> _Trust:
    """Judge the law by limit cycles, transients and runs that contradict each other."""
    name = best.law.name
    misfit = misfit_of(best, evidence.hunting)
    refuted = refutations(best.law, evidence.bracket)
    missed, transients = missed_transients(best, evidence.segments, evidence.envelopes)
    astray = ''
    if not best.fit.converged:
        astray = (
            f'the fit of the {name} law has not converged (a gain of the log likelihood of'
            f' {best.fit.remaining:.2g} is still in reach)'
        )
        warnings.append(f'{astray}: nothing is read from it')
    elif missed > max(0.3 * transients, 0.5):
        astray = (
            f'{missed} of {transients} free transients go another way than the {name} law says'
        )
        warnings.append(f'lack of fit: {astray}; no fold is claimed')
    if not astray and refuted:
        astray = f'the {name} law contradicts what was seen: {refuted[0]}'
        warnings.append(f'lack of fit: {astray}; what was seen stands alone')
    # Growth that ends again inside the data is a parabola's, and no rig's.
    other, (low, high) = best.law.other_root, evidence.speeds
    if not astray and other is not None and low < other < high:
        astray = (
            f'the linear growth rate of the {name} law falls through zero again at'
            f' {other:.3g} m/s, inside the speeds of the data'
        )
        warnings.append(f'lack of fit: {astray}; no fold is claimed')
    # The paper's form may miss what a richer one follows: that too is to be known.
    quintic = next(
        misfit_of(one, evidence.hunting) for one in evidence.laws if one.departure == 0.0
    )
    if quintic.flagged and not misfit.flagged:
        warnings.append(
            f'lack of fit of the quintic form ({100.0 * quintic.share:.1f} %); further terms are'
            ' let in, and D7, D10, D15 are effective coefficients'
        )
    against = contradictions(evidence.hunting)
    warnings += against
    if misfit.flagged:
        warnings.append(
            f'lack of fit: the {name} law misses the limit cycle by'
            f' {100.0 * misfit.share:.1f} % (p = {misfit.p:.1g}); no fold is claimed'
        )
    return _Trust(misfit, quintic, astray, against[0] if against else '')


def _recipe(
    identified: IdentifiedNormalForm | None, evidence: Evidence, warnings: list[str]
) -> tuple[FourPoint | None, str]:
    """Run the paper's recipe on the limit cycles at its four detunings; or why not."""
    if identified is None:
        return None, 'the four-point recipe needs v_c and D1 of a normal form, and none is given'
    form = identified.form
    chosen = at_detunings(evidence.hunting, evidence.segments, form.critical_speed)
    if isinstance(chosen, str):
        return None, chosen
    eps = np.array([state.speed / form.critical_speed - 1.0 for state in chosen])
    radii = np.array([state.amplitude for state in chosen]) / (2.0 * form.length_scale)
    try:
        recipe = four_point(eps, radii, form.D1)
    except (IdentificationError, np.linalg.LinAlgError) as error:
        return None, f'four-point recipe: {error}'
    if recipe.warnings:
        warnings.append(
            f'{recipe.warnings[0]} ({len(recipe.warnings)} of 4 points; condition number'
            f' {recipe.condition_number:.3g})'
        )
    return recipe, ''


def _summary(laws: Sequence[FittedLaw], evidence: Evidence, trust: _Trust) -> FitSummary:
    """Return how the best law was fitted, and how well it fits."""
    best = laws[0]
    inside = best.fit.innovations
    size = inside[:, 0] * np.exp(0.5 * inside[:, 2])
    used = size[inside[:, 2] != 0.0]
    paper = sum(one.weight for one in laws if one.departure == 0.0)
    why = f"share of the evidence: the paper's form {paper:.2g}, further terms {1.0 - paper:.2g}"
    return FitSummary(
        method='trajectory likelihood',
        law=best.law.name,
        why=why,
        segments=sum(segment.used for segment in evidence.segments),
        initial_amplitudes=int(best.path.starts.sum()),
        clusters=best.path.clusters,
        residual_rms=evidence.scales.amplitude * float(np.sqrt(np.mean(used**2)))
        if used.size
        else math.nan,
        lack_of_fit=bool(trust.lacks),
        lack_of_fit_because=tuple(trust.lacks),
        lack_of_fit_p=trust.misfit.p,
        converged=best.fit.converged,
        condition_number=robust_covariance(best.fit, len(evidence.envelopes)).condition_number,
        v_c_bound=critical_speed_bound(best),
    )


def _frequency(evidence: Evidence) -> Uncertain:
    """Hunting frequency: the frame's, weighted by the power of the mode, and its spread."""
    frequency = np.concatenate([envelope.frequency for envelope in evidence.envelopes])
    power = np.concatenate([envelope.amplitude for envelope in evidence.envelopes]) ** 2
    power = np.nan_to_num(power)
    mean = (
        float(np.average(frequency, weights=power))
        if power.sum() > 0.0
        else float(np.mean(frequency))
    )
    spread = float(np.sqrt(np.mean((frequency - mean) ** 2)))
    return Uncertain(mean, max(spread, 0.01))
