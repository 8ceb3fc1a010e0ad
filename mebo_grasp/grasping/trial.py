"""The settings of a trial: contact model, closing rule and the metric that is optimized."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from mebo_grasp.errors import InvalidSettingsError

ContactModel = Literal["hard", "frictionless", "soft"]
QualityName = Literal[
    "epsilon",
    "volume",
    "isotropy",
    "force_closure_epsilon",
    "epsilon_linf",
    "uniformity",
    "penalized_epsilon",
    "simox_epsilon",
    "simox_volume",
]
EngineName = Literal["bullet", "fast"]
ContactRule = Literal["touching", "pressing"]

ENGINE_NAMES: tuple[str, ...] = get_args(EngineName)
CONTACT_MODELS: tuple[str, ...] = get_args(ContactModel)
QUALITY_NAMES: tuple[str, ...] = get_args(QualityName)


@dataclass(frozen=True)
class TrialSettings:
    """How a trial is executed and measured.

    Args:
        friction: coefficient of friction.
        cone_edges: edges of the pyramid that stands for a friction cone.
        contact_model: what a contact transmits: a push with friction ("hard"), without ("frictionless"), or with
            friction and torque about the normal ("soft").
        torsion: largest torque about the normal of a soft contact over its normal force, metres; 2 mm is two thirds of
            the default friction times a patch of 6 mm radius.
        quality: metric reported as the quality.
        penalty_rate: lambda of the collision penalty, in "penalized_epsilon".
        engine: "bullet": gaps from PyBullet (reference); "fast": compiled, links as capsules and boxes.
        step: largest step of a joint while closing, radians; contact is then found by root search.
        gap_tolerance: gap at which a link touches, metres.
        contact_rule: "touching": links within ``gap_tolerance`` of the object give contacts; "pressing": also
            links that one more step of a joint would bring into it, as in Simox.
        palm_contacts: whether the palm and other still links give contacts where they touch.
        palm_distance: distance within which a still link touches, metres.
        whole_finger: whether a touching link stops its whole finger.
        compute_volume: whether the volume of the wrench space is computed for grasps in force closure
            (it costs more than all the rest of a trial).
        torque_length: metres by which torques are divided; None: half the object's longest side.

    Raises:
        InvalidSettingsError: a value is out of its range.
    """

    friction: float = 0.5
    cone_edges: int = 8
    contact_model: ContactModel = "hard"
    torsion: float = 0.002
    quality: QualityName = "epsilon"
    penalty_rate: float = 0.1
    engine: EngineName = "bullet"
    step: float = 0.02
    gap_tolerance: float = 5e-5
    contact_rule: ContactRule = "touching"
    palm_contacts: bool = False
    palm_distance: float = 1e-3
    whole_finger: bool = False
    compute_volume: bool = True
    torque_length: float | None = None

    def __post_init__(self) -> None:
        _in_range("friction", self.friction, 0.0, 10.0)
        _in_range("cone_edges", self.cone_edges, 3, 64)
        _in_range("torsion", self.torsion, 0.0, 0.1)
        _in_range("penalty_rate", self.penalty_rate, 1e-6, 100.0)
        if self.contact_model not in CONTACT_MODELS:
            raise InvalidSettingsError(
                f"contact_model '{self.contact_model}' is unknown; use one of {', '.join(CONTACT_MODELS)}"
            )
        _in_range("step", self.step, 1e-3, 0.5)
        _in_range("gap_tolerance", self.gap_tolerance, 1e-6, 1e-3)
        _in_range("palm_distance", self.palm_distance, 0.0, 0.02)
        if self.torque_length is not None:
            _in_range("torque_length", self.torque_length, 1e-4, 10.0)
        if self.quality not in QUALITY_NAMES:
            raise InvalidSettingsError(f"quality '{self.quality}' is unknown; use one of {', '.join(QUALITY_NAMES)}")
        if self.engine not in ENGINE_NAMES:
            raise InvalidSettingsError(f"engine '{self.engine}' must be 'bullet' or 'fast'")
        if self.contact_rule not in ("touching", "pressing"):
            raise InvalidSettingsError(f"contact_rule '{self.contact_rule}' must be 'touching' or 'pressing'")


def _in_range(name: str, value: float, lower: float, upper: float) -> None:
    if not (np.isfinite(value) and lower <= value <= upper):
        raise InvalidSettingsError(f"{name} is {value}; it must lie between {lower} and {upper}")
