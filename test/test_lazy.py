"""Packages that import what is asked of them."""

from __future__ import annotations

from importlib import import_module

import pytest
from made import python

LAZY = ('hunt_ros.detection', 'hunt_ros.identification')


@pytest.mark.parametrize('name', LAZY)
def test_every_public_name_is_there_and_no_other(name: str) -> None:
    package = import_module(name)
    for public in package.__all__:
        assert getattr(package, public).__module__.startswith(name) or public == 'Source'
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nothing'"):
        _ = package.nothing


# Who presses Ctrl-C while `hunt` starts sees no traceback of a library.
@pytest.mark.parametrize('name', [*LAZY, 'hunt_ros.cli.main'])
def test_a_package_alone_imports_no_numerics(name: str) -> None:
    words = f'import sys, {name}; print(sorted(set(sys.modules) & {{"numpy", "scipy", "numba"}}))'
    assert python('-c', words).stdout.strip() == '[]'
