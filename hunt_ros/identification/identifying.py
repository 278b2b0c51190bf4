"""From records to an identified normal form: the order of the work, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter
from os import PathLike

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hunt_ros.analysis.steady_state import (
    ObservedCriticalSpeeds,
    observed_critical_speeds,
    threshold_of_motion,
)
from hunt_ros.dynamics.growth_law import GrowthScales
from hunt_ros.dynamics.mode_shape import ModeShape, fitted_shape
from hunt_ros.errors import IdentificationError
from hunt_ros.estimation.record_lines import RecordLines
from hunt_ros.identification.bracket import bracket_of
from hunt_ros.identification.executors import Mapper, Tell, mapper
from hunt_ros.identification.fit import fit_law
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.preparation import Recording, Source, motion_in, runs_in
from hunt_ros.identification.record.channels import runs as spans
from hunt_ros.identification.record.envelope import (
    STEP_CYCLES,
    WINDOW_CYCLES,
    WINDOW_OVERLAP,
    WINDOW_REACH,
    WINDOW_VARIANCE,
    Envelope,
)
from hunt_ros.identification.record.hunting_frequency import looked_at
from hunt_ros.identification.record.mode_ratio import measured_ratio
from hunt_ros.identification.record.plateaus import Run
from hunt_ros.identification.record.screening import (
    Stretch,
    above_noise,
    doubts,
    held_amplitude,
    refuse_two_rigs,
    repeated,
)
from hunt_ros.identification.result import Identification
from hunt_ros.identification.settings import FREQUENCIES_HZ, IdentificationSettings
from hunt_ros.identification.verdict.verdict import Evidence, conclude
from hunt_ros.samples import Record

#: Share of the work that is done when all is read, when the envelopes are seen, and when the fit
#: stands.
_READ, _SEEN, _FITTED = 0.3, 0.6, 0.8
#: Amplitude of the fit's unit, of the largest one: however little of the time a rig hunts.
_NEAR_TOP = 0.9
#: Instants over which the power of the roller's lines is taken to be one.
_LINE_SPAN = 9
#: Windows in a row with the same coarse speed from which on it is held.
_HELD = 6
#: Distance of a line from the hunting, relative, within which it is the hunting.
_ITSELF = 0.15


def identify(
    records: Source | Iterable[Source],
    settings: IdentificationSettings | None = None,
    progress: Tell | None = None,
) -> Identification:
    """
    Identify the normal form from one or several recordings.

    Parameters
    ----------
    records : Record, callable, or iterable of them
        Each with `lateral` and `speed`; what is callable reads one, on the workers of
        `settings.cluster` where that is given, and its samples stay there. The known lines are
        removed by the angle of `roller`, or where that is missing by one that follows from the
        speed.
    settings : IdentificationSettings, optional
        What is known of the rig, and how to identify it.
    progress : callable, optional
        Told which fraction of the work is done, 0 to 1.

    Returns
    -------
    Identification
        What the data do not carry is None there, with the reason in its `warnings`.

    Raises
    ------
    IdentificationError
        If no record can be used at all, or something else than records is given.
    """
    sources = _sources(records)
    settings = settings or IdentificationSettings()
    tell = progress or (lambda fraction: None)
    warnings: list[str] = []
    with mapper(settings.cluster) as mapped:
        recordings = _usable(sources, settings, mapped, warnings)
        tell(_READ)
        settings = _with_resolution(settings, recordings, warnings)
        frequency, fixed, turning = _hunting_frequency(recordings, settings, mapped, warnings)
        work = partial(runs_in, frequency_hz=frequency, fixed_hz=fixed, turning=turning)
        runs = _runs(recordings, work, settings.flange_clearance_m, mapped, warnings)
        tell(_SEEN)
        states = [state for run in runs for state in run.states]
        bracket = bracket_of(runs)
        kicks = [*bracket.kicks, *(kick for run in runs for kick in run.kicks)]
        threshold = threshold_of_motion(np.concatenate([run.envelope.amplitude for run in runs]))
        observed = ObservedCriticalSpeeds()
        if threshold is not None:
            observed = observed_critical_speeds(states, kicks)
            observed = replace(observed, threshold=observed.threshold or threshold)
        path, scales = _path(runs, frequency, settings)
        fitted = fit_law(path, scales, settings, observed.v_c)
        tell(_FITTED)
        result = conclude(Evidence(fitted, runs, bracket, observed), settings, warnings)
        result = replace(result, records=_given(recordings))
        if (found := result.normal_form) is not None:
            shape = _mode_shape(runs)
            result = replace(result, normal_form=replace(found, mode_shape=shape))
    tell(1.0)
    return result


def _with_resolution(
    settings: IdentificationSettings, recordings: Sequence[Recording], warnings: list[str]
) -> IdentificationSettings:
    """Return the settings with the step that the readings of the speed show."""
    step = max(one.digest.speed_step for one in recordings)
    if step <= settings.speed_resolution_mps:
        return settings
    warnings.append(
        f'speed readings in steps of {step:.3g} m/s: the deviations of critical speeds hold'
        f' {step / math.sqrt(12.0):.2g} m/s for it'
    )
    return replace(settings, speed_resolution_mps=step)


def _sources(given: Source | Iterable[Source]) -> list[Source]:
    """Return the records, one or several; a path is none."""
    single = isinstance(given, Record | str | PathLike) or callable(given)
    sources = [given] if single else list(given)  # type: ignore[arg-type]
    for item in sources:
        if not (isinstance(item, Record) or callable(item)):
            raise IdentificationError(
                f'identify: expected records, got {item!r:.80};'
                ' hunt_ros.bag.read_record reads one from a path'
            )
    return sources  # type: ignore[return-value]


def _usable(
    sources: Sequence[Source],
    settings: IdentificationSettings,
    mapped: Mapper,
    warnings: list[str],
) -> list[Recording]:
    """Read the recordings; return those that count."""
    count = len(sources)
    for _, _, number in settings.ignore:
        if number > count:
            raise IdentificationError(
                f'ignore: recording {number} of {count} has no interval to leave out'
            )
    given = [Recording(source, k, settings) for k, source in enumerate(sources, start=1)]
    _read(given, mapped)
    left_out = zip(settings.ignore, *(one.digest.ignored for one in given), strict=True)
    warnings += [
        f'ignore: no sample is between {low:g} and {high:g} s'
        for (low, high, _), *some in left_out
        if not any(some)
    ]
    recordings = _distinct(given, warnings)
    warnings += [line for one in recordings for line in one.digest.said]
    refused = [one.digest.refused for one in recordings if one.digest.refused]
    if refused and len(recordings) == 1:
        raise IdentificationError(refused[0])
    warnings += [f'left out: {reason}' for reason in refused]
    if len(refused) == len(recordings):
        reason = f' (the first: {warnings[0]})' if warnings else ''
        raise IdentificationError(f'none of {len(recordings)} records can be used{reason}')
    warnings += doubts([stretch for _, _, stretch in _places(recordings)], settings)
    return recordings


def _read(recordings: Sequence[Recording], mapped: Mapper) -> None:
    """Have recordings read where the work is done."""
    digests = mapped(attrgetter('digest'), recordings)
    for one, digest in zip(recordings, digests, strict=True):
        one.digest = digest


def _distinct(given: Sequence[Recording], warnings: list[str]) -> list[Recording]:
    """
    Leave out what was given twice, and give each recording a name of its own.

    Of two that overlap the longer one stays whole: the other one may be cut out of it.
    """
    refuse_two_rigs([one.digest for one in given])
    warnings += [
        f'{one.digest.source}: damaged: {one.digest.problems}'
        for one in given
        if one.digest.problems
    ]
    kept: list[Recording] = []
    for one in sorted(given, key=lambda one: one.digest.span[0] - one.digest.span[1]):
        again = repeated(one.digest, [other.digest for other in kept])
        if again is not None:
            low, high, whose = again
            cut = '' if math.isinf(high) else f' from {low:.4g} to {high:.4g} s'
            warnings.append(f'left out: {one.digest.source}{cut}: the same samples as {whose}')
            if not cut:
                continue
            one = one.with_settings(ignore=(*one.settings.ignore, (low, high, 0)))
        kept.append(one)
    kept.sort(key=lambda one: one.number)
    named: dict[str, int] = {}
    names: set[str] = set()
    for one in kept:
        source = one.name = one.digest.source
        while one.name in names:
            count = named[source] = named.get(source, 1) + 1
            one.name = f'{source} ({count})'
        names.add(one.name)
    return kept


def _places(recordings: Sequence[Recording]) -> list[tuple[Recording, int, Stretch]]:
    """All stretches in which the rig runs, each with its recording and its number there."""
    return [(one, k, part) for one in recordings for k, part in enumerate(one.digest.stretches)]


def _given(recordings: Sequence[Recording]) -> tuple[Record, ...]:
    """Return those that were given as records; what a callable read stays where it was read."""
    given = [one for one in recordings if isinstance(one.source, Record) and one.digest.measures]
    return tuple(replace(one.samples[0], source=one.name) for one in given)


def _hunting_frequency(
    recordings: list[Recording],
    settings: IdentificationSettings,
    mapped: Mapper,
    warnings: list[str],
) -> tuple[float, list[float], list[float]]:
    """
    Look for the hunting and for lines that are none.

    Returns its frequency, and those lines: at one frequency, Hz, and in turns of the roller.

    A roller whose angle nobody gave is known by its line: where one is found, the recordings are
    read again with the diameter that it tells.
    """
    places = _places(recordings)
    stretches = [stretch for _, _, stretch in places]
    chosen = [places[k] for k in looked_at(stretches)]
    motions = mapped(motion_in, [one for one, _, _ in chosen], [k for _, k, _ in chosen])
    turns = [one.digest.turns_per_metre for one in recordings if one.digest.stretches]
    seen = [one for one in turns if math.isfinite(one)]
    roller = float(np.median(seen)) if seen else math.nan
    known = [order * roller for order in settings.orders.tolist() if seen]
    lines = RecordLines(list(motions), FREQUENCIES_HZ, known)
    frequency = settings.hunting_frequency_hz or lines.strongest_hz
    if not frequency:
        raise IdentificationError('no stretch of the lateral channel is free of drop-outs')
    forced = []
    for line in lines.unknown():
        at = [line.frequency_hz, *(line.turns_per_metre * one.speed for one in stretches)]
        # A limit cycle that stays as it is for most of the time looks forced.
        if not any(abs(math.log(hz / frequency)) < _ITSELF for hz in at):
            forced.append(line)
    if len(seen) < len(turns) and settings.orders.size and not settings.roller_diameter_m:
        ways = [x for x in (line.turns_per_metre for line in forced) if math.isfinite(x)]
        unit = roller if seen else min(ways, default=math.nan) / float(settings.orders.min())
        if math.isfinite(unit):
            diameter = 1.0 / (math.pi * unit)
            by = 'the encoder of other recordings' if seen else 'its line'
            warnings.append(f'no roller angle: a roller of {diameter:.3g} m by {by}')
            recordings[:] = [one.with_settings(roller_diameter_m=diameter) for one in recordings]
            _read(recordings, mapped)
            settings = replace(settings, roller_diameter_m=diameter)
            return _hunting_frequency(recordings, settings, mapped, warnings)
        warnings.append(
            'no roller angle, and no line that follows the speed stands out: none is removed;'
            ' roller_diameter_m (--set) gives it'
        )
    warnings += [line.words(roller) for line in forced]
    fixed = [line.frequency_hz for line in forced if math.isfinite(line.frequency_hz)]
    # The way alone does not tell the angle well enough, that of the roller does.
    turning = [line.turns_per_metre / roller for line in forced]
    return frequency, fixed, [order for order in turning if math.isfinite(order)]


def _runs(
    recordings: Sequence[Recording],
    work: Callable[..., tuple[list[Run], list[str]]],
    clearance_m: float,
    mapped: Mapper,
    warnings: list[str],
) -> list[Run]:
    """Return envelopes and steady amplitudes of all stretches."""

    def all_runs(clearance_m: float) -> tuple[list[Run], list[str]]:
        """Return runs and warnings for a clearance."""
        found = list(mapped(partial(work, clearance_m=clearance_m), recordings))
        return [run for some, _ in found for run in some], [x for _, said in found for x in said]

    runs, said = all_runs(clearance_m)
    if runs and not clearance_m:
        amplitude = np.concatenate([run.envelope.amplitude for run in runs])
        states = [state for run in runs for state in run.states]
        held, reason = held_amplitude(states, threshold_of_motion(amplitude))
        if held:
            warnings.append(reason)
            runs, said = all_runs(held)
    warnings += said
    if not runs:
        raise IdentificationError(said[0].removeprefix('left out: '))
    above_noise([run.envelope for run in runs])
    return runs


def _mode_shape(runs: Sequence[Run]) -> ModeShape | None:
    """Measure the shape wherever both sensors show it; None where nothing does."""
    windows = np.concatenate([measured_ratio(run.envelope) for run in runs])
    return fitted_shape(
        windows['speed'],
        windows['amplitude'],
        windows['ratio'],
        windows['relative_std'],
        windows['frequency_hz'],
    )


def _path(
    runs: Sequence[Run], frequency: float, settings: IdentificationSettings
) -> tuple[Path, GrowthScales]:
    """Put all envelopes in a row, in the units of the fit."""
    speed = np.concatenate([run.envelope.speed for run in runs])
    sizes = [run.envelope.time.size for run in runs]
    names = list(dict.fromkeys(run.envelope.source for run in runs))
    recording = np.repeat([names.index(run.envelope.source) for run in runs], sizes)
    hold_std = 0.0
    if settings.speed_resolution_mps and len(names) == 1:
        recording = _holds(speed)
        hold_std = settings.speed_resolution_mps / math.sqrt(12.0) if recording.any() else 0.0
    # A kick begins a new segment, as a gap does.
    joined = np.concatenate([np.where(run.kicked, np.nan, run.corrected.phasor) for run in runs])
    scales = GrowthScales(
        speed=float(np.median(speed)),
        amplitude=_NEAR_TOP * float(np.nanmax(np.abs(joined))),
        length_scale=settings.length_unit,
        time_scale=settings.time_unit,
        frequency_hz=frequency,
    )
    half = 0.5 * WINDOW_CYCLES / frequency
    path = Path(
        time=np.concatenate([run.envelope.time for run in runs]),
        u=speed / scales.speed - 1.0,
        phasor=np.asarray(joined / scales.amplitude, dtype=np.complex128),
        restart=np.concatenate([np.arange(size) == 0 for size in sizes]),
        blur=WINDOW_VARIANCE * half**2,
        reach=WINDOW_REACH * half,
        overlap=WINDOW_OVERLAP,
        turn=2.0 * math.pi * STEP_CYCLES,
        line=np.concatenate([_line(run.envelope) for run in runs]) / scales.amplitude**2,
        recording=recording,
        hold_std=hold_std / scales.speed,
    )
    return path, scales


def _holds(speed: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number the holds, where a speed stays the same, and what is between, shape (n,)."""
    held = [span for span in spans(np.diff(speed) == 0.0) if span[1] - span[0] >= _HELD]
    number = np.searchsorted(np.ravel(held), np.arange(speed.size), side='right')
    return np.unique(number, return_inverse=True)[1]


def _line(envelope: Envelope) -> NDArray[np.float64]:
    """Power of the roller's lines along one record, m^2: a running median, 0 where unknown."""
    power = envelope.line_power
    known = np.isfinite(power)
    if not known.any():
        return np.zeros(power.size)
    filled = np.interp(np.arange(power.size), np.flatnonzero(known), power[known])
    return np.asarray(median_filter(filled, size=_LINE_SPAN, mode='nearest'))
