"""What is explored and how: object, search space and optimizer, built from the node's parameters."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from mebo_grasp.errors import RunLogError
from mebo_grasp.grasp import FloatArray, HandPosture, Pose
from mebo_grasp.grasping.candidate_space import CandidateSpace, candidate_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import distance_weights
from mebo_grasp.grasping.posture_space import PosturePoseSpace
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.nodes.settings import OptimizerNodeSettings
from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace

SAME_POSE = 1e-6
"""Largest difference, metres and radians, at which two poses are the same, seen through a message."""


@dataclass(frozen=True)
class ExplorationPlan:
    """Everything that stays fixed during an exploration.

    Args:
        object_id: name of the object, and of the frame of every pose.
        hand_name: name of the hand.
        pose_space: maps points of the search space to TCP poses.
        settings: the node's parameters.
    """

    object_id: str
    hand_name: str
    pose_space: CandidateSpace
    settings: OptimizerNodeSettings

    @cached_property
    def search_space(self) -> SearchSpace:
        """The box in which the optimizer searches."""
        space = self.pose_space
        weights = distance_weights(space.units, self.settings.rotation_weight)
        return SearchSpace(space.names, space.lower, space.upper, space.units, weights)

    @property
    def input_noise(self) -> InputNoise:
        """How far an executed pose may be from the chosen one."""
        metres, radians = self.settings.input_noise_position, self.settings.input_noise_rotation
        if metres > 0.0 or radians > 0.0:
            return InputNoise.of_pose(metres, radians)
        return InputNoise((self.settings.input_noise,))

    @property
    def optimizer_settings(self) -> OptimizerSettings:
        """The optimizer's own settings."""
        settings = self.settings
        return OptimizerSettings(
            budget=settings.budget,
            n_initial=settings.initial_points,
            batch_size=settings.batch_size,
            ucb_beta=settings.ucb_beta,
            boltzmann_beta=settings.boltzmann_beta,
            burn_in=settings.burn_in,
            relearn_period=settings.relearn_period,
            kernel=settings.kernel,
            warp=settings.warp,
            learning=settings.learning,
            surrogate=settings.surrogate,
            min_leaf=settings.min_leaf,
            particles=settings.particles,
            safe=settings.safe,
            input_noise=self.input_noise,
            num_solutions=settings.num_solutions or None,
            min_distance=settings.min_distance or None,
        )

    @property
    def with_posture(self) -> bool:
        """Whether a candidate is a pose and a posture."""
        return isinstance(self.pose_space, PosturePoseSpace)

    def posture_of(self, x: FloatArray) -> HandPosture | None:
        """Return the posture in which a candidate arrives; None where that is the hand's preshape."""
        return self.pose_space.to_posture(x) if isinstance(self.pose_space, PosturePoseSpace) else None

    def open_optimizer(self) -> Optimizer | LoggedOptimizer:
        """Return a new optimizer, or the one that the run log tells of, with its budget raised to the settings'.

        Raises:
            MeboGraspError: a setting is not usable, or the log belongs to another run.
        """
        method, seed = self.settings.method, self.settings.seed
        if not self.settings.run_log:
            return Optimizer(self.search_space, method, self.optimizer_settings, np.random.default_rng(seed))
        path = Path(self.settings.run_log)
        if path.exists() and path.stat().st_size > 0:
            logged = LoggedOptimizer.resume(path)
            try:
                self._check_same_run(logged)
                logged.raise_budget(self.settings.budget)
            except BaseException:
                logged.close()
                raise
            return logged
        # A process killed while it created the file leaves an empty one: there is nothing to resume.
        path.unlink(missing_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        space, settings = self.search_space, self.optimizer_settings
        return LoggedOptimizer.create(path, space, method, settings, seed, about=self._scene)

    @property
    def _scene(self) -> dict[str, object]:
        """What makes other poses, or other qualities, of the same points of the search space."""
        scene: dict[str, object] = {"object": self.object_id, "hand": self.hand_name}
        return {**scene, "facet": self.settings.facet} if self.settings.space == "facet" else scene

    def _check_same_run(self, logged: LoggedOptimizer) -> None:
        optimizer = logged.optimizer
        seed = self.settings.seed if logged.seed is None else logged.seed
        # Logs of older versions do not say what they are about.
        scene = self._scene if logged.about is None else logged.about
        begun = {**scene, **_identity(seed, optimizer.method.name, optimizer.settings, optimizer.space)}
        own = _identity(self.settings.seed, self.settings.method, self.optimizer_settings, self.search_space)
        asked = {**self._scene, **own}
        differences = [
            f"{name} ({value} in the log, {asked.get(name)} now)"
            for name, value in begun.items()
            if value != asked.get(name)
        ]
        if differences:
            raise RunLogError(
                f"the run log {self.settings.run_log} belongs to a run with another "
                f"{', '.join(differences)}: resume it with the same parameters, or name another file"
            )

    def set_log_aside(self) -> Path | None:
        """Rename the run log, so that a new run can begin and nothing is lost; None when there is none."""
        path = Path(self.settings.run_log)
        if not self.settings.run_log or not path.exists():
            return None
        name, suffix = f"{path.name}.{time.strftime('%Y%m%d-%H%M%S')}", 0
        aside = path.with_name(name)
        while aside.exists():
            suffix += 1
            aside = path.with_name(f"{name}-{suffix}")
        return path.rename(aside)

    def point_of(self, pose: Pose) -> FloatArray | None:
        """Return the point of the search space that stands for a pose, shape (d,).

        None when the pose is not of this space: out of bounds, or other where the space is fixed; always None where
        a posture belongs to the point, which an answer does not tell.
        """
        if isinstance(self.pose_space, PosturePoseSpace):
            return None
        x = self.pose_space.from_pose(pose)
        if not self.search_space.contains(x):
            return None
        return x if self.has_pose(x, pose) else None

    def has_pose(self, x: FloatArray, pose: Pose) -> bool:
        """Whether a point of the search space, shape (d,), stands for a pose, seen through a message."""
        difference = self.pose_space.to_pose(x).inverse() @ pose
        moved = max(np.linalg.norm(difference.position), difference.rotation.magnitude())
        return bool(moved < SAME_POSE)


def _identity(seed: int, method: str, settings: OptimizerSettings, space: SearchSpace) -> dict[str, object]:
    """Return by name what two runs must have in common to be one; not the budget, which may be raised."""
    common = asdict(settings)
    del common["budget"]
    return {
        "method": method,
        "seed": seed,
        **common,
        "space": list(space.names),
        "lower_bounds": space.lower.tolist(),
        "upper_bounds": space.upper.tolist(),
        "rotation_weight": space.distance_weights.tolist(),
    }


def make_plan(settings: OptimizerNodeSettings) -> ExplorationPlan:
    """Build the plan of an exploration.

    Raises:
        MeboGraspError: the object, the hand, the space or its bounds are not usable.
    """
    target = TargetObject.load(settings.object, settings.object_scale)
    hand = HandModel.load(settings.hand)
    bounds = settings.lower_bounds or None, settings.upper_bounds or None
    pose_space = candidate_space(settings.space, target, hand, *bounds, settings.facet, settings.synergies)
    return ExplorationPlan(target.object_id, hand.name, pose_space, settings)
