"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from hunt_ros.errors import HuntError


def write_whole(path: str | Path, content: str | bytes, what: str = 'file') -> None:
    """
    Write a file under another name first: what stood there stays until the new one is on the disk.

    Parameters
    ----------
    path : str or Path
        What is there is replaced.
    content : str or bytes
        A text is written as UTF-8.
    what : str
        For the message.

    Raises
    ------
    HuntError
        If the disk refuses; nothing has changed then.
    """
    target = Path(path)
    partial = target.with_name(target.name + '.part')
    raw = content.encode('utf-8') if isinstance(content, str) else content
    try:
        partial.write_bytes(raw)
        with partial.open('rb+') as file:
            os.fsync(file.fileno())
        partial.replace(target)
    except OSError as error:
        raise HuntError(f'{path}: cannot write the {what} ({error.strerror})') from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
    with suppress(OSError):  # not every system syncs a folder
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)  # or the new name is lost with the power
        finally:
            os.close(folder)
