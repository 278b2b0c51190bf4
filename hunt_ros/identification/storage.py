"""
An identification as one file: everything but the samples, in NumPy's `.npz`.

A dataclass of the package becomes its name and its fields, an array an entry of the archive;
nothing in the file is code. The file knows the normal form it belongs to.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import fields, is_dataclass, replace
from functools import partial
from os import PathLike
from pkgutil import resolve_name
from typing import Any

import numpy as np

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import HuntError, IdentificationError
from hunt_ros.identification.result import Identification

#: Version of the file: another one is refused.
VERSION = 5
#: What reading raises of a file that holds something else, or is spoilt.
_SPOILT = (
    HuntError, ValueError, KeyError, TypeError, AttributeError, ImportError, EOFError,
    zipfile.BadZipFile,
)  # fmt: skip
_UNITS = 'SI: m, m/s, s, 1/s, Hz, rad; noise intensity m^2/s; stamps in ns'


def save(found: Identification, path: str | PathLike[str]) -> None:
    """
    Write an identification.

    Parameters
    ----------
    found : Identification
        Its `records` are not written: samples stay in their recordings.
    path : path
        Of the file, as it is given.

    Raises
    ------
    IdentificationError
        If it cannot be written.
    """
    form = '' if found.normal_form is None else found.normal_form.fingerprint
    head = json.dumps({'version': VERSION, 'units': _UNITS, 'form': form})
    arrays: dict[str, Any] = {}
    content = json.dumps(replace(found, records=()), default=partial(_plain, arrays))
    try:
        with open(path, 'wb') as file:
            np.savez_compressed(file, head=head, content=content, **arrays)
    except OSError as error:
        raise IdentificationError(
            f'{path}: cannot write the identification ({error.strerror})'
        ) from error


def load(path: str | PathLike[str], form: IdentifiedNormalForm | None = None) -> Identification:
    """
    Read an identification.

    Parameters
    ----------
    path : path
        Of a file that `save` wrote.
    form : IdentifiedNormalForm, optional
        The form that it must belong to.

    Raises
    ------
    IdentificationError
        If it cannot be read, is no such file, is of another version, or belongs to another form.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            head = json.loads(str(archive['head']))
            if head['version'] != VERSION:
                raise IdentificationError(
                    f'{path}: identification of version {head["version"]}, expected {VERSION}'
                )
            if form is not None and head['form'] != form.fingerprint:
                raise IdentificationError(
                    f'{path}: belongs to another normal form, v_c or one of its numbers differs'
                )
            found = json.loads(str(archive['content']), object_hook=partial(_whole, archive))
        if not isinstance(found, Identification):
            raise TypeError(type(found))
    except OSError as error:
        reason = error.strerror or 'not an identification'
        raise IdentificationError(f'{path}: cannot read the identification ({reason})') from error
    except IdentificationError:
        raise
    except _SPOILT as error:
        raise IdentificationError(
            f'{path}: is no identification that hunt identify has written'
        ) from error
    return found


def _plain(arrays: dict[str, Any], entry: Any) -> Any:
    """Return as JSON what JSON has not; arrays go into the archive."""
    if isinstance(entry, np.ndarray):
        name = f'array{len(arrays)}'
        arrays[name] = entry
        return {'array': name}
    if not is_dataclass(entry):
        return entry.item()
    kind = type(entry)
    content = {item.name: getattr(entry, item.name) for item in fields(entry)}
    return {'dataclass': f'{kind.__module__}:{kind.__name__}', **content}


def _whole(archive: Any, entry: dict[str, Any]) -> Any:
    """Return what `_plain` was given; sequences as tuples."""
    if 'array' in entry:
        return archive[entry['array']]
    name = entry.pop('dataclass', None)
    if name is None:
        return entry
    kind = resolve_name(name) if name.startswith('hunt_ros.') else None
    if not (isinstance(kind, type) and is_dataclass(kind)):
        raise TypeError(f'{name} is no part of an identification')
    return kind(**{key: _tuple(below) for key, below in entry.items()})


def _tuple(entry: Any) -> Any:
    return tuple(map(_tuple, entry)) if isinstance(entry, list) else entry
