"""
The recordings of a folder, as the second page shows them.

The folder is looked at whenever the page asks. What is in a recording is read once, in another
process (`digest`), one recording after the other, and kept in memory until its files change.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from hunt_ros.bag.reader import ACTIVE
from hunt_ros.bag.storage_files import STORAGES, folder_files, storage_kind
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import HuntError

#: Longer than an hour of samples takes on a slow machine, s.
_LONGEST_S = 600.0
_NOT_IN_FORCE = 'normal_form_reverted'
GONE = 'is not in the folder any more: moved, renamed or deleted'

#: Name, size and time of change of each file: what is read once is read again when it changes.
_State = tuple[tuple[str, int, int], ...]


class _Form(NamedTuple):
    """A normal form in the folder, and the recordings that it rests on."""

    path: Path
    changed_ns: int
    names: frozenset[str]


class Recordings:
    """
    The recordings of one folder.

    Parameters
    ----------
    directory : Path
        That of the recorder; it need not be there yet.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._lock = threading.Lock()
        #: What was read, and what the files were then.
        self._read: dict[Path, tuple[_State, dict[str, Any]]] = {}
        self._todo: list[Path] = []
        self._forms: dict[Path, tuple[int, _Form | None]] = {}
        self._seen: set[str] = set()
        self._reader: threading.Thread | None = None
        self._child: subprocess.Popen[str] | None = None
        self._closed = False

    def listing(self) -> dict[str, Any]:
        """
        Return what is in the folder now; reading of what is new begins.

        Returns
        -------
        dict
            For JSON. `directory`; `problem` ('' where the folder can be read); `reading`: True
            while there is more to come; `recordings`, the newest first: what `digest` gives, with
            `name`, `state` ('read', 'reading', 'open', 'damaged' or 'gone'), `v_c` and `v_n`
            (`value` and `ci95`, m/s, and the file `form`; null where no form is stored beside it),
            and `report` (its address; '' where there is none).
        """
        said: dict[str, Any] = {'directory': str(self.directory), 'problem': '', 'reading': False}
        try:
            paths = list(self._paths())
        except OSError as error:
            return said | {'problem': f'cannot be read: {error.strerror}', 'recordings': []}
        forms = list(self._known_forms())
        todo: list[Path] = []
        with self._lock:
            rows = [self._row(path, forms, todo) for path in paths]
            self._seen |= {path.name for path in paths}
            for name in sorted(self._seen - {path.name for path in paths}):
                if name.endswith(ACTIVE):
                    self._seen.remove(name)  # it was closed, and has its name now
                else:
                    rows.append(_gone(name, self._read.get(self.directory / name)))
            self._todo = todo
            if todo and not self._closed and (self._reader is None or not self._reader.is_alive()):
                self._reader = threading.Thread(
                    target=self._read_all, name='recordings', daemon=True
                )
                self._reader.start()
        rows.sort(key=lambda row: (row['began_s'] or 0.0, row['name']), reverse=True)
        return said | {'reading': bool(todo), 'recordings': rows}

    def report(self, name: str) -> Path | None:
        """Return the report of a recording; None where there is none."""
        with suppress(OSError):
            for path in self._paths():
                if path.name == name:
                    return _report(path)
        return None

    def to_play(self, name: str) -> dict[str, str] | None:
        """
        Return what a replay of a recording is told of it; None where it is not there.

        Returns
        -------
        dict or None
            `recording` and `form`: paths; '' where no normal form rests on it.
        """
        with suppress(OSError):
            for path in self._paths():
                if path.name == name:
                    form = self._newest_form(name, list(self._known_forms()))
                    return {'recording': str(path), 'form': str(form or '')}
        return None

    def close(self) -> None:
        """End the reading."""
        with self._lock:
            self._closed = True
            if self._child is not None:
                self._child.kill()

    def _paths(self) -> Iterator[Path]:
        """Yield what looks like a recording."""
        for path in sorted(self.directory.iterdir()):
            if path.is_file():
                if storage_kind(path) in STORAGES:
                    yield path
            elif (path / 'metadata.yaml').exists() or _holds_files(path):
                yield path

    def _row(self, path: Path, forms: list[_Form], todo: list[Path]) -> dict[str, Any]:
        """Return what is known of a recording; add to `todo` what is to be read for it."""
        row: dict[str, Any] = {**_NOTHING, 'name': path.name, 'v_c': None, 'v_n': None}
        row['report'] = f'report/{path.name}' if _report(path) else ''
        if path.name.endswith(ACTIVE):
            told = 'is being recorded now, or was not closed: hunt info says which'
            return row | {'state': 'open', 'problem': told}
        newest = self._newest_form(path.name, forms)
        if newest is not None:
            where = str(newest.relative_to(self.directory))
            for name, speed in self._known(newest, todo).items():
                row[name] = speed and {**speed, 'form': where}
        read = self._known(path, todo)
        if not read:
            return row | {'state': 'reading'}
        return row | read | {'state': 'damaged' if read['problem'] else 'read'}

    def _newest_form(self, name: str, forms: list[_Form]) -> Path | None:
        """Return the newest of the forms that rest on a recording."""
        own = [form for form in forms if _word(name) in form.names]
        return max(own, key=lambda form: form.changed_ns).path if own else None

    def _known(self, path: Path, todo: list[Path]) -> dict[str, Any]:
        """Return what was read; {}, and one more to do, where that is not known or has changed."""
        state, read = self._read.get(path, ((), {}))
        if state == _state(path):
            return read
        if path not in todo:
            todo.append(path)
        return {}

    def _known_forms(self) -> Iterator[_Form]:
        """Yield the normal forms of the folder and of the recordings in it."""
        for path in (*self.directory.glob('*.yaml'), *self.directory.glob('*/normal_form*.yaml')):
            if path.name.startswith(_NOT_IN_FORCE):
                continue
            with suppress(OSError):
                changed_ns = path.stat().st_mtime_ns
                known = self._forms.get(path)
                if known is None or known[0] != changed_ns:
                    known = changed_ns, _form(path, changed_ns, self.directory)
                    self._forms[path] = known
                if known[1] is not None:
                    yield known[1]

    def _read_all(self) -> None:
        """Read what is to be read, until there is nothing left; in a thread."""
        while True:
            with self._lock:
                if self._closed or not self._todo:
                    return
                path = self._todo.pop(0)
                state = _state(path)
                self._child = child = subprocess.Popen(
                    [sys.executable, '-m', 'hunt_ros.dashboard.digest', str(path)],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                )
            read = self._answer(path, child)
            with self._lock:
                self._read[path] = state, read

    def _answer(self, path: Path, child: subprocess.Popen[str]) -> dict[str, Any]:
        """Return what the process that reads has found."""
        nothing = {} if path.suffix == '.yaml' else _NOTHING
        try:
            said, wrong = child.communicate(timeout=_LONGEST_S)
            read: dict[str, Any] = json.loads(said)
        except subprocess.TimeoutExpired:
            child.kill()
            child.communicate()
            return {**nothing, 'problem': f'not read within {_LONGEST_S:.0f} s'} if nothing else {}
        except ValueError:
            last = wrong.strip().splitlines() or [f'exit code {child.returncode}']
            return {**nothing, 'problem': f'cannot be read: {last[-1]}'} if nothing else {}
        if 'problem' in read:  # the folder stands above the list
            read['problem'] = read['problem'].replace(f'{self.directory}/', '')
        return read


_NOTHING: dict[str, Any] = {
    'began_s': None, 'duration_s': None, 'speed_mps': None, 'alarms': None, 'picture': None,
    'problem': '',
}  # fmt: skip


def _gone(name: str, read: tuple[_State, dict[str, Any]] | None) -> dict[str, Any]:
    """Return the row of a recording that was there, and is not any more."""
    known = {**_NOTHING, **(read[1] if read else {}), 'name': name, 'state': 'gone'}
    return {**known, 'v_c': None, 'v_n': None, 'report': '', 'problem': GONE}


def _holds_files(path: Path) -> bool:
    with suppress(HuntError):
        return path.is_dir() and bool(folder_files(path))
    return False


def _state(path: Path) -> _State:
    """Return what changes with a recording, or with a form and the identification beside it."""
    found = []
    with suppress(OSError):
        for file in sorted(path.iterdir()) if path.is_dir() else [path, path.with_suffix('.npz')]:
            with suppress(OSError):
                about = file.stat()
                found.append((file.name, about.st_size, about.st_mtime_ns))
    return tuple(found)


def _report(path: Path) -> Path | None:
    """Return the newest page that stands beside a recording under its name, or in it."""
    word = _word(path.name)
    beside = (path.parent / f'{word}{ending}' for ending in ('.html', '_report.html'))
    inside = path.glob('*.html') if path.is_dir() else ()
    found = [page for page in (*beside, *inside) if page.is_file()]
    return max(found, key=lambda page: page.stat().st_mtime_ns, default=None)


def _word(name: str) -> str:
    """Return the name of a recording without the ending of a file."""
    return name.removesuffix('.zstd').removesuffix('.mcap').removesuffix('.db3')


def _form(path: Path, changed_ns: int, directory: Path) -> _Form | None:
    """Read a parameter file; None where it is no normal form."""
    try:
        form = IdentifiedNormalForm.from_yaml(path.read_text(encoding='utf-8'), str(path))
    except (OSError, ValueError, HuntError):
        return None
    names = {_word(Path(recording).name) for recording in form.recordings}
    names.add(path.stem if path.parent == directory else path.parent.name)
    return _Form(path, changed_ns, frozenset(names))
