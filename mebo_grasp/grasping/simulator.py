"""One trial: place the hand, test for collision, close the fingers, gather contacts, measure the grasp."""

from __future__ import annotations

import time
from types import TracebackType

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping import closing, hand_motion
from mebo_grasp.grasping.bullet_world import BulletWorld
from mebo_grasp.grasping.contacts import ContactFinder
from mebo_grasp.grasping.distance_field import build_field
from mebo_grasp.grasping.engine import BULLET, FAST, Engine
from mebo_grasp.grasping.hand_arrays import MOST_JOINTS, build_hand_arrays
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.hand_motion import exempt_touching_pairs
from mebo_grasp.grasping.joint_step import ClosingRule, new_state
from mebo_grasp.grasping.quality import GraspMetrics, measure
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings
from mebo_grasp.grasping.triangle_tree import build_tree


class GraspSimulator:
    """Executes trials of one hand on one object; the same pose gives the same grasp, bit for bit.

    Args:
        target: the object.
        hand: the hand; its joints start at the preshape.
        settings: how a trial is executed and measured.

    Raises:
        InvalidHandError: the hand's chains are longer than the closing loop takes, or nothing can collide.
    """

    def __init__(self, target: TargetObject, hand: HandModel, settings: TrialSettings | None = None) -> None:
        self.target = target
        self.hand = hand
        self.settings = settings or TrialSettings()
        self._arrays, self._layout = build_hand_arrays(hand, hand.preshape)
        exempt_touching_pairs(self._arrays)
        self._state = new_state()
        self._poses = hand_motion.new_poses()
        bullet = self.settings.engine == "bullet"
        surface = target.parts_surface if bullet else target.mesh
        self._field = build_field(surface, target.solid_parts)
        self._rule = ClosingRule(self.settings.step, self.settings.gap_tolerance, self.settings.whole_finger)
        tree, asked_at = build_tree(np.array(surface.triangles, dtype=np.float64)), np.eye(4)
        self._world = BulletWorld(target, self._layout.shapes, self._layout.T_group_shape, asked_at)
        rods = np.array([shape.kind in ("capsule", "sphere") for shape in self._layout.shapes])
        screened = rods & bool(target.solid_parts)
        self._engine = Engine(BULLET if bullet else FAST, self._world.callback, asked_at, tree, screened)
        self._finder = ContactFinder(
            self._arrays, self._layout, self._field, self._engine, self._world, self._rule, self.settings
        )

    def trial(self, T_object_tcp: Pose) -> Grasp:
        """Execute one trial.

        Args:
            T_object_tcp: pose of the hand's TCP in the object's frame.

        Returns:
            The grasp; its outcome is COLLISION if the open hand overlaps the object, NO_CONTACT if the closed
            hand does not touch it, and GRASPED otherwise.
        """
        begun = time.perf_counter()
        closed = closing.run_trial(
            self._arrays, self._field, self._engine, self._rule, self._poses, self._state, T_object_tcp.matrix
        )
        self._world.raise_pending()
        if not closed:
            return self._grasp(T_object_tcp, GraspOutcome.COLLISION, (), GraspMetrics(), begun)
        touching = self._finder.find(self._poses)
        if not touching.links:
            return self._grasp(T_object_tcp, GraspOutcome.NO_CONTACT, (), GraspMetrics(), begun)
        metrics = measure(touching, self.target, self.settings)
        contacts = tuple(map(GraspContact, *touching))
        return self._grasp(T_object_tcp, GraspOutcome.GRASPED, contacts, metrics, begun)

    def free_shares(self) -> npt.NDArray[np.float64]:
        """Return how much of one more step each closing joint could make after the last trial, shape (joints,)."""
        shares = np.zeros((len(self.hand.fingers), MOST_JOINTS))
        closing.free_shares(
            self._arrays, self._field, self._engine, self._rule, self._poses, self._state, shares
        )
        self._world.raise_pending()
        used = np.arange(MOST_JOINTS) < self._arrays["joint_count"][: len(shares), None]
        return shares[used]

    def close(self) -> None:
        """Free the physics engine; closing twice does no harm."""
        self._world.close()

    def __enter__(self) -> GraspSimulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _posture(self) -> HandPosture:
        values = dict(zip(self.hand.preshape.names, self.hand.preshape.positions, strict=True))
        for joints, angles in zip(self._layout.joints, self._poses["joints"].tolist(), strict=False):
            values.update(zip(joints, angles, strict=False))
        return HandPosture(tuple(values), tuple(values.values()))

    def _grasp(
        self, T_object_tcp: Pose, outcome: GraspOutcome, contacts: tuple[GraspContact, ...], metrics: GraspMetrics,
        begun: float,
    ) -> Grasp:
        return Grasp(
            T_object_tcp, outcome, metrics.quality, metrics.epsilon, metrics.volume, metrics.isotropy,
            metrics.force_closure, contacts, self._posture(), self.target.object_id, self.hand.name,
            time.perf_counter() - begun,
        )
