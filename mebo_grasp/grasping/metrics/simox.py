"""``simox_epsilon`` and ``simox_volume``: what Simox computes, in whose unit the thesis's tables are.

Differences from the textbook: friction edges stand at 45 degrees whatever the friction; torques are taken about the
mean of all triangle corners; the ball is centred at the mean of all wrenches instead of the origin; and both
figures are divided by those of the object wrench space, the hull of the pyramids of up to 300 of its faces, each at
the face's centroid. The ball can be positive without force closure. Torques have the sign of p x f here, the other
one there, which mirrors the hull and changes neither figure.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from mebo_grasp.errors import InvalidObjectError
from mebo_grasp.grasping.hull_volume import hull_volume
from mebo_grasp.grasping.origin_distance import origin_distance
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.wrench_space import contact_wrenches

FloatArray = npt.NDArray[np.float64]

EDGES = 8
FRICTION = 1.0
"""The coefficient whose cone has the half angle of 45 degrees."""
MOST_FACES = 300
FLATTEST = 1e-9
"""A ball or a volume below this is rounding."""


@dataclass(frozen=True, eq=False)
class ObjectWrenchSpace:
    """The hull of the wrenches of an object's whole surface, whose figures are the unit of a grasp's.

    Args:
        object_id: name of the object.
        wrenches: pyramid edges at the chosen faces, shape (n, 6).
    """

    object_id: str
    wrenches: FloatArray

    @cached_property
    def ball(self) -> float:
        """Radius of the largest ball about the mean of all wrenches.

        Raises:
            InvalidObjectError: the hull is flat: the faces do not surround anything.
        """
        return self._positive(ball_about_mean(self.wrenches))

    @cached_property
    def volume(self) -> float:
        """Six-dimensional volume; it takes seconds.

        Raises:
            InvalidObjectError: see ``ball``.
        """
        # Faces in one plane give wrenches in one plane; Qhull then needs them moved apart a little, as Simox does.
        return self._positive(hull_volume(self.wrenches) or _joggled_volume(self.wrenches))

    def _positive(self, value: float) -> float:
        if value > FLATTEST:
            return value
        raise InvalidObjectError(
            f"the faces of '{self.object_id}' span no wrench space, so Simox's figures have no unit; use epsilon"
        )


def _joggled_volume(points: FloatArray) -> float:
    try:
        return float(ConvexHull(points, qhull_options="QJ").volume)
    except (QhullError, ValueError):
        return 0.0


def simox_wrenches(positions: npt.ArrayLike, normals: npt.ArrayLike, target: TargetObject) -> FloatArray:
    """Return the wrenches of contacts with Simox's pyramids, centre and torque scale, shape (8 n, 6).

    Args:
        positions: contact points, shape (n, 3), metres, object frame.
        normals: unit normals into the object, shape (n, 3).
        target: the object.
    """
    return contact_wrenches(positions, normals, FRICTION, EDGES, target.corner_mean, target.longest_side / 2.0)


def ball_about_mean(wrenches: FloatArray) -> float:
    """Return the radius of the largest ball about the mean of all wrenches within their hull; 0 if it is flat."""
    return 0.0 if len(wrenches) < 7 else origin_distance(wrenches - wrenches.mean(axis=0))


def object_wrench_space(target: TargetObject, rng: np.random.Generator) -> ObjectWrenchSpace:
    """Return the pyramids at the centroids of randomly chosen faces.

    Args:
        target: the object.
        rng: chooses up to ``MOST_FACES`` faces without repetition, whatever their areas.
    """
    mesh = target.mesh
    faces = np.arange(len(mesh.faces))
    if len(faces) > MOST_FACES:
        faces = np.sort(rng.choice(faces, MOST_FACES, replace=False))
    inward = -np.asarray(mesh.face_normals)[faces]
    wrenches = simox_wrenches(np.asarray(mesh.triangles_center)[faces], inward, target)
    return ObjectWrenchSpace(target.object_id, wrenches)


def simox_epsilon(wrenches: FloatArray, unit: ObjectWrenchSpace) -> float:
    """Return the ball about the wrenches' mean over that of the object; 0 if the hull is flat."""
    return ball_about_mean(wrenches) / unit.ball


def simox_volume(wrenches: FloatArray, unit: ObjectWrenchSpace) -> float:
    """Return the hull's volume over that of the object."""
    return 0.0 if len(wrenches) < 7 else hull_volume(wrenches) / unit.volume
