"""
Recordings that a dead recorder left behind: closed after the fact.

A recorder holds a lock on the file it writes, and the system lets go of it when
the process dies: so a recording that is running is never taken for a leftover.
"""

from __future__ import annotations

import fcntl
from pathlib import Path

from hunt_ros.bag.mcap.salvage import Salvage, finish_mcap, salvage_mcap
from hunt_ros.bag.reader import ACTIVE
from hunt_ros.bag.repair import description
from hunt_ros.bag.storage_files import folder_files
from hunt_ros.errors import BagError


class BeingRecorded(BagError):
    """The recording is not left over: its recorder is alive."""


def finalise(active: Path) -> Path:
    """
    Close a recording whose recorder died: index, description, final name.

    Nothing is lost that is in the folder whole; files that are complete stay as they
    are.

    Parameters
    ----------
    active : Path
        A folder ending in `.active`.

    Returns
    -------
    Path
        The closed recording.

    Raises
    ------
    BagError
        If its recorder is still alive, nothing in it can be saved, or the disk refuses.
    """
    target = final = active.with_name(active.name.removesuffix(ACTIVE))
    number = 1
    while target.exists():
        target, number = final.with_name(f'{final.name}_{number}'), number + 1
    files = [name for name in folder_files(active) if name.suffix == '.mcap']
    if any(_is_held(name) for name in files):
        raise BeingRecorded(f'{active}: is being recorded')
    parts = [(name.name, _finish_file(name)) for name in files if name.stat().st_size]
    if not any(part.messages for _, part in parts):
        raise BagError(f'{active}: holds no whole message, nothing to close')
    try:
        (active / 'metadata.yaml').write_text(description(parts), encoding='utf-8')
        active.rename(target)
    except OSError as error:
        raise BagError(f'{active}: cannot be closed ({error.strerror})') from error
    return target


def _is_held(file: Path) -> bool:
    """Whether a living process writes the file: it holds a lock on it."""
    with open(file, 'rb') as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return True
    return False


def _finish_file(file: Path) -> Salvage:
    """Give a file its end; where more than that is damaged, what is sound is copied."""
    try:
        return finish_mcap(file)
    except ValueError:
        pass
    repaired = file.with_suffix('.mcap.part')
    repaired.unlink(missing_ok=True)
    result = salvage_mcap(file, repaired)
    try:
        repaired.replace(file)
    except OSError as error:
        raise BagError(f'{file}: cannot be replaced ({error.strerror})') from error
    return result


def finalise_left(directory: Path) -> list[str]:
    """
    Close every recording in a directory whose recorder died.

    Returns
    -------
    list of str
        One line for each, on what was done or why not; recordings that are running
        are passed over in silence.
    """
    lines = []
    for active in sorted(directory.glob(f'*{ACTIVE}')):
        try:
            lines.append(f'{finalise(active)}: closed, its recorder had ended without doing so')
        except BeingRecorded:
            continue
        except BagError as error:
            lines.append(str(error))
    return lines
