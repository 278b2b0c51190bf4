"""
One recording on its way into the fit: the work that needs no other recording.

Everything here may be done by another process: the samples stay where they were read, and only
what the functions return goes on.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.errors import IdentificationError
from hunt_ros.estimation.mode_measurement import measure_ratio
from hunt_ros.estimation.record_lines import ForcedLine, Motion, turns_per_metre
from hunt_ros.estimation.response_windows import measure_response
from hunt_ros.identification.days import day_of
from hunt_ros.identification.record.beat import without_beat
from hunt_ros.identification.record.channels import Channels
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.record.hunting_frequency import (
    Power,
    find_frequency,
    motion_of_channels,
    power_on,
    tracked_envelope,
)
from hunt_ros.identification.record.mode import Motions
from hunt_ros.identification.record.plateaus import analyse_record
from hunt_ros.identification.record.screening import Stretch, free_of_contact, moving
from hunt_ros.identification.record.segments import Segment
from hunt_ros.identification.record.stops import ignoring, measuring
from hunt_ros.identification.record.turning import is_assumed, with_angle
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import Record

#: A recording, or what reads it.
Source: TypeAlias = Record | Callable[[], Record]


@dataclass(frozen=True)
class Digest:
    """
    What is known of a recording without its samples.

    Parameters
    ----------
    source, day, rig : str
        What it is called, its day, and its rig ('' for none).
    problems : str
        What opening it showed to be wrong.
    fingerprint : str
        Hash of lateral samples and speed, by which a repeated recording is known.
    ignored : tuple of int
        Samples that each of the intervals of `ignore` leaves out.
    said : tuple of str
        What was taken out of it, and why.
    refused : str
        Why it cannot be used; '' if it can.
    measures : bool
        Whether the lateral sensor measures at all.
    turns_per_metre : float
        Of the roller, 1/m; NaN where not known.
    stretches : tuple of Stretch
        In which the rig runs.
    """

    source: str
    day: str
    rig: str
    problems: str
    fingerprint: str
    ignored: tuple[int, ...]
    said: tuple[str, ...]
    refused: str
    measures: bool
    turns_per_metre: float
    stretches: tuple[Stretch, ...]


@dataclass(frozen=True, eq=False)
class Prepared:
    """
    A recording with all its samples, ready for the fit.

    Parameters
    ----------
    record : Record
        NaN where no sensor measured.
    turning : Record
        The same with the angle of the roller.
    channels : tuple of Channels
        The stretches in which the rig runs.
    digest : Digest
    """

    record: Record
    turning: Record
    channels: tuple[Channels, ...]
    digest: Digest

    def stretches(self, bare: bool) -> list[Channels]:
        """Return the channels; with `bare` without an angle that nobody gave."""
        return [
            replace(one, roller=np.zeros(0)) if bare and one.assumed else one
            for one in self.channels
        ]


@dataclass(frozen=True, eq=False)
class Run:
    """One stretch of a recording as it enters the fit."""

    envelope: Envelope
    corrected: Envelope
    segments: Sequence[Segment]
    states: Sequence[SteadyState]

    @property
    def kicks(self) -> list[tuple[str, int]]:
        """Source and stamp, ns, of each kick."""
        return [(part.source, part.start_ns) for part in self.segments if part.kind == 'kick']

    @property
    def kicked(self) -> NDArray[np.bool_]:
        """Instants whose windows hold a kick."""
        stamp = self.envelope.start_ns + 1e9 * self.envelope.time
        kicked = np.zeros(stamp.size, dtype=bool)
        for part in self.segments:
            if part.kind == 'kick':
                kicked |= (stamp >= part.start_ns - 1e6) & (stamp <= part.end_ns + 1e6)
        return kicked


def prepare(source: Source, number: int, settings: IdentificationSettings) -> Prepared:
    """
    Read a recording and bring it onto its lateral samples.

    Parameters
    ----------
    source : Record or callable
        What is called is called once.
    number : int
        1 for the first.
    settings : IdentificationSettings
        What the user tells of the recordings.
    """
    record = source if isinstance(source, Record) else source()
    fingerprint = _fingerprint(record)
    record, ignored = ignoring(record, number, settings)
    said: list[str] = []
    refused, measures, turning = '', False, record
    channels: list[Channels] = []
    try:
        record = measuring(record, said, settings.lateral_range_m)
        measures = True
        turning = with_angle(record, settings)
        assumed = is_assumed(turning)
        channels = [replace(one, assumed=assumed) for one in moving(turning)]
    except IdentificationError as error:
        refused = str(error)
    digest = Digest(
        source=record.source or 'record',
        day=day_of(record),
        rig=record.notes.get('rig', '').strip(),
        problems=record.notes.get('problems', ''),
        fingerprint=fingerprint,
        ignored=ignored,
        said=tuple(said),
        refused=refused,
        measures=measures,
        turns_per_metre=turns_per_metre(record, settings.roller_diameter_m),
        stretches=tuple(map(Stretch.of, channels)),
    )
    return Prepared(record, turning, tuple(channels), digest)


def _fingerprint(record: Record) -> str:
    digest = hashlib.sha256()
    for name in ('lateral', 'speed'):
        if name in record:
            digest.update(name.encode())
            digest.update(record[name].stamps_ns.tobytes())
            digest.update(record[name].values.tobytes())
    return digest.hexdigest()


def digest_of(prepared: Prepared) -> Digest:
    """Return what is known of it without its samples."""
    return prepared.digest


def record_of(prepared: Prepared, name: str) -> Record:
    """Return its samples, under its name among all recordings."""
    record = prepared.record
    return record if name == prepared.digest.source else replace(record, source=name)


def motion_in(prepared: Prepared, stretch: int) -> Motion | None:
    """Return the displacement in one of its stretches, in which lines are looked for."""
    return motion_of_channels(prepared.channels[stretch])


def frequency_in(
    prepared: Prepared, stretch: int, settings: IdentificationSettings
) -> float | None:
    """Return the hunting frequency of one of its stretches alone, Hz; None if it shows none."""
    try:
        return find_frequency(prepared.channels[stretch], settings)
    except IdentificationError:
        return None  # too short or too broken to say; it is dealt with where it is fitted


def powers_in(
    prepared: Prepared,
    bare: bool,
    grid: NDArray[np.float64],
    forced: Sequence[ForcedLine],
    settings: IdentificationSettings,
) -> list[Power]:
    """Return the power on a grid of frequencies, of each of its stretches."""
    return [power_on(one, grid, forced, settings) for one in prepared.stretches(bare)]


def runs_in(
    prepared: Prepared,
    name: str,
    bare: bool,
    frequency_hz: float,
    settings: IdentificationSettings,
) -> tuple[list[Run], list[str]]:
    """
    Return envelope, segments and steady amplitudes of each of its stretches.

    Parameters
    ----------
    prepared : Prepared
        The recording.
    name : str
        Of the recording among all.
    bare : bool
        Whether an angle of the roller that nobody gave is left out.
    frequency_hz : float
        Of the hunting.
    settings : IdentificationSettings
        What the user tells of it.

    Returns
    -------
    runs : list of Run
    said : list of str
        What was left out, and why.
    """
    runs: list[Run] = []
    said: list[str] = []
    for channels in prepared.stretches(bare):
        channels = replace(channels, source=name)
        envelope = tracked_envelope(channels, frequency_hz, settings)
        envelope = free_of_contact(envelope, settings.flange_clearance_m, said)
        if np.isfinite(envelope.amplitude).sum() < 4:
            said.append(f'left out: {name}: no stretch is free of drop-outs')
            continue
        corrected = without_beat(envelope)
        segments, states = analyse_record(channels, envelope, corrected, settings)
        runs.append(Run(envelope, corrected, segments, states))
    return runs, said


def motions_in(
    prepared: Prepared, bare: bool, frequency_hz: float, settings: IdentificationSettings
) -> Motions:
    """Return what it shows of yaw and lateral motion together, where it holds both."""
    assumed = bare and is_assumed(prepared.turning)
    record, orders = prepared.record if assumed else prepared.turning, settings.orders.tolist()
    return Motions(
        measure_ratio(record, frequency_hz, orders),
        measure_response(record, frequency_hz, orders),
    )
