"""
What is wrong with recordings before any fit: told apart here, named, left out or refused.

A recording that cannot be what it says it is (a dead sensor, a speed of zero, the same
file twice) is left out with its reason; where none is left the first reason is the error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.stats import linregress

from hunt_ros.analysis.steady_state import SteadyState
from hunt_ros.errors import IdentificationError
from hunt_ros.identification.record.channels import Channels, channels_of
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import Record

#: Below this share of its highest speed a rig stands: there is nothing to learn there.
_STANDING = 0.05
#: Lateral motion larger or smaller than these in units of d0, and speeds outside this
#: range (m/s), are rather a wrong unit.
_LATERAL_RANGE = (2e-5, 5.0)
_SPEED_RANGE = (0.05, 150.0)
#: Power of the motion over that of the noise, at its 95th percentile.
_ABOVE_NOISE = 5.0
#: Share of the clearance from which on a flange touches now and then.
_TOUCHES = 0.95
#: The amplitude of a limit cycle far above its fold goes with the fourth root of the distance, so
#: with 0.25 of a power of the speed or more (Eq. (32)); one that rises by less is held.
_FLAT = 0.15
#: ... seen at so many speeds, over so much of the speed.
_FLAT_STATES, _FLAT_RANGE = 4, 0.1
#: Factor between the hunting frequencies of two runs at one speed that one rig does not show.
_OTHER_RIG = 1.35


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
    speed, slow : float
        Median and 5th percentile of the speed, m/s.
    assumed : bool
        Whether the roller's angle rests on a diameter that nobody gave.
    """

    source: str
    duration_s: float
    swing: float
    speed: float
    slow: float
    assumed: bool

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
            float(np.quantile(channels.speed, 0.05)),
            channels.assumed,
        )


@dataclass(frozen=True)
class Digest:
    """
    What is known of a recording without its samples.

    Parameters
    ----------
    source, rig : str
        What it is called, and its rig ('' for none).
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
    rig: str
    problems: str
    fingerprint: str
    ignored: tuple[int, ...]
    said: tuple[str, ...]
    refused: str
    measures: bool
    turns_per_metre: float
    stretches: tuple[Stretch, ...]


def distinct(recordings: Sequence[Digest], warnings: list[str]) -> list[tuple[int, str]]:
    """
    Leave out what was given twice, and give each recording a name of its own.

    Parameters
    ----------
    recordings : sequence of Digest
        As given by the user.
    warnings : list of str
        Grows by what was left out, and by what opening showed to be wrong.

    Returns
    -------
    list of (int, str)
        Place and name of those that are kept.

    Raises
    ------
    IdentificationError
        If the recordings say that they are of different rigs.
    """
    _one_rig(recordings)
    seen: dict[str, str] = {}
    named: dict[str, int] = {}
    kept = []
    for place, one in enumerate(recordings):
        if one.problems:
            warnings.append(f'{one.source}: damaged: {one.problems}')
        if one.fingerprint in seen:
            warnings.append(f'left out: {one.source}: the same samples as {seen[one.fingerprint]}')
            continue
        seen[one.fingerprint] = one.source
        count = named[one.source] = named.get(one.source, 0) + 1
        kept.append((place, one.source if count == 1 else f'{one.source} ({count})'))
    return kept


def _one_rig(recordings: Sequence[Digest]) -> None:
    """Refuse recordings of which two name different rigs."""
    rigs: dict[str, str] = {}
    for one in recordings:
        if one.rig:
            rigs.setdefault(one.rig, one.source)
    if len(rigs) > 1:
        (one_rig, first), (other, second) = list(rigs.items())[:2]
        raise IdentificationError(
            f'recordings of different rigs: {one_rig!r} in {first} and {other!r} in {second},'
            ' expected those of one rig'
        )


def moving(record: Record) -> list[Channels]:
    """
    Bring a record onto its lateral samples, without the stretches in which the rig stands.

    Raises
    ------
    IdentificationError
        As `channels_of`; for a lateral channel that never changes, and for a speed that
        is zero throughout.
    """
    channels = channels_of(record)
    finite = channels.lateral[np.isfinite(channels.lateral)]
    if finite.size == 0:
        raise IdentificationError(
            f'{channels.source}: no lateral sample lies within the time of the roller channel'
        )
    if float(np.ptp(finite)) == 0.0:
        raise IdentificationError(
            f'{channels.source}: lateral is {finite[0]:.3g} m throughout: a sensor that measures'
            ' nothing'
        )
    top = float(channels.speed.max())
    if top <= 0.0:
        raise IdentificationError(
            f'{channels.source}: speed is 0 throughout, expected a running speed'
        )
    runs = channels.speed > _STANDING * top
    if runs.all():
        return [channels]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], runs, [False]]).astype(np.int8)))
    parts = [
        _cut(channels, int(first), int(last))
        for first, last in edges.reshape(-1, 2)
        if last - first >= 50 and channels.time[last - 1] - channels.time[first] >= 3.0
    ]
    if not parts:
        raise IdentificationError(
            f'{channels.source}: the rig never runs for 3 s on end (highest speed {top:.3g} m/s)'
        )
    return parts


def _cut(channels: Channels, first: int, last: int) -> Channels:
    """Return the samples from first to before last; the time of the record stays."""
    part = slice(first, last)
    return replace(
        channels,
        time=channels.time[part],
        lateral=channels.lateral[part],
        speed=channels.speed[part],
        roller=channels.roller[part] if channels.roller.size else channels.roller,
    )


def doubts(stretches: Sequence[Stretch], settings: IdentificationSettings) -> list[str]:
    """
    Say what is taken from the paper's rig, and what looks like a wrong unit.

    Parameters
    ----------
    stretches : sequence of Stretch
        All that are used.
    settings : IdentificationSettings
        For d0.

    Returns
    -------
    list of str
        One line for each doubt.
    """
    found = _assumed(settings)
    low, high = (bound * settings.length_unit for bound in _LATERAL_RANGE)
    for one in stretches:
        if not low <= one.swing <= high:
            found.append(
                f'{one.source}: lateral motion of {one.swing:.2g} m with d0 ='
                f' {settings.length_unit:g} m: is the unit right? (metres; SOURCE*0.001 for mm)'
            )
        if not _SPEED_RANGE[0] <= one.speed <= _SPEED_RANGE[1]:
            found.append(
                f'{one.source}: speed of {one.speed:.3g} m/s: is the unit right?'
                ' (metres a second; SOURCE*0.001 for mm/s)'
            )
    return found


def _assumed(settings: IdentificationSettings) -> list[str]:
    """Say which units of the coefficients are those of the paper's rig, because none was given."""
    assumed = []
    if settings.length_scale is None:
        assumed.append(f'd0 = {settings.length_unit:.4g} m (--length-scale)')
    if settings.time_scale is None:
        assumed.append(f'1/omega_psi = {settings.time_unit:.4g} s (--time-scale)')
    if not assumed:
        return []
    return [
        f'not given, and taken from the rig of the paper: {" and ".join(assumed)}; the'
        ' coefficients of another rig are then not in its own scales'
    ]


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


def maybe_other_rig(stretches: Sequence[Stretch], settings: IdentificationSettings) -> list[int]:
    """Return the places of those that move: their frequencies tell whether they are of one rig."""
    if len(stretches) < 2 or settings.frequency_hz is not None:
        return []
    largest = max(one.swing for one in stretches)
    moving = [k for k, one in enumerate(stretches) if one.swing > 0.3 * largest]
    return moving if len(moving) > 1 else []


def other_rig(known: Sequence[tuple[float, Stretch]]) -> list[str]:
    """Compare the hunting frequencies, Hz, of stretches at one speed."""
    known = sorted(known, key=lambda pair: pair[0])
    for low, one in known:
        for high, other in reversed(known):
            if high < _OTHER_RIG * low:
                break
            if abs(one.speed / other.speed - 1.0) < 0.1:
                return [
                    f'{one.source} moves at {low:.3g} Hz and {other.source} at {high:.3g} Hz at'
                    ' one speed: are they of one rig?'
                ]
    return []


def without_contact(channels: Channels, settings: IdentificationSettings) -> Channels:
    """
    Leave out the samples of motion that a flange turns back: it is faster than hunting.

    Half a period of the slowest hunting on both sides of each contact goes with it; what touches
    throughout stays as it is.
    """
    if not settings.flange_clearance_m:
        return channels
    away = np.abs(channels.lateral - np.nanmedian(channels.lateral))
    touching = away >= _TOUCHES * settings.flange_clearance_m
    reach = round(0.5 * channels.rate_hz / settings.frequency_range_hz[0])
    near = maximum_filter1d(touching, 2 * reach + 1)
    free = np.where(near, np.nan, channels.lateral)
    return replace(channels, lateral=free) if np.isfinite(free).any() else channels


def free_of_contact(envelope: Envelope, clearance: float, warnings: list[str]) -> Envelope:
    """
    Take out the motion in which a flange touches: no smooth growth law holds there.

    Parameters
    ----------
    envelope : Envelope
        Of one recording.
    clearance : float
        Amplitude at which a flange touches, m; 0: not known.
    warnings : list of str
        Grows by how long it touched.

    Returns
    -------
    Envelope
        With NaN there.
    """
    if not clearance:
        return envelope
    # The wheelset travels by the hunting and by what the roller's lines make of it.
    lines = np.sqrt(2.0 * np.nan_to_num(np.maximum(envelope.line_power, 0.0)))
    travel = envelope.amplitude + lines
    touching = travel >= _TOUCHES * clearance
    if not touching.any():
        return envelope
    warnings.append(
        f'{envelope.source}: flange contact for {envelope.step * touching.sum():.3g} s: hunting'
        f" and the roller's lines come to {float(np.nanmax(travel)):.3g} m, the clearance is"
        f' {clearance:.3g} m; it is not fitted'
    )
    return replace(envelope, phasor=np.where(touching, complex(np.nan, np.nan), envelope.phasor))


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
    speed = np.array([state.speed for state in cycle])
    if speed.size < _FLAT_STATES or speed.max() < (1.0 + _FLAT_RANGE) * speed.min():
        return 0.0, ''
    amplitude = np.array([state.amplitude for state in cycle])
    found = linregress(np.log(speed), np.log(amplitude))
    if abs(found.slope) + 2.0 * found.stderr >= _FLAT:
        return 0.0, ''
    low, high = float(amplitude.min()), float(amplitude.max())
    return low, (
        f'the amplitude of the limit cycle does not depend on the speed ({1e3 * low:.3g} to'
        f' {1e3 * high:.3g} mm from {speed.min():.3g} to {speed.max():.3g} m/s), as if the flanges'
        ' held it: it is not fitted; flange_clearance_m (--clearance) says where they touch'
    )
