"""
Which drivers there are: the entry points `hunt_ros.drivers` of every installed package.

The name of an entry point is the name of the driver, the parameter `driver` of the nodes; its
value is a module with a class `Sensor`, a class `Drive`, or both. Our own stand in `setup.py` like
those of anybody else.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, distributions
from typing import Literal, overload

from hunt_ros.drivers.base import DriveDriver, SensorDriver
from hunt_ros.errors import ConfigError

GROUP = 'hunt_ros.drivers'

_BASES: dict[str, type] = {'Sensor': SensorDriver, 'Drive': DriveDriver}


def driver_names() -> tuple[str, ...]:
    """Return the names of all drivers, sorted, whether their libraries are installed or not."""
    return tuple(sorted(_points()))


def _points() -> dict[str, EntryPoint]:
    """
    Return the entry points by name; of two of one name that which Python finds first.

    `importlib.metadata.entry_points` looks at the first distribution of a name only: an old
    `hunt_ros.egg-info` in a source tree, found before what is installed, would hide the drivers.
    """
    found: dict[str, EntryPoint] = {}
    for distribution in distributions():
        for point in distribution.entry_points:
            if point.group == GROUP:
                found.setdefault(point.name, point)
    return found


@overload
def driver_class(name: str, role: Literal['Sensor']) -> type[SensorDriver]: ...
@overload
def driver_class(name: str, role: Literal['Drive']) -> type[DriveDriver]: ...
def driver_class(name: str, role: str) -> type:
    """
    Load the class of a driver.

    Parameters
    ----------
    name : str
        Of its entry point.
    role : str
        'Sensor' or 'Drive'.

    Raises
    ------
    ConfigError
        If there is no driver of this name, it cannot be imported, or it has no such class; with
        the names of those there are.
    """
    points = _points()
    if name not in points:
        names = ', '.join(sorted(points)) or 'none (install the package again: make install)'
        raise ConfigError(f'driver {name!r}: unknown, those there are: {names}')
    point = points[name]
    try:
        kind = getattr(point.load(), role, None)
    except Exception as error:  # whatever the module of a third party raises
        reason = ' '.join(f'{type(error).__name__}: {error}'.split())
        raise ConfigError(f'driver {name!r}: cannot import {point.value} ({reason})') from error
    if not (isinstance(kind, type) and issubclass(kind, _BASES[role])):
        raise ConfigError(
            f'driver {name!r}: {point.value} has no class {role},'
            f' expected one made from {_BASES[role].__name__}'
        )
    return kind
