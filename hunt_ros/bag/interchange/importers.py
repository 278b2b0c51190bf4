"""Recordings that other programs made, turned into a record and into a bag."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.channels import Channels, ChannelSource, channel_map
from hunt_ros.bag.clocks import refuse_years
from hunt_ros.bag.columns import read_record, with_constants
from hunt_ros.bag.interchange.tables import Table, load_table, select
from hunt_ros.bag.plausible import NO_READING
from hunt_ros.bag.reader import ROS_1, STORAGES, storage_kind
from hunt_ros.bursts import bursts_of, spread
from hunt_ros.errors import BagError
from hunt_ros.samples import CHANNELS, NANOSECONDS, Record, Series, different
from hunt_ros.sensors import UNITS, si_of

#: Units of a time, s; names that have one behind.
TIME_UNITS: dict[str, float] = {'ns': 1e-9, 'us': 1e-6, 'ms': 1e-3, 's': 1.0, 'min': 60.0}
_CLOCKS = ('stamp', 'time', 't')
#: Column names that mean the time: in s where neither they nor the file tell the unit.
TIMES: tuple[str, ...] = (
    *(f'{name}_{unit}' for name in _CLOCKS for unit in TIME_UNITS),
    *('time', 't', 'timestamp', 'seconds', 'x_value'),
)
#: Where more samples than this share of all have the time of another one, its clock is coarse:
#: they are spread over its ticks, if there are so many.
_SHARED, _TICKS = 0.1, 10
#: What loggers write where there is no reading.
_CODES = (999.0, 999.9, 7999.0, 9999.0, 9999.9, 99999.0, 999999.0)
#: Shortest and longest step of so many times, s: of days that are taken for seconds they are
#: shorter, of milliseconds longer.
_STEPS_S, _FEWEST = (2e-6, 0.15), 50
#: Times beyond this do not fit into whole nanoseconds of 64 bits, s.
LATEST_S = 9e9


def load_record(
    path: str | Path,
    channels: Channels = (),
    *,
    rate_hz: float | None = None,
    time: str | None = None,
) -> Record:
    """
    Read a foreign file as a record of the rig.

    Parameters
    ----------
    path : str or Path
        The file.
    channels : mapping or sequence
        `{'yaw': 'data[0]', 'lateral': 'data[1]*0.47', 'speed': 16.3}`. The others are found
        by name: lateral, yaw, roller, speed, with a unit behind (`lateral_mm`, `speed_kmh`),
        with the unit that the file tells, or in SI. One number alone, as the speed of a run,
        holds for all of it.
    rate_hz : float, optional
        Sample rate of a file without times; its first stamp is 1 s.
    time : str, optional
        Column of the times, `t_ms*0.001`, in seconds. Without it and without a rate, the
        channel's own times (a waveform), a column named as one of `TIMES` or one of dates is
        taken. A file that begins before 1 s is moved to begin there: a stamp of zero means
        "no time" in ROS.

    Raises
    ------
    BagError
        If something named is not there, there are no times, they go backwards or are too
        coarse, a series is all NaN, or its length is not that of the times.
    """
    mapping = channel_map(channels)
    if Path(path).is_dir() or storage_kind(Path(path)) in (*STORAGES, ROS_1):
        if rate_hz is not None or time is not None:
            raise BagError(f'{path}: a recording has its times, expected no rate and no column')
        return read_record(path, mapping, as_stamped=True)
    if rate_hz is not None and not 0.0 < rate_hz < 1e9:
        raise BagError(f'rate {rate_hz!r}: expected samples a second, greater than 0')
    if rate_hz is not None and time is not None:
        raise BagError(f'{path}: either the sample rate or the column of times, not both')
    table = load_table(path)
    try:
        series, mapping = _channels(table, mapping, rate_hz, time)
    except BagError as error:
        raise BagError(f'{path}: {error}{table.doubt}') from error
    told = {'source': Path(path).name, **table.told}
    notes = {name: text for name, text in told.items() if text}
    refuse_years(series, str(path))
    return Record(with_constants(series, mapping, str(path)), str(path), notes)


def _channels(
    table: Table, given: Mapping[str, ChannelSource], rate_hz: float | None, time: str | None
) -> tuple[dict[str, Series], dict[str, ChannelSource]]:
    """Return the series of the channels, and where each comes from."""
    given = {name: replace(one, source=table.column(one.source)) for name, one in given.items()}
    mapping = {**_named(table, given), **given}
    sources = {name: source for name, source in mapping.items() if source.constant is None}
    table.told['units_assumed'] = _assumed(table, sources)
    columns = {name: select(table, source.source) for name, source in sources.items()}
    if all(column.size < 2 for column in columns.values()):
        raise BagError('no channel has more than one value, expected a series of the file')
    stamps = _clocks(table, sources, columns, rate_hz, time)
    series = {name: _series(sources[name], columns[name], stamps[name]) for name in columns}
    return series, mapping


def _series(source: ChannelSource, values: NDArray[Any], stamps: NDArray[np.int64]) -> Series:
    """Return the samples of a channel."""
    if values.dtype.kind == 'M':
        raise BagError(f'{source.source} holds times, expected numbers')
    if values.size == 1:
        values = np.full(stamps.size, values[0])
    if stamps.size != values.size:
        raise BagError(f'{source.source} has {values.size} values for {stamps.size} times')
    # An empty cell is no sample; one that says "nan" is a sample that failed.
    there = ~np.ma.getmaskarray(values)
    stamps, values = stamps[there], np.ma.getdata(values)[there].astype(np.float64)
    values = _without_codes(values)
    if not np.isfinite(values).any():
        raise BagError(f'{source.source} holds no finite number')
    times = different(stamps)
    if values.size - times > _SHARED * values.size:
        raise BagError(
            f'{source.source} has {values.size} values at {times} different times,'
            ' expected times with more digits, or the sample rate (--rate)'
        )
    return Series(stamps, values * source.scale + source.offset)


def _without_codes(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values, NaN where one far beyond all others is a code for "no reading"."""
    sizes = np.abs(values)
    codes = np.isin(sizes, _CODES) | (sizes >= NO_READING)
    least = 0.1 * float(sizes[codes].min(initial=math.inf))
    return np.where(codes & (np.nanmax(sizes[~codes], initial=0.0) < least), math.nan, values)


def _clocks(
    table: Table,
    sources: Mapping[str, ChannelSource],
    columns: Mapping[str, NDArray[Any]],
    rate_hz: float | None,
    time: str | None,
) -> dict[str, NDArray[np.int64]]:
    """Return the stamps of each channel, ns: its own, or those of all."""
    clocks: dict[str, NDArray[np.int64]] = {}
    if rate_hz is None and time is None:
        own = {name: table.stamps_ns.get(source.source) for name, source in sources.items()}
        clocks = {name: stamps for name, stamps in own.items() if stamps is not None}
    if clocks.keys() != columns.keys():
        if rate_hz is not None:
            length = max(column.size for column in columns.values())
            times = np.rint(np.arange(length) / rate_hz * NANOSECONDS).astype(np.int64)
        else:
            source = _time_source(table, time)
            times = _spread(_to_ns(select(table, source.source), source), table)
            apart = np.diff(times) / NANOSECONDS
            step = float(np.median(apart)) if apart.size >= _FEWEST else _STEPS_S[1]
            taken = time is None and source.scale == 1.0  # for seconds
            if taken and not _STEPS_S[0] <= step <= _STEPS_S[1]:
                raise BagError(
                    f'the times of column {source.source} are {step:.3g} s apart: in which unit?'
                    f' (--time {source.source} of seconds, {source.source}*0.001 of milliseconds,'
                    f' {source.source}*86400 of days)'
                )
        clocks = dict.fromkeys(columns, times) | clocks
    begins = {int(stamps[0]): name for name, stamps in clocks.items() if stamps.size}
    ends = {int(stamps[-1]): name for name, stamps in clocks.items() if stamps.size}
    between = max(begins, default=0) - min(ends, default=0)
    if between > 0:
        raise BagError(
            f'{ends[min(ends)]} ends {between / NANOSECONDS:.3f} s before {begins[max(begins)]}'
            ' begins, expected a time that they share (--rate takes them as sampled together)'
        )
    shift = max(0, NANOSECONDS - min(begins, default=NANOSECONDS))
    return {name: stamps + shift for name, stamps in clocks.items()}


def _time_source(table: Table, time: str | None) -> ChannelSource:
    """Return the column of the times; its scale makes seconds of it."""
    if time is not None:
        source = ChannelSource.of('time', time)
        if source.constant is not None:
            raise BagError('the time is a constant, expected a column')
        return replace(source, source=table.column(source.source))
    names = {_key(str(name)): str(name) for name in table}
    usual = next((name for name in TIMES if name in names), '')
    dates = [name for name, column in table.items() if getattr(column, 'dtype', None) is not None
             and column.dtype.kind == 'M']  # fmt: skip
    by_unit = [name for name, unit in table.units.items() if _plain(unit) in TIME_UNITS]
    if not usual and not dates and len(by_unit) == 1:  # in any language
        return ChannelSource('time', by_unit[0], TIME_UNITS[_plain(table.units[by_unit[0]])])
    if not usual and not dates:
        unread = [str(column) for column in table.values() if isinstance(column, BagError)]
        raise BagError(
            'no column of times (t, time or stamp, with its unit behind), expected one, or the'
            ' sample rate (--rate), or --time COLUMN' + ''.join(f'; {why}' for why in unread[:1])
        )
    if not usual:
        return ChannelSource('time', dates[0])
    name = names[usual]
    unit = _told_unit(table, TIME_UNITS, name) or 's'
    if unit not in TIME_UNITS:
        raise BagError(f'column {name}: unknown unit {unit!r} of a time, expected --time')
    return ChannelSource('time', name, TIME_UNITS[unit])


def _to_ns(column: NDArray[Any], source: ChannelSource) -> NDArray[np.int64]:
    """Return times as whole nanoseconds, and whole ones as they are: float64 has no room."""
    dates = column.dtype.kind == 'M'
    raw: NDArray[np.float64] = np.ma.filled(
        (column.astype('datetime64[s]') if dates else column).astype(np.float64), np.nan
    )
    bad = np.isnat(column) if dates else ~np.isfinite(raw)
    seconds = np.where(bad, 0.0, raw) * source.scale + source.offset
    if (np.abs(seconds) > LATEST_S).any():
        raise BagError(
            f'{source.source} reaches beyond {LATEST_S:g} s: in which unit?'
            f' (--time {source.source}*0.001 of milliseconds, {source.source}*1e-9 of nanoseconds)'
        )
    if dates:
        stamps = column.astype('datetime64[ns]').astype(np.int64)
        stamps = stamps + round(source.offset * NANOSECONDS)
    else:
        stamps = np.rint(seconds * NANOSECONDS).astype(np.int64)
        if source.scale == 1e-9 and not source.offset:
            exact = column if column.dtype.kind in 'iu' else np.rint(np.where(bad, 0.0, raw))
            stamps = np.asarray(exact).astype(np.int64)
    if bad.any():
        raise BagError(f'{source.source} is not finite in row {np.flatnonzero(bad)[0]}')
    backwards = np.flatnonzero(np.diff(stamps) < 0)
    if backwards.size:
        raise BagError(f'{source.source} goes backwards in row {backwards[0] + 1}')
    return stamps


def _spread(stamps_ns: NDArray[np.int64], table: Table) -> NDArray[np.int64]:
    """Return the stamps of a coarse clock, which gives one to several samples, spread evenly."""
    shared = stamps_ns.size - different(stamps_ns) > _SHARED * stamps_ns.size
    found = bursts_of(stamps_ns, _SHARED, _TICKS) if shared else None
    if found is None or not found.even:
        return stamps_ns
    table.told['clock'] = found.taken
    return spread(Series(stamps_ns, np.zeros(stamps_ns.size)), found).stamps_ns


def _plain(unit: str) -> str:
    """Return a unit as names end in it: `km/h` and `kmh`, `m/s^2` and `mps2`."""
    text = unit.strip().replace('\u00b0', 'deg').replace('\u00b5', 'u').replace('\u03bc', 'u')
    text = text.replace('^', '').replace('\u00b2', '2').replace('km/h', 'kmh')
    return re.sub(r'(?<![a-z])([mun]?)sec(?![a-z])', r'\1s', text).replace('/', 'p')


def _key(name: str) -> str:
    """Return the name of a column as channels are told by it: `lateral_mm` for `Lateral [mm]`."""
    return re.sub(r'\W+', '_', _plain(name)).strip('_').lower()


def _told_unit(table: Table, units: Mapping[str, float], source: str) -> str:
    """Return the unit that the file tells of a column, or its name ends in; '' for none."""
    ending, told = _key(source).rpartition('_')[2], _plain(table.units.get(source, ''))
    ending = ending if ending in units else ''
    if told and ending and told != ending:
        raise BagError(f'column {source} is in {told} by the line of units: which is it?')
    return told or ending


def _assumed(table: Table, sources: Mapping[str, ChannelSource]) -> str:
    """
    Return the channels of which nobody has told the unit: `lateral in m, speed in m/s`.

    One that is taken as it is, and is not in SI by what the file says, is refused.
    """
    assumed = []
    for channel, source in sources.items():
        if source.scale != 1.0:  # who gives a factor knows the unit
            continue
        unit = _told_unit(table, UNITS[channel], source.source)
        factor = UNITS[channel].get(unit)
        if not unit:
            assumed.append(f'{channel} in {si_of(channel).replace("mps", "m/s")}')
        elif factor != 1.0:
            known = '' if factor else f' ({", ".join(UNITS[channel])} are known)'
            raise BagError(
                f'column {source.source} is in {unit}{known}, expected a factor:'
                f' {channel}={source.source}*{f"{factor:.7g}" if factor else "FACTOR"}'
            )
    return ', '.join(assumed)


def _named(table: Table, given: Mapping[str, ChannelSource]) -> dict[str, ChannelSource]:
    """Find the channels by the names of the columns, `lateral_mm` or `lateral`."""
    found: dict[str, ChannelSource] = {}
    for channel in CHANNELS:
        keys = {str(name): _key(str(name)) for name in table}
        names = [name for name, key in keys.items() if f'{key}_'.startswith(f'{channel}_')]
        if channel in given or not names:
            continue
        units = UNITS[channel]
        known = {
            name: unit
            for name in names
            if keys[name] in (channel, *(f'{channel}_{unit}' for unit in units))
            if (unit := _told_unit(table, units, name)) in ('', *units)
        }
        if not known and given and channel not in map(keys.get, names):
            continue  # a further column with a name like it, as speed_setpoint
        if not known:
            expected = ', '.join(f'{channel}_{unit}' for unit in units)
            told = f' [{table.units[names[0]]}]' if table.units.get(names[0]) else ''
            raise BagError(
                f'column {names[0]}{told}: unknown unit of {channel}, expected {expected}, or'
                f' --channel {channel}=...; beside any --channel it is passed over'
            )
        if len(known) > 1:
            raise BagError(
                f'{" and ".join(known)} are both {channel}, expected one, or'
                f' --channel {channel}=...'
            )
        ((name, unit),) = known.items()
        found[channel] = ChannelSource(channel, name, units.get(unit, 1.0))
    if not found and not given:
        raise BagError(
            f'no column named {", ".join(CHANNELS)}, expected one or'
            f' --channel lateral=...; it has {", ".join(map(str, list(table)[:12]))}'
        )
    return found
