"""ROS parameters declared from frozen dataclasses: name, default, description and range stand once.

A field made with :func:`parameter` becomes one read-only ROS parameter. What ROS itself cannot check
(choices, bounds that depend on one another) the dataclass checks in its ``__post_init__``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from mebo_grasp.errors import InvalidSettingsError

Settings = TypeVar("Settings")


def parameter(default: Any, description: str, *, least: float | None = None, most: float | None = None) -> Any:
    """Return a dataclass field that is declared as a ROS parameter.

    Args:
        default: the value when none is given; tuples become arrays.
        description: one line with the unit, shown by ``ros2 param describe``.
        least: smallest allowed number.
        most: largest allowed number.
    """
    metadata = {"description": description, "least": least, "most": most}
    return dataclasses.field(default=default, metadata=metadata)


def declare(node: Node, settings_type: type[Settings]) -> Settings:
    """Declare every field of a dataclass as a read-only parameter and return the values found.

    Raises:
        InvalidSettingsError: a value has the wrong type, is out of range, or the dataclass refuses it.
    """
    values: dict[str, Any] = {}
    for field in dataclasses.fields(settings_type):  # type: ignore[arg-type]
        values[field.name] = _declare_one(node, field)
    _warn_of_unknown(node, values)
    return settings_type(**values)


def _warn_of_unknown(node: Node, known: Iterable[str]) -> None:
    """Name the parameters that were given but that nobody reads: ROS itself drops a misspelt one silently."""
    given = getattr(node, "_parameter_overrides", {})
    ours = {*known, "use_sim_time", "start_type_description_service"}
    unknown = sorted(name for name in given if name not in ours and not name.startswith("qos_overrides."))
    if unknown:
        node.get_logger().warning(f"unknown parameters are ignored: {', '.join(unknown)}; known are {', '.join(known)}")


def _declare_one(node: Node, field: dataclasses.Field[Any]) -> Any:
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    try:
        if default == []:
            # rclpy cannot tell the type of an empty list: declared by type, "not given" means empty.
            kind = Parameter.Type.STRING_ARRAY if "str" in str(field.type) else Parameter.Type.DOUBLE_ARRAY
            value = node.declare_parameter(field.name, kind, _descriptor(field)).value
            value = [] if value is None else value
        else:
            value = node.declare_parameter(field.name, default, _descriptor(field)).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        whole = "; write whole numbers with a point, such as 1.0" if "expecting type 'DOUBLE" in str(error) else ""
        raise InvalidSettingsError(
            f"parameter '{field.name}' of node '{node.get_name()}': {error}{whole} "
            f"(default {field.default!r}: {field.metadata['description']})"
        ) from error
    if isinstance(field.default, tuple):
        if value is None:
            raise InvalidSettingsError(
                f"parameter '{field.name}' of node '{node.get_name()}' is empty (default {field.default!r}: "
                f"{field.metadata['description']})"
            )
        return tuple(value)
    _check_finite(node, field.name, value)
    return value


def _check_finite(node: Node, name: str, value: Any) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidSettingsError(
            f"parameter '{name}' of node '{node.get_name()}' must be a finite number, got {value}"
        )


def _descriptor(field: dataclasses.Field[Any]) -> ParameterDescriptor:
    least, most = field.metadata["least"], field.metadata["most"]
    descriptor = ParameterDescriptor(description=field.metadata["description"], read_only=True)
    if least is None and most is None:
        return descriptor
    if isinstance(field.default, int):
        upper = 2**62 if most is None else int(most)
        descriptor.integer_range = [IntegerRange(from_value=int(least or 0), to_value=upper, step=0)]
    else:
        upper_float = 1e300 if most is None else float(most)
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(least or 0.0), to_value=upper_float, step=0.0)
        ]
    return descriptor
