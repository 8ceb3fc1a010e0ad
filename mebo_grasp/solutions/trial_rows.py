"""A trial as rows of the tables ``trial`` and ``trial_detail``, and back. NaN is NULL, as SQLite keeps it."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from mebo_grasp.grasp import (
    Grasp,
    GraspContact,
    GraspOutcome,
    HandPosture,
    Pose,
    QualityUnderNoise,
    StampedGrasp,
)

TRIAL_COLUMNS = (
    "stamp_ns, outcome, quality, px, py, pz, qx, qy, qz, qw, epsilon, volume, isotropy, force_closure, "
    "expected_quality, quality_sd, worst_quality, noise_samples"
)
"""As ``trial_values`` gives them."""
DETAIL_COLUMNS = "hand, computation_time, message, joint_names, joint_positions, contact_links, contact_vectors"
"""As ``detail_values`` gives them."""
SELECT_WHOLE = (
    f"SELECT trial.{TRIAL_COLUMNS.replace(', ', ', trial.')}, {DETAIL_COLUMNS} FROM trial "
    "JOIN trial_detail ON trial_detail.object = trial.object "
    "AND trial_detail.stamp_ns = trial.stamp_ns WHERE trial.object = ?"
)
"""Rows as ``to_stamped_grasp`` takes them."""


def trial_values(stamped: StampedGrasp) -> tuple[float | int | None, ...]:
    """Return what ``trial`` holds of a trial."""
    grasp = stamped.grasp
    pose = grasp.T_object_tcp
    return (
        stamped.stamp_ns,
        int(grasp.outcome),
        grasp.quality,
        *map(float, pose.position),
        *map(float, pose.quaternion_xyzw),
        grasp.epsilon,
        grasp.volume,
        grasp.isotropy,
        int(grasp.force_closure),
        *_under_noise_values(grasp.under_noise),
    )


def _under_noise_values(known: QualityUnderNoise | None) -> tuple[float | int | None, ...]:
    return (None,) * 4 if known is None else (known.expected, known.sd, known.worst, known.samples)


def detail_values(grasp: Grasp) -> tuple[float | str | bytes, ...]:
    """Return what ``trial_detail`` holds of a trial."""
    vectors = np.array([[contact.position, contact.normal] for contact in grasp.contacts], dtype="<f8")
    return (
        grasp.hand,
        grasp.computation_time,
        grasp.message,
        json.dumps(grasp.hand_posture.names),
        np.array(grasp.hand_posture.positions, dtype="<f8").tobytes(),
        json.dumps([contact.link for contact in grasp.contacts]),
        vectors.tobytes(),
    )


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else float(value)


def to_stamped_grasp(row: tuple[Any, ...], object_id: str) -> StampedGrasp:
    """Return the trial of a row.

    Raises:
        ValueError: a value cannot be what it stands for (``TypeError`` for one of another kind).
    """
    (stamp_ns, outcome, quality, px, py, pz, qx, qy, qz, qw, epsilon, volume, isotropy, closure,
     expected, sd, worst, samples, hand, seconds, message, names, positions, links, vectors) = row  # fmt: skip
    contact_vectors = np.frombuffer(vectors, dtype="<f8").reshape(-1, 2, 3)
    contacts = tuple(
        GraspContact(link, position, normal)
        for link, (position, normal) in zip(json.loads(str(links)), contact_vectors, strict=True)
    )
    joint_positions = np.frombuffer(positions, dtype="<f8").tolist()
    grasp = Grasp(
        T_object_tcp=Pose(np.array([px, py, pz]), np.array([qx, qy, qz, qw])),
        outcome=GraspOutcome(outcome),
        quality=_or_nan(quality),
        epsilon=_or_nan(epsilon),
        volume=_or_nan(volume),
        isotropy=_or_nan(isotropy),
        force_closure=bool(closure),
        contacts=contacts,
        hand_posture=HandPosture(tuple(json.loads(str(names))), tuple(joint_positions)),
        object_id=object_id,
        hand=str(hand),
        computation_time=_or_nan(seconds),
        message=str(message),
        under_noise=None if samples is None else QualityUnderNoise(expected, sd, worst, samples),
    )
    return StampedGrasp(int(stamp_ns), grasp)
