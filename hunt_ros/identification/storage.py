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

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds, SteadyState
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.errors import HuntError, IdentificationError
from hunt_ros.identification.bracket import Bracket
from hunt_ros.identification.four_point import FourPoint
from hunt_ros.identification.growth_law import GrowthLaw, GrowthScales
from hunt_ros.identification.posterior import Posterior
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.record.events import Event
from hunt_ros.identification.record.segments import Segment
from hunt_ros.identification.result import BranchPoint, FitSummary, Identification
from hunt_ros.samples import Uncertain

#: Version of the file: another one is refused.
VERSION = 3
_UNITS = 'SI: m, m/s, s, 1/s, Hz, rad; noise intensity m^2/s; stamps in ns'

_CLASSES: Mapping[str, type] = {
    one.__name__: one
    for one in (
        Bracket,
        BranchPoint,
        Envelope,
        Event,
        FitSummary,
        FourPoint,
        GrowthLaw,
        GrowthScales,
        Identification,
        IdentifiedNormalForm,
        ModeShape,
        NormalForm,
        ObservedCriticalSpeeds,
        Posterior,
        Segment,
        SteadyState,
        Uncertain,
    )
}

#: Fields that are not kept: samples stay in their recordings.
_LEFT_OUT = {'Identification': {'records': ()}}


def save(result: Identification, path: str | PathLike[str]) -> None:
    """
    Write an identification.

    Parameters
    ----------
    result : Identification
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
        'form': '' if result.normal_form is None else result.normal_form.fingerprint,
        'content': _encoded(result, arrays),
    }
    try:
        with open(path, 'wb') as file:
            np.savez_compressed(file, head=np.array(json.dumps(head)), **arrays)  # type: ignore[arg-type]
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
            arrays = {name: archive[name] for name in archive.files if name != 'head'}
        result = _decoded(head['content'], arrays)
    except OSError as error:
        reason = error.strerror or 'not an identification'
        raise IdentificationError(f'{path}: cannot read the identification ({reason})') from error
    except IdentificationError:
        raise
    except (HuntError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise IdentificationError(
            f'{path}: is no identification that hunt identify has written'
        ) from error
    if not isinstance(result, Identification):
        raise IdentificationError(f'{path}: is no identification that hunt identify has written')
    return result


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
