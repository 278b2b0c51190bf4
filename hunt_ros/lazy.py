"""Packages that import what is asked of them, and not before: a name needs no solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazily(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """
    Return the `__getattr__` (PEP 562) of a package.

    Parameters
    ----------
    package : str
        Its name.
    homes : mapping of str to str
        Public name -> the module of the package that has it; none of them has its name.
    """

    def get(name: str) -> Any:
        """Import a public name from its module."""
        if name not in homes:
            raise AttributeError(f'module {package!r} has no attribute {name!r}')
        return getattr(import_module(f'{package}.{homes[name]}'), name)

    return get
