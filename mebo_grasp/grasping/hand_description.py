"""The YAML that goes with a hand's URDF: which link is the TCP, which chains close, how they are coupled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import Pose
from mebo_grasp.grasping.package_files import resolve

KNOWN_KEYS = {
    "name",
    "urdf",
    "tcp",
    "palm_links",
    "palm_normal",
    "grasp_center",
    "approach_axis",
    "preshape",
    "fingers",
    "motor_limits",
    "couplings",
    "synergies",
}
REQUIRED_KEYS = {"name", "urdf", "tcp", "palm_links", "palm_normal", "fingers"}


@dataclass(frozen=True)
class FingerDescription:
    """A chain of joints that closes together, from the palm outwards.

    Args:
        name: name of the finger.
        joints: joints that close, in order from the palm.
        speeds: relative closing speed of each joint; the sign is the closing direction.
    """

    name: str
    joints: tuple[str, ...]
    speeds: tuple[float, ...]


@dataclass(frozen=True)
class HandDescription:
    """What a URDF does not say about a hand; see docs/hands.md for the file format."""

    name: str
    urdf_path: Path
    tcp_link: str
    T_link_tcp: Pose
    palm_links: tuple[str, ...]
    palm_normal: tuple[float, float, float]
    grasp_center: tuple[float, float, float]
    approach_axis: tuple[float, float, float]
    fingers: tuple[FingerDescription, ...]
    preshape: Mapping[str, float] = field(default_factory=dict)
    motor_limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    couplings: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    synergies: Path | None = None


def read_description(path: Path) -> HandDescription:
    """Read and check a hand's YAML file.

    Raises:
        InvalidHandError: the file is unreadable, lacks a key, has an unknown one or a value of a wrong kind.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InvalidHandError(f"cannot read the hand description '{path}': {error}") from error
    if not isinstance(data, dict):
        raise InvalidHandError(f"'{path}' is no hand description: it must be a mapping of keys to values")
    _check_keys(data, path)
    try:
        return _description(data, path)
    except KeyError as error:
        raise InvalidHandError(f"hand description '{path}': an entry lacks its key {error}") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise InvalidHandError(f"hand description '{path}': {error}") from error


def _check_keys(data: dict[str, Any], path: Path) -> None:
    missing = sorted(REQUIRED_KEYS - set(data))
    if missing:
        raise InvalidHandError(f"hand description '{path}' lacks {', '.join(missing)}")
    unknown = sorted(str(key) for key in set(data) - KNOWN_KEYS)
    if unknown:
        raise InvalidHandError(
            f"hand description '{path}' has unknown keys {', '.join(unknown)}; "
            f"known are {', '.join(sorted(KNOWN_KEYS))}"
        )


def _description(data: dict[str, Any], path: Path) -> HandDescription:
    tcp = data["tcp"]
    normal = _unit(data["palm_normal"], "palm_normal")
    return HandDescription(
        name=str(data["name"]),
        urdf_path=resolve(str(data["urdf"]), path.parent, path),
        tcp_link=str(tcp["link"]),
        T_link_tcp=Pose.from_rpy(tcp.get("xyz", (0, 0, 0)), tcp.get("rpy", (0, 0, 0))),
        palm_links=_names(data["palm_links"], "palm_links"),
        palm_normal=normal,
        grasp_center=_vector(data.get("grasp_center", (0, 0, 0)), "grasp_center"),
        approach_axis=_unit(data.get("approach_axis", normal), "approach_axis"),
        fingers=_fingers(data["fingers"]),
        preshape={str(joint): _finite(value, joint) for joint, value in (data.get("preshape") or {}).items()},
        motor_limits={str(motor): _limits(limits, motor) for motor, limits in (data.get("motor_limits") or {}).items()},
        couplings={
            str(joint): {str(motor): _finite(value, motor) for motor, value in row.items()}
            for joint, row in (data.get("couplings") or {}).items()
        },
        synergies=resolve(str(data["synergies"]), path.parent, path) if data.get("synergies") else None,
    )


def _fingers(data: dict[str, Any]) -> tuple[FingerDescription, ...]:
    if not data:
        raise ValueError("no finger is described")
    fingers = []
    for name, entry in data.items():
        joints = _names(entry["joints"], f"joints of finger {name}")
        speeds = tuple(_finite(speed, name) for speed in entry.get("speeds", [1.0] * len(joints)))
        if not joints or len(joints) != len(speeds) or any(speed == 0.0 for speed in speeds):
            raise ValueError(f"finger '{name}' needs at least one joint and one non-zero speed a joint")
        fingers.append(FingerDescription(str(name), joints, speeds))
    return tuple(fingers)


def _names(values: Any, what: str) -> tuple[str, ...]:
    if not isinstance(values, list):  # of a text each character would be taken for a name
        raise ValueError(f"'{what}' must be a list of names in brackets, got {values!r}")
    return tuple(str(value) for value in values)


def _finite(value: Any, what: Any) -> float:
    number = float(value)
    if not np.isfinite(number):
        raise ValueError(f"'{what}' must be finite, got {value}")
    return number


def _limits(values: Any, motor: Any) -> tuple[float, float]:
    if len(values) != 2:
        raise ValueError(f"the limits of motor '{motor}' need two numbers, got {values}")
    lower, upper = _finite(values[0], motor), _finite(values[1], motor)
    if lower > upper:
        raise ValueError(f"motor '{motor}' has lower limit {lower} above upper limit {upper}")
    return lower, upper


def _vector(values: Any, what: str) -> tuple[float, float, float]:
    if len(values) != 3:
        raise ValueError(f"'{what}' needs three numbers, got {values}")
    return _finite(values[0], what), _finite(values[1], what), _finite(values[2], what)


def _unit(values: Any, what: str) -> tuple[float, float, float]:
    vector = np.array(_vector(values, what))
    norm = float(np.linalg.norm(vector))
    if norm < 1e-6:
        raise ValueError(f"'{what}' must not be zero")
    x, y, z = vector / norm
    return float(x), float(y), float(z)
