"""All objectives by name: those of this package and those that others add by an entry point."""

from __future__ import annotations

import dataclasses
import re
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, get_type_hints

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.objective import Objective
from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.objectives.grasp import GraspObjective
from mebo_grasp.experiments.objectives.noisy import NoisyFunction, NoisyGrasp

ENTRY_POINT_GROUP = "mebo_grasp.objectives"
RESERVED = frozenset({"name", "method", "seed", "budget", "n_initial", "batch_size"})
"""Names that a setting of an objective cannot have: a run's own."""
_LABEL = r"[\w.~-]+(/[\w.~-]+)*"
_BUILTIN: dict[str, type[Objective]] = {
    "cec2013": Cec2013, "grasp": GraspObjective, "noisy_function": NoisyFunction, "noisy_grasp": NoisyGrasp,
}  # fmt: skip


def objective_names() -> tuple[str, ...]:
    """Names of all objectives that are installed."""
    return (*_BUILTIN, *sorted(point.name for point in entry_points(group=ENTRY_POINT_GROUP)))


def objective_type(name: str) -> type[Objective]:
    """Return the class of an objective.

    Args:
        name: a built-in one, the name of an entry point, or ``package.module:Class``.

    Raises:
        InvalidSettingsError: there is none of this name, it cannot be loaded, or it is no objective.
    """
    if name in _BUILTIN:
        return _BUILTIN[name]
    try:
        found = _load(name)
    except (ImportError, AttributeError) as error:
        raise InvalidSettingsError(f"the objective {name!r} cannot be loaded: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Objective) and dataclasses.is_dataclass(found)):
        raise InvalidSettingsError(
            f"the objective {name!r} is {found!r}; it must be a frozen dataclass derived from "
            "mebo_grasp.experiments.objective.Objective"
        )
    return found


def _load(name: str) -> Any:
    for point in entry_points(group=ENTRY_POINT_GROUP):
        if point.name == name:
            return point.load()
    module, colon, attribute = name.partition(":")
    if not colon:
        raise InvalidSettingsError(
            f"objective must be one of {', '.join(objective_names())} or package.module:Class, got {name!r}"
        )
    return getattr(import_module(module), attribute)


def setting_names(name: str) -> tuple[str, ...]:
    """Names of an objective's settings.

    Raises:
        InvalidSettingsError: there is none of this name.
    """
    return tuple(item.name for item in dataclasses.fields(objective_type(name)))


def make_objective(name: str, settings: dict[str, Any]) -> Objective:
    """Build an objective from its settings.

    Raises:
        InvalidSettingsError: a setting is unknown, missing, of the wrong type or out of range.
    """
    kind = objective_type(name)
    known = {item.name: item for item in dataclasses.fields(kind)}
    taken = RESERVED & known.keys()
    if taken:
        raise InvalidSettingsError(
            f"the objective {name} has a setting {', '.join(sorted(taken))}, which names a part of a run; rename it"
        )
    for key in settings:
        if key not in known:
            raise InvalidSettingsError(f"the objective {name} has no setting {key!r}; it has {', '.join(known)}")
    required = [
        key
        for key, item in known.items()
        if item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING
    ]
    for key in required:
        if key not in settings:
            raise InvalidSettingsError(f"the objective {name} needs {key}")
    hints = get_type_hints(kind)
    objective = kind(**{key: _typed(name, key, value, hints[key]) for key, value in settings.items()})
    objective.check()
    _check_label(name, objective.label)
    return objective


def _check_label(name: str, label: str) -> None:
    if not re.fullmatch(_LABEL, label) or ".." in label:
        raise InvalidSettingsError(
            f"the label of the objective {name} must be made of letters, digits and ._~- with / between folders, "
            f"got {label!r}"
        )


def _typed(name: str, key: str, value: Any, hint: Any) -> Any:
    """Check a plain value against a plain type; other types are the objective's own matter."""
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if hint in (bool, int, float, str) and type(value) is not hint:
        raise InvalidSettingsError(f"{key} of the objective {name} must be of type {hint.__name__}, got {value!r}")
    return value
