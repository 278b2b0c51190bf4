"""From records to an identified normal form: the order of the work, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from hunt_ros.analysis.steady_state import (
    ObservedCriticalSpeeds,
    SteadyState,
    hunting_threshold,
    observed_critical_speeds,
)
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS, NormalForm
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.beat import without_beat
from hunt_ros.identification.envelope import (
    WINDOW_CYCLES,
    WINDOW_REACH,
    WINDOW_VARIANCE,
    Envelope,
    channels_of,
)
from hunt_ros.identification.four_point import PAPER_DETUNINGS, FourPoint, four_point
from hunt_ros.identification.growth_law import (
    QUINTIC,
    GrowthScales,
    from_normal_form,
    to_normal_form,
)
from hunt_ros.identification.hunting_frequency import find_frequency, tracked_envelope
from hunt_ros.identification.integral_fit import integral_start
from hunt_ros.identification.path_likelihood import Path
from hunt_ros.identification.plateaus import Segment, analyse_record, find_kicks
from hunt_ros.identification.result import BranchPoint, FitSummary, Identification
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.trajectory_fit import Prior, TrajectoryFit, fit_path
from hunt_ros.identification.uncertainty import (
    Covariance,
    draws,
    jacobian,
    robust_covariance,
    summary,
)
from hunt_ros.samples import Record, Uncertain

#: Length of the blocks of a run that stand in for runs, s.
_BLOCK_S = 15.0
#: Draws behind the intervals of speeds and branches.
_DRAWS = 400
#: Rounds in which jumps of the path are looked for.
_GATES = 6


def identify(
    records: Sequence[Record],
    settings: IdentificationSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> Identification:
    """
    Identify the normal form from one or several recordings.

    Parameters
    ----------
    records : sequence of Record
        Each with `lateral` and `speed`; with `roller` the roughness line is removed.
    settings : IdentificationSettings, optional
        What is known of the rig, and how to identify it.
    progress : callable, optional
        Told which fraction of the work is done, 0 to 1.

    Returns
    -------
    Identification

    Raises
    ------
    IdentificationError
        If no record can be used at all.
    """
    settings = settings or IdentificationSettings()
    warnings: list[str] = []
    channels = []
    for record in records:
        try:
            channels.append(channels_of(record))
        except IdentificationError as error:
            if len(records) == 1:
                raise
            warnings.append(f'left out: {error}')
    if not channels:
        raise IdentificationError(
            f'none of {len(records)} records can be used'
            + (f'; first reason: {warnings[0]}' if warnings else '')
        )
    frequency = find_frequency(channels, settings)
    envelopes: list[Envelope] = []
    segments: list[Segment] = []
    states: list[SteadyState] = []
    for channel in channels:
        envelope = tracked_envelope(channel, frequency, settings)
        if np.isfinite(envelope.amplitude).sum() < 4:
            warnings.append(f'{channel.source}: no stretch without drop-outs; left out')
            continue
        parts, steady = analyse_record(channel, envelope, settings)
        envelopes.append(envelope)
        segments += parts
        states += steady
    if not envelopes:
        raise IdentificationError('no record has a stretch without drop-outs')
    if not any(channel.roller.size for channel in channels):
        warnings.append('no roller angle: a roughness line, if there is one, is not removed')

    observed = observed_critical_speeds(states)
    path, scales = _path(envelopes, frequency, settings)
    fit, path = _fit(path, scales, settings, observed)
    return _conclude(
        fit, path, scales, settings, envelopes, segments, states, observed, warnings, records
    )


def _path(
    envelopes: Sequence[Envelope], frequency: float, settings: IdentificationSettings
) -> tuple[Path, GrowthScales]:
    """Put all envelopes in a row, in the units of the fit."""
    speed = np.concatenate([envelope.speed for envelope in envelopes])
    phasor: NDArray[np.complex128] = np.concatenate([without_beat(e).phasor for e in envelopes])
    scales = GrowthScales(
        speed=float(np.median(speed)),
        amplitude=float(np.nanpercentile(np.abs(phasor), 95.0)),
        length_scale=settings.length_scale,
        time_scale=settings.time_scale,
        frequency_hz=frequency,
    )
    restart, clusters, count = [], [], 0
    for envelope in envelopes:
        kicked = find_kicks(envelope)
        begins = kicked.copy()
        begins[1:] |= kicked[:-1]
        begins[0] = True
        restart.append(begins)
        if len(envelopes) >= 8:
            block = np.zeros(envelope.time.size, dtype=np.int64)
        else:
            block = ((envelope.time - envelope.time[0]) / _BLOCK_S).astype(np.int64)
        clusters.append(block + count)
        count += int(block.max()) + 1
        phasor[sum(len(r) for r in restart[:-1]) :][: begins.size][kicked] = np.nan
    path = Path(
        np.concatenate([envelope.time for envelope in envelopes]),
        speed / scales.speed - 1.0,
        np.asarray(phasor / scales.amplitude, dtype=np.complex128),
        np.concatenate(restart),
        np.concatenate(clusters),
        WINDOW_VARIANCE * (0.5 * WINDOW_CYCLES / frequency) ** 2,
        WINDOW_REACH * 0.5 * WINDOW_CYCLES / frequency,
    )
    return path, scales


def _priors(scales: GrowthScales, settings: IdentificationSettings) -> list[Prior]:
    """Turn what is known from elsewhere into functions of the law."""
    priors: list[Prior] = []
    if settings.prior_v_c is not None:
        v_c, std = settings.prior_v_c
        u = v_c / scales.speed - 1.0

        def offset(p: NDArray[np.float64]) -> float:
            slope = max(float(p[1] + 2.0 * p[2] * u), 1e-3)
            return float(p[0] + p[1] * u + p[2] * u**2) / slope * scales.speed

        priors.append((offset, 0.0, std))
    if settings.prior_D1 is not None:

        def linear(p: NDArray[np.float64]) -> float:
            form = to_normal_form(p, scales)
            if form is None:
                return float(p[1]) * scales.time_scale
            return form.D1

        priors.append((linear, *settings.prior_D1))
    return priors


def _fit(
    path: Path,
    scales: GrowthScales,
    settings: IdentificationSettings,
    observed: ObservedCriticalSpeeds,
) -> tuple[TrajectoryFit, Path]:
    """Start from integral least squares, and fit the paths."""
    amplitude = np.abs(path.phasor)
    known = amplitude[np.isfinite(amplitude)]
    threshold = hunting_threshold(known) or float(np.median(known))
    quiet = known[known <= threshold]
    floor = 2.0 * float(np.median(quiet)) if quiet.size else 0.1
    fastest = 2.0 * math.pi * scales.frequency_hz
    step = float(np.median(np.diff(path.time)))
    change = np.abs(np.diff(path.phasor))
    usual = float(np.nanmedian(change)) ** 2
    noise = np.log([max(0.3 * usual / step, 1e-12), max(0.3 * usual, 1e-12), 1e-3])
    priors = _priors(scales, settings)
    laws = [integral_start(path, floor, fastest, QUINTIC), *_templates(path, scales, observed)]
    starts = [
        fit_path(path, np.concatenate([law, noise]), fastest, priors, None, 8) for law in laws
    ]
    starts = [fit for fit in starts if math.isfinite(fit.log_likelihood)]
    best = max(starts, key=lambda fit: fit.log_likelihood)
    fit = fit_path(path, best.theta, fastest, priors)
    # A kick too small to be seen in its window shows as a jump of the path: start anew there.
    for _ in range(_GATES):
        jumps = _jumps(fit)
        if not jumps.any():
            break
        path = path.broken_at(jumps)
        fit = fit_path(path, fit.theta, fastest, priors)
    return fit, path


def _templates(
    path: Path, scales: GrowthScales, observed: ObservedCriticalSpeeds
) -> list[NDArray[np.float64]]:
    """
    Laws of the usual shapes at the observed speeds, as further starts.

    The likelihood has more than one hill; which is the highest, the data decide.
    """
    speeds = scales.speed * (1.0 + np.quantile(path.u, [0.25, 0.5, 0.75]))
    v_c = observed.v_c or float(speeds[2])
    common = {
        'critical_speed': v_c,
        'length_scale': scales.length_scale,
        'time_scale': scales.time_scale,
        'frequency_hz': scales.frequency_hz,
    }
    # Growth by a third of a cycle's share over the range of speeds; amplitudes of order A_ref.
    rate = 0.2 * scales.frequency_hz * scales.time_scale * 5.0
    big = rate / scales.ratio
    forms = [
        NormalForm(**common, D1=rate, D4=big, D7=0.0, D10=0.0, D15=-big / scales.ratio),
        NormalForm(**common, D1=rate, D4=-big, D7=0.0, D10=0.0, D15=0.0),
    ]
    return [from_normal_form(form, scales) for form in forms]


def _jumps(fit: TrajectoryFit) -> NDArray[np.bool_]:
    """Innovations that stand out from all others, and from their neighbours."""
    size = np.abs(fit.innovations[:, :2]).max(axis=1)
    usual = max(1.4826 * float(np.median(np.abs(fit.innovations[:, 0]))), 0.5)
    largest = maximum_filter1d(size, 7, mode='constant')
    jumps: NDArray[np.bool_] = (size > 6.0 * usual) & (size >= largest)
    return jumps


def _conclude(
    fit: TrajectoryFit,
    path: Path,
    scales: GrowthScales,
    settings: IdentificationSettings,
    envelopes: Sequence[Envelope],
    segments: Sequence[Segment],
    states: Sequence[SteadyState],
    observed: ObservedCriticalSpeeds,
    warnings: list[str],
    records: Sequence[Record],
) -> Identification:
    """Put numbers, intervals and warnings together."""
    runs = len(envelopes)
    covariance = robust_covariance(fit, runs)
    if runs < 8:
        warnings.append(
            f'{runs} independent runs: intervals rest on blocks of {_BLOCK_S:g} s and are widened'
        )
    law = fit.law
    form = to_normal_form(law, scales)
    if form is None:
        warnings.append('the linear growth rate nowhere rises through zero: v_c is not known')
    elif form.D15 >= 0.0 and form.D4 > 0.0:
        warnings.append('no restoring quintic term was found: no normal form is given')
        form = None
    sample = draws(law, covariance, _DRAWS, settings.seed)
    forms = [to_normal_form(p, scales) for p in sample]
    speed_std = _speed_std(settings)
    identified = None
    coefficients: dict[str, Uncertain | None] = dict.fromkeys(COEFFICIENTS)
    v_c = v_n = width = None
    branches: list[BranchPoint] = []
    if form is not None:
        identified = _identified(form, law, covariance, scales, speed_std)
        for index, name in enumerate(COEFFICIENTS, start=1):
            std = math.sqrt(identified.covariance[index, index])
            value = getattr(form, name)
            half = covariance.quantile * std
            coefficients[name] = Uncertain(value, std, value - half, value + half)
        extra = speed_std(form.critical_speed)
        v_c = summary(form.critical_speed, _each(forms, 'critical_speed'), extra)
        fold = form.nonlinear_critical_speed
        if fold is not None:
            v_n = summary(fold, _each(forms, 'nonlinear_critical_speed'), speed_std(fold))
            width = summary(
                form.critical_speed - fold, _each(forms, 'hysteresis_width'), speed_std(0.0)
            )
        branches = _branches(form, forms, path, scales)
    predicted = fit.innovations
    rms = float(np.sqrt(np.mean((predicted[:, 0] * np.exp(0.5 * predicted[:, 2])) ** 2)))
    recipe = _recipe(form, states, warnings)
    return Identification(
        normal_form=identified,
        v_c=v_c,
        v_n=v_n,
        hysteresis_width=width,
        coefficients=coefficients,
        criticality=None if form is None else form.criticality,
        length_scale=settings.length_scale,
        time_scale=settings.time_scale,
        branches=branches,
        steady_states=tuple(states),
        observed=observed,
        disturbance=None,
        four_point=recipe,
        fit=FitSummary(
            method='trajectory likelihood',
            law='quintic',
            why='',
            segments=int(path.restart.sum()),
            clusters=path.clusters,
            residual_rms=rms * scales.amplitude,
            lack_of_fit=False,
            lack_of_fit_p=math.nan,
            condition_number=covariance.condition_number,
        ),
        warnings=tuple(warnings),
        segments=tuple(segments),
        envelopes=tuple(envelopes),
        records=tuple(records),
    )


def _speed_std(settings: IdentificationSettings) -> Callable[[float], float]:
    """Deviation of a speed by resolution and scale of the reading, m/s, as a function."""

    def deviation(speed: float) -> float:
        return math.hypot(
            settings.speed_resolution / math.sqrt(12.0), settings.speed_scale_std * speed
        )

    return deviation


def _each(forms: Sequence[NormalForm | None], name: str) -> NDArray[np.float64]:
    """One attribute of each drawn form; NaN where there is none."""
    values = [None if form is None else getattr(form, name) for form in forms]
    return np.array([math.nan if value is None else value for value in values])


def _identified(
    form: NormalForm,
    law: NDArray[np.float64],
    covariance: Covariance,
    scales: GrowthScales,
    speed_std: Callable[[float], float],
) -> IdentifiedNormalForm:
    """Carry the covariance of the law over to (v_c, D1, D4, D7, D10, D15)."""

    def vector(p: NDArray[np.float64]) -> NDArray[np.float64]:
        other = to_normal_form(p, scales)
        if other is None:
            return np.full(6, math.nan)
        return IdentifiedNormalForm(other).vector

    widths = np.sqrt(np.maximum(np.diag(covariance.matrix), 0.0))
    slope = np.nan_to_num(jacobian(vector, law, widths))
    matrix = slope @ covariance.matrix @ slope.T
    matrix[0, 0] += speed_std(form.critical_speed) ** 2
    return IdentifiedNormalForm(form, matrix, {'method': 'trajectory likelihood'})


def _branches(
    form: NormalForm,
    forms: Sequence[NormalForm | None],
    path: Path,
    scales: GrowthScales,
) -> list[BranchPoint]:
    """Both branches with their intervals over the speeds of the data."""
    low, high = (scales.speed * (1.0 + x) for x in (path.u.min(), path.u.max()))
    points = []
    speeds = np.linspace(low, high, 41)
    fold = form.nonlinear_critical_speed
    if fold is not None and low < fold < high:
        speeds = np.unique(np.concatenate([speeds, fold + np.array([1e-3, 0.02, 0.05])]))
    drawn = [other.steady_amplitudes(speeds) for other in forms if other is not None]
    unstable, stable = form.steady_amplitudes(speeds)
    for k, speed in enumerate(speeds):
        entry = []
        for branch, index in ((stable, 1), (unstable, 0)):
            sample = np.array([pair[index][k] for pair in drawn])
            entry.append(
                summary(float(branch[k]), sample, least=0.0) if sample.size > 20 else None
            )
        points.append(BranchPoint(float(speed), entry[0], entry[1]))
    return points


def _recipe(
    form: NormalForm | None, states: Sequence[SteadyState], warnings: list[str]
) -> FourPoint | None:
    """Run the paper's recipe on the four hunting states nearest to its four speeds."""
    if form is None:
        return None
    threshold = hunting_threshold(np.array([state.amplitude for state in states]))
    hunting = [state for state in states if threshold is not None and state.amplitude > threshold]
    if len(hunting) < 4:
        return None
    eps = np.array([state.speed / form.critical_speed - 1.0 for state in hunting])
    chosen = {int(np.argmin(np.abs(eps - target))) for target in PAPER_DETUNINGS}
    if len(chosen) < 4:
        return None
    index = sorted(chosen)
    radii = np.array([hunting[k].amplitude for k in index]) / (2.0 * form.length_scale)
    try:
        recipe = four_point(eps[index], radii, form.D1)
    except IdentificationError as error:
        warnings.append(str(error))
        return None
    warnings += recipe.warnings
    return recipe


def update(
    prior: Identification | None,
    records: Sequence[Record],
    settings: IdentificationSettings | None = None,
    keep: int = 20,
) -> Identification:
    """
    Identify again when new recordings have closed, over a bounded history.

    Parameters
    ----------
    prior : Identification or None
        The last one; its recordings are kept.
    records : sequence of Record
        New recordings.
    settings : IdentificationSettings, optional
        What is known of the rig, and how to identify it.
    keep : int
        Recordings that are kept at most, the newest ones.

    Returns
    -------
    Identification

    Raises
    ------
    IdentificationError
        If no record can be used.
    """
    known = list(prior.records) if prior is not None else []
    return identify([*known, *records][-keep:], settings)
