"""The set of good and mutually diverse grasps that is kept for one object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.diversity import (
    PoseMetric,
    mean_min_distance,
    mutually_diverse_count,
    qd_value,
)


@dataclass(frozen=True)
class SolutionSet:
    """Mutually diverse grasps, best first, with the figures by which the thesis judges a set.

    Args:
        object_id: name of the target object.
        grasps: best first.
        diverse: M_d, number of mutually diverse grasps (thesis, section 7.4.2).
        mean_min_distance: mean distance to the nearest other grasp of the set, metres.
        mean_quality: mean quality of the set; 0 for an empty set.
        qd: quality-diversity value (thesis, section 5.3.2).
    """

    object_id: str
    grasps: tuple[StampedGrasp, ...]
    diverse: int
    mean_min_distance: float
    mean_quality: float
    qd: float

    @classmethod
    def of(
        cls,
        object_id: str,
        grasps: tuple[StampedGrasp, ...],
        min_distance: float,
        metric: PoseMetric,
    ) -> SolutionSet:
        """Measure a set of grasps.

        Args:
            object_id: name of the target object.
            grasps: members of the set, best first.
            min_distance: tau of M_d, metres.
            metric: distance between poses.
        """
        if not grasps:
            return cls(object_id, (), 0, 0.0, 0.0, 0.0)
        poses = [stamped.grasp.T_object_tcp for stamped in grasps]
        distances = metric.pairwise(
            np.array([pose.position for pose in poses]),
            np.array([pose.quaternion_xyzw for pose in poses]),
        )
        qualities = np.array([stamped.grasp.quality for stamped in grasps])
        return cls(
            object_id,
            grasps,
            mutually_diverse_count(distances, min_distance),
            mean_min_distance(distances),
            float(np.mean(qualities)),
            qd_value(distances, qualities, min_distance),
        )
