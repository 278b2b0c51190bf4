"""
One switch between numba's compiler and plain Python.

Inner loops are written once, in the subset of Python that numba compiles, and
decorated with `compiled`. With the extra ``fast`` installed they run as machine
code; without it they run as they stand, slower, with the same results to
rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, TypeVar, cast

_Function = TypeVar('_Function', bound=Callable[..., Any])

#: True where numba is installed and kernels run as machine code.
HAVE_COMPILER: bool = find_spec('numba') is not None


def compiled(function: _Function) -> _Function:
    """
    Compile a kernel on first use, and keep the machine code on disk.

    The kernel releases the GIL, and keeps IEEE semantics (no fastmath), so that
    NaN stays NaN and a block split in two gives the same numbers as the whole.

    Parameters
    ----------
    function : callable
        Numeric code on scalars and numpy arrays, without Python objects.

    Returns
    -------
    callable
        The compiled kernel, or `function` itself where numba is missing.
    """
    if not HAVE_COMPILER:
        return function
    import numba  # here, because it takes half a second and not every command needs it

    return cast(_Function, numba.njit(cache=True, nogil=True)(function))
