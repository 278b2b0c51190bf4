"""
Files of numbers that are no bags: CSV, MATLAB, NumPy, TDMS.

Each becomes a table: named arrays, as the file holds them.
"""

from __future__ import annotations

import csv
import logging
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import BagError, one_line


class Table(dict[str, Any]):
    """
    Name -> array of any shape, or a mapping or a list again (a MATLAB structure).

    Attributes
    ----------
    units : dict of str to str
        Of the columns whose unit the file tells.
    stamps_ns : dict of str to ndarray of int64
        Of the columns that have times of their own (a waveform).
    told : dict of str to str
        'left_out': what of the file was not taken; 'clock': what was made of times that several
        samples share.
    doubt : str
        What may be wrong with its names, for the end of a message; '' else.
    """

    def __init__(self, content: Mapping[str, Any] | None = None) -> None:
        super().__init__(content or {})
        self.units: dict[str, str] = {}
        self.stamps_ns: dict[str, NDArray[np.int64]] = {}
        self.told: dict[str, str] = {}
        self.doubt = ''

    def column(self, source: str) -> str:
        """Return a source, or the name of the column whose unit stands behind it."""
        name = _name_and_unit(source)[0]
        return name if source not in self and name in self.units else source


_STEP = re.compile(r'\.?([^.\[\]]+)|\[([^\[\]]*)\]')
#: Lines of a text file by which its columns are told.
_LOOKED_AT = 200
#: A date and time with its zone; a name with its unit behind: `lateral [mm]`, `speed (km/h)`.
_ZONE = re.compile(r'^(.+:[\d.]+)\s*(?:Z|UTC|([+-])(\d\d):?(\d\d)?)$')
_NAME_UNIT = re.compile(r'^(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|,\s+(\S+))$')
#: A number with a mark, which is that of its decimals.
_ONE_MARK = re.compile(r'[+-]?\d*([.,])\d*(?:[eE][+-]?\d+)?')
#: A number, which may have a decimal comma.
_DECIMAL_COMMA = re.compile(r'[+-]?\d+(?:,\d+)?(?:[eE][+-]?\d+)?')
#: A cell with nothing in it, and what stands for it: of any kind of numbers, and none of a sensor.
_EMPTY, _HOLE = re.compile(r'(^|[;,\t|]) *(?![^;,\t|])'), np.iinfo(np.int64).min
#: A waveform does not begin longer behind its start, s.
_LONGEST_S = 1e9
#: A date as Germany writes it; a time of day.
_DAY_FIRST = re.compile(r'^(\d\d?)\.(\d\d?)\.(\d{4})[ T]+(\d\d:.*)$')
_CLOCK = re.compile(r'^\d\d?:\d\d:\d\d(\.\d*)?$')


def load_table(path: str | Path) -> Table:
    """
    Read a file by its ending: .csv .txt .tsv .dat .asc .lvm .mat .npy .npz .tdms.

    Raises
    ------
    BagError
        If it cannot be read, or its format is unknown.
    """
    file = Path(path)
    ending = file.suffix.lower()
    try:
        if ending not in _READERS:
            raise BagError(f'unknown format {file.suffix!r}, expected {", ".join(_READERS)}')
        if not file.is_file():
            raise BagError('no such file')
        table = _READERS[ending](file)
        if not table:
            raise BagError('holds no numbers')
    except BagError as error:
        raise BagError(f'{path}: {error}') from error
    except ImportError:  # who runs this says what to install
        raise
    except Exception as error:  # foreign readers raise what they meet in a damaged file
        reason = one_line(error)
        raise BagError(f'{path}: cannot be read as {file.suffix} ({reason:.120})') from error
    return table if isinstance(table, Table) else Table(table)


def select(table: Mapping[str, Any], source: str) -> NDArray[Any]:
    """
    Pick a series out of a table: `y`, `data[1]`, `data[:,2]`, `runs[6].force`.

    Indices count from zero, rows before columns.

    Returns
    -------
    ndarray, shape (n,)
        Numbers or times; a masked array where the file has empty cells. One number alone
        has shape (1,).

    Raises
    ------
    BagError
        If there is no such series, or it is not one-dimensional or not numeric.
    """
    if source in table:
        return _series(table[source], source)
    base = source.partition('[')[0].strip()
    if not base:
        raise BagError(f'{source!r} names nothing, expected one of {_shown(table)}')
    value: Any = table
    position, end = 0, len(source.rstrip())
    if base in table:
        value, position = table[base], source.index(base) + len(base)
    while position < end:
        match = _STEP.match(source, position)
        if match is None:
            raise BagError(f'{source!r}: expected an index such as [0] or [:,0]')
        name, inside = match.groups()
        if name is not None:
            value = _part(value, name.strip(), source)
        else:
            value = _element(value, inside, source)
        position = match.end()
    return _series(value, source)


def _series(value: Any, source: str) -> NDArray[Any]:
    if isinstance(value, BagError):  # a column of words, which matters to who asks for it
        raise value
    if isinstance(value, Mapping):
        raise BagError(f'{source} is a structure, expected one of {_shown(value)}')
    if _is_list(value):
        inside = [f'.{_shown(one)}' for one in value[:1] if isinstance(one, Mapping)]
        kind = 'structures' if inside else 'words or cells'
        raise BagError(
            f'{source} is an array of {len(value)} {kind}, expected numbers'
            + ''.join(f', one such as {source}[0]{one}' for one in inside)
        )
    array = np.asanyarray(value)
    if array.dtype.kind not in 'biufM':
        raise BagError(f'{source} is of type {array.dtype}, expected numbers')
    if array.size == 1 or 1 in array.shape:
        array = array.reshape(-1)
    if array.ndim != 1:
        shape = ' x '.join(map(str, array.shape))
        raise BagError(
            f'{source} is {shape}, expected a series such as {source}[0] or {source}[:,0]'
        )
    series: NDArray[Any] = array if array.dtype.kind in 'iuM' else array.astype(np.float64)
    return series


def _is_list(value: Any) -> bool:
    """Return True for an array of structures or of cells."""
    if isinstance(value, np.ndarray):
        return value.dtype == object and value.ndim == 1
    return isinstance(value, list) and any(isinstance(one, Mapping | list) for one in value[:1])


def _part(value: Any, name: str, source: str) -> Any:
    """Return a part of a structure by its name."""
    if isinstance(value, Mapping) and name in value:
        return value[name]
    known = _shown(value) if isinstance(value, Mapping) else 'no parts'
    if _is_list(value):
        known = f'{len(value)} structures: [0] to [{len(value) - 1}]'
    raise BagError(f'there is no {name!r} for {source!r}, it has {known}')


def _element(value: Any, inside: str, source: str) -> Any:
    """Return a part of an array by its index."""
    if isinstance(value, Mapping):  # one structure, or in version 7.3 the lists of several
        lists = all(isinstance(part, list) for part in value.values())
        if lists and len({len(part) for part in value.values()}) == 1:
            rows = zip(*value.values(), strict=True)
            value = [dict(zip(value, row, strict=True)) for row in rows]
        else:
            value = [value]
    try:
        parts = [part.strip() for part in inside.split(',')]
        index = tuple(slice(None) if part == ':' else int(part) for part in parts)
        if _is_list(value) and len(index) == 1:
            return value[index[0]]
        return np.asarray(value)[index]
    except (IndexError, ValueError) as error:
        shape = ' x '.join(map(str, np.shape(value) if not _is_list(value) else (len(value),)))
        raise BagError(f'{source!r}: no [{inside}] in {shape} numbers') from error


def _shown(table: Any) -> str:
    names = [str(name) for name in table] if isinstance(table, Mapping) else []
    return ', '.join(names[:12]) + (f' and {len(names) - 12} more' if len(names) > 12 else '')


def _read_csv(path: Path) -> Table:
    """Read the columns of a text file by their names, or as c0, c1 ..."""
    text, doubt = _decoded(path.read_bytes())
    text = text.rstrip('\0')  # where the power failed
    lines = re.split('\r\n?|\n', text)  # other signs of a new line may stand in a remark
    # Digits of a last line that does not end may be missing.
    cut = len(lines) if text and text[-1] not in '\r\n' else 0
    lines = lines[: cut - 1] if cut else lines
    lines = [line if line.strip(' \t;,') else '' for line in lines]  # of Excel: empty cells
    told = [i for i, line in enumerate(lines[:_LOOKED_AT]) if line.strip() and line[0] not in '#%']
    if not told:
        raise BagError('has no lines of numbers')
    delimiter = Counter(_delimiter(lines[i]) for i in told).most_common(1)[0][0]
    if delimiter == '|' and lines[told[-1]].lstrip()[:1] == '|':  # Markdown: around each line too
        lines = [line.strip().removeprefix('|').removesuffix('|') for line in lines]
    looked = {i: _cells(lines[i], delimiter) for i in told}
    width = Counter(map(len, looked.values())).most_common(1)[0][0]
    # Cells behind separators that end every line are none.
    usual = max(max(_filled(row) for row in looked.values() if len(row) == width), 1)
    kinds = {
        i: tuple(map(_is_number, row[:usual]))
        for i, row in looked.items()
        if len(row) >= usual >= _filled(row) and not _is_head(row, 1)
    }
    if not kinds:
        raise BagError('has no numbers under its names')
    # Lines in front that are of another kind than most say something about the file.
    most = Counter(kinds.values()).most_common(1)[0][0]
    first = next(i for i, kind in kinds.items() if kind == most)
    names, units = [f'c{number}' for number in range(usual)], [''] * usual
    above = [_cells(line.lstrip('#% '), delimiter) for line in lines[:first]]
    most_names = usual + (delimiter is not None)  # one for remarks; a title of words has any
    heads = [i for i, row in enumerate(above) if _is_head(row, usual, most_names)]
    if heads:  # numpy writes the names as a comment
        two = heads[-2:-1] == [heads[-1] - 1] and _filled(above[heads[-2]]) == usual
        two = two and all(lines[i][0] not in '#%' for i in heads[-2:])
        place = heads[-2 if two else -1]
        pairs = [_name_and_unit(cell.strip()) for cell in above[place][:usual]]
        names, units = [name for name, _ in pairs], [unit for _, unit in pairs]
        whole = [cell.strip() for cell in above[place][:usual]]  # of one name with several units
        names = [b if names.count(a) > 1 else a for a, b in zip(names, whole, strict=True)]
        # Lines of units and the like under the names; what is no such line, its error tells.
        below = list(takewhile(lambda row: _is_head(row, 1), above[place + 1 :]))
        first = place + 1 + len(below)
        below = [row for row in below if len(row) == len(above[place])]  # no remark
        below = below or [
            ['', *row[1:]] for row in above if row[:1] == ['Y_Unit_Label']
        ]  # LabVIEW
        if below:
            under = [cell.strip(' []()"-') for cell in below[0]] + [''] * usual
            units = [a or b for a, b in zip(units, under, strict=False)]
    if end := (delimiter or '') * (width - usual):
        lines = [line.rstrip().removesuffix(end) for line in lines]
    table = Table(_columns(lines, first, delimiter, names))
    for name in {name for name in names if names.count(name) > 1}:
        table[name] = BagError(f'the column {name!r} occurs twice, expected unique names')
    table.units = {name: unit for name, unit in zip(names, units, strict=False) if unit}
    table.told['left_out'] = f'line {cut}, which does not end' if cut else ''
    table.doubt = '' if ''.join(names).isascii() else doubt
    return table


def _decoded(raw: bytes) -> tuple[str, str]:
    """Return a text in one of the encodings that loggers write, and that it may be another."""
    if raw[:2] in (b'\xff\xfe', b'\xfe\xff'):
        return raw.decode('utf-16'), ''
    if b'\0' in raw[:2]:  # UTF-16 that does not say so
        return raw.decode('utf-16-be' if raw[:1] == b'\0' else 'utf-16-le'), ''
    with suppress(UnicodeDecodeError):
        return raw.decode('utf-8-sig'), ''
    return raw.decode('latin-1'), '; its names are no UTF-8, and were read as Latin-1'


def _name_and_unit(cell: str) -> tuple[str, str]:
    match = _NAME_UNIT.match(cell)
    return (match[1], (match[2] or match[3] or match[4] or '').strip()) if match else (cell, '')


def _delimiter(line: str) -> str | None:
    parts = line.split()
    decimal = len(parts) > 1 and all(map(_DECIMAL_COMMA.fullmatch, parts))
    found = (
        mark for mark in (';', '\t', '|', ',') if mark in line and not (mark == ',' and decimal)
    )
    return next(found, None)  # any white space


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])


def _filled(cells: list[str]) -> int:
    """Return the number of cells up to the last one with something in it."""
    return max((place for place, cell in enumerate(cells, start=1) if cell.strip()), default=0)


def _is_head(cells: list[str], least: int, most: float = math.inf) -> bool:
    """Return True for names or units: so many cells are filled, and none is a number."""
    words = not any(c.strip() and _is_number(c) for c in cells)
    return words and least <= _filled(cells) <= most


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(',', '.'))
    except ValueError:
        return not cell.strip()
    return True


def _columns(
    lines: list[str], first: int, delimiter: str | None, names: list[str]
) -> dict[str, Any]:
    """Read the numbers: all at once, or cell by cell where they are not all such."""
    places = [i for i in range(first, len(lines)) if lines[i].strip() and lines[i][0] not in '#%']
    rows = [lines[i] for i in places]
    # Whole nanoseconds since 1970 do not fit into a float64.
    head = zip(names, _cells(rows[0], delimiter), strict=False)
    whole = [name.endswith('_ns') and cell.strip().isdigit() for name, cell in head]
    kind = np.dtype([(str(i), 'i8' if one else 'f8') for i, one in enumerate(whole)])
    plain = rows
    if delimiter != ',' and any(',' in row for row in rows):  # there it cannot separate
        plain = [row.replace(',', '.') for row in rows]
    if plain is rows or not any('.' in row for row in rows):  # else either is the decimal mark
        for holes in (False, True):
            read = (_EMPTY.sub(rf'\1{_HOLE}', row) for row in plain) if holes else plain
            with suppress(ValueError):  # a word, a date, or a fault: it is said where
                table = np.loadtxt(read, kind, delimiter=delimiter, ndmin=1, comments=None)
                found = [table[number] for number in kind.names or ()]
                found = [np.ma.masked_equal(one, _HOLE) for one in found] if holes else found
                return dict(zip(names, found, strict=True))
    columns: list[list[str]] = [[] for _ in names]
    for place, row in zip(places, rows, strict=True):
        cells = _cells(row, delimiter)
        if not len(cells) >= len(names) >= _filled(cells):
            raise BagError(f'line {place + 1} has {len(cells)} cells, expected {len(names)}')
        for column, cell in zip(columns, cells, strict=False):
            column.append(cell.strip())
    different = {cell for column in columns for cell in column}
    marks = {match[1]: cell for cell in different if (match := _ONE_MARK.fullmatch(cell))}
    if len(marks) > 1:
        raise BagError(
            f'{" and ".join(marks.values())}: comma or point, which is the decimal mark?'
        )
    columns = [[cell.replace(',', '.') for cell in column] for column in columns]
    parts = zip(names, columns, whole, strict=True)
    return {name: _column(column, one, places) for name, column, one in parts}


def _column(cells: list[str], whole: bool, places: list[int]) -> Any:
    """
    Return numbers, masked where a cell is empty, or times, where all cells are such.

    Of a column with anything else in it, its error: nobody may want that column.
    """
    if cells and ':' in cells[0]:
        try:
            times: Any = np.array([_date(cell) for cell in cells])
            # Times of day go on over midnight.
            days = np.cumsum(np.diff(times, prepend=times[:1]) < np.timedelta64(-12, 'h'))
            return times + days.astype('timedelta64[D]')
        except ValueError:
            return BagError(
                f'line {places[0] + 1}: {cells[0][:40]!r} is no time that is told, expected'
                ' 2024-03-04 13:59:55, 04.03.2024 13:59:55 or 13:59:55'
            )
    values: Any = np.zeros(len(cells), 'i8' if whole else 'f8')
    for row, cell in enumerate(cells):
        try:
            values[row] = int(cell or 0) if whole else float(cell or 0)
        except (ValueError, OverflowError):
            return BagError(f'line {places[row] + 1}: {cell[:40]!r} is not a number')
    return np.ma.MaskedArray(values, [not cell for cell in cells])


def _date(text: str) -> np.datetime64:
    """Read a date and time of ISO 8601 or day.month.year, or a time of day; UTC, or its zone."""
    if match := _DAY_FIRST.match(text):
        text = f'{match[3]}-{match[2]:0>2}-{match[1]:0>2}T{match[4]}'
    elif _CLOCK.match(text):
        text = f'1970-01-01T{text:0>8}'
    match = _ZONE.match(text)
    date = np.datetime64(match[1] if match else text, 'ns')
    if match is None or match[2] is None:
        return date
    minutes = 60 * int(match[3]) + int(match[4] or 0)
    return date - np.timedelta64(minutes if match[2] == '+' else -minutes, 'm')


def _read_matlab(path: Path) -> Mapping[str, Any]:
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


def _read_numpy(path: Path) -> Mapping[str, Any]:
    content = np.load(path, allow_pickle=False)
    if isinstance(content, np.ndarray):
        if content.dtype.names:
            return {name: content[name] for name in content.dtype.names}
        return {'data': content}
    columns: dict[str, Any] = {}
    with content:
        for name in content.files:
            try:
                columns[name] = content[name]
            except ValueError as error:  # Python objects: nobody may want them
                columns[name] = BagError(f'{name} cannot be read ({one_line(error)})')
    return columns


def _read_tdms(path: Path) -> Table:
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    table = Table()
    log_manager.set_level(logging.ERROR)  # a file that was cut is said here
    with TdmsFile.read(path) as file:
        if file.file_status.incomplete_final_segment:
            table.told['left_out'] = 'the end of the last segment, which was cut'
        channels = [channel for group in file.groups() for channel in group.channels()]
        names = [channel.name for channel in channels]
        for channel in channels:
            # A channel whose name is unique needs no group.
            short = [channel.name] if names.count(channel.name) == 1 else []
            about = channel.properties
            for name in [f'{channel.group_name}/{channel.name}', *short]:
                table[name] = channel[:]
                table.units[name] = str(about.get('unit_string', ''))
                try:
                    step = float(about.get('wf_increment', 0.0))
                    first = float(about.get('wf_start_offset', 0.0))
                    begin = np.datetime64(about.get('wf_start_time', 0), 'ns').astype(np.int64)
                except (TypeError, ValueError) as error:
                    text = f'{name}: its waveform has no times ({one_line(error)})'
                    raise BagError(text) from error
                if 0.0 < step < 1e3 and abs(first) < _LONGEST_S:
                    offset = first + step * np.arange(len(channel))
                    table.stamps_ns[name] = begin + np.rint(offset * 1e9).astype(np.int64)
    return table


_READERS: dict[str, Callable[[Path], Mapping[str, Any]]] = {
    **dict.fromkeys(('.csv', '.txt', '.tsv', '.dat', '.asc', '.lvm'), _read_csv),
    '.mat': _read_matlab,
    '.npy': _read_numpy,
    '.npz': _read_numpy,
    '.tdms': _read_tdms,
}
