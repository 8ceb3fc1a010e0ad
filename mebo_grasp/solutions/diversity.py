"""How far apart two grasps are, and which grasps of many are good and mutually diverse.

Notation: n grasps with positions P, shape (n, 3), metres, and quaternions Q (xyzw), shape (n, 4); D is
the symmetric matrix of their mutual distances, shape (n, n); y their qualities, shape (n,). Two grasps
are diverse when their distance is at least the minimum distance tau (thesis, section 5.3.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse.csgraph import connected_components

from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import FloatArray, Pose
from mebo_grasp.solutions.pose_distance import distance_table, distances_to_many

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class PoseMetric:
    """Distance between poses: sqrt(|dp|^2 + (w * angle)^2), metres, angle geodesic in [0, pi].

    With a symmetry axis it is the least distance over all turns of one pose about the axis: a bottle that
    is turned about its axis is grasped in the same way.

    Args:
        rotation_weight: w, metres that one radian of rotation is worth; with 0.05 a quarter turn counts
            as 79 mm. 0 compares positions only.
        symmetry_axis: direction, in the object's frame, of the axis through its origin about which the
            object looks the same from all sides; it need not be of unit length. None for no symmetry.

    Raises:
        InvalidQueryError: the weight is negative or not finite, or the axis is not three finite numbers
            of which one is not 0.
    """

    rotation_weight: float = 0.05
    symmetry_axis: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if not math.isfinite(self.rotation_weight) or self.rotation_weight < 0.0:
            raise InvalidQueryError(f"rotation_weight must be finite and at least 0 m/rad, got {self.rotation_weight}")
        object.__setattr__(self, "rotation_weight", float(self.rotation_weight))
        if self.symmetry_axis is not None:
            axis = np.array(self.symmetry_axis, dtype=np.float64)
            length = float(np.linalg.norm(axis))
            if axis.shape != (3,) or not math.isfinite(length) or length == 0.0:
                raise InvalidQueryError(
                    f"symmetry_axis needs three finite numbers, not all 0; got {self.symmetry_axis}"
                )
            object.__setattr__(self, "symmetry_axis", tuple((axis / length).tolist()))

    @property
    def axis(self) -> FloatArray:
        """The symmetry axis as a unit vector, shape (3,), or zero for none."""
        return np.array(self.symmetry_axis or (0.0, 0.0, 0.0))

    def distance(self, a: Pose, b: Pose) -> float:
        """Return the distance between two poses, metres."""
        return float(self.to_many(a, b.position[None], b.quaternion_xyzw[None])[0])

    def to_many(self, pose: Pose, positions: FloatArray, quaternions: FloatArray) -> FloatArray:
        """Return the distances from one pose to n others, shape (n,), metres.

        Args:
            pose: where to measure from.
            positions: shape (n, 3), metres.
            quaternions: xyzw, unit norm, shape (n, 4).
        """
        distances: FloatArray = distances_to_many(
            np.array(pose.position),
            np.array(pose.quaternion_xyzw),
            _rows(positions),
            _rows(quaternions),
            self.rotation_weight,
            self.axis,
        )
        return distances

    def pairwise(self, positions: FloatArray, quaternions: FloatArray) -> FloatArray:
        """Return all mutual distances, shape (n, n), metres.

        Args:
            positions: shape (n, 3), metres.
            quaternions: xyzw, unit norm, shape (n, 4).
        """
        distances: FloatArray = distance_table(_rows(positions), _rows(quaternions), self.rotation_weight, self.axis)
        return distances


def _rows(values: FloatArray) -> FloatArray:
    # A writable copy in row order: the one form for which the compiled code is made.
    return np.array(values, dtype=np.float64, order="C")


def select_diverse(
    positions: FloatArray,
    quaternions: FloatArray,
    qualities: FloatArray,
    size: int,
    min_distance: float,
    metric: PoseMetric,
) -> IntArray:
    """Take the best grasp, then again and again the best that is diverse from all taken (greedy).

    Args:
        positions: shape (n, 3), metres.
        quaternions: xyzw, shape (n, 4).
        qualities: shape (n,); of equal ones the earlier row is taken first.
        size: how many at most.
        min_distance: tau, metres.
        metric: distance between poses.

    Returns:
        Row numbers, best first, shape (m,) with m <= size.
    """
    taken: list[int] = []
    is_open = np.ones(len(qualities), dtype=bool)
    for row in np.argsort(-qualities, kind="stable"):
        if len(taken) >= size:
            break
        if not is_open[row]:
            continue
        taken.append(int(row))
        if min_distance > 0.0:
            pose = Pose(positions[row], quaternions[row])
            is_open &= metric.to_many(pose, positions, quaternions) >= min_distance
    return np.array(taken, dtype=np.int64)


def mutually_diverse_count(distances: FloatArray, min_distance: float) -> int:
    """Return M_d, the number of diverse solutions in a set.

    Solutions closer than ``min_distance`` are one solution, and so are those linked by a chain of such
    neighbours: the rule by which the thesis merges what lacks diversity (section 5.3.1, figure 5.3)
    and counts its sets (section 7.4.2).

    Args:
        distances: D, shape (n, n).
        min_distance: tau, in the unit of D.
    """
    if len(distances) == 0:
        return 0
    count, _ = connected_components(np.asarray(distances) < min_distance, directed=False)
    return int(count)


def mean_min_distance(distances: FloatArray) -> float:
    """Return the mean over the set of the distance to the nearest other member; 0 for fewer than two.

    Args:
        distances: D, shape (n, n).
    """
    n = len(distances)
    if n < 2:
        return 0.0
    others = np.array(distances, dtype=np.float64)
    np.fill_diagonal(others, np.inf)
    return float(np.mean(np.min(others, axis=1)))


def qd_value(distances: FloatArray, qualities: FloatArray, min_distance: float) -> float:
    """Return QD(X) = M_d * mean of d_min * (lowest quality + mean quality) (thesis, section 5.3.2).

    The thesis leaves d_min undefined for a single solution; it is taken as 0 here, and so is QD then.

    Args:
        distances: D, shape (n, n).
        qualities: y, shape (n,).
        min_distance: tau of M_d, in the unit of D.
    """
    if len(qualities) == 0:
        return 0.0
    diverse = mutually_diverse_count(distances, min_distance)
    return float(diverse * mean_min_distance(distances) * (np.min(qualities) + np.mean(qualities)))
