"""From records to an identified normal form: the order of the work, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hunt_ros.analysis.steady_state import (
    SteadyState,
    hunting_threshold,
    observed_critical_speeds,
)
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import IdentificationError
from hunt_ros.estimation.record_lines import RecordLines, turns_per_metre
from hunt_ros.identification.fit import fit_laws
from hunt_ros.identification.growth_law import GrowthScales
from hunt_ros.identification.path import Path
from hunt_ros.identification.record.beat import without_beat
from hunt_ros.identification.record.channels import Channels
from hunt_ros.identification.record.envelope import (
    WINDOW_CYCLES,
    WINDOW_OVERLAP,
    WINDOW_REACH,
    WINDOW_VARIANCE,
    Envelope,
)
from hunt_ros.identification.record.hunting_frequency import (
    find_frequency,
    lines_of,
    tracked_envelope,
)
from hunt_ros.identification.record.mode import measured_shape
from hunt_ros.identification.record.plateaus import analyse_record
from hunt_ros.identification.record.screening import (
    above_noise,
    distinct,
    doubts,
    free_of_contact,
    moving,
)
from hunt_ros.identification.record.segments import Segment
from hunt_ros.identification.record.stops import ignoring, measuring
from hunt_ros.identification.record.turning import is_assumed, lines_above, with_angle
from hunt_ros.identification.result import Identification
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.uncertainty import ENOUGH_RUNS
from hunt_ros.identification.verdict.conclusions import Evidence, conclude
from hunt_ros.samples import Record

#: Length of the blocks of a run that stand in for runs, s.
_BLOCK_S = 15.0
#: Share of the work that is done when the fit stands and the intervals begin.
_FITTED = 0.5
#: Amplitude of the fit's unit, of the largest one: however little of the time a rig hunts.
_NEAR_TOP = 0.9
#: Instants over which the power of the roller's lines is taken to be one.
_LINE_SPAN = 9


def identify(
    records: Record | Iterable[Record],
    settings: IdentificationSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> Identification:
    """
    Identify the normal form from one or several recordings.

    Parameters
    ----------
    records : Record or iterable of Record
        Each with `lateral` and `speed`. The known lines are removed by the angle of `roller`,
        or where that is missing by one that follows from the speed.
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
    records = _records(records)
    settings = settings or IdentificationSettings()
    tell = progress or (lambda fraction: None)
    warnings: list[str] = []
    records = ignoring(records, settings, warnings)
    records = _measuring(distinct(records, warnings), settings, warnings)
    turning = [with_angle(record, settings) for record in records]
    channels = _usable(turning, settings, warnings)
    lines = lines_of(channels, settings)
    warnings += _forced(lines, records, settings)
    frequency = find_frequency(channels, settings, lines)
    if any(map(is_assumed, turning)):
        bare = [replace(c, roller=np.zeros(0)) if c.assumed else c for c in channels]
        plain = find_frequency(bare, settings, lines)
        assumed = f'no roller angle, and a roller of {RigParameters.roller_diameter_m:g} m assumed'
        if lines_above(channels, settings, min(frequency, plain)):
            warnings.append(f'{assumed}: its lines are removed where the speed has them')
        else:  # a line of a roller that nobody named must not be the hunting itself
            warnings.append(f'{assumed}: its lines would be near the hunting, none is removed')
            channels, frequency, turning = bare, plain, records
    runs = _envelopes(channels, frequency, settings, warnings)
    tell(0.2)
    states = [state for run in runs for state in run.states]
    observed = observed_critical_speeds(states, [k for run in runs for k in run.kicks])
    if observed.threshold is None:
        amplitude = np.concatenate([run.envelope.amplitude for run in runs])
        observed = replace(observed, threshold=hunting_threshold(amplitude))
    path, scales = _path(runs, frequency, settings)
    laws = fit_laws(path, scales, settings, observed.v_c, _floor(path))
    tell(_FITTED)
    evidence = Evidence(
        laws=laws,
        scales=scales,
        states=states,
        observed=observed,
        segments=[segment for run in runs for segment in run.segments],
        envelopes=[run.envelope for run in runs],
        records=records,
    )
    result = conclude(
        evidence, settings, warnings, lambda part: tell(_FITTED + (1.0 - _FITTED) * part)
    )
    if result.normal_form is not None:
        shape = measured_shape(turning, frequency, settings)
        form = replace(result.normal_form, mode_shape=shape)
        result = replace(result, normal_form=form)
    tell(1.0)
    return result


def _records(given: Record | Iterable[Record]) -> list[Record]:
    """Return the records, one or several; a path is none."""
    records = [given] if isinstance(given, Record | str | PathLike) else list(given)
    for item in records:
        if not isinstance(item, Record):
            raise IdentificationError(
                f'identify: expected records, got {item!r:.80};'
                ' hunt_ros.bag.read_record reads one from a path'
            )
    return records


@dataclass(frozen=True, eq=False)
class _Run:
    """One record as it enters the fit."""

    envelope: Envelope
    corrected: Envelope
    segments: Sequence[Segment]
    states: Sequence[SteadyState]
    kicks: Sequence[tuple[str, int]]

    @property
    def kicked(self) -> NDArray[np.bool_]:
        """Instants whose windows hold a kick."""
        stamp = self.envelope.start_ns + 1e9 * self.envelope.time
        kicked = np.zeros(stamp.size, dtype=bool)
        for part in self.segments:
            if part.kind == 'kick':
                kicked |= (stamp >= part.start_ns - 1e6) & (stamp <= part.end_ns + 1e6)
        return kicked


def _measuring(
    records: Sequence[Record], settings: IdentificationSettings, warnings: list[str]
) -> list[Record]:
    """Take out what no sensor measured; a record of which nothing is left goes with it."""
    kept = []
    for record in records:
        try:
            kept.append(measuring(record, warnings, settings.lateral_range_m))
        except IdentificationError as error:
            if len(records) == 1:
                raise
            warnings.append(f'left out: {error}')
    return kept


def _usable(
    records: Sequence[Record], settings: IdentificationSettings, warnings: list[str]
) -> list[Channels]:
    """Bring the records onto their lateral samples; say which cannot be used, and why."""
    channels = []
    for record in records:
        try:
            channels += [replace(c, assumed=is_assumed(record)) for c in moving(record)]
        except IdentificationError as error:
            if len(records) == 1:
                raise
            warnings.append(f'left out: {error}')
    if not channels:
        reason = f' (the first: {warnings[0]})' if warnings else ''
        raise IdentificationError(f'none of {len(records)} records can be used{reason}')
    warnings += doubts(channels, settings)
    return channels


def _forced(
    lines: RecordLines, records: Sequence[Record], settings: IdentificationSettings
) -> list[str]:
    """Name the forced lines that are not known ones: none of them is taken for the hunting."""
    turns = [turns_per_metre(record, settings.roller_diameter_m) for record in records]
    known = [one for one in turns if math.isfinite(one)]
    roller = float(np.median(known)) if known else math.nan
    orders = [order * roller for order in settings.orders.tolist() if known]
    return [line.words(roller) for line in lines.forced(orders)]


def _envelopes(
    channels: Sequence[Channels],
    frequency: float,
    settings: IdentificationSettings,
    warnings: list[str],
) -> list[_Run]:
    """Envelope, segments and steady amplitudes of each record."""
    runs = []
    for channel in channels:
        envelope = tracked_envelope(channel, frequency, settings)
        envelope = free_of_contact(envelope, settings.flange_clearance_m, warnings)
        if np.isfinite(envelope.amplitude).sum() < 4:
            warnings.append(f'left out: {channel.source}: no stretch is free of drop-outs')
            continue
        corrected = without_beat(envelope)
        segments, states = analyse_record(channel, envelope, corrected, settings)
        kicks = [(part.source, part.start_ns) for part in segments if part.kind == 'kick']
        runs.append(_Run(envelope, corrected, segments, states, kicks))
    if not runs:
        raise IdentificationError(
            f'none of {len(channels)} records has a stretch free of drop-outs'
        )
    above_noise([run.envelope for run in runs])
    if len(runs) < ENOUGH_RUNS:
        warnings.append(
            f'{len(runs)} independent runs, fewer than {ENOUGH_RUNS}: the intervals rest on'
            f' blocks of {_BLOCK_S:g} s and are widened'
        )
    return runs


def _path(
    runs: Sequence[_Run], frequency: float, settings: IdentificationSettings
) -> tuple[Path, GrowthScales]:
    """Put all envelopes in a row, in the units of the fit."""
    speed = np.concatenate([run.envelope.speed for run in runs])
    phasor: list[NDArray[np.complex128]] = []
    restart, clusters, count = [], [], 0
    for run in runs:
        time = run.envelope.time
        restart.append(np.arange(time.size) == 0)
        # A kick begins a new segment, as a gap does.
        phasor.append(np.where(run.kicked, np.nan, run.corrected.phasor))
        block = np.zeros(time.size, dtype=np.int64)
        if len(runs) < ENOUGH_RUNS:
            block = ((time - time[0]) / _BLOCK_S).astype(np.int64)
        clusters.append(block + count)
        count += int(block.max()) + 1
    joined = np.concatenate(phasor)
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
        restart=np.concatenate(restart),
        cluster=np.concatenate(clusters),
        blur=WINDOW_VARIANCE * half**2,
        reach=WINDOW_REACH * half,
        overlap=WINDOW_OVERLAP,
        line=np.concatenate([_line(run.envelope) for run in runs]) / scales.amplitude**2,
    )
    return path, scales


def _line(envelope: Envelope) -> NDArray[np.float64]:
    """Power of the roller's lines along one record, m^2: a running median, 0 where unknown."""
    power = envelope.line_power
    known = np.isfinite(power)
    if not known.any():
        return np.zeros(power.size)
    filled = np.interp(np.arange(power.size), np.flatnonzero(known), power[known])
    smooth: NDArray[np.float64] = median_filter(filled, size=_LINE_SPAN, mode='nearest')
    return smooth


def _floor(path: Path) -> float:
    """Amplitude below which motion is noise, in units of A_ref: twice the quiet one's median."""
    amplitude = np.abs(path.phasor)
    known = amplitude[np.isfinite(amplitude)]
    threshold = hunting_threshold(known)
    if threshold is None:
        return 0.1 * float(np.median(known))
    return 2.0 * float(np.median(known[known <= threshold]))


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
        From all recordings kept; its interval is that of a fit to all of them at once.

    Raises
    ------
    IdentificationError
        If no record can be used.
    """
    known = list(prior.records) if prior is not None else []
    kept = [*known, *records][-keep:]
    return replace(identify(kept, settings), records=tuple(kept))
