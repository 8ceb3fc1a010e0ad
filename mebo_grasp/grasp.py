"""The value types that every room of the package shares: pose, contact, posture and grasp.

Units are SI: metres, radians, seconds. Quaternions are ordered x, y, z, w (REP-103 and ROS).
A frame pair stands in the name: ``T_object_tcp`` maps coordinates in the TCP frame to the object's.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from mebo_grasp.errors import InvalidPoseError, InvalidQualityError

FloatArray = npt.NDArray[np.float64]

QUATERNION_NORM_TOLERANCE = 1e-3
"""Largest deviation from unit norm that is taken for rounding and mended; beyond it a pose is refused."""


def _read_only(values: npt.ArrayLike, shape: tuple[int, ...], what: str) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    if array.shape != shape:
        raise InvalidPoseError(f"{what} must have shape {shape}, got {array.shape}")
    # For so few numbers faster than numpy, and it is done for each contact of each grasp.
    if not all(map(math.isfinite, array.ravel().tolist())):
        raise InvalidPoseError(f"{what} must be finite, got {array.tolist()}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform from a child frame to its parent.

    Args:
        position: origin of the child frame, shape (3,), metres.
        quaternion_xyzw: rotation of the child frame, shape (4,), unit norm.

    Raises:
        InvalidPoseError: a value is not finite, or the quaternion's norm differs from 1 by more than
            ``QUATERNION_NORM_TOLERANCE``.
    """

    position: FloatArray
    quaternion_xyzw: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))

    def __post_init__(self) -> None:
        quaternion = _read_only(self.quaternion_xyzw, (4,), "quaternion xyzw")
        norm = float(np.linalg.norm(quaternion))
        if abs(norm - 1.0) > QUATERNION_NORM_TOLERANCE:
            raise InvalidPoseError(
                f"quaternion xyzw {quaternion.tolist()} has norm {norm:.6g}; normalize it to 1 before sending"
            )
        if norm != 1.0:
            quaternion = _read_only(quaternion / norm, (4,), "quaternion xyzw")
        object.__setattr__(self, "position", _read_only(self.position, (3,), "position"))
        object.__setattr__(self, "quaternion_xyzw", quaternion)

    @classmethod
    def identity(cls) -> Pose:
        """Return the transform that changes nothing."""
        return cls(np.zeros(3))

    @classmethod
    def from_rpy(cls, position: npt.ArrayLike, rpy: npt.ArrayLike) -> Pose:
        """Build a pose from fixed-axis roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll).

        Args:
            position: shape (3,), metres.
            rpy: shape (3,), radians.

        Raises:
            InvalidPoseError: a value is not finite or a shape is wrong.
        """
        angles = _read_only(rpy, (3,), "roll pitch yaw")
        return cls(np.asarray(position, dtype=np.float64), Rotation.from_euler("xyz", angles).as_quat())

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Pose:
        """Build a pose from a homogeneous matrix, shape (4, 4).

        Raises:
            InvalidPoseError: the matrix is not finite or its rotation part is not orthonormal to 1e-6.
        """
        T = _read_only(matrix, (4, 4), "homogeneous matrix")
        R = T[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
            raise InvalidPoseError(f"the upper left 3x3 block is not a rotation: {R.tolist()}")
        return cls(T[:3, 3], Rotation.from_matrix(R).as_quat())

    @property
    def rotation(self) -> Rotation:
        """The rotation part as a scipy ``Rotation``."""
        return Rotation.from_quat(self.quaternion_xyzw)

    @property
    def matrix(self) -> FloatArray:
        """The homogeneous matrix, shape (4, 4)."""
        x, y, z, w = self.quaternion_xyzw.tolist()
        p, q, r = self.position.tolist()
        # Written out, since a trial asks for it and scipy's general way takes four times as long.
        return np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), p],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w), q],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y), r],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )

    @property
    def rpy(self) -> FloatArray:
        """Fixed-axis roll, pitch, yaw, shape (3,), radians; at a pitch of 90 degrees the yaw is 0."""
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Gimbal lock")
            angles: FloatArray = self.rotation.as_euler("xyz")
        return angles

    def inverse(self) -> Pose:
        """Return the transform from the parent frame to the child's."""
        R_inverse = self.rotation.as_matrix().T
        return Pose(-R_inverse @ self.position, self.rotation.inv().as_quat())

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: ``T_a_b @ T_b_c`` is ``T_a_c``."""
        rotation = self.rotation * other.rotation
        return Pose(self.transform_points(other.position), rotation.as_quat())

    def transform_points(self, points: npt.ArrayLike) -> FloatArray:
        """Map points of the child frame, shape (n, 3) or (3,), metres, into the parent frame."""
        mapped: FloatArray = np.asarray(points, dtype=np.float64) @ self.rotation.as_matrix().T + self.position
        return mapped


class GraspOutcome(IntEnum):
    """How a trial ended. COLLISION and NO_CONTACT are values (quality 0); FAILED has no value (NaN)."""

    GRASPED = 0
    NO_CONTACT = 1
    COLLISION = 2
    FAILED = 3


@dataclass(frozen=True, eq=False)
class GraspContact:
    """One contact between a hand link and the object, in the object's frame.

    Args:
        link: name of the hand link.
        position: contact point on the object's surface, shape (3,), metres.
        normal: unit normal pointing into the object, shape (3,).
    """

    link: str
    position: FloatArray
    normal: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _read_only(self.position, (3,), "contact position"))
        normal = _read_only(self.normal, (3,), "contact normal")
        if abs(math.hypot(*normal.tolist()) - 1.0) > 1e-6:
            raise InvalidPoseError(f"contact normal {normal.tolist()} is not of unit length")
        object.__setattr__(self, "normal", normal)

    @classmethod
    def from_rows(
        cls, links: Sequence[str], positions: npt.ArrayLike, normals: npt.ArrayLike
    ) -> tuple[GraspContact, ...]:
        """Build one contact a row, all checked at once: one by one they would cost a trial more than its closing.

        Args:
            links: names of the hand links.
            positions: shape (n, 3), metres.
            normals: unit normals into the object, shape (n, 3).

        Raises:
            InvalidPoseError: as for a single contact.
        """
        points = _read_only(positions, (len(links), 3), "contact positions")
        directions = _read_only(normals, (len(links), 3), "contact normals")
        contacts = []
        for x, y, z in directions.tolist():
            if abs(math.sqrt(x * x + y * y + z * z) - 1.0) > 1e-6:
                raise InvalidPoseError(f"contact normal {[x, y, z]} is not of unit length")
        for link, point, direction in zip(links, points, directions, strict=True):
            contact = object.__new__(cls)
            contact.__dict__.update(link=link, position=point, normal=direction)
            contacts.append(contact)
        return tuple(contacts)


@dataclass(frozen=True)
class HandPosture:
    """Joint values of a hand: ``names[i]`` is at ``positions[i]`` radians."""

    names: tuple[str, ...] = ()
    positions: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.names) != len(self.positions):
            raise InvalidPoseError(
                f"a posture needs one position a joint: {len(self.names)} names and {len(self.positions)} positions"
            )
        if not all(map(math.isfinite, self.positions)):
            raise InvalidPoseError(f"joint positions must be finite, got {self.positions}")


@dataclass(frozen=True)
class QualityUnderNoise:
    """What the quality of a grasp comes to when the hand is not exactly where it was told to be.

    Args:
        expected: mean quality over the executions.
        sd: their standard deviation, at least 0.
        worst: the lowest quality of them.
        samples: number of executions, or of points at which a model was asked; at least 1.

    Raises:
        InvalidQualityError: a number is out of range or not finite, or the worst is above the mean.
    """

    expected: float
    sd: float
    worst: float
    samples: int

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise InvalidQualityError(f"quality under noise needs at least 1 sample, got {self.samples}")
        figures = (self.expected, self.sd, self.worst)
        if not all(map(math.isfinite, figures)) or self.sd < 0.0:
            raise InvalidQualityError(
                "quality under noise needs finite numbers and a deviation of at least 0, got "
                f"expected {self.expected}, sd {self.sd}, worst {self.worst}"
            )
        if self.worst > self.expected + 1e-9 * (1.0 + abs(self.expected)):  # a mean is rounded
            raise InvalidQualityError(
                f"the worst quality {self.worst} cannot be above the expected one, {self.expected}"
            )

    @classmethod
    def of(cls, qualities: npt.ArrayLike) -> QualityUnderNoise | None:
        """Sum up repeated executions; None when none of them gave a value.

        Args:
            qualities: of the executions, shape (n,); NaN for one that failed, which does not count.

        Returns:
            The figures, with the standard deviation of the sample (n - 1 in the divisor; 0 for a single one).

        Raises:
            InvalidQualityError: a quality is infinite.
        """
        values = np.asarray(qualities, dtype=np.float64)
        values = values[~np.isnan(values)]
        if not len(values):
            return None
        sd = float(values.std(ddof=1)) if len(values) > 1 else 0.0
        return cls(float(values.mean()), sd, float(values.min()), len(values))


@dataclass(frozen=True)
class Grasp:
    """The answer to one trial: where the hand was, what happened and how good the grasp is.

    ``quality`` is the value that is optimized (one of the metrics, by default epsilon). It is NaN
    exactly when the outcome is FAILED, and 0 for COLLISION and NO_CONTACT (thesis, section 2.2.2).

    Args:
        T_object_tcp: pose of the TCP in the object's frame.
        outcome: how the trial ended.
        quality: value to be maximized, dimensionless.
        epsilon: radius of the largest origin-centred ball in the grasp wrench space (thesis 2.2.2).
        volume: volume of the grasp wrench space (6-D).
        isotropy: grasp isotropy index in [0, 1] (thesis 2.2.1).
        force_closure: whether the origin lies inside the grasp wrench space.
        contacts: contacts after closing, object frame.
        hand_posture: final joint values.
        object_id: name of the target object.
        hand: name of the hand.
        computation_time: seconds that the trial took.
        message: why a trial failed or what a reader should know; empty otherwise.
        under_noise: what is known of the grasp's quality under noise; None when nothing is.

    Raises:
        InvalidPoseError: quality and outcome contradict each other.
    """

    T_object_tcp: Pose
    outcome: GraspOutcome
    quality: float
    epsilon: float = 0.0
    volume: float = 0.0
    isotropy: float = 0.0
    force_closure: bool = False
    contacts: tuple[GraspContact, ...] = ()
    hand_posture: HandPosture = field(default_factory=HandPosture)
    object_id: str = ""
    hand: str = ""
    computation_time: float = 0.0
    message: str = ""
    under_noise: QualityUnderNoise | None = None

    def __post_init__(self) -> None:
        failed = self.outcome is GraspOutcome.FAILED
        if failed != math.isnan(self.quality) or math.isinf(self.quality):
            raise InvalidPoseError(
                f"outcome {self.outcome.name} contradicts quality {self.quality}: "
                "quality is NaN for FAILED and finite otherwise"
            )

    @classmethod
    def failed(cls, T_object_tcp: Pose, message: str, object_id: str = "", hand: str = "") -> Grasp:
        """Return the grasp of a trial that gave no value, with the reason."""
        return cls(
            T_object_tcp,
            GraspOutcome.FAILED,
            math.nan,
            math.nan,
            math.nan,
            math.nan,
            object_id=object_id,
            hand=hand,
            message=message,
        )


@dataclass(frozen=True)
class StampedGrasp:
    """A grasp with the identity of its trial: the candidate's time stamp in nanoseconds."""

    stamp_ns: int
    grasp: Grasp
