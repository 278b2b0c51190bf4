"""Files: text that a user has named, and what is written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from hunt_ros.errors import ConfigError, HuntError

#: A file that is being written has this ending.
PART = '.part'


def read_text(path: str | Path, what: str) -> str:
    """
    Read a text file that a user has named.

    Parameters
    ----------
    path : str or Path
        The file.
    what : str
        What it should be, for the message: 'normal form'.

    Raises
    ------
    ConfigError
        If it is missing, a folder, not readable, empty, or no text.
    """
    try:
        text = Path(path).read_text(encoding='utf-8')
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or 'not UTF-8 text'
        raise ConfigError(f'{path}: cannot read it as a {what} ({reason})') from error
    if not text.strip():
        raise ConfigError(f'{path}: cannot read it as a {what} (the file is empty)')
    return text


def write_whole(
    path: str | Path, content: str | bytes | Callable[[Path], object], what: str = 'file'
) -> None:
    """
    Write a file under another name first: what stood there stays until the new one is on the disk.

    Parameters
    ----------
    path : str or Path
        A file that is there is replaced, and through a link the file that it leads to; a device
        or a pipe is written to.
    content : str, bytes or callable
        A text is written as UTF-8; what is too large for the memory writes itself to a path.
    what : str
        For the message.

    Raises
    ------
    HuntError
        If the disk refuses; nothing has changed then.
    """
    raw = content.encode('utf-8') if isinstance(content, str) else content
    write = raw if callable(raw) else lambda file: file.write_bytes(raw)
    target = Path(os.path.realpath(path))
    partial = target.with_name(target.name + PART)
    try:
        # A rename would put a file in the place of /dev/null, for every program of the machine.
        if os.path.exists(path) and not os.path.isfile(path):
            write(Path(path))
            return
        partial.unlink(missing_ok=True)  # of a program that was killed
        write(partial)
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
