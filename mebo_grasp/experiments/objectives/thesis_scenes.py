"""The thesis's grasp scenes (section 7.4): search boxes and occluded heights of its three objects.

The figures stand as in the thesis's scene, in millimetres and radians, the hand's TCP in the world's frame. Its
meshes are not at hand for all objects, so the scene is laid over an object by the centres of their bounding boxes.
What the methods return is in metres and radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import FloatArray

NUM_SOLUTIONS = 4
MIN_DISTANCE, ROTATION_WEIGHT = 0.04, 0.001
"""tau of a set of grasps and what a radian counts in it, metres: the thesis takes the Euclidean distance of two
candidates in its own numbers, 40, so that a radian is one millimetre (section 7.4)."""
MM = 0.001


@dataclass(frozen=True)
class ThesisScene:
    """What the thesis says of one object.

    Args:
        center: middle of the object's bounding box in the world, mm.
        position_lower, position_upper: box of x, y, z in the 3-D experiments, mm.
        pose_lower, pose_upper: box of x, y, z, roll, pitch, yaw in the 6-D experiments, mm and rad.
        small: heights of the TCP from which and up to which grasps are blocked by the small occlusion, mm.
        large: height from which on grasps are blocked by the large occlusion, mm.
        num_solutions: M, grasps wanted.
    """

    center: tuple[float, float, float]
    position_lower: tuple[float, ...]
    position_upper: tuple[float, ...]
    pose_lower: tuple[float, ...]
    pose_upper: tuple[float, ...]
    small: tuple[float, float]
    large: float
    num_solutions: int = NUM_SOLUTIONS

    def bounds(self, space: str, center: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper bounds in the frame of an object, metres and radians.

        Args:
            space: "position" or "pose".
            center: middle of the object's bounding box in its own frame, shape (3,), metres.
        """
        if space == "position":
            lower, upper = np.array(self.position_lower, float), np.array(self.position_upper, float)
        else:
            lower, upper = np.array(self.pose_lower, float), np.array(self.pose_upper, float)
        for values in (lower, upper):
            values[:3] = MM * (values[:3] - np.array(self.center)) + center
        return lower, upper

    def available(self, heights: FloatArray, center: FloatArray) -> dict[str, npt.NDArray[np.bool_]]:
        """Return which TCP heights the small and the large occlusion leave (section 7.4.3).

        Args:
            heights: z of the TCP in the object's frame, shape (n,), metres.
            center: as in ``bounds``.
        """
        z = (heights - center[2]) / MM + self.center[2]
        return {"small": (z < self.small[0]) | (z > self.small[1]), "large": z < self.large}


THESIS_SCENES = {
    "bottle": ThesisScene(
        (25.57, -46.0, -40.24),
        (-50, -20, -150), (3, 35, 34),
        (-35, -30, -150, -1.8, -0.4, -0.78), (15, 25, 65, -0.78, 0.4, 0.78),
        (-90, 30), -90,
    ),
    "vase": ThesisScene(
        (35.0, -20.0, 43.2),
        (-60, -5, -70), (20, 70, 170),
        (-13, -2, -65, -1.96, -0.1, -0.7), (30, 35, 100, -0.8, 0.1, 0.2),
        (-35, 65), -35,
    ),
    "drill": ThesisScene(
        (15.0, -60.0, 50.0),
        (-15, -6.5, -70), (15, 45, 70),
        (-25, -7, -70, -1.8, -0.1, -0.7), (25, 45, 95, -1.2, 0.1, 0.4),
        (-50, 50), -50, num_solutions=3,
    ),
}  # fmt: skip
"""By the thesis's name of the object. The drill's origin is lost with its mesh and taken for the centre."""
