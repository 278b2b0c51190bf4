"""Recordings for other programs: one table on the union of the channels' stamps."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.channels import Channels
from hunt_ros.bag.columns import read_columns, read_record
from hunt_ros.bag.reader import Bag, opened
from hunt_ros.errors import BagError
from hunt_ros.files import write_whole
from hunt_ros.samples import NANOSECONDS, Series
from hunt_ros.sensors import si_of

#: Column of the stamps.
_STAMPS = 'stamp_ns'
_ROWS = 100_000

#: Values where there are some; masked where a channel has no sample.
Column: TypeAlias = Any


def export_file(
    path: str | Path | Bag,
    out: str | Path,
    channels: Channels = (),
    *,
    from_s: float | None = None,
    to_s: float | None = None,
) -> int:
    """
    Write channels of a recording as CSV.

    A row a stamp; a channel that has no sample at a stamp leaves its cell empty, a
    sample that is not a number is written as nan.
    Stamps are whole nanoseconds (`stamp_ns`), numbers are written with all the digits
    that make them exact.

    Parameters
    ----------
    path : str, Path or Bag
        The recording.
    out : str or Path
        File to make: .csv. It has its name only when complete.
    channels : mapping or sequence
        Any names and fields: `{'a': '/rig/hunting/amplitude.position[0]'}`. Without any,
        the measurements of the rig.
    from_s, to_s : float, optional
        Only from_s <= stamp < to_s, in s since the recording began.

    Returns
    -------
    int
        Rows written.

    Raises
    ------
    HuntError
        If its name does not end in .csv, the file exists or cannot be written, or the
        channels cannot be read.
    """
    target = Path(out)
    if target.suffix.lower() != '.csv':
        raise BagError(f'{out}: unknown format {target.suffix!r}, expected .csv')
    if target.exists():
        raise BagError(f'{out}: exists already, expected the name of a new file')
    with opened(path) as bag:
        origin, last = bag.span_ns or (0, 0)
        series: Mapping[str, Series]
        if channels:
            series = read_columns(bag, channels)
        else:
            record = read_record(bag, as_stamped=True)
            series = {f'{name}_{si_of(name)}': one for name, one in record.items()}
    if _STAMPS in series:
        raise BagError(f'{out}: {_STAMPS} is the column of the stamps, expected another name')
    if from_s is not None or to_s is not None:
        begin = origin + round((from_s or 0.0) * NANOSECONDS)
        end = last + 1 if to_s is None else origin + round(to_s * NANOSECONDS)
        series = {name: one.between(begin, end) for name, one in series.items()}
    stamps, columns = aligned(series)
    if not stamps.size:
        lasts_s = (last - origin) / NANOSECONDS
        raise BagError(f'{bag.path}: no samples in this time, it lasts {lasts_s:.3f} s')
    write_whole(out, lambda file: _write_csv(file, stamps, columns), 'table')
    return int(stamps.size)


def aligned(
    series: Mapping[str, Series],
) -> tuple[NDArray[np.int64], dict[str, Column]]:
    """
    Put series on the union of their stamps.

    Returns
    -------
    stamps : ndarray of int64, shape (n,)
        Increasing; a stamp that a series has twice is there twice.
    columns : dict of str to masked array, shape (n,)
        Masked where a series has no sample.
    """
    keys = {name: _repeats(part.stamps_ns) for name, part in series.items()}
    union = np.unique(np.concatenate(list(keys.values())))
    columns = {}
    for name, part in series.items():
        values, absent = np.full(union.size, np.nan), np.ones(union.size, dtype=bool)
        places = np.searchsorted(union, keys[name])
        values[places], absent[places] = part.values, False
        columns[name] = np.ma.MaskedArray(values, absent)
    return union['stamp'], columns


def _repeats(stamps: NDArray[np.int64]) -> NDArray[Any]:
    """Number the samples of one stamp, so that each has a row of its own."""
    keys = np.zeros(stamps.size, dtype=[('stamp', np.int64), ('repeat', np.int64)])
    keys['stamp'] = stamps
    order = np.argsort(stamps, kind='stable')
    in_order = stamps[order]
    keys['repeat'][order] = np.arange(stamps.size) - np.searchsorted(in_order, in_order)
    return keys


def _write_csv(path: Path, stamps: NDArray[np.int64], columns: Mapping[str, Column]) -> None:
    with open(path, 'w', encoding='utf-8', newline='') as file:
        table = csv.writer(file, lineterminator='\n')
        table.writerow([_STAMPS, *columns])
        for begin in range(0, stamps.size, _ROWS):
            part = slice(begin, begin + _ROWS)
            cells = (column[part].tolist() for column in columns.values())
            table.writerows(zip(stamps[part].tolist(), *cells, strict=True))
