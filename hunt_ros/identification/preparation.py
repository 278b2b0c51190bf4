"""
One recording on its way into the fit: the work that needs no other recording.

Everything here may be done by another process: the samples stay where they are read, and only
what the functions return goes on.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any, TypeAlias

import numpy as np

from hunt_ros.analysis.rig_check import FAIL, check_roller
from hunt_ros.bursts import bursts_of
from hunt_ros.errors import IdentificationError
from hunt_ros.estimation.record_motion import Motion, turns_per_metre
from hunt_ros.identification.record.channels import Channels, refuse, speed_step
from hunt_ros.identification.record.envelope import FEWEST_SAMPLES, WINDOW_CYCLES, without_beat
from hunt_ros.identification.record.hunting_frequency import motion_of_channels, tracked_envelope
from hunt_ros.identification.record.kicks import find_kicks
from hunt_ros.identification.record.plateaus import Run, steady_states
from hunt_ros.identification.record.screening import (
    Digest,
    Stretch,
    moving,
    parted_by_contact,
    sketch_of,
    without_contact,
)
from hunt_ros.identification.record.stops import ignoring, measuring
from hunt_ros.identification.record.turning import with_angle
from hunt_ros.identification.settings import FREQUENCIES_HZ, IdentificationSettings
from hunt_ros.samples import Record, Series
from hunt_ros.sensors import DISPLACEMENTS, saturated_from

#: A recording, or what reads it.
Source: TypeAlias = Record | Callable[[], Record]
#: What to do with a recording whose encoder is wrong.
_NO_ENCODER = 'where it is the encoder, leave roller out of "channels" (--set, or the rig file)'


class Recording:
    """
    A recording by what reads it, and what is asked of it; it is read where its samples are needed.

    Parameters
    ----------
    source : Record or callable
        What is called is called once in each process that works on it.
    number : int
        1 for the first.
    settings : IdentificationSettings
        What the user tells of it.
    """

    #: What it is called among all recordings.
    name = ''

    def __init__(self, source: Source, number: int, settings: IdentificationSettings) -> None:
        self.source, self.number, self.settings = source, number, settings

    def with_settings(self, **changes: Any) -> Recording:
        """Return it with other settings, to be read anew."""
        other = Recording(self.source, self.number, replace(self.settings, **changes))
        other.name = self.name
        return other

    def __reduce__(self) -> tuple[Any, ...]:
        given = self.source, self.number, self.settings
        return _held, (pickle.dumps(given),), {'name': self.name}

    @cached_property
    def samples(self) -> tuple[Record, Record, list[Channels], Digest]:
        """
        What is read of it: the record, NaN where no sensor measured; the same with the angle of
        the roller; the stretches in which the rig runs; and what is known without the samples.
        """
        settings = self.settings
        record = self.source if isinstance(self.source, Record) else self.source()
        bursts, problems = (record.notes.get(name, '') for name in ('bursts', 'problems'))
        untimed = any(bursts_of(record[n].stamps_ns) for n in DISPLACEMENTS if n in record)
        record = replace(record, channels={name: one.in_order() for name, one in record.items()})
        record, ignored = ignoring(record, self.number, settings)
        said = [bursts] if bursts else []
        refused, measures, turning = '', False, record
        channels: list[Channels] = []
        try:
            refuse(untimed, record.source, bursts or 'samples come in bursts: bursts.evened')
            record = measuring(record, said, saturated_from(settings, 'lateral'))
            measures = True
            record = self._with_encoder(record)
            turning = with_angle(record, settings)
            channels = moving(turning)
            low, rate = FREQUENCIES_HZ[0], channels[0].rate_hz
            few = f'{rate:.3g} samples a second are too few for a mode of {low:g} Hz'
            refuse(rate < 4.0 * low, channels[0].source, few)
        except IdentificationError as error:
            refused = f'{error}; damaged: {problems}' if problems else str(error)
        digest = Digest(
            source=record.source or 'record',
            rig=record.notes.get('rig', '').strip(),
            problems=problems,
            span=(record.start_ns, record.end_ns),
            sketch=sketch_of(
                record.get('lateral', Series(np.zeros(0, dtype=np.int64), np.zeros(0)))
            ),
            ignored=ignored,
            said=tuple(said),
            refused=refused,
            measures=measures,
            turns_per_metre=turns_per_metre(turning, settings.roller_diameter_m),
            speed_step=speed_step(record['speed']) if 'speed' in record else 0.0,
            stretches=tuple(map(Stretch.of, channels)),
        )
        return record, turning, channels, digest

    def _with_encoder(self, record: Record) -> Record:
        """Return a record with an encoder only where the rig has one, and the speed agrees."""
        if 'roller' not in self.settings.channels:
            others = {name: series for name, series in record.items() if name != 'roller'}
            return replace(record, channels=others)
        seen, _ = ignoring(record, self.number, self.settings, ('roller',))
        for one in check_roller(seen, self.settings):
            apart = one.check == 'diameter' and one.state == FAIL
            refuse(apart, record.source, f'{one.text}: {one.advice}; {_NO_ENCODER}')
        return record

    @cached_property
    def digest(self) -> Digest:
        """What is known of it without its samples."""
        return self.samples[-1]


@lru_cache(maxsize=4)
def _held(given: bytes) -> Recording:
    """A process that is asked for several things of a recording reads it once."""
    return Recording(*pickle.loads(given))


def motion_in(recording: Recording, stretch: int) -> Motion | None:
    """Return the displacement in one of its stretches, in which lines are looked for."""
    channels = recording.samples[2][stretch]
    return motion_of_channels(without_contact(channels, recording.settings))


def runs_in(
    recording: Recording,
    frequency_hz: float,
    clearance_m: float,
    fixed_hz: Sequence[float] = (),
    turning: Sequence[float] = (),
) -> tuple[list[Run], list[str]]:
    """
    Return envelope and steady amplitudes of each of its stretches.

    Parameters
    ----------
    recording : Recording
        From which they are taken.
    frequency_hz : float
        Of the hunting.
    clearance_m : float
        Amplitude at which a flange touches; 0: not known.
    fixed_hz, turning : sequence of float
        Lines of one frequency, and in turns of the roller, that are taken out beside the known.

    Returns
    -------
    runs : list of Run
    said : list of str
        What was left out, and why.
    """
    settings = recording.settings
    runs: list[Run] = []
    said: list[str] = []
    _, record, stretches, _ = recording.samples
    for channels in stretches:
        channels = channels.with_yaw(record)
        channels = replace(channels, source=recording.name or channels.source)
        seen, clean = tracked_envelope(channels, frequency_hz, settings, fixed_hz, turning)
        seen, envelope = parted_by_contact(seen, channels, clearance_m, said)
        if np.isfinite(envelope.amplitude).sum() < 4:
            least = FEWEST_SAMPLES * frequency_hz / WINDOW_CYCLES
            said.append(
                f'left out: {channels.source}: {channels.rate_hz:.3g} samples a second are too few'
                f' to tell a motion of {frequency_hz:.3g} Hz, expected {least:.3g}'
                if channels.rate_hz < least
                else f'left out: {channels.source}: no stretch is free of drop-outs'
            )
            continue
        corrected = without_beat(envelope)
        kicked = find_kicks(clean, envelope)
        states = steady_states(channels, envelope, corrected, kicked, settings)
        runs.append(Run(seen, envelope, corrected, kicked, states))
    return runs, said
