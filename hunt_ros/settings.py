"""
Settings: frozen dataclasses whose fields carry a unit, a range and a description.

The nodes declare their ROS parameters from these fields, the documentation
lists them, and `Settings` itself refuses a value out of range, so that a bad
value is named the same way wherever it comes from.
"""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from numbers import Real
from typing import Any, Literal, TypeVar

import yaml

from hunt_ros.errors import ConfigError

_Kind = TypeVar('_Kind', bound='Settings')

#: A name so alike a known one is a slip for it, and none of somebody else's.
_SLIP = 0.85


def setting(
    default: Any,
    description: str,
    *,
    unit: str = '',
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    fixed: bool = False,
) -> Any:
    """
    Declare a field of a `Settings` dataclass.

    Parameters
    ----------
    default : bool, int, float, str or tuple
        Its default; the type is the field's type.
    description : str
        What it does, for the operator.
    unit : str
        SI unit, e.g. 'm/s'.
    low, high : float, optional
        Range, both ends included; `low=0.0` of a tuple: finite numbers, none negative.
    choices : tuple of str
        The values a text may take.
    fixed : bool
        True where a node that follows its other settings while it runs cannot take a new value.
    """
    metadata = {
        'description': description,
        'unit': unit,
        'low': low,
        'high': high,
        'choices': choices,
        'fixed': fixed,
    }
    return field(default=default, metadata=metadata)


#: ... which a node that runs cannot change.
fixed = partial(setting, fixed=True)


@dataclass(frozen=True)
class Settings:
    """
    Base of every settings dataclass: checks each field on construction.

    Raises
    ------
    ConfigError
        Naming the field, its value, and what was expected.
    """

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            kind, number = type(item.default), isinstance(value, int | float)
            if kind is float and number and not isinstance(value, bool):
                value = float(value)
                object.__setattr__(self, item.name, value)
            elif kind is tuple and type(value) in (list, tuple):
                numbers = item.metadata.get('low') is not None
                value = tuple(
                    checked(item.name, x, 'not be negative') if numbers else x for x in value
                )
                object.__setattr__(self, item.name, value)
            problem = _problem(value, item.default, item.metadata)
            if problem:
                raise ConfigError(f'{item.name}: {value!r} is {problem}')

    @classmethod
    def from_recorded(cls: type[_Kind], values: Mapping[str, Any]) -> _Kind:
        """
        Build the settings from those of a recording, by name, as JSON keeps them.

        Another version may have made it: what it does not have gets its default, and a name
        that this one does not have is left out, see `unknown`.

        Raises
        ------
        ConfigError
            For a value out of range.
        """
        unknown = cls.unknown(values)
        return cls(**{name: value for name, value in values.items() if name not in unknown})

    @classmethod
    def unknown(cls, values: Mapping[str, Any]) -> set[str]:
        """Return the names that are none of these settings."""
        return set(values) - {item.name for item in fields(cls)}


def meant(name: str, known: Iterable[str]) -> str:
    """Return the known name for which another one is a slip; '' where it is none."""
    return next(iter(difflib.get_close_matches(name, known, 1, _SLIP)), '')


class _Loader(yaml.SafeLoader):  # type: ignore[misc] # it has no types
    """Refuses a key that stands twice: ROS takes both sections, YAML the last, without a word."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping."""
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in seen:
                text = f'{key.value!r} stands there twice'
                raise yaml.constructor.ConstructorError(None, None, text, key.start_mark)
            seen.add(str(key.value))
        return dict(super().construct_mapping(node, deep))


def yaml_document(text: str, source: str) -> Any:
    """
    Return what a YAML text holds.

    Raises
    ------
    ConfigError
        In one line, where it is not YAML.
    """
    try:
        return yaml.load(text, _Loader)
    except RecursionError as error:
        raise ConfigError(f'{source}: nested too deeply to be read') from error
    except yaml.YAMLError as error:
        raise ConfigError(f'{source}: not YAML ({" ".join(str(error).split())})') from error


def yaml_value(default: Any, value: Any, choices: Collection[str] = ()) -> Any:
    """
    Make of a YAML value what a setting is: YAML takes some words for a bool, numbers for words.

    Parameters
    ----------
    default : object
        Default of the setting.
    value : object
        As YAML 1.1 reads it.
    choices : collection of str
        Texts that the setting may be: `off` is meant where it is one of them.
    """
    if isinstance(value, bool) and (word := 'on' if value else 'off') in choices:
        return word
    if isinstance(default, float) and isinstance(value, str):
        # YAML 1.1 takes 1e-5 for a word, ROS and people for a number.
        try:
            return float(value)
        except ValueError:
            return value
    return value


def checked(
    name: str,
    value: Any,
    must: Literal['be finite', 'be positive', 'not be negative'] = 'be finite',
    expected: str = 'a number',
) -> float:
    """
    Return one finite number, where no `Settings` holds it.

    Parameters
    ----------
    name : str
        Its name, for the message.
    value : object
        What stands there.
    must : {'be finite', 'be positive', 'not be negative'}
        Which numbers are taken; an infinite one never is.
    expected : str
        What should stand there, for the message.

    Raises
    ------
    ConfigError
        For anything else.
    """
    if type(value) is bool or not issubclass(type(value), Real):
        raise ConfigError(f'{name} must be {expected}, got {str(value)[:40]!r}')
    # A whole number may be larger than any float.
    finite = -sys.float_info.max <= value <= sys.float_info.max
    wrong = (must == 'be positive' and value <= 0.0) or (must == 'not be negative' and value < 0.0)
    if wrong or not finite:
        raise ConfigError(f'{name} must {must}, got {value!s:.40}')
    return float(value)


_KINDS = {
    bool: 'true or false',
    int: 'a whole number',
    float: 'a number',
    str: 'a text, expected "..." in quotes',
    tuple: 'a list, expected [..., ...]',
}


def _problem(value: Any, default: Any, metadata: Any) -> str:
    """Say what is wrong with a value, or nothing."""
    kind = type(default)
    if kind in _KINDS and type(value) is not kind:
        return f'not {_KINDS[kind]}'
    if kind is float and math.isnan(value) and not math.isnan(default):
        return 'not a number'
    choices = metadata.get('choices') or ()
    if choices and value not in choices:
        return f'unknown, expected one of {", ".join(choices)}'
    low, high, unit = metadata.get('low'), metadata.get('high'), metadata.get('unit', '')
    if kind in (int, float):
        if low is not None and value < low:
            return f'below {low:g} {unit}'.rstrip()
        if high is not None and value > high:
            return f'above {high:g} {unit}'.rstrip()
    return ''
