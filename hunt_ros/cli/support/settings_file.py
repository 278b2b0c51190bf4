"""Settings from a ROS 2 parameter file and from `--set NAME=VALUE`, without ROS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import yaml

from hunt_ros.cli.support.options import read_text
from hunt_ros.errors import ConfigError
from hunt_ros.rig import parameters_of
from hunt_ros.settings import Settings, yaml_value

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
            if values[name] is None:  # lines= is a list without a line
                values[name] = () if isinstance(known[name], tuple) else ''
    return kind(**{name: yaml_value(known[name], value) for name, value in values.items()})


def _listed(names: Mapping[str, object]) -> str:
    return ', '.join(sorted(names))
