"""
The parameter files of a rig: the newest normal form, and the earlier ones by number.

`normal_form.yaml` is the newest. When another comes it stays as `normal_form_001.yaml`,
`_002`, ..., the highest number being the latest. One that a person went back from stays
too, as `normal_form_reverted_001.yaml`: nothing is ever deleted.
"""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

from hunt_ros.detection.acceptance import rolled_back
from hunt_ros.dynamics.identified import NEWEST_FILE, IdentifiedNormalForm
from hunt_ros.errors import HuntError
from hunt_ros.files import write_whole

#: Ends the name of the identification that a parameter file comes from.
_WHOLE = '.npz'


def _move(path: Path, to: Path) -> None:
    """Rename a parameter file, and the identification beside it."""
    path.rename(to)
    with suppress(FileNotFoundError):
        path.with_suffix(_WHOLE).rename(to.with_suffix(_WHOLE))


class FormFiles:
    """
    The parameter files in one folder.

    Parameters
    ----------
    directory : Path
        Made when the first file is kept.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    @property
    def newest(self) -> Path:
        """Where the newest form stands."""
        return self._directory / NEWEST_FILE

    def kept(self) -> IdentifiedNormalForm | None:
        """
        Return the newest form; None where there is none.

        Raises
        ------
        HuntError
            If it cannot be read.
        """
        return IdentifiedNormalForm.read(self.newest) if self.newest.exists() else None

    def used(self) -> set[Path]:
        """Return every recording that a kept form rests on, gone back from or not."""
        found: set[Path] = set()
        for path in self._directory.glob('normal_form*.yaml'):
            with suppress(HuntError):
                found.update(map(Path, IdentifiedNormalForm.read(path).recordings))
        return found

    def earlier(self) -> list[Path]:
        """Return the earlier forms, the oldest first."""
        return self._numbered('normal_form')

    def keep(self, text: str, whole: Path | None = None) -> Path:
        """
        Write the parameter file; the one before stays under a number.

        Parameters
        ----------
        text : str
            The parameter file.
        whole : Path, optional
            File of `Identification.save`: what it comes from, kept beside it as `.npz`.

        Raises
        ------
        HuntError
            If the folder or the file cannot be written.
        """
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            if self.newest.exists():
                _move(self.newest, self._next('normal_form'))
            if whole is not None:
                shutil.copyfile(whole, self.newest.with_suffix(_WHOLE))
            write_whole(self.newest, text, 'normal form')
        except OSError as error:
            raise HuntError(
                f'{self.newest}: cannot keep the normal form ({error.strerror})'
            ) from error
        return self.newest

    def go_back(self) -> str:
        """
        Make the latest of the earlier forms the newest again, marked as what it is.

        Returns
        -------
        str
            The parameter file, with the mark of `detection.acceptance.rolled_back`.

        Raises
        ------
        HuntError
            If no earlier form is kept, or it cannot be read: then nothing is changed.
        """
        earlier = self.earlier()
        if not earlier:
            raise HuntError(f'{self._directory}: no earlier normal form is kept there')
        latest = earlier[-1]
        try:
            text = rolled_back(IdentifiedNormalForm.read(latest)).to_yaml()
            if self.newest.exists():
                _move(self.newest, self._next('normal_form_reverted'))
            _move(latest, self.newest)
            write_whole(self.newest, text, 'normal form')
        except OSError as error:
            raise HuntError(f'{latest}: cannot go back to it ({error.strerror})') from error
        return text

    def _numbered(self, stem: str) -> list[Path]:
        """Return the files with a number behind the stem, by number."""
        paths = self._directory.glob(f'{stem}_*.yaml')
        found = {path.stem.removeprefix(f'{stem}_'): path for path in paths}
        return [found[number] for number in sorted(filter(str.isdecimal, found), key=int)]

    def _next(self, stem: str) -> Path:
        """Return the name after the highest number, so that the order is that of time."""
        numbers = [int(path.stem.removeprefix(f'{stem}_')) for path in self._numbered(stem)]
        return self._directory / f'{stem}_{1 + max(numbers, default=0):03d}.yaml'
