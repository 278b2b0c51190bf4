"""
Files of numbers that are no bags: CSV, MATLAB, NumPy, TDMS, Parquet.

Each becomes a table: named arrays, as the file holds them.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import BagError

#: Name -> array of any shape, or a mapping again (a MATLAB struct).
Table = Mapping[str, Any]

_INDEX = re.compile(r'\[([^\[\]]*)\]')
_NAME = re.compile(r'^[^\[\]]+')


def load_table(path: str | Path) -> Table:
    """
    Read a file by its ending: .csv .txt .tsv .dat .mat .npy .npz .tdms .parquet.

    Raises
    ------
    BagError
        If it cannot be read, its format is unknown, or a package for it is missing.
    """
    file = Path(path)
    reader = _READERS.get(file.suffix.lower())
    if reader is None:
        raise BagError(f'{path}: unknown format {file.suffix!r}, expected {", ".join(_READERS)}')
    if not file.is_file():
        raise BagError(f'{path}: no such file')
    try:
        table = reader(file)
    except BagError:
        raise
    except ImportError as error:
        extra = {'.tdms': 'tdms', '.parquet': 'parquet'}.get(file.suffix.lower(), 'matlab73')
        raise BagError(
            f'{path}: {error.name} is not installed (pip install "hunt_ros[{extra}]")'
        ) from error
    except Exception as error:  # foreign readers raise what they meet in a damaged file
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BagError(f'{path}: cannot be read as {file.suffix} ({reason:.120})') from error
    if not table:
        raise BagError(f'{path}: holds no numbers')
    return table


def select(table: Table, source: str, path: str | Path) -> NDArray[np.float64]:
    """
    Pick one series out of a table: `y`, `data[1]`, `data[:,2]`, `run.force[0]`.

    Indices count from zero, rows before columns.

    Returns
    -------
    ndarray of float64, shape (n,)
        A masked array where the file has empty cells.

    Raises
    ------
    BagError
        If there is no such series, or it is not one-dimensional or not numeric.
    """
    value = table[source] if source in table else _follow(table, source, path)
    if isinstance(value, Mapping):
        raise BagError(f'{path}: {source} is a structure, expected one of {_shown(value)}')
    array = np.asanyarray(value)
    if array.dtype.kind not in 'biuf':
        raise BagError(f'{path}: {source} is of type {array.dtype}, expected numbers')
    if array.ndim > 1 and 1 in array.shape:
        array = array.squeeze()
    if array.ndim != 1:
        shape = ' x '.join(map(str, array.shape)) or 'a single number'
        raise BagError(
            f'{path}: {source} is {shape}, expected a series such as {source}[0] or {source}[:,0]'
        )
    numbers: NDArray[np.float64] = array.astype(np.float64)
    return numbers


def _follow(table: Table, source: str, path: str | Path) -> Any:
    """Return what a path such as `run.y[:,0]` stands for."""
    name = _NAME.match(source)
    value: Any = table
    if name is None:
        raise BagError(f'{path}: {source!r} names nothing, expected one of {_shown(table)}')
    base, rest = name[0].strip(), source[name.end() :]
    for step in [base] if base in table else base.split('.'):
        if not isinstance(value, Mapping) or step not in value:
            known = _shown(value) if isinstance(value, Mapping) else 'no parts'
            raise BagError(f'{path}: there is no {step!r} for {source!r}, it has {known}')
        value = value[step]
    if _INDEX.sub('', rest).strip():
        raise BagError(f'{path}: {source!r}: expected an index such as [0] or [:,0]')
    for inside in _INDEX.findall(rest):
        try:
            index = tuple(_index(part) for part in inside.split(','))
            value = np.asarray(value)[index]
        except (IndexError, ValueError) as error:
            shape = ' x '.join(map(str, np.shape(value)))
            raise BagError(f'{path}: {source!r}: no [{inside}] in {shape} numbers') from error
    return value


def _index(text: str) -> int | slice:
    text = text.strip()
    return slice(None) if text == ':' else int(text)


def _shown(table: Mapping[str, Any]) -> str:
    names = [str(name) for name in table]
    return ', '.join(names[:12]) + (f' and {len(names) - 12} more' if len(names) > 12 else '')


def _read_csv(path: Path) -> Table:
    """Read the columns of a text file by their names, or as c0, c1 ..."""
    lines = path.read_text(encoding='utf-8-sig').splitlines()
    first = next((i for i, line in enumerate(lines) if line.strip() and line[0] not in '#%'), None)
    if first is None:
        raise BagError(f'{path}: has no lines of numbers')
    delimiter = _delimiter(lines[first])
    cells = _cells(lines[first], delimiter)
    names = [f'c{number}' for number in range(len(cells))]
    if not all(_is_number(cell) for cell in cells):
        names, first = _unique([cell.strip() for cell in cells], path), first + 1
        # A line of units under the names.
        if first < len(lines) and not any(map(_is_number, _cells(lines[first], delimiter))):
            first += 1
    columns = _columns(lines, first, delimiter, len(names), path)
    table = dict(zip(names, columns, strict=True))
    for number, name in enumerate(names):
        # Whole nanoseconds since 1970 do not fit into a float64.
        if name.endswith('_ns'):
            with suppress(ValueError):
                whole: Any = np.loadtxt(
                    lines[first:], np.int64, delimiter=delimiter, usecols=number, ndmin=1,
                    comments=('#', '%'),
                )  # fmt: skip
                table[name] = whole
    return table


def _unique(names: list[str], path: Path) -> list[str]:
    for name in names:
        if names.count(name) > 1:
            raise BagError(f'{path}: the column {name!r} occurs twice, expected unique names')
    return names


def _delimiter(line: str) -> str | None:
    for mark in (';', '\t', ','):
        if mark in line:
            return mark
    return None  # any white space


def _cells(line: str, delimiter: str | None) -> list[str]:
    return line.split() if delimiter is None else next(csv.reader([line], delimiter=delimiter))


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(',', '.'))
    except ValueError:
        return not cell.strip()
    return True


def _columns(
    lines: list[str], first: int, delimiter: str | None, count: int, path: Path
) -> list[NDArray[np.float64]]:
    """Read the numbers; an empty cell is masked, and a fault is told with its line."""
    rows = lines[first:]
    if not any(row.strip() for row in rows):
        raise BagError(f'{path}: has names and no numbers')
    try:
        table = np.loadtxt(rows, delimiter=delimiter, ndmin=2, comments=('#', '%'))
        if table.shape[1] == count:
            return list(table.T)
    except ValueError:
        pass  # an empty cell, a decimal comma, or a fault: read cell by cell, and say where
    numbers: list[list[float | None]] = []
    for number, row in enumerate(rows, first + 1):
        if not row.strip() or row[0] in '#%':
            continue
        cells = _cells(row, delimiter)
        if len(cells) != count:
            raise BagError(f'{path}: line {number} has {len(cells)} cells, expected {count}')
        numbers.append([_number(cell, delimiter, number, path) for cell in cells])
    values = np.array(numbers, dtype=np.float64)  # None becomes NaN
    absent = np.array([[cell is None for cell in row] for row in numbers])
    return list(np.ma.MaskedArray(values, absent).T)


def _number(cell: str, delimiter: str | None, line: int, path: Path) -> float | None:
    """Read a cell, None for an empty one; a decimal comma is one where it cannot separate."""
    text = cell.strip() if delimiter == ',' else cell.strip().replace(',', '.')
    if not text:
        return None
    try:
        return float(text)
    except ValueError as error:
        raise BagError(f'{path}: line {line}: {cell!r} is not a number') from error


def _read_matlab(path: Path) -> Table:
    from scipy.io import loadmat

    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:  # version 7.3 is HDF5
        from pymatreader import read_mat

        content = read_mat(path)
    return {
        name: value
        for name, value in content.items()
        if not name.startswith('__') and name != 'None'
    }


def _read_numpy(path: Path) -> Table:
    content = np.load(path, allow_pickle=False)
    if isinstance(content, np.ndarray):
        if content.dtype.names:
            return {name: content[name] for name in content.dtype.names}
        return {'data': content}
    with content:
        return {name: content[name] for name in content.files}


def _read_tdms(path: Path) -> Table:
    from nptdms import TdmsFile

    table: dict[str, Any] = {}
    with TdmsFile.read(path) as file:
        for group in file.groups():
            for channel in group.channels():
                table[f'{group.name}/{channel.name}'] = channel[:]
        # A channel whose name is unique needs no group.
        names = [name.partition('/')[2] for name in table]
        for full, values in list(table.items()):
            short = full.partition('/')[2]
            if names.count(short) == 1:
                table.setdefault(short, values)
    return table


def _read_parquet(path: Path) -> Table:
    from pyarrow import parquet

    table = parquet.read_table(path)
    columns = {}
    for name in table.column_names:
        column = table.column(name)
        absent = column.is_null().to_numpy()
        values = column.fill_null(0).to_numpy() if absent.any() else column.to_numpy()
        columns[name] = np.ma.MaskedArray(values, absent) if absent.any() else values
    return columns


_READERS: dict[str, Callable[[Path], Table]] = {
    '.csv': _read_csv,
    '.txt': _read_csv,
    '.tsv': _read_csv,
    '.dat': _read_csv,
    '.mat': _read_matlab,
    '.npy': _read_numpy,
    '.npz': _read_numpy,
    '.tdms': _read_tdms,
    '.parquet': _read_parquet,
}
