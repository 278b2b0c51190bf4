"""All recordings of an identification: which can be used, and what they say together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from hunt_ros.analysis.steady_state import hunting_threshold
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import IdentificationError
from hunt_ros.estimation.record_lines import RecordLines
from hunt_ros.identification.executors import Tell, collected
from hunt_ros.identification.preparation import (
    Recording,
    Run,
    Source,
    digest_of,
    motion_in,
    motions_in,
    powers_in,
    runs_in,
)
from hunt_ros.identification.record.hunting_frequency import frequency_grid, looked_at, strongest
from hunt_ros.identification.record.mode import measured_shape
from hunt_ros.identification.record.screening import (
    Stretch,
    above_noise,
    doubts,
    held_amplitude,
    refuse_two_rigs,
    repeated,
)
from hunt_ros.identification.record.turning import lines_above
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import Record

#: Distance of a line from the hunting, relative, within which it is the hunting.
_ITSELF = 0.15


def usable(
    sources: Sequence[Source],
    settings: IdentificationSettings,
    pool: Executor,
    warnings: list[str],
    tell: Tell,
) -> list[Recording]:
    """
    Read the recordings, and return those that count.

    Parameters
    ----------
    sources : sequence of Source
        Recordings, or what reads them.
    settings : IdentificationSettings
        What the user tells of them.
    pool : Executor
        Reads and prepares them.
    warnings : list of str
        Grows by what was left out, and by what looks wrong.
    tell : callable
        Told which fraction has been read.

    Raises
    ------
    IdentificationError
        If none can be used, or they are of different rigs.
    """
    count, settings = len(sources), settings.of_recording()
    for _, _, number in settings.ignore:
        if number > count:
            raise IdentificationError(
                f'ignore: recording {number} of {count} has no interval to leave out'
            )
    given = [Recording(source, k, settings) for k, source in enumerate(sources, start=1)]
    for one, digest in zip(given, collected(pool.map(digest_of, given), count, tell), strict=True):
        one.digest = digest
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


def _distinct(given: Sequence[Recording], warnings: list[str]) -> list[Recording]:
    """Leave out what was given twice, and give each recording a name of its own."""
    refuse_two_rigs([one.digest for one in given])
    named: dict[str, int] = {}
    kept: list[Recording] = []
    for one in given:
        digest, source, settings = one.digest, one.digest.source, one.settings
        if digest.problems:
            warnings.append(f'{source}: damaged: {digest.problems}')
        again = repeated(digest, [other.digest for other in kept])
        if again is not None:
            low, high, whose = again
            cut = '' if math.isinf(high) else f' from {low:.4g} to {high:.4g} s'
            warnings.append(f'left out: {source}{cut}: the same samples as {whose}')
            if not cut:
                continue
            settings = replace(settings, ignore=(*settings.ignore, (low, high, 0)))
        count = named[source] = named.get(source, 0) + 1
        name = source if count == 1 else f'{source} ({count})'
        kept.append(Recording(one.source, one.number, settings, name))
        if again is None:
            kept[-1].digest = digest
    return kept


def _places(recordings: Sequence[Recording]) -> list[tuple[Recording, int, Stretch]]:
    """All stretches in which the rig runs, each with its recording and its number there."""
    return [(one, k, part) for one in recordings for k, part in enumerate(one.digest.stretches)]


def records_of(recordings: Sequence[Recording]) -> list[Record]:
    """Return those that were given as records; what a callable read stays where it was read."""
    given = [one for one in recordings if isinstance(one.source, Record) and one.digest.measures]
    return [replace(one.prepared.record, source=one.name) for one in given]


def hunting_frequency(
    recordings: Sequence[Recording],
    settings: IdentificationSettings,
    pool: Executor,
    warnings: list[str],
) -> tuple[float, bool]:
    """
    Find the frequency of the hunting; say which lines are forced.

    Returns
    -------
    frequency : float
        Hz.
    bare : bool
        Whether an angle of the roller that rests on a diameter nobody gave is left out, because
        its lines would be near the hunting.
    """
    places = _places(recordings)
    stretches = [stretch for _, _, stretch in places]
    chosen = [places[k] for k in looked_at(stretches)]
    motions = pool.map(motion_in, [one for one, _, _ in chosen], [k for _, k, _ in chosen])
    lines = RecordLines(list(motions), settings.frequency_range_hz)
    grid = frequency_grid(lines, settings)

    def found(bare: bool) -> float:
        if settings.frequency_hz is not None:
            return settings.frequency_hz
        work = partial(powers_in, bare=bare, grid=grid, forced=lines.forced())
        return strongest(grid, [power for some in pool.map(work, recordings) for power in some])

    frequency, bare = found(bare=False), False
    if any(stretch.assumed for stretch in stretches):
        # A line of a roller that nobody named must not be the hunting itself.
        plain = found(bare=True)
        bare = not lines_above(stretches, settings, min(frequency, plain))
        frequency = plain if bare else frequency
        warnings.append(
            f'no roller angle, and a roller of {RigParameters.roller_diameter_m:g} m assumed: its'
            f' lines {"would be near the hunting, none is" if bare else "are"} removed'
            f'{"" if bare else " where the speed has them"}'
        )
    turns = [one.digest.turns_per_metre for one in recordings if one.digest.measures]
    known = [one for one in turns if math.isfinite(one)]
    roller = float(np.median(known)) if known else math.nan
    for line in lines.forced([order * roller for order in settings.orders.tolist() if known]):
        at = [line.frequency_hz, *(line.turns_per_metre * one.speed for one in stretches)]
        # A limit cycle that stays as it is for most of the time looks forced.
        if not any(abs(math.log(hz / frequency)) < _ITSELF for hz in at):
            warnings.append(line.words(roller))
    return frequency, bare


def runs_of(
    recordings: Sequence[Recording],
    frequency_hz: float,
    bare: bool,
    clearance_m: float,
    pool: Executor,
    warnings: list[str],
    tell: Tell,
) -> list[Run]:
    """
    Return envelopes, segments and steady amplitudes of all stretches.

    Raises
    ------
    IdentificationError
        If none is long enough, or there is nothing but noise.
    """

    def all_runs(clearance_m: float, tell: Tell | None) -> tuple[list[Run], list[str]]:
        work = partial(runs_in, bare=bare, frequency_hz=frequency_hz, clearance_m=clearance_m)
        found = collected(pool.map(work, recordings), len(recordings), tell)
        return [run for some, _ in found for run in some], [x for _, said in found for x in said]

    runs, said = all_runs(clearance_m, tell)
    if runs and not clearance_m:
        amplitude = np.concatenate([run.envelope.amplitude for run in runs])
        states = [state for run in runs for state in run.states]
        held, reason = held_amplitude(states, hunting_threshold(amplitude))
        if held:
            warnings.append(reason)
            runs, said = all_runs(held, None)
    warnings += said
    if not runs:
        raise IdentificationError(said[0].removeprefix('left out: '))
    above_noise([run.envelope for run in runs])
    return runs


def mode_shape_of(
    recordings: Sequence[Recording],
    form: NormalForm,
    frequency_hz: float,
    bare: bool,
    pool: Executor,
) -> ModeShape | None:
    """Measure both modes wherever what can be used holds both sensors; else None."""
    measuring = [one for one in recordings if one.digest.measures and not one.digest.refused]
    work = partial(motions_in, bare=bare, frequency_hz=frequency_hz)
    return measured_shape(list(pool.map(work, measuring)), form, frequency_hz)
