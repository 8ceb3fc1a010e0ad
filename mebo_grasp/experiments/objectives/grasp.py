"""Grasps of an object by a simulated hand, as an objective."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.objective import (
    Evaluator,
    Objective,
    WantedSet,
    checked_choice,
    pointwise,
    settings_digest,
)
from mebo_grasp.experiments.objectives.installed_files import package_folder
from mebo_grasp.experiments.objectives.thesis_scenes import (
    MIN_DISTANCE,
    NUM_SOLUTIONS,
    ROTATION_WEIGHT,
    THESIS_SCENES,
    ThesisScene,
)
from mebo_grasp.grasp import FloatArray, Grasp
from mebo_grasp.grasping.candidate_space import CandidateSpace, candidate_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import distance_weights
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import ENGINE_NAMES, QUALITY_NAMES, EngineName, QualityName, TrialSettings
from mebo_grasp.optimization.search_space import SearchSpace

SPACES = ("position", "pose")
BOUNDS = ("thesis", "object")
LONGEST_HEAD = 24


def name_of(object_or_file: str) -> str:
    """Name of an object in folders and tables: its own, or that of its file without what a path cannot hold."""
    return re.sub(r"[^\w~-]", "_", Path(object_or_file).stem)


@dataclass(frozen=True)
class GraspObjective(Objective):
    """Quality of the grasp at a pose of the hand's TCP in the object's frame, metres and radians.

    Args:
        object: a built-in object, a mesh file, or ``package:file`` for a file of an installed package.
        space: "position" (x, y, z at the side approach) or "pose" (with roll, pitch, yaw).
        quality: the metric that is maximized.
        bounds: "thesis": the thesis's box for its bottle, vase or drill; "object": derived from the object's box.
        scene: which of the thesis's objects a mesh stands for; the object's own name if empty.
        scale: factor from the mesh's unit to metres.
        hand: name of a built-in hand.
        engine: "bullet" or "fast".
        friction: coefficient of friction; the Simox metrics know none.
        num_solutions: M; 0 for the thesis's of the object, or 4.
        min_distance: tau, metres.
        rotation_weight: metres that a radian counts in tau; the thesis's own where nothing is said.
    """

    object: str
    space: str = "position"
    quality: QualityName = "epsilon"
    bounds: str = "object"
    scene: str = ""
    scale: float = 1.0
    hand: str = "icub_left"
    engine: EngineName = "bullet"
    friction: float = 0.5
    num_solutions: int = 0
    min_distance: float = MIN_DISTANCE
    rotation_weight: float = ROTATION_WEIGHT

    @property
    def object_name(self) -> str:
        """The object's name in folders and tables."""
        return self.scene or name_of(self.object)

    @property
    def thesis_scene(self) -> ThesisScene | None:
        """The thesis's scene with this object, if there is one."""
        return THESIS_SCENES.get(self.scene or self.object)

    @property
    def label(self) -> str:
        """Object, space and quality, with eight digits where another setting has not its default."""
        shown = {"space", "bounds", "quality"} | ({"object"} if self.object == self.object_name else set())
        rest = settings_digest(self, frozenset(shown))
        return f"{self.object_name}/{self.space}-{self.bounds}/{self.quality}{rest}"

    @property
    def column(self) -> str:
        """The object; of a name with its parameters in it, the first word."""
        name = self.object_name
        return name if len(name) <= LONGEST_HEAD else name.split("_")[0]

    @property
    def group(self) -> str:
        """Metric and space."""
        return f"{self.quality}, TCP {self.space}"

    def check(self) -> None:
        """Refuse settings out of range, without loading the object.

        Raises:
            InvalidSettingsError: naming the setting, its value and those allowed.
        """
        checked_choice("space", self.space, SPACES)
        checked_choice("quality", self.quality, QUALITY_NAMES)
        checked_choice("bounds", self.bounds, BOUNDS)
        checked_choice("engine", self.engine, ENGINE_NAMES)
        if self.bounds == "thesis" and self.thesis_scene is None:
            raise InvalidSettingsError(
                f"the thesis has boxes for {', '.join(THESIS_SCENES)}, not for {self.object!r}; say which of them it "
                "stands for by scene, or set bounds to object"
            )
        if self.num_solutions < 0 or self.min_distance <= 0.0 or self.rotation_weight < 0.0:
            raise InvalidSettingsError(
                "num_solutions and rotation_weight must be at least 0 and min_distance above 0, got "
                f"{self.num_solutions}, {self.rotation_weight} and {self.min_distance}"
            )

    def wanted_set(self, seed: int) -> WantedSet:
        """M and tau; all methods are told them, as the command line does."""
        del seed
        scene = self.thesis_scene
        return WantedSet(self.num_solutions or (scene.num_solutions if scene else NUM_SOLUTIONS), self.min_distance)

    @contextmanager
    def open(self, seed: int) -> Iterator[Evaluator]:
        """Load the object and its hand; those of the last objective are kept."""
        del seed
        self.check()
        bench = _bench(self)
        yield Evaluator(bench.search_space, pointwise(bench.quality))

    def available(self, X: FloatArray) -> dict[str, np.ndarray]:
        """Which candidates the thesis's occlusions leave (section 7.4.3), by occlusion; {} for other objects.

        Args:
            X: candidates, shape (n, d).
        """
        scene = self.thesis_scene
        if scene is None:
            return {}
        return scene.available(X[:, 2], load_target(self.object, self.scale).bounds.mean(axis=0))

    def grasps(self, X: FloatArray) -> tuple[TargetObject, HandModel, list[Grasp]]:
        """Execute candidates once more: the same pose gives the same grasp."""
        bench = _bench(self)
        return bench.target, bench.hand, [bench.grasp(x) for x in X]


class _Bench:
    """An object before the hand, and the map from candidates to poses."""

    def __init__(self, objective: GraspObjective) -> None:
        self.target, self.hand = (
            load_target(objective.object, objective.scale),
            HandModel.load(objective.hand),
        )
        self.poses = _pose_space(objective, self.target, self.hand)
        weights = distance_weights(self.poses.units, objective.rotation_weight)
        self.search_space = SearchSpace(self.poses.names, self.poses.lower, self.poses.upper, self.poses.units, weights)
        self._settings = TrialSettings(
            friction=objective.friction,
            quality=objective.quality,
            engine=objective.engine,
            compute_volume=False,
        )

    @cached_property
    def _simulator(self) -> GraspSimulator:
        return GraspSimulator(self.target, self.hand, self._settings)

    def grasp(self, x: FloatArray) -> Grasp:
        return self._simulator.trial(self.poses.to_pose(x))

    def quality(self, x: FloatArray) -> float:
        return self.grasp(x).quality


def _pose_space(objective: GraspObjective, target: TargetObject, hand: HandModel) -> CandidateSpace:
    scene = objective.thesis_scene
    if objective.bounds != "thesis" or scene is None:
        return candidate_space(objective.space, target, hand)
    return candidate_space(objective.space, target, hand, *scene.bounds(objective.space, target.bounds.mean(axis=0)))


@lru_cache(maxsize=1)
def _bench(objective: GraspObjective) -> _Bench:
    # Building a simulator takes as long as a thousand trials, and a worker gets many runs of one objective in a row.
    return _Bench(objective)


@lru_cache(maxsize=4)
def load_target(name: str, scale: float) -> TargetObject:
    """Load a built-in object, a mesh file, or ``package:file``; the last few are kept.

    Raises:
        InvalidSettingsError: the package is not installed.
        InvalidFileError: the mesh cannot be read.
    """
    package, colon, file = name.partition(":")
    if colon and not Path(name).exists():
        return TargetObject.from_file(package_folder(package) / file, scale)
    return TargetObject.load(name, scale)
