"""All recordings of an identification: what each is asked for, and what they say together."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from hunt_ros.analysis.steady_state import hunting_threshold
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.errors import IdentificationError
from hunt_ros.estimation.record_lines import RecordLines
from hunt_ros.identification import preparation
from hunt_ros.identification.preparation import Digest, Run, Source
from hunt_ros.identification.record.hunting_frequency import frequency_grid, looked_at, strongest
from hunt_ros.identification.record.mode import measured_shape
from hunt_ros.identification.record.screening import (
    Stretch,
    above_noise,
    distinct,
    doubts,
    held_amplitude,
    maybe_other_rig,
    other_rig,
)
from hunt_ros.identification.record.stops import nothing_ignored
from hunt_ros.identification.record.turning import lines_above
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.work.places import Tell, Workers
from hunt_ros.samples import Record

_T = TypeVar('_T')


class Recordings:
    """
    The recordings that can be used, wherever their samples are.

    Parameters
    ----------
    sources : sequence of Source
        Recordings, or what reads them.
    settings : IdentificationSettings
        What the user tells of them.
    workers : Workers
        Read and prepare them.
    warnings : list of str
        Grows by what was left out, and by what looks wrong.
    tell : callable
        Told which fraction has been read.

    Raises
    ------
    IdentificationError
        If none can be used, or they are of different rigs.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        settings: IdentificationSettings,
        workers: Workers,
        warnings: list[str],
        tell: Tell,
    ) -> None:
        settings = settings.of_recording()
        self._settings, self._workers, self._warnings = settings, workers, warnings
        for _, _, number in settings.ignore:
            if number > len(sources):
                raise IdentificationError(
                    f'ignore: recording {number} of {len(sources)} has no interval to leave out'
                )
        count = len(sources)
        # Where no interval is one recording's own, the place of a recording means nothing.
        numbered = any(number for _, _, number in settings.ignore)
        numbers = range(1, count + 1) if numbered else [1] * count
        prepared = workers.map(preparation.prepare, sources, numbers, [settings] * count)
        digests: list[Digest] = workers.collect(workers.map(preparation.digest_of, prepared), tell)
        warnings += nothing_ignored([one.ignored for one in digests], settings)
        kept = distinct(digests, warnings)
        self._read_here = [isinstance(sources[k], Record) for k, _ in kept]
        self._prepared = [prepared[k] for k, _ in kept]
        self._digests = [digests[k] for k, _ in kept]
        self._names = [name for _, name in kept]
        self._bare = False
        self._leave_out()

    def _leave_out(self) -> None:
        """Leave out what cannot be used; say why, and what looks wrong of the others."""
        warnings, settings = self._warnings, self._settings
        warnings += [line for one in self._digests for line in one.said]
        refused = [one.refused for one in self._digests if one.refused]
        if refused and len(self._digests) == 1:
            raise IdentificationError(refused[0])
        warnings += [f'left out: {reason}' for reason in refused]
        if len(refused) == len(self._digests):
            reason = f' (the first: {warnings[0]})' if warnings else ''
            raise IdentificationError(f'none of {len(self._digests)} records can be used{reason}')
        stretches = self._stretches
        warnings += doubts(stretches, settings)
        hunting = maybe_other_rig(stretches, settings)
        places = [self._places[k] for k in hunting]
        frequencies = self._ask(
            preparation.frequency_in,
            [self._prepared[record] for record, _ in places],
            [stretch for _, stretch in places],
        )
        known = [
            (frequency, stretches[k])
            for k, frequency in zip(hunting, frequencies, strict=True)
            if frequency is not None
        ]
        warnings += other_rig(known)

    def _ask(
        self, work: Callable[..., _T], *arguments: Sequence[Any], tell: Tell | None = None
    ) -> list[_T]:
        """Let the workers do something with the settings, and collect the results."""
        count = len(arguments[0])
        handles = self._workers.map(work, *arguments, [self._settings] * count)
        return self._workers.collect(handles, tell)

    @property
    def _stretches(self) -> list[Stretch]:
        """All stretches in which the rig runs."""
        return [stretch for one in self._digests for stretch in one.stretches]

    @property
    def _places(self) -> list[tuple[int, int]]:
        """Of each stretch the number of its recording, and its own in that."""
        return [
            (record, stretch)
            for record, one in enumerate(self._digests)
            for stretch in range(len(one.stretches))
        ]

    @property
    def days(self) -> dict[str, str]:
        """The day of each recording whose sensor measures, by its name."""
        pairs = zip(self._names, self._digests, strict=True)
        return {name: digest.day for name, digest in pairs if digest.measures}

    def records(self) -> list[Record]:
        """Return those that were given as records; what was read elsewhere stays there."""
        chosen = [
            k for k, digest in enumerate(self._digests) if self._read_here[k] and digest.measures
        ]
        handles = self._workers.map(
            preparation.record_of,
            [self._prepared[k] for k in chosen],
            [self._names[k] for k in chosen],
        )
        found: list[Record] = self._workers.collect(handles)
        return found

    def frequency(self) -> float:
        """
        Find the frequency of the hunting, Hz; say which lines are forced.

        An angle of the roller that rests on a diameter nobody gave is left out from here on
        where its lines would be near the hunting.
        """
        lines = self._lines()
        turns = [one.turns_per_metre for one in self._digests if one.measures]
        self._warnings += _forced(lines, turns, self._settings)
        frequency = self._frequency(lines, bare=False)
        stretches = self._stretches
        if any(stretch.assumed for stretch in stretches):
            plain = self._frequency(lines, bare=True)
            diameter = RigParameters.roller_diameter_m
            assumed = f'no roller angle, and a roller of {diameter:g} m assumed'
            if lines_above(stretches, self._settings, min(frequency, plain)):
                self._warnings.append(f'{assumed}: its lines are removed where the speed has them')
            else:  # a line of a roller that nobody named must not be the hunting itself
                self._warnings.append(
                    f'{assumed}: its lines would be near the hunting, none is removed'
                )
                self._bare, frequency = True, plain
        return frequency

    def _lines(self) -> RecordLines:
        """Look for the lines of the lateral displacement, in all recordings together."""
        places = [self._places[k] for k in looked_at(self._stretches)]
        handles = self._workers.map(
            preparation.motion_in,
            [self._prepared[record] for record, _ in places],
            [stretch for _, stretch in places],
        )
        motions = self._workers.collect(handles)
        return RecordLines(motions, self._settings.frequency_range_hz)

    def _frequency(self, lines: RecordLines, bare: bool) -> float:
        if self._settings.frequency_hz is not None:
            return self._settings.frequency_hz
        grid, count = frequency_grid(lines, self._settings), len(self._prepared)
        powers = self._ask(
            preparation.powers_in,
            self._prepared,
            [bare] * count,
            [grid] * count,
            [lines.forced()] * count,
        )
        return strongest(grid, [power for some in powers for power in some])

    def runs(self, frequency_hz: float, tell: Tell) -> list[Run]:
        """
        Return envelopes, segments and steady amplitudes of all stretches.

        Raises
        ------
        IdentificationError
            If none is long enough, or there is nothing but noise.
        """
        runs, said = self._runs(frequency_hz, tell)
        if runs and not self._settings.flange_clearance_m:
            amplitude = np.concatenate([run.envelope.amplitude for run in runs])
            states = [state for run in runs for state in run.states]
            held, reason = held_amplitude(states, hunting_threshold(amplitude))
            if held:
                self._warnings.append(reason)
                self._settings = replace(self._settings, flange_clearance_m=held)
                runs, said = self._runs(frequency_hz, lambda part: None)
        self._warnings += said
        if not runs:
            raise IdentificationError(
                f'none of {len(self._stretches)} records has a stretch free of drop-outs'
            )
        above_noise([run.envelope for run in runs])
        return runs

    def _runs(self, frequency_hz: float, tell: Tell) -> tuple[list[Run], list[str]]:
        """Return the stretches as they enter the fit, and what is said of them."""
        count = len(self._prepared)
        found = self._ask(
            preparation.runs_in,
            self._prepared,
            self._names,
            [self._bare] * count,
            [frequency_hz] * count,
            tell=tell,
        )
        runs = [run for some, _ in found for run in some]
        return runs, [line for _, said in found for line in said]

    def mode_shape(self, form: NormalForm, frequency_hz: float) -> ModeShape | None:
        """Measure both modes wherever what can be used holds both sensors; else None."""
        pairs = zip(self._prepared, self._digests, strict=True)
        measuring = [one for one, digest in pairs if digest.measures and not digest.refused]
        count = len(measuring)
        motions = self._ask(
            preparation.motions_in, measuring, [self._bare] * count, [frequency_hz] * count
        )
        return measured_shape(motions, form, frequency_hz)


def _forced(
    lines: RecordLines, turns: Sequence[float], settings: IdentificationSettings
) -> list[str]:
    """Name the forced lines that are not known ones: none of them is taken for the hunting."""
    known = [one for one in turns if math.isfinite(one)]
    roller = float(np.median(known)) if known else math.nan
    orders = [order * roller for order in settings.orders.tolist() if known]
    return [line.words(roller) for line in lines.forced(orders)]
