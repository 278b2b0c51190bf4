"""ROS parameters from a `Settings` dataclass: declared with range and description."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, fields, replace
from functools import partial
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import yaml
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.errors import ConfigError, one_line
from hunt_ros.rig import PARAMETERS as RIG
from hunt_ros.settings import Settings, meant

_Config = TypeVar('_Config', bound=Settings)

#: Type of an array by that of its elements: ROS cannot see it from an empty one.
_ARRAYS = {
    'tuple[str, ...]': Parameter.Type.STRING_ARRAY,
    'tuple[float, ...]': Parameter.Type.DOUBLE_ARRAY,
    'tuple[int, ...]': Parameter.Type.INTEGER_ARRAY,
}
_FIXED, _FORM = 'set at the start only', 'normal_form.'
#: Parameters of earlier versions: without them a reading would be taken for SI, and a limit be
#: none.
_GONE = {
    'calibration': 'gain, offset and range',
    'scale': 'gain',
    'rate_limit_mps': 'amplitude_limit_m',
    'emergency_speed_mps': 'none: an emergency stop is a stop',
}
#: Gets the settings by their class as they would be, those that do not change among them.
Check = Callable[[Mapping[type, Any]], None]


def declare(
    node: Node,
    kind: type[_Config],
    follow: Callable[[_Config], None] | None = None,
    check: Check | None = None,
) -> _Config:
    """
    Declare one parameter for each field of a settings class, and read them.

    A parameter either takes effect when it is set, or is read-only and says so: where the
    node gives no `follow`, and for fields that are `fixed`, it is read-only. Settings that
    are set together, of whatever classes, are taken together or not at all.

    Parameters
    ----------
    node : Node
        Gets the parameters, named as the fields.
    kind : type of Settings
        The settings class.
    follow : callable, optional
        Takes new settings into use. It is called when nothing can refuse them any more,
        and so must not fail.
    check : callable, optional
        Gets all settings of the node by class, as they would be; raises ConfigError where they
        cannot be taken now; changes nothing.

    Returns
    -------
    Settings
        The values in force.

    Raises
    ------
    ConfigError
        For a value out of range, with its name.
    """
    values = {}
    for item in fields(kind):
        descriptor = _descriptor(item, live=follow is not None)
        default = item.default
        if isinstance(default, tuple):
            default = list(default) or _ARRAYS[str(item.type)]
        value = node.declare_parameter(item.name, default, descriptor).value
        values[item.name] = item.default if value is None else _frozen(value)
    config = kind(**values)
    if follow is not None:
        if node not in _FOLLOWED:
            _FOLLOWED[node] = []
            node.add_on_set_parameters_callback(partial(_take, _FOLLOWED[node]))
        _FOLLOWED[node].append(_Group(config, follow, check))
    return config


@dataclass
class _Group:
    """Settings of one class that a node follows."""

    config: Any
    follow: Callable[[Any], None]
    check: Check | None

    def renewed(self, parameters: Sequence[Parameter]) -> Any:
        """Return the settings with new values; the same where none of them is meant."""
        names = {item.name for item in fields(self.config)}
        changes = {p.name: _frozen(p.value) for p in parameters if p.name in names}
        return replace(self.config, **changes) if changes else self.config


_FOLLOWED: WeakKeyDictionary[Node, list[_Group]] = WeakKeyDictionary()


def _take(groups: Sequence[_Group], parameters: Sequence[Parameter]) -> SetParametersResult:
    """Refuse new values with the reason, or put all into force; rclpy asks nobody after this."""
    try:
        configs = [group.renewed(parameters) for group in groups]
        changed = [(g, new) for g, new in zip(groups, configs, strict=True) if new is not g.config]
        for check in {group.check for group, _ in changed if group.check is not None}:
            check({type(config): config for config in configs})
    except Exception as error:  # what is raised here ends the node
        return SetParametersResult(successful=False, reason=one_line(error))
    for group, config in changed:
        group.config = config
        group.follow(config)
    return SetParametersResult(successful=True)


def parameter_file(node: str, parameters: Mapping[str, Parameter]) -> str:
    """Return the parameters of a node, by its full name, that have a value as a parameter file."""
    values = {name: _frozen(one.value) for name, one in parameters.items()}
    given = {name: value for name, value in values.items() if value is not None}
    document = {node: {'ros__parameters': given}}
    return yaml.safe_dump(document, default_flow_style=None, width=99)


def refuse_unknown(node: Node) -> None:
    """Refuse a slip in the name of a parameter: ConfigError. What another node has is ignored."""
    for name in sorted(node._parameter_overrides):  # rclpy has no public list of them
        foreign = name.startswith(('qos_overrides.', _FORM))
        # The rig is described to all nodes, and each takes what it needs.
        if not node.has_parameter(name) and not foreign and name not in RIG:
            if near := _GONE.get(name) or meant(name, node._parameters):
                raise ConfigError(f'unknown parameter {name!r}, expected {near}')
            node.get_logger().warning(f'unknown parameter {name!r} is ignored')


def _frozen(value: Any) -> Any:
    """Turn the arrays of ROS into tuples."""
    array = hasattr(value, '__iter__') and not isinstance(value, str | bytes)
    return tuple(value) if array else value


def _descriptor(item: Field[Any], live: bool) -> ParameterDescriptor:
    """Return how tools show a setting: its text, unit and limits."""
    metadata = item.metadata
    unit = f' [{metadata["unit"]}]' if metadata.get('unit') else ''
    fixed = bool(metadata.get('fixed', False)) or not live
    choices = metadata.get('choices') or ()
    limits = [f'one of {", ".join(choices)}'] if choices else []
    low, high = metadata.get('low'), metadata.get('high')
    descriptor = ParameterDescriptor(
        description=metadata.get('description', '') + unit, read_only=fixed
    )
    # A range has two ends, and tools draw a slider from one to the other: one end alone is
    # said in words, and checked by the settings themselves.
    if low is None or high is None:
        limits += [f'at least {low:g}'] if low is not None else []
        limits += [f'at most {high:g}'] if high is not None else []
    elif isinstance(item.default, float):
        bounds = FloatingPointRange(from_value=float(low), to_value=float(high))
        descriptor.floating_point_range = [bounds]
    else:
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    descriptor.additional_constraints = '; '.join([*limits, *([_FIXED] if fixed else [])])
    return descriptor


def declare_normal_form(node: Node, rig_name: str = '') -> IdentifiedNormalForm | None:
    """
    Declare the parameters `normal_form.*` that were given, and read the normal form in them.

    Parameters
    ----------
    node : Node
        Started with a parameter file of `hunt identify --out`, or without one.
    rig_name : str
        Of the rig: a form of another one is refused; '': none is.

    Returns
    -------
    IdentifiedNormalForm or None
        None where no `normal_form.v_c` was given.

    Raises
    ------
    ConfigError
        Naming the value that is missing or impossible, or the other rig.
    """
    given = {}
    fixed = f'{_FIXED}; then by the topic hunting/normal_form'
    for full, override in node._parameter_overrides.items():  # rclpy has no public list of them
        if full.startswith(_FORM):
            name = full.removeprefix(_FORM)
            descriptor = ParameterDescriptor(
                description=f'Identified normal form: {name}.',
                additional_constraints=fixed,
                read_only=True,
            )
            node.declare_parameter(full, override.value, descriptor)
            given[name] = _frozen(override.value)
    if 'v_c' not in given:
        return None
    form = IdentifiedNormalForm.from_parameters(given, 'parameters normal_form')
    form.refuse_other(rig_name, 'parameters normal_form')
    return form
