"""Settings from a ROS 2 parameter file and from `--set NAME=VALUE`, without ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

from hunt_ros.cli.options import read_text
from hunt_ros.errors import ConfigError
from hunt_ros.settings import Settings

_Kind = TypeVar('_Kind', bound=Settings)


def read_settings(
    kind: type[_Kind],
    node: str,
    files: Sequence[Path],
    words: Sequence[str] = (),
    others: Sequence[type[Settings]] = (),
) -> _Kind:
    """
    Build the settings of a node the way ROS would.

    Parameters
    ----------
    kind : type of Settings
        Which settings.
    node : str
        Name of the node: the sections of the files that are taken.
    files : sequence of Path
        ROS 2 parameter files; a later one wins.
    words : sequence of str
        NAME=VALUE, value as YAML; these win over the files.
    others : sequence of type of Settings
        Further settings of the node, whose names are passed over here.

    Raises
    ------
    ConfigError
        Naming the file or word, and what was expected.
    """
    known = {item.name: item.default for item in fields(kind)}
    foreign = {item.name: item.default for other in others for item in fields(other)}
    values: dict[str, Any] = {}
    for path in files:
        found = parameters_of(node, read_text(path, 'parameter file'), str(path))
        values |= {k: v for k, v in found.items() if k in known}
    for word in words:
        name, equals, text = word.partition('=')
        if not equals or name not in known | foreign:
            names = _listed(known | foreign)
            raise ConfigError(f'--set {word}: expected NAME=VALUE with one of {names}')
        if name in known:
            try:
                values[name] = yaml.safe_load(text)
            except yaml.YAMLError:
                raise ConfigError(f'--set {word}: the value is not YAML') from None
    return kind(**{name: _like(known[name], value) for name, value in values.items()})


def parameters_of(node: str, text: str, source: str) -> dict[str, Any]:
    """
    Return the parameters of a file that are meant for a node, under any namespace.

    Parameters
    ----------
    node : str
        Name of the node.
    text, source : str
        The parameter file, and where it comes from, for messages.

    Raises
    ------
    ConfigError
        Naming the source, if it is no parameter file.
    """
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f'{source}: not YAML ({str(error).splitlines()[0]})') from error
    if not isinstance(document, Mapping):
        raise ConfigError(f'{source}: no parameter file, expected NODE: ros__parameters: ...')
    values: dict[str, Any] = {}
    for name, section in document.items():
        meant = str(name) == '/**' or str(name).rsplit('/', 1)[-1] == node
        if meant and isinstance(section, Mapping):
            values |= section.get('ros__parameters') or {}
    return values


def _like(default: Any, value: Any) -> Any:
    """Make of a YAML value what the setting is: a tuple, or a word that YAML takes for a bool."""
    if isinstance(default, str) and isinstance(value, bool):
        return 'on' if value else 'off'
    if isinstance(default, float) and isinstance(value, str):
        # YAML 1.1 takes 1e-5 for a word, ROS and people for a number.
        try:
            return float(value)
        except ValueError:
            return value
    return tuple(value) if isinstance(default, tuple) and isinstance(value, list) else value


def _listed(names: Mapping[str, object]) -> str:
    return ', '.join(sorted(names))
