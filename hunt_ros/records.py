"""
Records: memory with named fields that compiled kernels and plain Python both work on.

A record is declared as a class that has nothing but annotated fields: float, complex, int, bool,
another such class, ``Annotated[NDArray[...], shape...]`` of np.float64 or np.int64, or
``Annotated[list[Other], length]``. A kernel is handed a pointer to one block of memory, and
writes `f.sensors[k].noise`; plain Python runs the same line on objects. To write
`t.filters[1] = t.filters[0]` copies all that is in the one to the other.
"""

from __future__ import annotations

from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

_Kind = TypeVar('_Kind')
_SCALARS: dict[type, type] = {
    float: np.float64,
    int: np.int64,
    bool: np.bool_,
    complex: np.complex128,
}


def dtype_of(kind: type) -> np.dtype[np.void]:
    """
    Return the layout in memory of the records that a class declares.

    Raises
    ------
    TypeError
        For a name that every record of numpy has for another thing, such as `size`.
    """
    fields: list[tuple[Any, ...]] = []
    for name, (inner, shape) in _fields(kind).items():
        if hasattr(np.record, name):
            raise TypeError(f'{kind.__name__}.{name}: numpy.record has this name already')
        fields.append((name, _SCALARS.get(inner) or dtype_of(inner), shape))
    return np.dtype(fields, align=True)


def zeros(kind: type[_Kind], compiled: bool) -> _Kind:
    """
    Return a record in which every number is zero.

    Parameters
    ----------
    kind : type
        A class as in the module's docstring.
    compiled : bool
        True: one block of memory, as kernels want it. False: objects, which plain Python
        reads and writes ten times as fast.
    """
    if compiled:
        layout = np.dtype((np.record, dtype_of(kind)))  # fields are attributes of it
        record: _Kind = np.zeros(1, layout)[0]
        return record
    made = kind()
    for name, (inner, shape) in _fields(kind).items():
        if inner in _SCALARS:
            value = np.zeros(shape, _SCALARS[inner]) if shape else inner()
        else:
            parts: list[Any] = [zeros(inner, False) for _ in range(shape[0])] if shape else []
            value = _Places(parts) if shape else zeros(inner, False)
        setattr(made, name, value)
    return made


class _Places(list[Any]):
    """A row of records that are objects: to set one copies its contents, as memory does."""

    def __setitem__(self, place: Any, record: Any) -> None:
        _copy(record, self[place])


def _copy(record: Any, to: Any) -> None:
    """Copy every number of a record into another one of its kind."""
    for name, value in vars(record).items():
        if isinstance(value, _Places):
            for one, other in zip(value, getattr(to, name), strict=True):
                _copy(one, other)
        elif isinstance(value, np.ndarray):
            getattr(to, name)[...] = value
        elif hasattr(value, '__dict__'):
            _copy(value, getattr(to, name))
        else:
            setattr(to, name, value)


def _fields(kind: type) -> dict[str, tuple[type, tuple[int, ...]]]:
    """Return what each field holds, and in which shape."""
    found = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        shape = getattr(hint, '__metadata__', ())
        inner = get_args(hint)[0] if shape else hint
        if get_origin(inner) is list:
            inner = get_args(inner)[0]
        elif shape:
            (scalar,) = get_args(get_args(inner)[1])
            inner = int if scalar is np.int64 else float
        found[name] = (inner, shape)
    return found
