"""What a fit allows to say: numbers with intervals, guards, and the reasons for silence."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import (
    ObservedCriticalSpeeds,
    SteadyState,
)
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS, NormalForm
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.envelope import Envelope
from hunt_ros.identification.four_point import PAPER_DETUNINGS, FourPoint, four_point
from hunt_ros.identification.growth_law import QUINTIC, GrowthLaw, GrowthScales
from hunt_ros.identification.guards import Support, support_of
from hunt_ros.identification.lack_of_fit import (
    LackOfFit,
    contradictions,
    following,
    lack_of_fit,
    missed_transients,
)
from hunt_ros.identification.law_choice import FittedLaw
from hunt_ros.identification.result import BranchPoint, FitSummary, Identification
from hunt_ros.identification.segments import Segment
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.uncertainty import draw_laws, robust_covariance, summary
from hunt_ros.samples import Record, Uncertain

#: Speeds at which the branches are given.
_BRANCH_POINTS = 41


@dataclass(frozen=True, eq=False)
class Evidence:
    """Everything the conclusions are drawn from."""

    laws: Sequence[FittedLaw]
    scales: GrowthScales
    states: Sequence[SteadyState]
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
    progress: Callable[[float], None] | None = None,
) -> Identification:
    """
    Draw the conclusions of a fit.

    Parameters
    ----------
    evidence : Evidence
        Fitted laws and what was seen in the records.
    settings : IdentificationSettings
        For scales, speed errors and the bootstrap.
    warnings : list of str
        What was said so far; grows.
    progress : callable, optional
        Told which fraction is done.

    Returns
    -------
    Identification
    """
    laws = following(evidence.laws, evidence.hunting)
    best = laws[0]
    runs = len(evidence.envelopes)
    misfit = lack_of_fit(best.law, evidence.hunting)
    against = contradictions(evidence.hunting)
    missed, transients = missed_transients(best, evidence.segments, evidence.envelopes)
    astray = missed > max(0.3 * transients, 0.5)
    if astray:
        warnings.append(
            f'lack of fit: {missed} of {transients} free transients go another way than the'
            f' {best.law.name} law says; no fold is claimed'
        )
    flagged = misfit.flagged or bool(against) or astray
    # The paper's form may miss what a richer one follows: that too is to be known.
    quintic = next(
        lack_of_fit(one.law, evidence.hunting) for one in evidence.laws if one.law.name == QUINTIC
    )
    if quintic.flagged and not misfit.flagged:
        warnings.append(
            f'lack of fit of the quintic form ({100.0 * quintic.share:.1f} %); the law chosen'
            f' is {best.law.name}, and D7, D10, D15 are effective coefficients'
        )
    warnings += against
    # A misfit is a systematic error: it widens all intervals in its proportion.
    stretch = 1.0 + (min(misfit.share / 0.01, 10.0) if flagged else 0.0)
    drawn = draw_laws(laws, settings, runs, stretch, progress)
    numbers = _Numbers(best.law, drawn, evidence.speeds, settings)
    support = support_of(
        best, numbers.forms, evidence.states, evidence.segments, evidence.envelopes, settings
    )
    warnings += support.reasons
    if misfit.flagged:
        warnings.append(
            f'lack of fit: the {best.law.name} law misses the limit cycle by'
            f' {100.0 * misfit.share:.1f} % (p = {misfit.p:.1g}); no fold is claimed'
        )
    fold = support.nonlinear and not flagged
    identified = numbers.identified(best.law.name) if support.complete else None
    if identified is not None and (astray or against or (flagged and misfit.share > 0.05)):
        warnings.append('the misfit is too large for a normal form: none is given')
        identified = None
    recipe = _recipe(identified, evidence.hunting, warnings)
    return Identification(
        normal_form=identified,
        v_c=numbers.critical_speed() if support.critical else None,
        v_n=numbers.fold() if fold else None,
        hysteresis_width=numbers.width() if fold else None,
        coefficients=numbers.coefficients(support),
        criticality=best.law.criticality if support.cubic and not astray else None,
        length_scale=settings.length_scale,
        time_scale=settings.time_scale,
        branches=numbers.branches() if support.cubic else (),
        steady_states=tuple(evidence.states),
        observed=evidence.observed,
        disturbance=numbers.disturbance(evidence.observed) if fold else None,
        four_point=recipe,
        fit=_summary(laws, evidence, misfit, flagged or quintic.flagged),
        warnings=tuple(warnings),
        segments=tuple(evidence.segments),
        envelopes=tuple(evidence.envelopes),
        records=tuple(evidence.records),
        frequency_hz=_frequency(evidence),
    )


class _Numbers:
    """Quantities of a law, each with the spread that the draws give it."""

    def __init__(
        self,
        law: GrowthLaw,
        drawn: Sequence[GrowthLaw],
        speeds: tuple[float, float],
        settings: IdentificationSettings,
    ) -> None:
        self._law, self._drawn, self._settings = law, drawn, settings
        self._low, self._high = speeds
        self.form = law.normal_form(self._low, self._high)
        self.forms: list[NormalForm | None] = [
            one.normal_form(self._low, self._high) for one in drawn
        ]
        self._folds = [one.saddle_node(self._lowest) for one in drawn]

    @property
    def _lowest(self) -> float:
        return self._low - 0.3 * (self._high - self._low)

    def _speed_std(self, speed: float) -> float:
        """Deviation of a speed by resolution and scale of the reading, m/s."""
        return math.hypot(
            self._settings.speed_resolution / math.sqrt(12.0),
            self._settings.speed_scale_std * speed,
        )

    def critical_speed(self) -> Uncertain | None:
        v_c = self._law.critical_speed
        if v_c is None:
            return None
        return summary(
            v_c, _values([one.critical_speed for one in self._drawn]), self._speed_std(v_c)
        )

    def fold(self) -> Uncertain | None:
        v_n = self._law.saddle_node(self._lowest)
        return None if v_n is None else summary(v_n, _values(self._folds), self._speed_std(v_n))

    def width(self) -> Uncertain | None:
        v_c, v_n = self._law.critical_speed, self._law.saddle_node(self._lowest)
        if v_c is None or v_n is None:
            return None
        ends = zip(self._drawn, self._folds, strict=True)
        sample = _values(
            [
                None if fold is None or one.critical_speed is None else one.critical_speed - fold
                for one, fold in ends
            ]
        )
        # A scale error of the speed stretches the width, a resolution blurs both its ends.
        extra = math.hypot(
            self._settings.speed_resolution / math.sqrt(6.0),
            self._settings.speed_scale_std * (v_c - v_n),
        )
        return summary(v_c - v_n, sample, extra)

    def coefficients(self, support: Support) -> dict[str, Uncertain | None]:
        known: dict[str, Uncertain | None] = dict.fromkeys(COEFFICIENTS)
        if self.form is None:
            return known
        for name in COEFFICIENTS:
            if support.knows(name):
                sample = _values([None if f is None else getattr(f, name) for f in self.forms])
                known[name] = summary(getattr(self.form, name), sample)
        return known

    def identified(self, name: str) -> IdentifiedNormalForm | None:
        if self.form is None:
            return None
        rows = np.array([IdentifiedNormalForm(f).vector for f in self.forms if f is not None])
        centre = IdentifiedNormalForm(self.form).vector
        # Far draws of a flat direction are cut at the quantiles that the intervals show.
        low, high = np.percentile(rows, [1.0, 99.0], axis=0)
        spread = np.clip(rows, low, high) - centre
        matrix = spread.T @ spread / len(rows)
        matrix[0, 0] += self._speed_std(self.form.critical_speed) ** 2
        provenance = {'method': 'trajectory likelihood', 'law': name}
        return IdentifiedNormalForm(self.form, matrix, provenance)

    def branches(self) -> tuple[BranchPoint, ...]:
        speeds = np.linspace(self._low, self._high, _BRANCH_POINTS)
        fold = self._law.saddle_node(self._lowest)
        if fold is not None and self._low < fold < self._high:
            speeds = np.unique(np.concatenate([speeds, fold + np.array([1e-4, 0.01, 0.03, 0.1])]))
        drawn = [one.steady_amplitudes(speeds) for one in self._drawn]
        unstable, stable = self._law.steady_amplitudes(speeds)

        def at(k: int, value: float, index: int) -> Uncertain | None:
            sample = np.array([pair[index][k] for pair in drawn])
            # Where a draw has no such branch there it has met zero or the fold: that is
            # part of its interval, and no reason to hide the branch.
            return summary(value, sample, least=0.3)

        return tuple(
            BranchPoint(float(speed), at(k, float(stable[k]), 1), at(k, float(unstable[k]), 0))
            for k, speed in enumerate(speeds)
        )

    def disturbance(self, observed: ObservedCriticalSpeeds) -> Uncertain | None:
        """Disturbance that explains the observed jump up: A_u there, Appendix A."""
        if observed.v_c is None:
            return None
        speed = np.array([observed.v_c])
        value = float(self._law.steady_amplitudes(speed)[0][0])
        sample = np.array([float(one.steady_amplitudes(speed)[0][0]) for one in self._drawn])
        return summary(value, sample, least=0.5)


def _values(values: Sequence[float | None]) -> NDArray[np.float64]:
    return np.array([math.nan if value is None else value for value in values])


def _recipe(
    identified: IdentifiedNormalForm | None,
    hunting: Sequence[SteadyState],
    warnings: list[str],
) -> FourPoint | None:
    """Run the paper's recipe on the hunting states nearest to its four detunings."""
    if identified is None or len(hunting) < 4:
        return None
    form = identified.form
    eps = np.array([state.speed / form.critical_speed - 1.0 for state in hunting])
    chosen = sorted({int(np.argmin(np.abs(eps - target))) for target in PAPER_DETUNINGS})
    if len(chosen) < 4:
        warnings.append('four-point recipe: no four limit cycles near eps = -0.2, -0.1, 0, 0.1')
        return None
    radii = np.array([hunting[k].amplitude for k in chosen]) / (2.0 * form.length_scale)
    try:
        recipe = four_point(eps[chosen], radii, form.D1)
    except (IdentificationError, np.linalg.LinAlgError) as error:
        warnings.append(f'four-point recipe: {error}')
        return None
    if recipe.warnings:
        warnings.append(
            f'{recipe.warnings[0]} ({len(recipe.warnings)} of 4 points; condition number'
            f' {recipe.condition_number:.3g})'
        )
    return recipe


def _summary(
    laws: Sequence[FittedLaw], evidence: Evidence, misfit: LackOfFit, flagged: bool
) -> FitSummary:
    best = laws[0]
    inside = best.fit.innovations
    size = inside[:, 0] * np.exp(0.5 * inside[:, 2])
    used = size[inside[:, 2] != 0.0]
    others = ', '.join(f'{one.law.name} {one.weight:.2g}' for one in laws)
    return FitSummary(
        method='trajectory likelihood',
        law=best.law.name,
        why=f'share of the evidence: {others}',
        segments=int(best.path.restart.sum()),
        clusters=best.path.clusters,
        residual_rms=evidence.scales.amplitude * float(np.sqrt(np.mean(used**2)))
        if used.size
        else math.nan,
        lack_of_fit=flagged,
        lack_of_fit_p=misfit.p,
        condition_number=robust_covariance(best.fit, len(evidence.envelopes)).condition_number,
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
