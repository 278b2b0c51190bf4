"""
The dataclasses every room shares: what was measured, and a number with its uncertainty.

All are frozen. Values are SI (m, rad, m/s, s, Hz); stamps are integer
nanoseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import HuntError
from hunt_ros.sensors import MOTION, SENSORS

#: Channels that may be measured: the sensors of the motion (`hunt_ros.sensors`), the continuous
#: roller angle (rad), the running speed v (m/s).
CHANNELS: tuple[str, ...] = (*MOTION, 'roller', 'speed')
#: Those that a rig has, unless it is said otherwise.
USUAL_CHANNELS: tuple[str, ...] = (
    *(sensor.name for sensor in SENSORS if sensor.usual),
    'roller',
    'speed',
)

NANOSECONDS = 1_000_000_000
#: A stamp further back than this is a clock that was set, not a late sample: a network does not
#: hold samples back for so long while later ones pass, ns.
CLOCK_RESET_NS = NANOSECONDS
#: Sensors whose clock is further from that of the detector are not believed: clocks that drift are
#: nearer, one that is hours away is that of another day.
CLOCK_OFFSET_NS = 15 * NANOSECONDS
#: Spacing of two stamps, in usual ones, in which a sample is missing.
GAP_STEPS = 1.5
#: Powers of ten from which a number is printed with an exponent.
_LARGE, _SMALL = 5, -4
#: Half a 95 % interval of a normal distribution, in standard deviations.
NORMAL_95 = 1.959964


@dataclass(frozen=True, eq=False)
class Series:
    """
    The samples of one channel, in the order in which they were recorded.

    Parameters
    ----------
    stamps_ns : array_like of int64, shape (n,)
        Header stamps. Neither their spacing nor their order is taken for granted.
    values : array_like of float64, shape (n,)
        Values in SI units. NaN is kept: whoever uses it says what becomes of it.

    Raises
    ------
    HuntError
        If the two are not one-dimensional and of one length.
    """

    stamps_ns: NDArray[np.int64]
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        stamps = np.asarray(self.stamps_ns, dtype=np.int64)
        values = np.asarray(self.values, dtype=np.float64)
        if stamps.ndim != 1 or stamps.shape != values.shape:
            raise HuntError(
                f'a series needs one stamp a value, got {stamps.shape} stamps'
                f' and {values.shape} values'
            )
        object.__setattr__(self, 'stamps_ns', stamps)
        object.__setattr__(self, 'values', values)

    def __len__(self) -> int:
        return int(self.values.size)

    def seconds(self, origin_ns: int | None = None) -> NDArray[np.float64]:
        """
        Stamps as seconds since `origin_ns` (default: the first stamp).

        Returns
        -------
        ndarray of float64, shape (n,)
        """
        if not len(self):
            return np.zeros(0)
        origin = int(self.stamps_ns[0]) if origin_ns is None else origin_ns
        seconds: NDArray[np.float64] = (self.stamps_ns - origin) / NANOSECONDS
        return seconds

    def between(self, start_ns: int, end_ns: int) -> Series:
        """Return the samples with start_ns <= stamp < end_ns, in their order."""
        inside: Any = (self.stamps_ns >= start_ns) & (self.stamps_ns < end_ns)
        if (self.stamps_ns[1:] >= self.stamps_ns[:-1]).all():  # a view of them
            inside = slice(*np.searchsorted(self.stamps_ns, [start_ns, end_ns]))
        return Series(self.stamps_ns[inside], self.values[inside])

    def in_order(self) -> Series:
        """Return the samples by their stamps; of those with one stamp the first."""
        if np.all(self.stamps_ns[1:] > self.stamps_ns[:-1]):
            return self
        stamps, first = np.unique(self.stamps_ns, return_index=True)
        return Series(stamps, self.values[first])

    def finite(self) -> Series:
        """Return the samples whose values are finite, in their order."""
        good = np.isfinite(self.values)
        return self if good.all() else Series(self.stamps_ns[good], self.values[good])

    @property
    def rate_hz(self) -> float:
        """Sample rate from the median spacing, Hz; NaN for fewer than two samples."""
        if len(self) < 2:
            return math.nan
        step = float(np.median(np.diff(self.stamps_ns)))
        return NANOSECONDS / step if step > 0 else math.nan


@dataclass(frozen=True, eq=False)
class Record(Mapping[str, Series]):
    """
    One recording of the rig: a series for each channel that was recorded.

    Parameters
    ----------
    channels : mapping of str to Series
        Keys out of `CHANNELS`; a channel that was not recorded is absent.
    source : str
        Where it comes from, for messages (a path, a seed).
    notes : mapping of str to str
        Rig, operator, remarks, as recorded.
    """

    channels: Mapping[str, Series]
    source: str = ''
    notes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknown = sorted(set(self.channels) - set(CHANNELS))
        if unknown:
            raise HuntError(f'{self.source}: unknown channel {unknown[0]!r}, expected {CHANNELS}')

    def __getitem__(self, channel: str) -> Series:
        return self.channels[channel]

    def __iter__(self) -> Iterator[str]:
        return iter(self.channels)

    def __len__(self) -> int:
        return len(self.channels)

    @property
    def start_ns(self) -> int:
        """First stamp over all channels, ns; 0 for an empty record."""
        firsts = [int(series.stamps_ns.min()) for series in self.values() if len(series)]
        return min(firsts, default=0)

    @property
    def end_ns(self) -> int:
        """Last stamp over all channels, ns; 0 for an empty record."""
        lasts = [int(series.stamps_ns.max()) for series in self.values() if len(series)]
        return max(lasts, default=0)

    @property
    def duration_s(self) -> float:
        """Time from the first stamp to the last, s."""
        return (self.end_ns - self.start_ns) / NANOSECONDS

    def between(self, start_ns: int, end_ns: int) -> Record:
        """Return the part of the record with start_ns <= stamp < end_ns."""
        parts = {name: series.between(start_ns, end_ns) for name, series in self.items()}
        return Record(parts, self.source, self.notes)


def rounded(
    numbers: Sequence[float], std: float | None = None, digits: int = 4
) -> tuple[list[str], int]:
    """
    Round numbers to two significant digits of a deviation (GUM, JCGM 100:2008, 7.2.6).

    Decimal and half to even, so that what is printed never depends on how a number happens to be
    stored in binary.

    Parameters
    ----------
    numbers : sequence of float
        Finite; the first is the estimate, and the others end where it ends.
    std : float, optional
        Its standard deviation; None or 0 where there is none.
    digits : int
        Significant digits of the estimate where there is no deviation.

    Returns
    -------
    list of str, int
        The numbers, and the power of ten that they are to be multiplied by: 0 for usual ones.
    """
    value = numbers[0]
    if std:
        place = _leading(std) - 1
        # 0.0996 rounds to 0.10: one place up, or it would show three digits.
        place = max(place, _leading(float(_at(std, place))) - 1)
    else:
        place = _leading(value) - digits + 1 if value else -1
    leading = max((_leading(x) for x in (value, std or 0.0) if x), default=0)
    power = leading if leading >= _LARGE or leading <= _SMALL else 0
    # No minus before a zero.
    scaled = [_at(x, place).scaleb(-power) for x in numbers]
    return [f'{x if x else abs(x):.{max(0, power - place)}f}' for x in scaled], power


def _leading(value: float) -> int:
    """Power of ten of the first significant digit; 0 for zero."""
    return Decimal(repr(float(abs(value)))).adjusted() if value else 0


def _at(value: float, place: int) -> Decimal:
    """`value` rounded at a decimal place given as a power of ten."""
    unit = Decimal(1).scaleb(place)
    return (Decimal(repr(float(value))) / unit).to_integral_value(ROUND_HALF_EVEN) * unit


@dataclass(frozen=True)
class Uncertain:
    """
    A number with its uncertainty.

    Parameters
    ----------
    value, std : float
        Estimate and its standard deviation, in the unit of the quantity.
    low, high : float, optional
        95 % interval; value -/+ 1.96 std where it is not given (draws give
        their own, which need not be symmetric).
    """

    value: float
    std: float
    low: float = math.nan
    high: float = math.nan

    def __post_init__(self) -> None:
        if math.isnan(self.low):
            object.__setattr__(self, 'low', self.value - NORMAL_95 * self.std)
        if math.isnan(self.high):
            object.__setattr__(self, 'high', self.value + NORMAL_95 * self.std)

    def __str__(self) -> str:
        """Value and deviation, which keeps two digits; its unit is not known here."""
        return self.text(' ± ')

    def text(self, between: str) -> str:
        """Return value and deviation with other words between them."""
        if not self._has_digits:
            return f'{self.value:.5g}'
        (value, std), power = rounded((self.value, self.std), self.std)
        return f'({value}{between}{std})e{power:+03d}' if power else f'{value}{between}{std}'

    def with_interval(self, unit: str = '') -> str:
        """Return value, unit and 95 % interval, e.g. '8.013 m/s (95 %: 7.931 to 8.095)'."""
        numbers, power = (self.value, self.low, self.high), 0
        texts = [f'{number:.5g}' for number in numbers]
        if self._has_digits and math.isfinite(self.low + self.high):
            texts, power = rounded(numbers, self.std)
        value, low, high = (f'{text}e{power:+03d}' if power else text for text in texts)
        return f'{f"{value} {unit}".rstrip()} (95 %: {low} to {high})'

    @property
    def _has_digits(self) -> bool:
        return math.isfinite(self.value) and math.isfinite(self.std) and self.std > 0.0

    def to_json(self) -> dict[str, Any] | None:
        """Return {value, std, ci95}, or None where the value is not finite."""
        if not math.isfinite(self.value):
            return None
        return {
            'value': self.value,
            'std': self.std if math.isfinite(self.std) else None,
            'ci95': [self.low, self.high] if math.isfinite(self.low + self.high) else None,
        }


@dataclass(frozen=True)
class Unknown:
    """
    A number that the data do not give; its JSON is null.

    Parameters
    ----------
    reason : str
        Why it is not known, for a person.
    """

    reason: str

    def __str__(self) -> str:
        return f'not known: {self.reason}'

    def to_json(self) -> None:
        """Return None."""


def as_text(value: object) -> str:
    """Return a value as it is published: floats with the digits that make them exact."""
    return repr(float(value)) if isinstance(value, float) else str(value)


def number_of(texts: Mapping[str, str], name: str) -> float:
    """Return a number that was published as text; NaN where there is none of this name."""
    try:
        return float(texts.get(name, 'nan'))
    except ValueError:
        return math.nan


def plain(number: float, digits: int = 3) -> str:
    """Return a number of so many digits without an exponent: 3000, and not 3e+03."""
    return np.format_float_positional(number, digits, fractional=False, trim='-')


def counted(number: int, thing: str) -> str:
    """Return e.g. '1 recording', '2 recordings'."""
    return f'{number} {thing}' if number == 1 else f'{number} {thing}s'


def different(stamps_ns: NDArray[np.int64]) -> int:
    """Return how many different times there are among stamps in any order."""
    # np.unique hashes integers since NumPy 2.3: thirty times slower where they are in order.
    ordered = np.sort(stamps_ns, kind='stable')
    return min(1, ordered.size) + int(np.count_nonzero(np.diff(ordered)))


def smallest_step(readings: NDArray[np.float64]) -> float:
    """Return the smallest step between finite readings, in their unit; 0 where all are alike."""
    steps = np.diff(np.unique(readings))
    # Numbers that went through a scale differ by rounding, 6e-8 of them in single precision. A
    # spike is no usual one.
    usual = float(np.percentile(np.abs(readings), 99.0)) if steps.size else 0.0
    steps = steps[steps > 1e-6 * usual]
    return float(steps.min()) if steps.size else 0.0


def known(value: float | None) -> float | None:
    """Return the number, or None where it is not finite: what JSON holds for 'not known'."""
    return None if value is None or not math.isfinite(value) else float(value)


def key(name: str) -> dict[str, str]:
    """Metadata of a field whose key in the JSON is not its name; '': it is not in the JSON."""
    return {'key': name}


def as_json(entry: Any) -> Any:
    """Return a result as JSON types: dataclasses by the keys of their fields, None for NaN."""
    if isinstance(entry, Uncertain | Unknown):
        return entry.to_json()
    if is_dataclass(entry):
        named = {item.metadata.get('key', item.name): item.name for item in fields(entry)}
        return {name: as_json(getattr(entry, own)) for name, own in named.items() if name}
    if isinstance(entry, Mapping):
        return {str(name): as_json(below) for name, below in entry.items()}
    if isinstance(entry, Sequence) and not isinstance(entry, str):
        return [as_json(below) for below in entry]
    return known(entry) if isinstance(entry, float) else entry
