"""A node's parameters as the text of a ROS parameter file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import yaml
from rcl_interfaces.msg import ParameterValue

#: ParameterType -> field of ParameterValue; 0 is "not set".
_FIELDS = (
    '', 'bool_value', 'integer_value', 'double_value', 'string_value', 'byte_array_value',
    'bool_array_value', 'integer_array_value', 'double_array_value', 'string_array_value',
)  # fmt: skip


def parameter_text(node: str, names: Sequence[str], values: Sequence[ParameterValue]) -> str:
    """
    Return a parameter file that gives a node the values it has.

    Parameters
    ----------
    node : str
        Full name.
    names, values : sequences
        As the node's services answer; what is not set is left out.
    """
    parameters = {}
    for name, value in zip(names, values, strict=True):
        if 0 < value.type < len(_FIELDS):
            parameters[name] = _plain(getattr(value, _FIELDS[value.type]))
    document = {node: {'ros__parameters': parameters}}
    return yaml.safe_dump(document, default_flow_style=None, width=99)


def _plain(value: object) -> object:
    if isinstance(value, bool | int | float | str):
        return value
    items = cast('Sequence[object]', value)
    return [item[0] if isinstance(item, bytes) else item for item in items]
