"""The metrics of a grasp from its contacts; each is defined in docs/grasp_metrics.md."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasping import wrench_space
from mebo_grasp.grasping.contacts import Contacts
from mebo_grasp.grasping.metrics.contact_models import grasp_matrix, model_wrenches, singular_ratio
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class GraspMetrics:
    """What is measured on a grasp; all 0 where there is none."""

    quality: float = 0.0
    epsilon: float = 0.0
    volume: float = 0.0
    isotropy: float = 0.0
    force_closure: bool = False


def torque_length(target: TargetObject, settings: TrialSettings) -> float:
    """Return the metres by which torques are divided: by default half the longest side of the object's box."""
    return settings.torque_length or target.longest_side / 2.0


def wrenches_of(
    positions: FloatArray, normals: FloatArray, target: TargetObject, settings: TrialSettings
) -> FloatArray:
    """Return the wrenches that unit forces at the contacts give, contact by contact, shape (n k, 6)."""
    length = torque_length(target, settings)
    return model_wrenches(
        settings.contact_model,
        positions,
        normals,
        settings.friction,
        settings.cone_edges,
        target.center_of_mass,
        length,
        settings.torsion,
    )


def measure(contacts: Contacts, target: TargetObject, settings: TrialSettings) -> GraspMetrics:
    """Compute the metrics of a set of contacts on an object."""
    positions, normals = contacts.points, contacts.normals
    length = torque_length(target, settings)
    if settings.contact_model == "hard":
        wrenches, isotropy = wrench_space.hard_contacts(
            positions, normals, settings.friction, settings.cone_edges, target.center_of_mass, length
        )
    else:
        wrenches = wrenches_of(positions, normals, target, settings)
        isotropy = singular_ratio(
            grasp_matrix(settings.contact_model, positions, normals, target.center_of_mass, length)
        )
    epsilon = wrench_space.epsilon(wrenches)
    closed = wrench_space.force_closure(epsilon)
    wanted = settings.quality == "volume" or (settings.compute_volume and closed)
    volume = wrench_space.volume(wrenches) if wanted else 0.0
    values = {
        "epsilon": epsilon,
        "volume": volume,
        "isotropy": isotropy,
        "force_closure_epsilon": epsilon if closed else 0.0,
    }
    # Metrics that need more than the contacts are put in by ``metrics.chosen``.
    return GraspMetrics(values.get(settings.quality, 0.0), epsilon, volume, isotropy, closed)
