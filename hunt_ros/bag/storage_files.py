"""The files of a recording: which there are, and how one of them is opened."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import zstandard

from hunt_ros.bag.blocks import Storage
from hunt_ros.bag.mcap.file import McapFile
from hunt_ros.bag.sqlite_file import SqliteFile
from hunt_ros.errors import BagError

STORAGES: dict[str, type[McapFile] | type[SqliteFile]] = {'.mcap': McapFile, '.db3': SqliteFile}

#: Left free where a compressed file is expanded, bytes.
_RESERVE = 1 << 28


def storage_kind(name: Path) -> str:
    """Return '.mcap' or '.db3', looking behind '.zstd'; another ending as it is."""
    return Path(name.stem).suffix if name.suffix == '.zstd' else name.suffix


def folder_files(folder: Path) -> list[Path]:
    """Return the recorded files of a folder, in the order in which they were begun."""
    try:
        found = [
            name for name in folder.iterdir() if storage_kind(name) in STORAGES and name.is_file()
        ]
    except OSError as error:
        raise BagError(f'{folder}: cannot be read ({error.strerror})') from error
    return sorted(found, key=_natural)


def open_storage(name: Path, scratch: Path) -> Storage:
    """
    Open one file.

    Parameters
    ----------
    name : Path
        `.mcap` or `.db3`, or one of them with `.zstd`.
    scratch : Path
        Where a compressed file is expanded to.

    Raises
    ------
    BagError
        If it is no recording, or damaged so far that nothing can be read.
    """
    kind = storage_kind(name)
    if kind not in STORAGES:
        raise BagError(
            f'{name}: not a recording, expected a folder, .mcap or .db3; "hunt import" makes one'
            ' of a CSV, MATLAB, NumPy, TDMS or Parquet file'
        )
    if not name.is_file():  # a pipe would be waited for without end
        raise BagError(f'{name}: not a file, expected a recording')
    if name.suffix != '.zstd':
        return STORAGES[kind](name)
    opened = STORAGES[kind](expand_file(name, scratch))
    opened.path = str(name)
    return opened


def expand_file(name: Path, scratch: Path, *, partial: bool = False) -> Path:
    """
    Expand a file that is compressed as a whole.

    Parameters
    ----------
    name : Path
        Ends in `.zstd`.
    scratch : Path
        Folder for the expanded file.
    partial : bool
        Take what can be expanded of a damaged file.

    Raises
    ------
    BagError
        If it is no zstd file, or the disk has no room for it.
    """
    target = scratch / name.stem
    free = shutil.disk_usage(scratch).free - _RESERVE
    try:
        with (
            open(name, 'rb') as packed,
            open(target, 'wb') as out,
            zstandard.ZstdDecompressor().stream_reader(packed) as stream,
        ):
            try:
                while part := stream.read(1 << 20):
                    free -= len(part)
                    if free < 0:
                        raise BagError(f'{name}: no space in {scratch} to expand it')
                    out.write(part)
            except zstandard.ZstdError:
                if not partial:
                    raise
    except (OSError, zstandard.ZstdError, MemoryError) as error:
        raise BagError(f'{name}: cannot be expanded ({error})') from error
    return target


def _natural(name: Path) -> list[tuple[int, str]]:
    """Sort bag_2 before bag_10."""
    parts = re.split(r'(\d+)', name.name)
    return [(int(part), '') if part.isdigit() else (0, part) for part in parts]
