"""
Is a channel measuring? Silence, NaN, stuck, saturated and sparse readings, impossible stamps.

One kernel walks the samples of a channel and says, for each row of the estimates,
what is wrong with it and, for each sample, whether it may be used.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F1, F2, I1, R1, compiled, compiled_part
from hunt_ros.detection import stamps as faults
from hunt_ros.detection.door import Block
from hunt_ros.samples import NANOSECONDS
from hunt_ros.sensors import MOTION, SENSORS

# What can be wrong with a channel, one bit each.
REPEATED_STAMP, BACKWARD_STAMP, AHEAD_STAMP = faults.REPEATED, faults.BACKWARD, faults.AHEAD
LATE = faults.LATE
INVALID = 16
STANDSTILL = 32
WAITING = 64
SILENT = 128
NO_VALUE = 256
STUCK = 512
SATURATED = 1024
REVERSE = 2048
SPARSE = 4096
_BITS = 13
#: Found by `speed_check`, not by the kernel below.
CONTRADICTED = 8192
#: Found by the merger: its clock is away from the detector's, and the stamps are corrected.
CLOCK = 16384
#: In place of silence, where the channel is optional: known, and no fault.
ABSENT = 32768

#: Told in the status, but the channel is still believed.
MILD = (
    REPEATED_STAMP
    | BACKWARD_STAMP
    | AHEAD_STAMP
    | LATE
    | INVALID
    | STANDSTILL
    | REVERSE
    | SPARSE
    | CLOCK
)
#: The channel cannot be trusted.
SEVERE = WAITING | SILENT | NO_VALUE | STUCK | SATURATED | CONTRADICTED
#: A saturated sensor still shows that there is motion; the others show nothing.
BLIND = SEVERE & ~SATURATED | ABSENT
#: Of these, the ones that are a fault of the sensor rather than missing input.
FAULTS = NO_VALUE | STUCK | SATURATED | CONTRADICTED

WORDS: dict[int, str] = {
    REPEATED_STAMP: 'repeated stamps',
    BACKWARD_STAMP: 'stamps that jump back',
    AHEAD_STAMP: 'stamps that jump ahead',
    LATE: 'samples that came too late',
    INVALID: 'NaN or infinite values',
    STANDSTILL: 'zero: the rig stands still',
    WAITING: 'no sample yet',
    SILENT: 'silent',
    NO_VALUE: 'only NaN or infinite values',
    STUCK: 'stuck at one value',
    SATURATED: 'saturated',
    REVERSE: 'negative: the rig runs in reverse',
    SPARSE: 'sampled too slowly for the fastest hunting that is followed',
    CONTRADICTED: 'contradicts the roller angle',
    CLOCK: 'clocks differ',
}

#: Codes of what makes a channel one that cannot be trusted: part of an alarm's code.
CODES: dict[int, str] = {
    WAITING: 'waiting',
    SILENT: 'silent',
    NO_VALUE: 'no_value',
    STUCK: 'stuck',
    SATURATED: 'saturated',
    CONTRADICTED: 'contradicted',
}

#: A fault is told for this long after its last sign, s: what comes and goes is one fault.
FAULT_HOLD_S = 1.0
#: A sensor that repeats one value for this long, s, is stuck, if the motion exceeds its steps: no
#: motion of 1 Hz and more rests at its top for a quarter of a second.
STUCK_S = 0.25
#: Samples in a period of the fastest motion that is followed: with less than two it appears as a
#: slower one (Nyquist), and stamps that are not even leave room for less.
_SAMPLES_A_PERIOD = 2.5
#: The time between samples is averaged over this time, s.
_SPACING_S = 1.0
#: Below this speed, m/s, the rig stands still: encoders and drives creep by less.
STANDSTILL_MPS = 0.05

#: What it costs to do without a channel.
COSTS: dict[str, str] = {
    **{sensor.name: sensor.cost for sensor in SENSORS},
    'roller': 'the lines of the roller are where the speed has them, and nothing checks the speed',
    'speed': 'the speed is taken to be constant_speed_mps',
}

_MOTION, _ROLLER, _SPEED = 0, 1, 2
_KINDS = {**dict.fromkeys(MOTION, _MOTION), 'roller': _ROLLER, 'speed': _SPEED}

# Integer memory: stamps, ns, and counts.
_I_ANY, _I_VALID, _I_RUN_START, _I_RUN, _I_START, _I_WINDOW, _I_SHORT, _I_SEEN = range(8)
# Float memory: last value, extremes of this window and of the one before, smallest step,
# mean length of a run of equal values, extremes of this short window and of the one before,
# mean time between usable samples, s; the value before the last one, largest displacements in this
# short window and in the one before.
_F_VALUE, _F_HIGH, _F_LOW, _F_HIGH0, _F_LOW0, _F_STEP, _F_RUN = range(7)
_F_TOP, _F_BOTTOM, _F_TOP0, _F_BOTTOM0, _F_SPACING, _F_BEFORE, _F_PEAK, _F_PEAK0, _FLOATS = range(
    7, 16
)
# Settings.
_S_KIND, _S_RANGE, _S_STUCK, _S_HOLD, _S_TIMEOUT, _S_OMEGA, _S_STANDSTILL, _S_SPACING = range(8)

_NEVER = -(2**62)

_Ints = NDArray[np.int64]
_Floats = NDArray[np.float64]

_WINDOW_NS = 4_000_000_000
#: A run of equal readings at the extreme counts as clipping from this many samples.
_FLAT_SAMPLES = 5
#: ... and from this many times the flat top that rounding alone gives a sine.
_FLAT_EXCESS = 3.0
#: The motion must span this many steps of the converter before clipping is looked for.
_SPAN_STEPS = 16.0
#: A motion that spanned so many steps within the last half to one period does not come to rest
#: within one step before `STUCK_S`: the least damped motion of a rig cannot.
_REST_STEPS = 4.0


class ChannelHealth:
    """
    Watches one channel.

    Parameters
    ----------
    channel : str
        One of `CHANNELS`.
    timeout_ns : int
        Silence that counts.
    value_range : float
        Readings of this size and more are saturated; 0: no such limit.
    frequency_hz : float
        Of the motion: what a flat top is measured against.
    fastest_hz : float
        Of the motion that is followed: what the time between samples is measured against.
    """

    def __init__(
        self,
        channel: str,
        timeout_ns: int,
        value_range: float,
        frequency_hz: float,
        fastest_hz: float,
    ) -> None:
        self._settings = np.array(
            [
                _KINDS[channel],
                value_range,
                round(STUCK_S * NANOSECONDS),
                round(FAULT_HOLD_S * NANOSECONDS),
                timeout_ns,
                2.0 * np.pi * frequency_hz,
                STANDSTILL_MPS,
                1.0 / (_SAMPLES_A_PERIOD * fastest_hz),
            ],
            dtype=np.float64,
        )
        self._whole = np.full(_I_SEEN + _BITS, _NEVER, dtype=np.int64)
        self._whole[_I_RUN] = 0
        self._real = np.zeros(_FLOATS)
        self._real[_F_VALUE] = np.nan
        self._real[[_F_HIGH, _F_HIGH0, _F_TOP, _F_TOP0]] = -np.inf
        self._real[[_F_BEFORE, _F_PEAK, _F_PEAK0]] = np.nan
        self._real[[_F_LOW, _F_LOW0, _F_BOTTOM, _F_BOTTOM0, _F_STEP]] = np.inf

    def follow(self, other: ChannelHealth) -> None:
        """Use the settings of another watch from now on."""
        self._settings = other._settings

    def update(
        self, block: Block, rows_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.uint32], NDArray[np.bool_], _Floats]:
        """
        Watch the samples up to the last row.

        Parameters
        ----------
        block : Block
            n samples, none after the last row.
        rows_ns : ndarray of int64, shape (m,)
            Stamps of the rows.

        Returns
        -------
        wrong : ndarray of uint32, shape (m,)
            Bits set at each row.
        usable : ndarray of bool, shape (n,)
            Samples that may be used.
        sizes : ndarray, shape (3, m)
            In their unit: the smallest step of the readings so far; their largest size in the
            last half to one period, each by the median of three, as one may be wrong; and half
            their range in the last 4 to 8 s.
        """
        wrong = np.zeros(rows_ns.size, dtype=np.uint32)
        usable = np.zeros(block.stamps_ns.size, dtype=np.bool_)
        sizes = np.empty((3, rows_ns.size))
        watch(
            block.stamps_ns,
            block.values,
            block.marks,
            rows_ns,
            self._settings,
            self._whole,
            self._real,
            wrong,
            usable,
            sizes,
        )
        if block.shifted:
            wrong |= np.uint32(CLOCK)
        return wrong, usable, sizes


def excused(wrong: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Return the bits of an optional channel: its silence is an absence."""
    missing = (wrong & np.uint32(SILENT | WAITING)) != 0
    rest = wrong & ~np.uint32(SILENT | WAITING)
    excused: NDArray[np.uint32] = np.where(missing, rest | np.uint32(ABSENT), rest)
    return excused


@compiled
def watch(
    stamps: I1,
    values: R1,
    marks: Annotated[NDArray[np.uint8], 1],
    rows: I1,
    settings: R1,
    whole: I1,
    real: F1,
    wrong: Annotated[NDArray[np.uint32], 1],
    usable: B1,
    sizes: F2,
) -> None:
    """Run `ChannelHealth.update` with its memory in `whole` and `real`."""
    n = 0
    for k in range(rows.size):
        row = rows[k]
        if whole[_I_START] == _NEVER:
            whole[_I_START] = row
        while n < stamps.size and stamps[n] <= row:
            usable[n] = _sample(stamps[n], values[n], marks[n], settings, whole, real)
            n += 1
        wrong[k] = _row(row, settings, whole, real)
        sizes[0, k] = real[_F_STEP]
        sizes[1, k] = np.fmax(real[_F_PEAK], real[_F_PEAK0])
        sizes[2, k] = 0.5 * (max(real[_F_HIGH], real[_F_HIGH0]) - min(real[_F_LOW], real[_F_LOW0]))
    while n < stamps.size:  # behind the last row only where rows were left out
        usable[n] = _sample(stamps[n], values[n], marks[n], settings, whole, real)
        n += 1


@compiled_part
def _sample(
    stamp: int, value: float, mark: int, settings: _Floats, whole: _Ints, real: _Floats
) -> bool:
    """Take one sample; return whether it may be used."""
    # Where every channel was silent no row has seen it.
    if whole[_I_ANY] != _NEVER and stamp - whole[_I_ANY] > settings[_S_TIMEOUT]:
        whole[_I_SEEN + 7] = stamp
    whole[_I_ANY] = stamp
    if mark != 0:
        for bit in range(4):
            if mark & (1 << bit):
                whole[_I_SEEN + bit] = stamp
    if not np.isfinite(value):
        whole[_I_SEEN + 4] = stamp
        return False
    kind = settings[_S_KIND]
    if kind == _SPEED:
        whole[_I_VALID] = stamp
        if value < -settings[_S_STANDSTILL]:
            whole[_I_SEEN + 11] = stamp
        elif value <= settings[_S_STANDSTILL]:
            whole[_I_SEEN + 5] = stamp
        return True
    spacing = 1e-9 * (stamp - whole[_I_VALID])
    if kind == _MOTION and spacing <= 1e-9 * settings[_S_TIMEOUT]:  # beyond, it is silence
        # Weighted with the time it lasts.
        real[_F_SPACING] += min(spacing / _SPACING_S, 1.0) * (spacing - real[_F_SPACING])
    whole[_I_VALID] = stamp
    if settings[_S_RANGE] > 0.0 and abs(value) >= settings[_S_RANGE]:
        whole[_I_SEEN + 10] = stamp
    if value == real[_F_VALUE]:
        whole[_I_RUN] += 1
        length = stamp - whole[_I_RUN_START]
        long = whole[_I_RUN] >= _FLAT_SAMPLES and length >= settings[_S_STUCK]
        if long and _should_move(real):
            whole[_I_SEEN + 9] = stamp
            return False
        if kind == _MOTION and _clipped(value, length, settings, whole, real):
            whole[_I_SEEN + 10] = stamp
        return True
    # In line, not a function: it runs for every sample, and the call costs as much again.
    if whole[_I_RUN] > 0:  # close the run of equal values, and widen the extremes
        run = float(stamp - whole[_I_RUN_START])
        real[_F_RUN] += 0.05 * (min(run, 4.0 * real[_F_RUN] + 1e6) - real[_F_RUN])
        step = abs(value - real[_F_VALUE])
        if step < real[_F_STEP]:
            real[_F_STEP] = step
    before = value if np.isnan(real[_F_VALUE]) else real[_F_VALUE]
    older = before if whole[_I_RUN] > 1 or np.isnan(real[_F_BEFORE]) else real[_F_BEFORE]
    real[_F_BEFORE] = before
    middle = max(min(value, before), min(max(value, before), older))
    whole[_I_RUN] = 1
    whole[_I_RUN_START] = stamp
    real[_F_VALUE] = value
    if (stamp - whole[_I_SHORT]) * 1e-9 * settings[_S_OMEGA] > np.pi:
        whole[_I_SHORT] = stamp
        real[_F_TOP0] = real[_F_TOP]
        real[_F_BOTTOM0] = real[_F_BOTTOM]
        real[_F_TOP] = real[_F_BOTTOM] = before
        real[_F_PEAK0] = real[_F_PEAK]
        real[_F_PEAK] = abs(middle)
    real[_F_PEAK] = np.fmax(real[_F_PEAK], abs(middle))
    real[_F_TOP] = max(real[_F_TOP], value)
    real[_F_BOTTOM] = min(real[_F_BOTTOM], value)
    if stamp - whole[_I_WINDOW] > _WINDOW_NS:
        whole[_I_WINDOW] = stamp
        real[_F_HIGH0] = real[_F_HIGH]
        real[_F_LOW0] = real[_F_LOW]
        real[_F_HIGH] = value
        real[_F_LOW] = value
    real[_F_HIGH] = max(real[_F_HIGH], value)
    real[_F_LOW] = min(real[_F_LOW], value)
    return True


@compiled_part
def _should_move(real: _Floats) -> bool:
    """Return True if the motion seen last is larger than what the steps of the sensor hide."""
    span = max(real[_F_TOP], real[_F_TOP0]) - min(real[_F_BOTTOM], real[_F_BOTTOM0])
    # A sensor that has never shown another value has no known step: it is not believed.
    return bool(np.isinf(real[_F_STEP]) or span > _REST_STEPS * real[_F_STEP])


@compiled_part
def _clipped(value: float, length: int, settings: _Floats, whole: _Ints, real: _Floats) -> bool:
    """Return True if the top is flatter than rounding makes that of a sine."""
    high = max(real[_F_HIGH], real[_F_HIGH0])
    low = min(real[_F_LOW], real[_F_LOW0])
    if value < high and value > low:
        return False
    span = high - low
    if whole[_I_RUN] < _FLAT_SAMPLES or not span > _SPAN_STEPS * real[_F_STEP]:
        return False
    # A sine of amplitude a stays within one step q of its top for 2 sqrt(2 q / a) / omega.
    rounding = 2.0 * np.sqrt(4.0 * real[_F_STEP] / span) / settings[_S_OMEGA] * 1e9
    return bool(length > _FLAT_EXCESS * max(rounding, real[_F_RUN]))


@compiled_part
def _row(row: int, settings: _Floats, whole: _Ints, real: _Floats) -> int:
    """Return the bits of one row."""
    timeout = settings[_S_TIMEOUT]
    since = whole[_I_START] if whole[_I_ANY] == _NEVER else whole[_I_ANY]
    if row - since > timeout:
        whole[_I_SEEN + 7] = row
    elif whole[_I_ANY] == _NEVER:
        whole[_I_SEEN + 6] = row
    else:
        valid = whole[_I_START] if whole[_I_VALID] == _NEVER else whole[_I_VALID]
        if row - valid > timeout:
            whole[_I_SEEN + 8] = row
        if real[_F_SPACING] > settings[_S_SPACING]:
            whole[_I_SEEN + 12] = row
    bits = 0
    for bit in range(_BITS):
        seen = whole[_I_SEEN + bit]
        held = settings[_S_HOLD] if bit != 6 else 0.0
        if seen != _NEVER and row - seen <= held:
            bits |= 1 << bit
    return bits
