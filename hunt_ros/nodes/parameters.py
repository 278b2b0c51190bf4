"""ROS parameters from a `Settings` dataclass: declared with range and description."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from hunt_ros.dynamics.identified import PARAMETERS, SCALES, IdentifiedNormalForm
from hunt_ros.dynamics.mode_shape import KEYS as MODE_SHAPE
from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.errors import ConfigError
from hunt_ros.settings import Settings

_Config = TypeVar('_Config', bound=Settings)

_UNBOUNDED = 1e300


def declare(node: Node, kind: type[_Config], **defaults: Any) -> _Config:
    """
    Declare one parameter for each field of a settings class, and read them.

    Parameters
    ----------
    node : Node
        Gets the parameters, named as the fields.
    kind : type of Settings
        The settings class.
    **defaults
        Defaults of this node that differ from those of the class.

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
        default = defaults.get(item.name, item.default)
        if default is MISSING:
            raise TypeError(f'{kind.__name__}.{item.name} has no default')
        descriptor = _descriptor(item.metadata, default)
        given = list(default) if isinstance(default, tuple) else default
        values[item.name] = node.declare_parameter(item.name, given, descriptor).value
    return kind(**{name: _frozen(value) for name, value in values.items()})


def on_change(node: Node, current: _Config, apply: Callable[[_Config], None]) -> None:
    """
    Let a running node take new values: checked as at the start, refused with the reason.

    Parameters
    ----------
    node : Node
        With parameters declared from `current`.
    current : Settings
        The values in force now.
    apply : callable
        Gets the new settings once all are valid.
    """
    names = {item.name for item in fields(current)}
    state = [current]

    def change(parameters: Sequence[Parameter]) -> SetParametersResult:
        changes = {p.name: _frozen(p.value) for p in parameters if p.name in names}
        if changes:
            try:
                state[0] = replace(state[0], **changes)
                apply(state[0])
            except ConfigError as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(change)


def warn_unknown(node: Node, also: Sequence[str] = ()) -> None:
    """Name every parameter that was given to the node but means nothing to it."""
    for name in sorted(node._parameter_overrides):  # rclpy has no public list of them
        foreign = name.startswith(('qos_overrides.', 'normal_form.', *also))
        if not node.has_parameter(name) and not foreign:
            node.get_logger().warning(f'unknown parameter {name!r} is ignored')


def read_rig(path: str) -> RigParameters:
    """
    Read the rig that a parameter names; an empty name is the built-in rig.

    Raises
    ------
    ConfigError
        If the file cannot be read or is no rig.
    """
    if not path:
        return paper_rig()
    try:
        text = Path(path).read_text(encoding='utf-8')
    except OSError as error:
        raise ConfigError(f'rig {path!r}: cannot read it ({error.strerror})') from error
    return RigParameters.from_yaml(text, path)


def _frozen(value: Any) -> Any:
    """Turn the arrays of ROS into tuples."""
    return (
        tuple(value)
        if not isinstance(value, str | bytes) and hasattr(value, '__iter__')
        else value
    )


def _descriptor(metadata: Any, default: Any) -> ParameterDescriptor:
    unit = f' [{metadata["unit"]}]' if metadata.get('unit') else ''
    choices = metadata.get('choices') or ()
    descriptor = ParameterDescriptor(
        description=metadata.get('description', '') + unit,
        additional_constraints=f'one of {", ".join(choices)}' if choices else '',
        read_only=bool(metadata.get('fixed', False)),
    )
    low, high = metadata.get('low'), metadata.get('high')
    if low is None and high is None:
        return descriptor
    if isinstance(default, float):
        bounds = FloatingPointRange(
            from_value=-_UNBOUNDED if low is None else float(low),
            to_value=_UNBOUNDED if high is None else float(high),
        )
        descriptor.floating_point_range = [bounds]
    elif isinstance(default, int) and not isinstance(default, bool):
        most = 2**62
        bounds = IntegerRange(
            from_value=-most if low is None else int(low),
            to_value=most if high is None else int(high),
            step=1,
        )
        descriptor.integer_range = [bounds]
    return descriptor


def declare_normal_form(node: Node) -> IdentifiedNormalForm | None:
    """
    Declare the parameters `normal_form.*`, and read the normal form given in them.

    Parameters
    ----------
    node : Node
        Started with a parameter file of `hunt identify --out`, or without one.

    Returns
    -------
    IdentifiedNormalForm or None
        None where no `normal_form.v_c` was given.

    Raises
    ------
    ConfigError
        Naming the value that is missing or impossible.
    """
    given: dict[str, Any] = {}
    kinds = dict.fromkeys((*PARAMETERS, *SCALES), Parameter.Type.DOUBLE)
    kinds['covariance'] = Parameter.Type.DOUBLE_ARRAY
    kinds |= dict.fromkeys(MODE_SHAPE, Parameter.Type.DOUBLE_ARRAY)
    kinds['provenance'] = Parameter.Type.STRING_ARRAY
    for name, kind in kinds.items():
        full = f'normal_form.{name}'
        descriptor = ParameterDescriptor(description=f'Identified normal form: {name}.')
        node.declare_parameter(full, kind, descriptor)
        value = node.get_parameter_or(full).value
        if value is not None:
            given[name] = _frozen(value)
    if 'v_c' not in given:
        return None
    return IdentifiedNormalForm.from_parameters(given, 'parameters normal_form')
