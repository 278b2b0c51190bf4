"""Recordings that other programs made, turned into a record and into a bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.channels import Channels, ChannelSource, channel_map
from hunt_ros.bag.columns import constant_stamps, read_record
from hunt_ros.bag.interchange.tables import Table, load_table, select
from hunt_ros.bag.record_writer import write_record
from hunt_ros.bag.storage_files import STORAGES, storage_kind
from hunt_ros.errors import BagError
from hunt_ros.samples import CHANNELS, NANOSECONDS, Record, Series
from hunt_ros.sensors import ANGLES, SENSORS

#: Channel -> endings of column names that tell its unit: to SI.
UNITS: dict[str, Mapping[str, float]] = {
    **{sensor.name: sensor.units for sensor in SENSORS},
    'roller': ANGLES,
    'speed': {'mps': 1.0, 'kmh': 1.0 / 3.6},
}
#: Column names that mean the time, and their unit in seconds.
TIMES: dict[str, float] = {
    'stamp_ns': 1e-9, 'time_ns': 1e-9, 't_ns': 1e-9, 'time_us': 1e-6, 't_us': 1e-6,
    'time_ms': 1e-3, 't_ms': 1e-3, 'time_s': 1.0, 't_s': 1.0, 'time': 1.0, 't': 1.0,
    'timestamp': 1.0, 'seconds': 1.0,
}  # fmt: skip

#: Times beyond this do not fit into whole nanoseconds of 64 bits, s.
LATEST_S = 9e9


def import_file(
    path: str | Path,
    out: str | Path,
    channels: Channels = (),
    *,
    rate_hz: float | None = None,
    time: str | None = None,
    namespace: str = 'rig',
    notes: Mapping[str, str] | None = None,
) -> Path:
    """
    Turn a file into a bag with the topics of a live rig.

    Parameters
    ----------
    path : str or Path
        CSV, MATLAB, NumPy, TDMS, Parquet, or a bag that somebody else recorded.
    out : str or Path
        Folder to make.
    channels, rate_hz, time
        As `load_record`.
    namespace : str
        Of the topics.
    notes : mapping of str to str, optional
        Rig, operator, remarks.

    Raises
    ------
    BagError
        If the file does not hold what is asked for, or `out` exists.
    """
    record = load_record(path, channels, rate_hz=rate_hz, time=time)
    return write_record(out, record, namespace=namespace, notes=notes)


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
        `{'yaw': 'data[0]', 'lateral': 'data[1]*0.47', 'speed': 16.3}`. Without any, columns
        named lateral, yaw, roller, speed are taken, with a unit behind (`lateral_mm`,
        `speed_kmh`) or in SI.
    rate_hz : float, optional
        Sample rate of a file without times; its first stamp is 1 s.
    time : str, optional
        Column of the times, `t_ms*0.001`, in seconds. Without it and without a rate, a
        column named as one of `TIMES` is taken. A file that begins before 1 s is moved
        to begin there: a stamp of zero means "no time" in ROS.

    Raises
    ------
    BagError
        If something named is not there, there are no times, they go backwards or are too
        coarse, a series is all NaN, or its length is not that of the times.
    """
    mapping = channel_map(channels)
    if Path(path).is_dir() or storage_kind(Path(path)) in STORAGES:
        return read_record(path, mapping)
    if rate_hz is not None and not 0.0 < rate_hz < 1e9:
        raise BagError(f'rate {rate_hz!r}: expected samples a second, greater than 0')
    table = load_table(path)
    mapping = mapping or _named(table, path)
    stamps = None if rate_hz is not None else _stamps(table, time, path)
    series = {
        name: _series(table, source, rate_hz, stamps, path)
        for name, source in mapping.items()
        if source.constant is None
    }
    if not series:
        raise BagError(f'{path}: only constants are asked for, expected a channel of the file')
    record = Record(series, str(path), {'source': Path(path).name})
    spread = constant_stamps(record.start_ns, record.end_ns)
    for name, source in mapping.items():
        if source.constant is not None:
            series[name] = Series(spread, np.full(spread.size, source.constant))
    return Record(series, record.source, record.notes)


def _series(
    table: Table,
    source: ChannelSource,
    rate_hz: float | None,
    stamps: NDArray[np.int64] | None,
    path: str | Path,
) -> Series:
    """Return the samples of a channel; the stamps are made of the rate where there are none."""
    values = select(table, source.source, path)
    # An empty cell is no sample; one that says "nan" is a sample that failed.
    absent = np.ma.getmaskarray(values)
    if not np.isfinite(values).any():
        raise BagError(f'{path}: {source.source} holds no finite number')
    if stamps is None:
        assert rate_hz is not None
        step = np.arange(values.size) / rate_hz
        stamps = NANOSECONDS + np.rint(step * NANOSECONDS).astype(np.int64)
    if stamps.size != values.size:
        raise BagError(f'{path}: {source.source} has {values.size} values for {stamps.size} times')
    there, stamps = np.ma.getdata(values)[~absent], stamps[~absent]
    times = np.unique(stamps).size
    if 2 * times <= there.size and times < there.size:
        raise BagError(
            f'{path}: {source.source} has {there.size} values at {times} different times, expected'
            ' times with more digits, or the sample rate (--rate)'
        )
    return Series(stamps, there * source.scale + source.offset)


def _stamps(table: Table, time: str | None, path: str | Path) -> NDArray[np.int64]:
    """Return the stamps of a table, ns; they begin at 1 s where the times begin near zero."""
    if time is not None:
        source = ChannelSource.of('time', time)
        if source.constant is not None:
            raise BagError(f'{path}: the time is a constant, expected a column')
    else:
        found = next((name for name in TIMES if name in table), None)
        if found is None:
            raise BagError(
                f'{path}: no column of times ({", ".join(TIMES)}), expected one, or the'
                ' sample rate (--rate), or --time COLUMN'
            )
        source = ChannelSource('time', found, TIMES[found])
    raw: NDArray[np.float64] = np.ma.filled(select(table, source.source, path), np.nan)
    if not np.isfinite(raw).all():
        row = int(np.flatnonzero(~np.isfinite(raw))[0])
        raise BagError(f'{path}: {source.source} is not finite in row {row}')
    if (np.abs(raw * source.scale + source.offset) > LATEST_S).any():
        raise BagError(f'{path}: {source.source} reaches beyond {LATEST_S:g} s, expected seconds')
    stamps = _to_ns(table, source, raw)
    backwards = np.flatnonzero(np.diff(stamps) < 0)
    if backwards.size:
        row = int(backwards[0]) + 1
        raise BagError(f'{path}: {source.source} goes backwards in row {row}')
    if stamps.size and stamps[0] < NANOSECONDS:
        stamps = stamps - stamps[0] + NANOSECONDS
    return stamps


def _to_ns(table: Table, source: ChannelSource, raw: NDArray[np.float64]) -> NDArray[np.int64]:
    """Whole nanoseconds stay whole: float64 has no room for today's."""
    column = table.get(source.source)
    if source.scale == 1e-9 and not source.offset and isinstance(column, np.ndarray):
        if column.dtype.kind in 'iu':
            return column.astype(np.int64).ravel()
        return np.rint(raw).astype(np.int64)
    return np.rint((raw * source.scale + source.offset) * NANOSECONDS).astype(np.int64)


def _named(table: Table, path: str | Path) -> dict[str, ChannelSource]:
    """Find the channels by the names of the columns, `lateral_mm` or `lateral`."""
    found: dict[str, ChannelSource] = {}
    for channel in CHANNELS:
        names = [str(name) for name in table if f'{name}_'.startswith(f'{channel}_')]
        units = UNITS[channel]
        for name in names:
            unit = name[len(channel) + 1 :]
            if not unit or unit in units:
                found[channel] = ChannelSource(channel, name, units.get(unit, 1.0))
        if names and channel not in found:
            expected = ', '.join(f'{channel}_{unit}' for unit in units)
            raise BagError(
                f'{path}: column {names[0]}: unknown unit of {channel}, expected {expected}, or'
                f' --channel {channel}=...'
            )
    if not found:
        raise BagError(
            f'{path}: no column named {", ".join(CHANNELS)}, expected one or'
            f' --channel lateral=...; it has {", ".join(map(str, list(table)[:12]))}'
        )
    return found
