"""Answers to trials: ``GraspQuality``, its contacts and its posture."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from mebo_grasp_interfaces.msg import GraspContact as GraspContactMsg
from mebo_grasp_interfaces.msg import GraspQuality
from sensor_msgs.msg import JointState

from mebo_grasp.errors import InvalidMessageError
from mebo_grasp.grasp import (
    Grasp,
    GraspContact,
    GraspOutcome,
    HandPosture,
    QualityUnderNoise,
    StampedGrasp,
)
from msg_adapters.checks import require_finite, require_frame
from msg_adapters.pose import (
    from_point_msg,
    from_pose_msg,
    to_pose_msg,
    write_point,
)
from msg_adapters.time import from_duration_msg, from_time_msg, to_duration_msg, to_time_msg

ROUNDING = 1e-9
NORMAL_TOLERANCE = 1e-3
"""Largest deviation of a contact normal from unit length that is taken for rounding and mended."""


def to_grasp_quality_msg(stamped: StampedGrasp, frame_id: str) -> GraspQuality:
    """Return the message of an answered trial.

    Args:
        stamped: the grasp and the stamp of its candidate.
        frame_id: the object's frame.

    Raises:
        InvalidMessageError: the stamp or the computation time does not fit into a message.
    """
    grasp = stamped.grasp
    message = GraspQuality(
        tcp_pose=to_pose_msg(grasp.T_object_tcp),
        outcome=int(grasp.outcome),
        quality=float(grasp.quality),
        epsilon=float(grasp.epsilon),
        volume=float(grasp.volume),
        isotropy=float(grasp.isotropy),
        force_closure=bool(grasp.force_closure),
        contacts=[to_grasp_contact_msg(contact) for contact in grasp.contacts],
        hand_posture=to_joint_state_msg(grasp.hand_posture, stamped.stamp_ns),
        object_id=grasp.object_id,
        hand=grasp.hand,
        computation_time=to_duration_msg(grasp.computation_time),
        message=grasp.message,
    )
    _write_under_noise(message, grasp.under_noise)
    message.header.stamp = to_time_msg(stamped.stamp_ns)
    message.header.frame_id = frame_id
    return message


def from_grasp_quality_msg(message: GraspQuality, expected_frame: str) -> StampedGrasp:
    """Return the answered trial of a message.

    Args:
        message: as a hand sent it.
        expected_frame: the object's frame.

    Raises:
        WrongFrameError: the message is given in another frame.
        InvalidPoseError: a pose, contact or joint holds a number that is not usable.
        InvalidMessageError: the stamp or the outcome is unknown, or a number is not finite although the
            outcome says that there is a value.
        InvalidQualityError: the figures under noise are not usable although there are samples.
    """
    require_frame(message.header.frame_id, expected_frame, "a grasp quality")
    outcome = _outcome(message.outcome)
    numbers = {
        name: _number(getattr(message, name), name, outcome) for name in ("quality", "epsilon", "volume", "isotropy")
    }
    if outcome is GraspOutcome.FAILED and not math.isnan(numbers["quality"]):
        raise InvalidMessageError(f"outcome FAILED has no value, but quality is {numbers['quality']}; it must be NaN")
    grasp = Grasp(
        T_object_tcp=from_pose_msg(message.tcp_pose),
        outcome=outcome,
        force_closure=bool(message.force_closure),
        contacts=tuple(from_grasp_contact_msg(contact) for contact in message.contacts),
        hand_posture=from_joint_state_msg(message.hand_posture),
        object_id=message.object_id,
        hand=message.hand,
        computation_time=from_duration_msg(message.computation_time),
        message=message.message,
        under_noise=_under_noise(message),
        **numbers,
    )
    return StampedGrasp(from_time_msg(message.header.stamp), grasp)


def _outcome(value: int) -> GraspOutcome:
    try:
        return GraspOutcome(value)
    except ValueError as error:
        known = ", ".join(f"{outcome.name}={outcome.value}" for outcome in GraspOutcome)
        raise InvalidMessageError(f"outcome {value} is unknown; known are {known}") from error


def _number(value: float, name: str, outcome: GraspOutcome) -> float:
    if outcome is GraspOutcome.FAILED and math.isnan(value):
        return math.nan
    return require_finite(value, f"{name} of a trial with outcome {outcome.name}")


def _write_under_noise(message: GraspQuality, known: QualityUnderNoise | None) -> None:
    if known is None:
        message.expected_quality = message.quality_sd = message.worst_quality = math.nan
        return
    message.expected_quality, message.quality_sd = float(known.expected), float(known.sd)
    message.worst_quality, message.noise_samples = float(known.worst), int(known.samples)


def _under_noise(message: Any) -> QualityUnderNoise | None:
    # Recordings of older versions lack the fields; a hand that knows nothing of them leaves them 0.
    samples = int(getattr(message, "noise_samples", 0))
    if samples == 0:
        return None
    return QualityUnderNoise(
        float(message.expected_quality), float(message.quality_sd), float(message.worst_quality), samples
    )


def to_grasp_contact_msg(contact: GraspContact) -> GraspContactMsg:
    """Return the message of a contact."""
    message = GraspContactMsg()
    message.link = contact.link
    write_point(message.position, contact.position)
    write_point(message.normal, contact.normal)
    return message


def from_grasp_contact_msg(message: GraspContactMsg) -> GraspContact:
    """Return the contact of a message.

    Raises:
        InvalidPoseError: a number is not finite or the normal is not of unit length.
    """
    normal = from_point_msg(message.normal)
    length = float(np.linalg.norm(normal))
    if ROUNDING < abs(length - 1.0) <= NORMAL_TOLERANCE:
        normal = normal / length
    return GraspContact(message.link, from_point_msg(message.position), normal)


def to_joint_state_msg(posture: HandPosture, stamp_ns: int, frame_id: str = "") -> JointState:
    """Return the message of a posture.

    Args:
        posture: joint values, radians.
        stamp_ns: nanoseconds since the epoch.
        frame_id: usually empty, joints have no frame.

    Raises:
        InvalidMessageError: the stamp does not fit into a message.
    """
    message = JointState(name=list(posture.names), position=[float(value) for value in posture.positions])
    message.header.stamp = to_time_msg(stamp_ns)
    message.header.frame_id = frame_id
    return message


def from_joint_state_msg(message: Any) -> HandPosture:
    """Return the posture of a ``sensor_msgs/JointState``; velocities and efforts are left out.

    Raises:
        InvalidPoseError: names and positions differ in number or a position is not finite.
    """
    return HandPosture(tuple(message.name), tuple(float(value) for value in message.position))
