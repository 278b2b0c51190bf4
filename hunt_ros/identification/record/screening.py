"""
What is wrong with recordings before any fit: told apart here, named, left out or refused.

A recording that cannot be what it says it is (a dead sensor, a speed of zero, the same
file twice) is left out with its reason; where none is left the first reason is the error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.stats import linregress

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.record.channels import Channels, channels_of, refuse, runs
from hunt_ros.identification.record.envelope import WINDOW_CYCLES, Envelope
from hunt_ros.identification.settings import FREQUENCIES_HZ, IdentificationSettings
from hunt_ros.samples import NANOSECONDS, Record, Series

#: Below this share of its highest speed a rig stands: there is nothing to learn there.
_STANDING = 0.05
#: A longer time without a sample parts a record, s: what went on meanwhile is not known.
_GAP_S = 60.0
#: Lateral motion larger or smaller than these in units of d0, and speeds outside this
#: range (m/s), are rather a wrong unit.
_LATERAL_RANGE = (2e-5, 5.0)
_SPEED_RANGE = (0.05, 150.0)
#: Factor between the speeds of two recordings that is rather another unit; and a displacement that
#: is none of a wheelset, m.
_OTHER_UNIT, _ABSURD = 3.0, 1e3
#: Power of the motion over that of the noise, at its 95th percentile.
_ABOVE_NOISE = 5.0
#: Share of the clearance from which on a flange touches now and then.
_TOUCHES = 0.95
#: The amplitude of a limit cycle far above its fold goes with the fourth root of the distance, so
#: with 0.25 of a power of the speed or more (Eq. (32)); one that rises by less is held.
_FLAT = 0.15
#: ... seen at so many speeds, over so much of the speed.
_FLAT_STATES, _FLAT_RANGE = 4, 0.1
#: One sample in so many stands in the sketch of a recording, whichever cut holds it; so many in
#: common, of which half are the same, are of one experiment; of so much of it, all is.
_SKETCHED, _COMMON, _ALL = 64, 8, 0.99


@dataclass(frozen=True)
class Stretch:
    """
    What is known of a stretch of a recording without its samples.

    Parameters
    ----------
    source : str
        Its recording.
    duration_s : float
    swing : float
        Half the central 98 % of the lateral motion about its median, m.
    speed : float
        Its median, m/s.
    """

    source: str
    duration_s: float
    swing: float
    speed: float

    @classmethod
    def of(cls, channels: Channels) -> Stretch:
        """Look at the samples."""
        known = channels.lateral[np.isfinite(channels.lateral)]
        low, high = np.percentile(known, [1.0, 99.0])
        return cls(
            channels.source,
            float(channels.time[-1] - channels.time[0]),
            0.5 * float(high - low),
            float(np.median(channels.speed)),
        )


@dataclass(frozen=True, eq=False)
class Digest:
    """
    What is known of a recording without its samples.

    Parameters
    ----------
    source, rig : str
        What it is called, and its rig ('' for none).
    problems : str
        What opening it showed to be wrong.
    span : (int, int)
        First and last stamp, ns.
    sketch : Series
        Some of the lateral samples, by which those that were given twice are known.
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
    speed_step : float
        Step of coarse speed readings, m/s; 0: they are fine.
    stretches : tuple of Stretch
        In which the rig runs.
    """

    source: str
    rig: str
    problems: str
    span: tuple[int, int]
    sketch: Series
    ignored: tuple[int, ...]
    said: tuple[str, ...]
    refused: str
    measures: bool
    turns_per_metre: float
    speed_step: float
    stretches: tuple[Stretch, ...]


def sketch_of(lateral: Series) -> Series:
    """Return some samples, chosen by their stamps alone: of any cut the same."""
    mixed = lateral.stamps_ns.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    chosen = mixed < np.uint64(2**64 // _SKETCHED)
    return Series(lateral.stamps_ns[chosen], lateral.values[chosen])


def repeated(one: Digest, others: Sequence[Digest]) -> tuple[float, float, str] | None:
    """
    Return the interval of a recording that another one holds too, s since its start, and whose.

    Data that are given twice, whole or in cuts that overlap, would count twice.
    """
    start, end = one.span
    for other in others:
        low, high = max(start, other.span[0]), min(end, other.span[1])
        _, mine, its = np.intersect1d(
            one.sketch.stamps_ns, other.sketch.stamps_ns, return_indices=True
        )
        same = one.sketch.values[mine] == other.sketch.values[its]
        if same.size >= _COMMON and same.mean() > 0.5:
            if high - low > _ALL * (end - start):
                return 0.0, math.inf, other.source
            return (low - start) / NANOSECONDS, (high + 1 - start) / NANOSECONDS, other.source
    return None


def refuse_two_rigs(recordings: Sequence[Digest]) -> None:
    """
    Refuse recordings of which two name different rigs.

    Raises
    ------
    IdentificationError
        Naming both.
    """
    rigs = {one.rig: one.source for one in reversed(recordings) if one.rig}
    if len(rigs) > 1:
        first, second = list(reversed(rigs.items()))[:2]
        raise IdentificationError(
            f'recordings of different rigs: {first[0]!r} in {first[1]} and {second[0]!r} in'
            f' {second[1]}, expected those of one rig'
        )


def moving(record: Record) -> list[Channels]:
    """
    Bring a record onto its lateral samples, in stretches in which the rig runs without a long gap.

    Raises
    ------
    IdentificationError
        As `channels_of`; for a lateral channel that never changes, and for a speed that
        is zero throughout.
    """
    channels = channels_of(record)
    name, finite = channels.source, channels.lateral[np.isfinite(channels.lateral)]
    refuse(not finite.size, name, 'no lateral sample lies within the time of the roller channel')
    dead = f'lateral is {finite[0] + 0.0:.3g} m throughout: a sensor that measures nothing'
    refuse(float(np.ptp(finite)) == 0.0, name, dead)
    most = float(np.abs(finite).max())
    absurd = f'lateral reaches {most:.3g} m: no displacement of a wheelset (metres)'
    refuse(most > _ABSURD, name, absurd)
    top = float(channels.speed.max())
    refuse(top <= 0.0, name, 'speed is 0 throughout, expected a running speed')
    gaps = np.flatnonzero(np.diff(channels.time) > _GAP_S) + 1
    parts = [
        channels.part(slice(first, last))
        for begin, end in runs(channels.speed > _STANDING * top)
        for first, last in pairwise([begin, *gaps[(gaps > begin) & (gaps < end)].tolist(), end])
        if np.isfinite(channels.lateral[first:last]).sum() >= 50
        and channels.time[last - 1] - channels.time[first] >= 3.0
    ]
    refuse(not parts, name, f'the rig never runs for 3 s on end (highest speed {top:.3g} m/s)')
    return parts


def doubts(stretches: Sequence[Stretch], settings: IdentificationSettings) -> Iterator[str]:
    """Say what is taken from the paper's rig, and what looks like a wrong unit."""
    unit, time = settings.length_unit, settings.time_unit
    assumed = [f'd0 = {unit:.4g} m (length_scale_m)'] * (not settings.length_scale_m)
    assumed += [f'1/omega_psi = {time:.4g} s (time_scale_s)'] * (not settings.time_scale_s)
    if assumed:
        yield (
            f'not given, and taken from the rig of the paper: {" and ".join(assumed)}; the'
            ' coefficients of another rig are then not in its own scales'
        )
    for one in stretches:
        if not _LATERAL_RANGE[0] <= one.swing / unit <= _LATERAL_RANGE[1]:
            yield (
                f'{one.source}: lateral motion of {one.swing:.2g} m with d0 = {unit:g} m: is the'
                ' unit right? (metres; SOURCE*0.001 for mm)'
            )
        if not _SPEED_RANGE[0] <= one.speed <= _SPEED_RANGE[1]:
            yield (
                f'{one.source}: speed of {one.speed:.3g} m/s: is the unit right?'
                ' (metres a second; SOURCE*0.001 for mm/s)'
            )
    speeds = [one.speed for one in stretches]
    if speeds and max(speeds) > _OTHER_UNIT * min(speeds):
        one, other = (stretches[speeds.index(end(speeds))] for end in (min, max))
        yield (
            f'{one.source} runs at {one.speed:.3g} and {other.source} at {other.speed:.3g} m/s:'
            ' is the unit right? (SOURCE*0.2778 for km/h)'
        )


def above_noise(envelopes: Sequence[Envelope]) -> None:
    """
    Refuse recordings of nothing but noise, whose strongest line is a line of chance.

    Raises
    ------
    IdentificationError
        If the power at the hunting frequency is what white noise has anywhere.
    """
    power = np.concatenate([envelope.amplitude for envelope in envelopes]) ** 2
    noise = 2.0 * np.concatenate([envelope.noise for envelope in envelopes]) ** 2
    known = np.isfinite(power) & np.isfinite(noise) & (noise > 0.0)
    if not known.any():
        return
    # Of white noise the ratio is exponential with mean one: 3.0 at this percentile.
    if float(np.percentile(power[known] / noise[known], 95.0)) < _ABOVE_NOISE:
        raise IdentificationError(
            'no hunting motion stands out of the noise of the lateral channel'
            f' ({float(np.sqrt(np.median(power[known]))):.2g} m at'
            f' {float(np.median(envelopes[0].frequency)):.3g} Hz, its strongest line)'
        )


def without_contact(channels: Channels, settings: IdentificationSettings) -> Channels:
    """
    Leave out the samples of motion that a flange turns back: it is faster than hunting.

    Half a period of the slowest hunting on both sides of each contact goes with it; what touches
    throughout stays as it is.
    """
    if not settings.flange_clearance_m:
        return channels
    touching = _travel(channels) >= _TOUCHES * settings.flange_clearance_m
    reach = round(0.5 * channels.rate_hz / FREQUENCIES_HZ[0])
    near = maximum_filter1d(touching, 2 * reach + 1)
    free = np.where(near, np.nan, channels.lateral)
    return replace(channels, lateral=free) if np.isfinite(free).any() else channels


def parted_by_contact(
    envelope: Envelope, channels: Channels, clearance: float, warnings: list[str]
) -> tuple[Envelope, Envelope]:
    """
    Part the motion in which a flange touches from the rest: no smooth growth law holds there.

    Parameters
    ----------
    envelope : Envelope
        Of one recording.
    channels : Channels
        What it is the envelope of. In contact the frequency is another one, and the envelope
        shows little of the motion.
    clearance : float
        Displacement at which a flange touches, m; 0: not known.
    warnings : list of str
        Grows by how long it touched.

    Returns
    -------
    seen, free : Envelope
        Where a flange touched in the window the one has the displacement as its amplitude, the
        other NaN.
    """
    if not clearance:
        return envelope, envelope
    window = WINDOW_CYCLES / float(np.median(envelope.frequency))
    travel = np.nan_to_num(_travel(channels))
    largest = maximum_filter1d(travel, 2 * round(0.5 * window * channels.rate_hz) + 1)
    at = np.minimum(np.searchsorted(channels.time, envelope.time), travel.size - 1)
    touching = largest[at] >= _TOUCHES * clearance
    if not touching.any():
        return envelope, envelope
    warnings.append(
        f'{envelope.source}: flange contact for {envelope.step * touching.sum():.3g} s: the'
        f' displacement comes to {travel.max():.3g} m, the clearance is {clearance:.3g} m;'
        ' it is not fitted'
    )
    seen, free = (
        replace(envelope, phasor=np.where(touching, there, envelope.phasor))
        for there in (largest[at].astype(complex), np.full(at.size, complex(np.nan, np.nan)))
    )
    return seen, free


def _travel(channels: Channels) -> NDArray[np.float64]:
    """Return how far the wheelset is from its middle, m."""
    return np.abs(channels.lateral - np.nanmedian(channels.lateral))


def held_amplitude(states: Sequence[SteadyState], threshold: float | None) -> tuple[float, str]:
    """
    Find a limit cycle that is as large at every speed: a flange holds it, and no growth law.

    Parameters
    ----------
    states : sequence of SteadyState
        Of all recordings.
    threshold : float or None
        Amplitude that parts quiet from hunting, m.

    Returns
    -------
    amplitude : float
        Its smallest amplitude, m; 0 where the limit cycle depends on the speed.
    said : str
        What was seen, and what would tell more.
    """
    cycle = [s for s in states if threshold is not None and s.amplitude > threshold]
    if not _flat(cycle):
        return 0.0, ''
    # Neither is that of a recording alone: one of them may have another unit.
    alone = [[s for s in cycle if s.source == source] for source in {s.source for s in cycle}]
    if any(_several(some) and not _flat(some) for some in alone):
        return 0.0, ''
    amplitude, speed = [s.amplitude for s in cycle], [s.speed for s in cycle]
    low, high = min(amplitude), max(amplitude)
    return low, (
        f'the amplitude of the limit cycle does not depend on the speed ({1e3 * low:.3g} to'
        f' {1e3 * high:.3g} mm from {min(speed):.3g} to {max(speed):.3g} m/s), as if the flanges'
        ' held it: it is not fitted; flange_clearance_m says where they touch'
    )


def _several(cycle: Sequence[SteadyState]) -> bool:
    """Whether limit cycles were seen at enough speeds to tell how they depend on it."""
    speed = [state.speed for state in cycle]
    return len(speed) >= _FLAT_STATES and max(speed) >= (1.0 + _FLAT_RANGE) * min(speed)


def _flat(cycle: Sequence[SteadyState]) -> bool:
    if not _several(cycle):
        return False
    found = linregress(*np.log([(s.speed, s.amplitude) for s in cycle]).T)
    return bool(abs(found.slope) + 2.0 * found.stderr < _FLAT)
