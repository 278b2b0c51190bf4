"""
The recordings of a folder, as the second page lists them: their files, forms and reports.

The folder is looked at whenever the page asks. Of a recording its description is read
(`metadata.yaml`), never a message: `hunt info`, `hunt report` and `hunt replay` do that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from hunt_ros.bag.clips import recording_of
from hunt_ros.bag.reader import (
    ACTIVE,
    STORAGES,
    folder_files,
    is_recording,
    read_metadata,
    storage_kind,
)
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import HuntError
from hunt_ros.samples import NANOSECONDS

_NOT_IN_FORCE = 'normal_form_reverted'

_Found = TypeVar('_Found')


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
        #: What was read of a small file, and its time of change then.
        self._read: dict[Path, tuple[int, Any]] = {}

    def listing(self) -> dict[str, Any]:
        """
        Return what is in the folder now.

        Returns
        -------
        dict
            For JSON. `directory`; `problem` ('' where the folder can be read); `recordings`, the
            newest first: `name`, `open` (True: it is being recorded, or was not closed),
            `began_s` (s since 1970, or simulated), `duration_s` (null without a description),
            `bytes`, `files` (names of those that can be had, its clips behind), `form` (the
            newest normal form that rests on it: `file` and `words`, or null), and `report` (True
            where there is one).
        """
        said: dict[str, Any] = {'directory': str(self.directory), 'problem': ''}
        try:
            paths = self._paths()
        except OSError as error:
            return said | {'problem': f'cannot be read: {error.strerror}', 'recordings': []}
        forms = list(self._forms())
        rows = []
        for path, clips in paths.items():
            with suppress(OSError, HuntError):  # it has gone meanwhile
                rows.append(self._row(path, clips, forms))
        rows.sort(key=lambda row: (row['open'], row['began_s'], row['name']), reverse=True)
        return said | {'recordings': rows}

    def file(self, name: str, file: str) -> Path | None:
        """Return a file of a recording that can be had; None where there is none of that name."""
        with suppress(OSError, HuntError, KeyError):
            path, clips = self._named()[name]
            return next((each for each in _offered(path, clips) if each.name == file), None)
        return None

    def form(self, name: str) -> Path | None:
        """Return the newest normal form that rests on a recording."""
        own = [path for path, names, _ in self._forms() if _word(name) in names]
        return max(own, key=lambda path: path.stat().st_mtime_ns, default=None)

    def report(self, name: str) -> Path | None:
        """Return the report of a recording; None where there is none."""
        with suppress(OSError, KeyError):
            return _report(self._named()[name][0])
        return None

    def _named(self) -> dict[str, tuple[Path, list[Path]]]:
        """Return the recordings with their clips, by name."""
        return {path.name: (path, clips) for path, clips in self._paths().items()}

    def _paths(self) -> dict[Path, list[Path]]:
        """Return what looks like a recording, each with the clips of it."""
        found: dict[Path, list[Path]] = {}
        files = []
        for path in sorted(self.directory.iterdir()):
            if path.is_file():
                files += [path] if storage_kind(path) in STORAGES else []
            elif (path / 'metadata.yaml').exists() or is_recording(path):
                found[path] = []
        for path in files:  # a clip whose recording is not there stands for itself
            whole = path.with_name(recording_of(path))
            whole = whole if whole in found else whole.with_name(whole.name + ACTIVE)
            if whole in found:
                found[whole].append(path)
            else:
                found[path] = []
        return found

    def _row(
        self, path: Path, clips: list[Path], forms: list[tuple[Path, frozenset[str], str]]
    ) -> dict[str, Any]:
        known = self._known(path / 'metadata.yaml', _span) or (path.stat().st_mtime, None)
        own = [form for form in forms if _word(path.name) in form[1]]
        newest = max(own, key=lambda form: form[0].stat().st_mtime_ns, default=None)
        return {
            'name': path.name,
            'open': path.name.endswith(ACTIVE),
            'began_s': known[0],
            'duration_s': known[1],
            'bytes': sum(file.stat().st_size for file in _files(path)),
            'files': [file.name for file in _offered(path, clips)],
            'form': newest and {'file': newest[0].name, 'words': newest[2]},
            'report': _report(path) is not None,
        }

    def _forms(self) -> Iterator[tuple[Path, frozenset[str], str]]:
        """Yield the normal forms of the folder and of the recordings in it."""
        for path in (*self.directory.glob('*.yaml'), *self.directory.glob('*/normal_form*.yaml')):
            if not path.name.startswith(_NOT_IN_FORCE) and (form := self._known(path, _form)):
                names, words = form
                names |= {path.stem if path.parent == self.directory else path.parent.name}
                yield path, names, words

    def _known(self, path: Path, read: Callable[[Path], _Found]) -> _Found | None:
        """Return what a small file says, read again when it changes; None where it is nothing."""
        try:
            changed_ns = path.stat().st_mtime_ns
            if path not in self._read or self._read[path][0] != changed_ns:
                self._read[path] = changed_ns, None
                self._read[path] = changed_ns, read(path)
        except (OSError, ValueError, KeyError, TypeError, HuntError):
            pass
        found: _Found | None = self._read.get(path, (0, None))[1]
        return found


def _span(path: Path) -> tuple[float, float]:
    """Return when a recording began, and how long it is, by its description: s."""
    told = read_metadata(path)
    began_ns = told['starting_time']['nanoseconds_since_epoch']
    return began_ns / NANOSECONDS, told['duration']['nanoseconds'] / NANOSECONDS


def _form(path: Path) -> tuple[frozenset[str], str]:
    """Return the recordings on which a normal form rests, and its critical speeds in words."""
    form = IdentifiedNormalForm.from_yaml(path.read_text(encoding='utf-8'), str(path))
    return frozenset(_word(Path(each).name) for each in form.recordings), form.words


def _files(path: Path) -> list[Path]:
    """Return the files of a recording: those with its messages, and its description."""
    if path.is_file():
        return [path]
    description = path / 'metadata.yaml'
    return [*folder_files(path), *([description] if description.is_file() else [])]


def _offered(path: Path, clips: list[Path]) -> list[Path]:
    """Return the files that can be had: of a recording that is not closed its clips."""
    return clips if path.name.endswith(ACTIVE) else [*_files(path), *clips]


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
