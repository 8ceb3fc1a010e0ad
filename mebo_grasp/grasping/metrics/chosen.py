"""The metric that is optimized, where it needs more than the contacts and their wrenches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mebo_grasp.errors import InvalidObjectError
from mebo_grasp.grasp import GraspContact, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.metrics import simox
from mebo_grasp.grasping.metrics.collision_penalty import penalized
from mebo_grasp.grasping.metrics.uniformity import uniformity
from mebo_grasp.grasping.minkowski_sum import sum_origin_distance
from mebo_grasp.grasping.quality import GraspMetrics, torque_length, wrenches_of
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

FACES_SEED = 0
"""Of the faces that stand for an object in Simox's figures: the same ones in every run."""


@dataclass(frozen=True)
class ClosedGrasp:
    """What a metric may look at, besides object, hand and settings.

    Args:
        T_object_tcp: pose of the hand.
        outcome: how the trial ended.
        contacts: contacts, object frame.
        posture: final joint values.
        metrics: the basic ones, all 0 without contacts.
        count_colliding: counts the parts of the open hand that overlap the object.
    """

    T_object_tcp: Pose
    outcome: GraspOutcome
    contacts: Sequence[GraspContact]
    posture: HandPosture
    metrics: GraspMetrics
    count_colliding: Callable[[], int]


@dataclass(frozen=True)
class ChosenMetric:
    """Puts the chosen metric in place as the quality.

    Args:
        target: the object.
        hand: the hand.
        settings: which metric, and its numbers.
    """

    target: TargetObject
    hand: HandModel
    settings: TrialSettings
    _methods: dict[str, Callable[[ClosedGrasp], float]] = field(init=False)

    def __post_init__(self) -> None:
        methods: dict[str, Callable[[ClosedGrasp], float]] = {
            "epsilon_linf": self._epsilon_linf,
            "uniformity": self._uniformity,
            "penalized_epsilon": self._penalized,
            "simox_epsilon": self._simox_epsilon,
            "simox_volume": self._simox_volume,
        }
        object.__setattr__(self, "_methods", methods)
        if self.settings.quality == "simox_epsilon":
            _ = self.object_wrenches.ball
        if self.settings.quality == "simox_volume":
            _ = self.object_wrenches.volume

    @cached_property
    def object_wrenches(self) -> simox.ObjectWrenchSpace:
        """The object's own wrench space, the unit of Simox's figures."""
        return simox.object_wrench_space(self.target, np.random.default_rng(FACES_SEED))

    @property
    def is_basic(self) -> bool:
        """Whether the quality is one of the basic metrics, which need nothing from here."""
        return self.settings.quality not in self._methods

    def apply(self, grasp: ClosedGrasp) -> GraspMetrics:
        """Return the grasp's metrics with the chosen one as quality."""
        if self.is_basic:
            return grasp.metrics
        return replace(grasp.metrics, quality=self._methods[self.settings.quality](grasp))

    def values(self, grasp: ClosedGrasp) -> dict[str, float]:
        """Return the metrics of this module for display; Simox's volume, which takes seconds, only if it is chosen.

        Simox's figures are NaN for an object that has no unit for them.
        """
        found = {}
        for name, method in self._methods.items():
            if name != "simox_volume" or self.settings.quality == name:
                try:
                    found[name] = method(grasp)
                except InvalidObjectError:
                    found[name] = float("nan")
        return found

    def _epsilon_linf(self, grasp: ClosedGrasp) -> float:
        if not grasp.contacts:
            return 0.0
        wrenches = wrenches_of(*_points_and_normals(grasp), self.target, self.settings)
        return sum_origin_distance(wrenches.reshape(len(grasp.contacts), -1, 6))

    def _uniformity(self, grasp: ClosedGrasp) -> float:
        length = torque_length(self.target, self.settings)
        return uniformity(
            self.hand, grasp.posture, grasp.T_object_tcp, grasp.contacts, self.target.center_of_mass, length
        )

    def _penalized(self, grasp: ClosedGrasp) -> float:
        colliding = grasp.count_colliding() if grasp.outcome is GraspOutcome.COLLISION else 0
        return penalized(grasp.metrics.epsilon, colliding, self.settings.penalty_rate)

    def _simox_wrenches(self, grasp: ClosedGrasp) -> np.ndarray:
        return simox.simox_wrenches(*_points_and_normals(grasp), self.target)

    def _simox_epsilon(self, grasp: ClosedGrasp) -> float:
        return simox.simox_epsilon(self._simox_wrenches(grasp), self.object_wrenches)

    def _simox_volume(self, grasp: ClosedGrasp) -> float:
        return simox.simox_volume(self._simox_wrenches(grasp), self.object_wrenches)


def _points_and_normals(grasp: ClosedGrasp) -> tuple[np.ndarray, np.ndarray]:
    """Return contact points and normals, each (n, 3)."""
    points = np.array([contact.position for contact in grasp.contacts]).reshape(-1, 3)
    return points, np.array([contact.normal for contact in grasp.contacts]).reshape(-1, 3)
