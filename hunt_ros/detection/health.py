"""
Is a channel measuring? Silence, NaN, stuck, saturated and sparse readings, impossible stamps.

One kernel walks the samples of a channel and says, for each row of the estimates,
what is wrong with it and, for each sample, whether it may be used.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F2, I1, R1, compiled, compiled_part
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.door import Block
from hunt_ros.estimation.tracker_config import REFERENCE_HZ
from hunt_ros.samples import NANOSECONDS
from hunt_ros.sensors import MOTION, SENSORS, saturated_from

#: What can be wrong with a channel: words, and the code that it is part of in the code of an
#: alarm where the channel cannot be trusted then; bit k of a row says number k. The first four
#: are the marks of `stamps`; those from 13 on are not found by the kernel below: the check of the
#: speed, the door, silence of a channel that is optional, which is known and no fault, and the
#: second opinion.
_TABLE = (
    ('repeated stamps', ''),
    ('stamps that jump back', ''),
    ('stamps that jump ahead', ''),
    ('samples that came too late', ''),
    ('NaN or infinite values', ''),
    ('zero: the rig stands still', ''),
    ('no sample yet', 'waiting'),
    ('silent', 'silent'),
    ('only NaN or infinite values', 'no_value'),
    ('stuck at one value', 'stuck'),
    ('saturated', 'saturated'),
    ('negative: the rig runs in reverse', ''),
    ('sampled too slowly for the fastest hunting that is followed', ''),
    ('contradicts the roller angle', 'contradicted'),
    ('clocks differ', ''),
    ('', ''),
    ('shows nothing any more, not even the roller', 'lost'),
)
_INVALID, _STANDS, _WAITING, _SILENT, _NO_VALUE, _STUCK, _SATURATED, _REVERSE, _SPARSE = range(
    4, 13
)
WAITING, SILENT, NO_VALUE, STUCK, SATURATED = (1 << k for k in range(6, 11))
SPARSE, CONTRADICTED, CLOCK, ABSENT, LOST = (1 << k for k in range(12, 17))

#: Words of each bit; the codes of those that make a channel one that cannot be trusted, and these
#: bits together.
WORDS: dict[int, str] = {1 << k: words for k, (words, _) in enumerate(_TABLE) if words}
CODES: dict[int, str] = {1 << k: code for k, (_, code) in enumerate(_TABLE) if code}
SEVERE = sum(CODES)
#: A saturated sensor still shows that there is motion; the others show nothing.
BLIND = SEVERE & ~SATURATED | ABSENT
#: A fault of the sensor; a channel that gives nothing, which is another one or an optional one.
FAULTS = NO_VALUE | STUCK | SATURATED | CONTRADICTED | LOST
MISSING = SILENT | ABSENT

#: A fault is told for this long after its last sign, s: what comes and goes is one fault.
FAULT_HOLD_S = 1.0
#: A channel that repeats one value for this long, s, is stuck. A sensor of the motion is if its
#: motion exceeds its steps, and after this part of the hunting period: none rests so long at its
#: top.
STUCK_S, _STUCK_PERIODS = 0.25, 0.25
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
_NEVER = -(2**62)

_WINDOW_NS = 4_000_000_000
#: A run of equal readings at the extreme counts as clipping from this many samples.
_FLAT_SAMPLES = 5
#: ... and from this many times the flat top that rounding alone gives a sine.
_FLAT_EXCESS = 3.0
#: The motion must span this many steps of the converter before clipping is looked for.
_SPAN_STEPS = 16.0
#: A motion that spanned so many steps within the last half to one period does not come to rest
#: within one step before it counts as stuck: the least damped motion of a rig cannot.
_REST_STEPS = 4.0

#: What is remembered: stamps, ns, of the first row, of the last sample, of the last usable one,
#: of the beginning of the run of equal values and of the two windows; when each fault was seen
#: last; length of the run; the last two values, the smallest step between two, the mean length of
#: a run, ns, the mean time between usable samples, s; of this window and the one before the
#: extremes, of the short ones the extremes and the largest size.
_BEGINNING: dict[str, Any] = {
    **dict.fromkeys(('start', 'any', 'valid', 'begun', 'window', 'short'), _NEVER),
    'seen': [_NEVER] * (_SPARSE + 1),
    'run': 0,
    **dict.fromkeys(('value', 'before'), np.nan),
    'step': np.inf,
    **dict.fromkeys(('length', 'spacing'), 0.0),
    **dict.fromkeys(('high', 'top'), [-np.inf] * 2),
    **dict.fromkeys(('low', 'bottom'), [np.inf] * 2),
    'peak': [np.nan] * 2,
}
_MEMORY: np.dtype[np.void] = np.dtype(
    [(name, np.asarray(x).dtype, np.shape(x)) for name, x in _BEGINNING.items()], align=True
)


def stuck_s(config: DetectorConfig, channel: str) -> float:
    """Return how long a channel may repeat one value, s."""
    period_s = 1.0 / (REFERENCE_HZ * config.faster)
    return max(STUCK_S, _STUCK_PERIODS * period_s if channel in MOTION else 0.0)


class _Limits(NamedTuple):
    """What a channel is held to: its unit, ns, rad/s, s."""

    kind: int
    value_range: float
    timeout: int
    stuck: int
    hold: int
    omega: float
    spacing: float


class ChannelHealth:
    """
    Watches one channel.

    Parameters
    ----------
    config : DetectorConfig
        With a hunting frequency: of the motion, what a flat top is measured against, and
        of the fastest that is followed, what the time between samples is.
    channel : str
        One of `CHANNELS`.
    """

    def __init__(self, config: DetectorConfig, channel: str) -> None:
        self._channel = channel
        self.follow(config)
        self._memory = np.array([tuple(_BEGINNING.values())], dtype=_MEMORY)

    def follow(self, config: DetectorConfig) -> None:
        """Use other settings from now on."""
        self._optional = self._channel in config.optional_channels
        self._limits = _Limits(
            _KINDS[self._channel],
            saturated_from(config, self._channel),
            config.timeout_ns(self._channel),
            round(stuck_s(config, self._channel) * NANOSECONDS),
            round(FAULT_HOLD_S * NANOSECONDS),
            2.0 * np.pi * config.hunting_frequency_hz,
            1.0 / (_SAMPLES_A_PERIOD * config.followed_hz[1]),
        )

    def update(
        self, block: Block, rows_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.uint32], NDArray[np.bool_], NDArray[np.float64]]:
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
            their range in the last 4 to 8 s. NaN where the sensor shows nothing.
        """
        wrong = np.zeros(rows_ns.size, dtype=np.uint32)
        usable = np.zeros(block.stamps_ns.size, dtype=np.bool_)
        sizes = np.empty((3, rows_ns.size))
        samples = block.stamps_ns, block.values, block.marks
        _watch(*samples, rows_ns, self._limits, self._memory, wrong, usable, sizes)
        sizes[:, (wrong & BLIND) != 0] = np.nan
        if block.shifted:
            wrong |= np.uint32(CLOCK)
        if self._optional:  # its silence is an absence
            missing = (wrong & np.uint32(SILENT | WAITING)) != 0
            wrong[missing] = wrong[missing] & ~np.uint32(SILENT | WAITING) | np.uint32(ABSENT)
        return wrong, usable, sizes


@compiled
def _watch(
    stamps: I1,
    values: R1,
    marks: Annotated[NDArray[np.uint8], 1],
    rows: I1,
    limits: _Limits,
    memory: Annotated[NDArray[np.void], 1, _MEMORY],
    wrong: Annotated[NDArray[np.uint32], 1],
    usable: B1,
    sizes: F2,
) -> None:
    """Run `ChannelHealth.update`."""
    m = memory[0]
    n = 0
    for k in range(rows.size):
        row = rows[k]
        if m['start'] == _NEVER:
            m['start'] = row
        while n < stamps.size and stamps[n] <= row:
            usable[n] = _sample(stamps[n], values[n], marks[n], limits, m)
            n += 1
        wrong[k] = _row(row, limits, m)
        sizes[0, k] = m['step']
        sizes[1, k] = np.fmax(m['peak'][0], m['peak'][1])
        sizes[2, k] = 0.5 * (max(m['high'][0], m['high'][1]) - min(m['low'][0], m['low'][1]))


@compiled_part
def _sample(stamp: int, value: float, mark: int, limits: _Limits, m: Any) -> bool:
    """Take one sample; return whether it may be used."""
    seen = m['seen']
    # Where every channel was silent no row has seen it.
    if m['any'] != _NEVER and stamp - m['any'] > limits.timeout:
        seen[_SILENT] = stamp
    m['any'] = stamp
    if mark != 0:
        for bit in range(_INVALID):
            if mark & (1 << bit):
                seen[bit] = stamp
    if not np.isfinite(value):
        seen[_INVALID] = stamp
        return False
    if limits.kind == _SPEED:
        m['valid'] = stamp
        if value < -STANDSTILL_MPS:
            seen[_REVERSE] = stamp
        elif value <= STANDSTILL_MPS:
            seen[_STANDS] = stamp
        return True
    if limits.kind == _MOTION and stamp - m['valid'] <= limits.timeout:  # beyond, it is silence
        # Weighted with the time it lasts.
        spacing = 1e-9 * (stamp - m['valid'])
        m['spacing'] += min(spacing / _SPACING_S, 1.0) * (spacing - m['spacing'])
    m['valid'] = stamp
    if limits.value_range > 0.0 and abs(value) >= limits.value_range:
        seen[_SATURATED] = stamp
    if value == m['value']:
        m['run'] += 1
        length = stamp - m['begun']
        if m['run'] >= _FLAT_SAMPLES and length >= limits.stuck and _should_move(m):
            seen[_STUCK] = stamp
            return False
        if limits.kind == _MOTION and _clipped(value, length, limits, m):
            seen[_SATURATED] = stamp
        return True
    # In line, not a function: it runs for every sample, and the call costs as much again.
    last = m['value']
    if m['run'] > 0:  # close the run of equal values, and widen the extremes
        run = float(stamp - m['begun'])
        m['length'] += 0.05 * (min(run, 4.0 * m['length'] + 1e6) - m['length'])
        m['step'] = min(m['step'], abs(value - last))
    before = value if np.isnan(last) else last
    older = before if m['run'] > 1 or np.isnan(m['before']) else m['before']
    m['before'] = before
    size = abs(max(min(value, before), min(max(value, before), older)))
    m['run'] = 1
    m['begun'] = stamp
    m['value'] = value
    if (stamp - m['short']) * 1e-9 * limits.omega > np.pi:
        m['short'] = stamp
        m['top'][1], m['bottom'][1], m['peak'][1] = m['top'][0], m['bottom'][0], m['peak'][0]
        m['top'][0] = m['bottom'][0] = before
        m['peak'][0] = size
    m['peak'][0] = np.fmax(m['peak'][0], size)
    m['top'][0] = max(m['top'][0], value)
    m['bottom'][0] = min(m['bottom'][0], value)
    if stamp - m['window'] > _WINDOW_NS:
        m['window'] = stamp
        m['high'][1], m['low'][1] = m['high'][0], m['low'][0]
        m['high'][0] = m['low'][0] = value
    m['high'][0] = max(m['high'][0], value)
    m['low'][0] = min(m['low'][0], value)
    return True


@compiled_part
def _should_move(m: Any) -> bool:
    """Return True if the motion seen last is larger than what the steps of the sensor hide."""
    span = max(m['top'][0], m['top'][1]) - min(m['bottom'][0], m['bottom'][1])
    # A sensor that has never shown another value has no known step: it is not believed.
    return bool(np.isinf(m['step']) or span > _REST_STEPS * m['step'])


@compiled_part
def _clipped(value: float, length: int, limits: _Limits, m: Any) -> bool:
    """Return True if the top is flatter than rounding makes that of a sine."""
    high, low = max(m['high'][0], m['high'][1]), min(m['low'][0], m['low'][1])
    span = high - low
    if low < value < high or m['run'] < _FLAT_SAMPLES or not span > _SPAN_STEPS * m['step']:
        return False
    # A sine of amplitude a stays within one step q of its top for 2 sqrt(2 q / a) / omega.
    rounding = 2.0 * np.sqrt(4.0 * m['step'] / span) / limits.omega * 1e9
    return bool(length > _FLAT_EXCESS * max(rounding, m['length']))


@compiled_part
def _row(row: int, limits: _Limits, m: Any) -> int:
    """Return the bits of one row."""
    seen = m['seen']
    if row - (m['start'] if m['any'] == _NEVER else m['any']) > limits.timeout:
        seen[_SILENT] = row
    elif m['any'] == _NEVER:
        seen[_WAITING] = row
    else:
        if row - (m['start'] if m['valid'] == _NEVER else m['valid']) > limits.timeout:
            seen[_NO_VALUE] = row
        if m['spacing'] > limits.spacing:
            seen[_SPARSE] = row
    bits = 0
    for bit in range(seen.size):
        held = limits.hold if bit != _WAITING else 0
        if limits.kind == _MOTION and bit in (_STUCK, _SATURATED):
            # A slow one is cut off, and rests, once a period.
            held = max(held, int(3e9 * np.pi / limits.omega))
        if seen[bit] != _NEVER and row - seen[bit] <= held:
            bits |= 1 << bit
    return bits
