"""The metrics of a grasp from its contacts; each is defined in docs/grasp_metrics.md."""

from __future__ import annotations

from dataclasses import dataclass

from mebo_grasp.grasping import wrench_space
from mebo_grasp.grasping.contacts import Contacts
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings


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


def measure(
    contacts: Contacts, target: TargetObject, settings: TrialSettings
) -> GraspMetrics:
    """Compute the metrics of a set of contacts on an object."""
    positions, normals = contacts.points, contacts.normals
    length = torque_length(target, settings)
    wrenches = wrench_space.contact_wrenches(
        positions, normals, settings.friction, settings.cone_edges, target.center_of_mass, length
    )
    epsilon = wrench_space.epsilon(wrenches)
    closed = wrench_space.force_closure(epsilon)
    wanted = settings.quality == "volume" or (settings.compute_volume and closed)
    volume = wrench_space.volume(wrenches) if wanted else 0.0
    isotropy = wrench_space.isotropy(positions, normals, target.center_of_mass, length)
    values = {
        "epsilon": epsilon,
        "volume": volume,
        "isotropy": isotropy,
        "force_closure_epsilon": epsilon if closed else 0.0,
    }
    return GraspMetrics(values[settings.quality], epsilon, volume, isotropy, closed)
