"""
An identification as one file: everything but the samples, in NumPy's `.npz`.

A frozen dataclass becomes its name and its fields, an array an entry of the archive; nothing in
the file is code. The file knows the normal form it belongs to.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from os import PathLike
from typing import Any

import numpy as np

from hunt_ros import samples
from hunt_ros.analysis import steady_state
from hunt_ros.dynamics import growth_law, identified, mode_shape, normal_form
from hunt_ros.errors import HuntError, IdentificationError
from hunt_ros.identification import bracket, four_point, posterior, result
from hunt_ros.identification.record import envelope, events, segments
from hunt_ros.identification.result import Identification

#: Version of the file: another one is refused.
VERSION = 4
_UNITS = 'SI: m, m/s, s, 1/s, Hz, rad; noise intensity m^2/s; stamps in ns'

#: Rooms whose dataclasses a file may hold.
_ROOMS = (
    samples, steady_state, identified, mode_shape, normal_form, bracket, four_point, growth_law,
    posterior, result, envelope, events, segments,
)  # fmt: skip
_CLASSES: Mapping[str, Any] = {
    name: one for room in _ROOMS for name, one in vars(room).items() if is_dataclass(one)
}

#: Fields that are not kept: samples stay in their recordings.
_LEFT_OUT = {'Identification': {'records': ()}}


def save(found: Identification, path: str | PathLike[str]) -> None:
    """
    Write an identification.

    Parameters
    ----------
    found : Identification
        Its `records` are not written.
    path : path
        Of the file, as it is given.

    Raises
    ------
    IdentificationError
        If it cannot be written.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    head = {
        'version': VERSION,
        'units': _UNITS,
        'form': '' if found.normal_form is None else found.normal_form.fingerprint,
        'content': _encoded(found, arrays),
    }
    try:
        with open(path, 'wb') as file:
            np.savez_compressed(file, head=np.array(json.dumps(head)), **arrays)  # type: ignore[arg-type]
    except OSError as error:
        raise IdentificationError(
            f'{path}: cannot write the identification ({error.strerror})'
        ) from error


def load(
    path: str | PathLike[str], form: identified.IdentifiedNormalForm | None = None
) -> Identification:
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
            arrays = {name: archive[name] for name in archive.files if name != 'head'}
        found = _decoded(head['content'], arrays)
    except OSError as error:
        reason = error.strerror or 'not an identification'
        raise IdentificationError(f'{path}: cannot read the identification ({reason})') from error
    except IdentificationError:
        raise
    except (HuntError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise IdentificationError(
            f'{path}: is no identification that hunt identify has written'
        ) from error
    if not isinstance(found, Identification):
        raise IdentificationError(f'{path}: is no identification that hunt identify has written')
    return found


def _encoded(entry: Any, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    """Return an entry as JSON; arrays go into the archive."""
    if isinstance(entry, np.ndarray):
        name = f'array{len(arrays)}'
        arrays[name] = entry
        return {'array': name}
    if isinstance(entry, np.generic):
        entry = entry.item()
    if isinstance(entry, float) and not math.isfinite(entry):
        return {'float': repr(entry)}
    if is_dataclass(entry) and not isinstance(entry, type):
        name = type(entry).__name__
        left_out = _LEFT_OUT.get(name, {})
        kept = [one.name for one in fields(entry) if one.name not in left_out]
        return {name: {key: _encoded(getattr(entry, key), arrays) for key in kept}}
    if isinstance(entry, Mapping):
        return {'mapping': {key: _encoded(below, arrays) for key, below in entry.items()}}
    if isinstance(entry, list | tuple):
        return [_encoded(below, arrays) for below in entry]
    return entry


def _decoded(entry: Any, arrays: Mapping[str, np.ndarray[Any, Any]]) -> Any:
    """Return what `_encoded` was given; sequences as tuples."""
    if isinstance(entry, list):
        return tuple(_decoded(below, arrays) for below in entry)
    if not isinstance(entry, dict):
        return entry
    ((name, content),) = entry.items()
    if name == 'array':
        return arrays[content]
    if name == 'float':
        return float(content)
    below = {key: _decoded(one, arrays) for key, one in content.items()}
    return below if name == 'mapping' else _CLASSES[name](**_LEFT_OUT.get(name, {}), **below)
