"""From records to an identified normal form: the order of the work, and nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from os import PathLike

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hunt_ros.analysis.steady_state import hunting_threshold, observed_critical_speeds
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.bracket import bracket_of
from hunt_ros.identification.executors import Tell, executor
from hunt_ros.identification.fit import fit_laws
from hunt_ros.identification.growth_law import GrowthScales
from hunt_ros.identification.likelihood.path import Path
from hunt_ros.identification.preparation import Run, Source
from hunt_ros.identification.record.envelope import (
    WINDOW_CYCLES,
    WINDOW_OVERLAP,
    WINDOW_REACH,
    WINDOW_VARIANCE,
    Envelope,
)
from hunt_ros.identification.recordings import (
    hunting_frequency,
    mode_shape_of,
    records_of,
    runs_of,
    usable,
)
from hunt_ros.identification.result import Identification
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.uncertainty import ENOUGH_RUNS
from hunt_ros.identification.verdict.verdict import Evidence, conclude
from hunt_ros.samples import Record, counted

#: Length of the blocks of a run that stand in for runs, s.
_BLOCK_S = 15.0
#: Share of the work that is done when all is read, when the envelopes are seen, and when the fit
#: stands.
_READ, _SEEN, _FITTED = 0.3, 0.6, 0.8
#: Amplitude of the fit's unit, of the largest one: however little of the time a rig hunts.
_NEAR_TOP = 0.9
#: Instants over which the power of the roller's lines is taken to be one.
_LINE_SPAN = 9


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
    with executor(settings.cluster) as pool:
        recordings = usable(sources, settings, pool, warnings, lambda part: tell(_READ * part))
        frequency, bare = hunting_frequency(recordings, settings, pool, warnings)
        runs = runs_of(
            recordings,
            frequency,
            bare,
            settings.flange_clearance_m,
            pool,
            warnings,
            lambda part: tell(_READ + (_SEEN - _READ) * part),
        )
        if len(runs) < ENOUGH_RUNS:
            warnings.append(
                f'{counted(len(runs), "independent run")}, fewer than {ENOUGH_RUNS}:'
                f' the intervals rest on blocks of {_BLOCK_S:g} s'
            )
        states = [state for run in runs for state in run.states]
        bracket = bracket_of([run.seen for run in runs], [run.kicked for run in runs])
        kicks = [*bracket.kicks, *(kick for run in runs for kick in run.kicks)]
        observed = observed_critical_speeds(states, kicks)
        if observed.threshold is None:
            amplitude = np.concatenate([run.envelope.amplitude for run in runs])
            observed = replace(observed, threshold=hunting_threshold(amplitude))
        path, scales = _path(runs, frequency, settings)
        laws = fit_laws(path, scales, settings, observed.v_c, _floor(path))
        tell(_FITTED)
        evidence = Evidence(laws, runs, bracket, observed, records_of(recordings))
        result = conclude(evidence, settings, warnings)
        if result.normal_form is not None:
            found = result.normal_form
            shape = mode_shape_of(recordings, found.form, frequency, bare, pool)
            result = replace(result, normal_form=replace(found, mode_shape=shape))
    tell(1.0)
    return result


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


def _path(
    runs: Sequence[Run], frequency: float, settings: IdentificationSettings
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
