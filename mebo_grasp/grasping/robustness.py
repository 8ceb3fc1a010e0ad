"""Grasps under uncertain execution: a candidate is executed many times with noise, and its qualities are summed up.

Nogueira evaluates a recommended grasp so: Gaussian noise on the input, mean, standard deviation and worst of 100
executions; a coordinate that noise would carry out of the box keeps its noise-free value.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, HandPosture, Pose, QualityUnderNoise
from mebo_grasp.grasping.pose_space import PoseSpace
from mebo_grasp.grasping.simulator import GraspSimulator

FloatArray = npt.NDArray[np.float64]

LARGEST_FRICTION = 10.0


@dataclass(frozen=True)
class ExecutionNoise:
    """Standard deviations of Gaussian noise; 0 for none.

    Args:
        unit: on each coordinate of a candidate, in shares of its range (the normalized cube).
        position: on each coordinate of the executed position, metres.
        rotation: on each component of the rotation vector by which the executed pose is turned, radians.
        friction: on the coefficient of friction; kept within 0 to ``LARGEST_FRICTION``.
        normal: angle by which contact normals are tilted, about each of two axes across them, radians.

    Raises:
        InvalidSettingsError: a value is negative or not finite.
    """

    unit: float = 0.0
    position: float = 0.0
    rotation: float = 0.0
    friction: float = 0.0
    normal: float = 0.0

    def __post_init__(self) -> None:
        for name in ("unit", "position", "rotation", "friction", "normal"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidSettingsError(f"{name} noise is {value}; it must be a finite number, at least 0")


@dataclass(frozen=True)
class Executions:
    """What came of repeated executions.

    Args:
        qualities: quality of each, shape (n,).
        outcomes: how many ended how.
        under_noise: the qualities summed up; None if all executions failed.
    """

    qualities: FloatArray
    outcomes: Counter[GraspOutcome]
    under_noise: QualityUnderNoise | None

    @classmethod
    def of(cls, grasps: list[Grasp]) -> Executions:
        """Sum up single executions."""
        qualities = np.array([grasp.quality for grasp in grasps])
        return cls(qualities, Counter(grasp.outcome for grasp in grasps), QualityUnderNoise.of(qualities))


def perturb_point(
    x: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike, sd: float, rng: np.random.Generator
) -> FloatArray:
    """Return a candidate with noise; coordinates that would leave the box stay as they are.

    Args:
        x: the candidate, shape (d,).
        lower: bounds, shape (d,).
        upper: bounds, shape (d,).
        sd: standard deviation, in shares of the ranges.
        rng: source of the noise.
    """
    point, low, high = (np.asarray(values, dtype=np.float64) for values in (x, lower, upper))
    moved: FloatArray = point + sd * (high - low) * rng.standard_normal(point.shape)
    return np.where((moved >= low) & (moved <= high), moved, point)


def perturb_pose(pose: Pose, position_sd: float, rotation_sd: float, rng: np.random.Generator) -> Pose:
    """Return a pose moved in its parent's frame and turned about its own origin, each by Gaussian noise.

    Args:
        pose: the pose aimed at.
        position_sd: metres, on each coordinate.
        rotation_sd: radians, on each component of the rotation vector.
        rng: source of the noise.
    """
    position = pose.position + position_sd * rng.standard_normal(3)
    turn = Rotation.from_rotvec(rotation_sd * rng.standard_normal(3))
    return Pose(position, (pose.rotation * turn).as_quat())


def tilt_normal(contact: GraspContact, sd: float, rng: np.random.Generator) -> GraspContact:
    """Return a contact whose normal is turned about two axes across it.

    Args:
        contact: the contact.
        sd: standard deviation of each angle, radians.
        rng: source of the noise.
    """
    helper = np.eye(3)[np.abs(contact.normal).argmin()]
    first = np.cross(contact.normal, helper)
    first /= np.linalg.norm(first)
    axis = sd * rng.standard_normal(2) @ np.array([first, np.cross(contact.normal, first)])
    normal = Rotation.from_rotvec(axis).as_matrix() @ contact.normal
    return GraspContact(contact.link, contact.position, normal / np.linalg.norm(normal))


def execute(
    simulator: GraspSimulator,
    pose: Pose,
    noise: ExecutionNoise,
    rng: np.random.Generator,
    preshape: HandPosture | None = None,
) -> Grasp:
    """Execute one pose with noise on the pose, on friction and on contact normals; ``noise.unit`` is left out.

    Args:
        simulator: object, hand and settings.
        pose: the pose aimed at, of the TCP in the object's frame.
        noise: what is uncertain.
        rng: source of the noise.
        preshape: posture from which the hand closes, as in ``GraspSimulator.trial``.

    Returns:
        The grasp; its pose is the one that noise led to.
    """
    grasp = simulator.trial(perturb_pose(pose, noise.position, noise.rotation, rng), preshape)
    if (noise.friction == 0.0 and noise.normal == 0.0) or not grasp.contacts:
        return grasp
    friction = simulator.settings.friction + noise.friction * rng.standard_normal()
    settings = replace(simulator.settings, friction=float(np.clip(friction, 0.0, LARGEST_FRICTION)))
    contacts = tuple(tilt_normal(contact, noise.normal, rng) for contact in grasp.contacts)
    return simulator.measured_anew(grasp, contacts, settings)


class InexactHand:
    """A hand that does not go quite where it is sent, and does not know it: its grasps carry the commanded pose.

    Args:
        simulator: object, hand and settings.
        noise: what is uncertain; ``unit`` is left out. Without any, a trial is the simulator's, bit for bit.
        rng: source of the noise, drawn in the order of the trials.
        repetitions: a trial that ends in a quality above 0 is executed so many times more, and the grasp carries
            what they came to as ``under_noise``.

    Raises:
        InvalidSettingsError: a negative number of repetitions, or repetitions without noise, which would be equal.
    """

    def __init__(
        self, simulator: GraspSimulator, noise: ExecutionNoise, rng: np.random.Generator, repetitions: int = 0
    ) -> None:
        if repetitions < 0:
            raise InvalidSettingsError(f"repetitions is {repetitions}; it must be at least 1, or 0 for none")
        if repetitions and noise == ExecutionNoise():
            raise InvalidSettingsError(
                f"repetitions is {repetitions}, but all noise is 0, so that they would be equal; set a noise, or "
                "repetitions to 0"
            )
        self._simulator, self._noise, self._rng, self._repetitions = simulator, noise, rng, repetitions

    def trial(self, T_object_tcp: Pose, preshape: HandPosture | None = None) -> Grasp:
        """Execute one trial; contacts and metrics are those of the pose that noise led to.

        Args:
            T_object_tcp: the commanded pose of the TCP in the object's frame.
            preshape: as in ``GraspSimulator.trial``.

        Raises:
            InvalidHandError: as ``GraspSimulator.trial``.
        """
        if self._noise == ExecutionNoise():
            return self._simulator.trial(T_object_tcp, preshape)
        executed = replace(self._execute(T_object_tcp, preshape), T_object_tcp=T_object_tcp)
        if not executed.quality > 0.0:
            return executed
        further = [self._execute(T_object_tcp, preshape).quality for _ in range(self._repetitions)]
        return replace(executed, under_noise=QualityUnderNoise.of(further))

    def _execute(self, pose: Pose, preshape: HandPosture | None) -> Grasp:
        return execute(self._simulator, pose, self._noise, self._rng, preshape)


def execute_repeatedly(
    simulator: GraspSimulator, pose: Pose, noise: ExecutionNoise, repeats: int, rng: np.random.Generator
) -> Executions:
    """Execute one pose many times.

    Args:
        simulator: object, hand and settings.
        pose: the pose aimed at, of the TCP in the object's frame.
        noise: what is uncertain; ``unit`` must be 0, it belongs to candidates of a space.
        repeats: number of executions, at least 1.
        rng: source of the noise.

    Raises:
        InvalidSettingsError: fewer than one execution, or noise in units of a space.
    """
    if noise.unit > 0.0:
        raise InvalidSettingsError(
            "noise in the normalized cube needs a search space; give position and rotation noise"
        )
    _check_repeats(repeats)
    return Executions.of([execute(simulator, pose, noise, rng) for _ in range(repeats)])


def execute_candidate_repeatedly(
    simulator: GraspSimulator,
    space: PoseSpace,
    x: npt.ArrayLike,
    noise: ExecutionNoise,
    repeats: int,
    rng: np.random.Generator,
) -> Executions:
    """Execute a candidate of a search space many times, with noise on its coordinates too.

    Args:
        simulator: object, hand and settings.
        space: the space.
        x: the candidate, shape (d,).
        noise: what is uncertain.
        repeats: number of executions, at least 1.
        rng: source of the noise.

    Raises:
        InvalidSettingsError: fewer than one execution.
    """
    _check_repeats(repeats)
    grasps = []
    for _ in range(repeats):
        point = perturb_point(x, space.lower, space.upper, noise.unit, rng)
        grasps.append(execute(simulator, space.to_pose(point), noise, rng))
    return Executions.of(grasps)


def _check_repeats(repeats: int) -> None:
    if repeats < 1:
        raise InvalidSettingsError(f"repeats is {repeats}; it must be at least 1")
