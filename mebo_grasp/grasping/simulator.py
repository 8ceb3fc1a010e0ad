"""One trial: place the hand, test for collision, close the fingers, gather contacts, measure the grasp."""

from __future__ import annotations

import time
from dataclasses import replace
from types import TracebackType

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, HandPosture, Pose
from mebo_grasp.grasping import closing, hand_motion
from mebo_grasp.grasping.bullet_world import BulletWorld
from mebo_grasp.grasping.compiled_trial import TrialRunner
from mebo_grasp.grasping.contacts import Contacts
from mebo_grasp.grasping.distance_field import build_field
from mebo_grasp.grasping.engine import BULLET, ENGINE_TYPE, FAST, Engine, exact_gap
from mebo_grasp.grasping.hand_arrays import MOST_JOINTS, build_hand_arrays
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.hand_motion import exempt_touching_pairs
from mebo_grasp.grasping.joint_step import ClosingRule
from mebo_grasp.grasping.metrics.chosen import ChosenMetric, ClosedGrasp
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
        bullet = self.settings.engine == "bullet"
        surface = target.parts_surface if bullet else target.mesh
        self._tree = build_tree(np.array(surface.triangles, dtype=np.float64))
        self._field = build_field(np.array(surface.bounds), self._tree, target.solid_parts)
        self._rule = ClosingRule(self.settings.step, self.settings.gap_tolerance, self.settings.whole_finger)
        self._world: BulletWorld | None = None
        self._open_hand = hand.preshape
        self._take_preshape(self._open_hand)
        self._chosen = ChosenMetric(target, hand, self.settings)

    def _take_preshape(self, preshape: HandPosture) -> None:
        """Let the hand stand in a posture before it closes."""
        check_limits(self.hand, preshape)
        self._arrays, self._layout = build_hand_arrays(self.hand, preshape)
        exempt_touching_pairs(self._arrays)
        engine = np.zeros(1, ENGINE_TYPE)
        if self._world is None:
            self._world = BulletWorld(self.target, self._layout.shapes, self._layout.T_group_shape, engine["pose"][0])
        else:  # a posture moves shapes about, but leaves them and their order as they are
            self._world.stand(self._layout.T_group_shape, engine["pose"][0])
        engine["kind"] = BULLET if self.settings.engine == "bullet" else FAST
        if self.target.solid_parts:
            rods = [shape.kind in ("capsule", "sphere") for shape in self._layout.shapes]
            engine["screened"][0, : len(rods)] = rods
        self._engine = Engine(self._world.callback, self._tree, engine)
        self._runner = TrialRunner(
            self._arrays, self._layout, self._field, self._engine, self._world, self._rule, self.settings
        )
        self._preshape = preshape
        self._places = [[preshape.names.index(name) for name in joints] for joints in self._layout.joints]

    def trial(self, T_object_tcp: Pose, preshape: HandPosture | None = None) -> Grasp:
        """Execute one trial.

        Args:
            T_object_tcp: pose of the hand's TCP in the object's frame.
            preshape: posture from which the hand closes; joints not named, and all if None, stand at the hand's own
                preshape. Another one than that of the trial before costs some three milliseconds.

        Returns:
            The grasp; its outcome is COLLISION if the open hand overlaps the object, NO_CONTACT if the closed
            hand does not touch it, and GRASPED otherwise.

        Raises:
            InvalidHandError: the preshape names a joint that the hand has not, or puts one beyond its limits.
        """
        begun = time.perf_counter()
        posture = self._open_hand if preshape is None else self.hand.posture(preshape)
        if posture is not self._preshape and posture != self._preshape:
            self._take_preshape(posture)
        touching = self._runner.run(T_object_tcp.matrix)
        self._raise_pending()
        if touching is None:
            return self._grasp(T_object_tcp, GraspOutcome.COLLISION, (), GraspMetrics(), begun)
        if not touching.links:
            return self._grasp(T_object_tcp, GraspOutcome.NO_CONTACT, (), GraspMetrics(), begun)
        metrics = measure(touching, self.target, self.settings)
        contacts = GraspContact.from_rows(*touching)
        return self._grasp(T_object_tcp, GraspOutcome.GRASPED, contacts, metrics, begun)

    def free_shares(self) -> npt.NDArray[np.float64]:
        """Return how much of one more step each closing joint could make after the last trial, shape (joints,)."""
        shares = np.zeros((len(self.hand.fingers), MOST_JOINTS))
        closing.free_shares(
            self._arrays, self._field, self._engine, self._rule, self._runner.poses, self._runner.state, shares
        )
        self._raise_pending()
        used = np.arange(MOST_JOINTS) < self._arrays["joint_count"][: len(shares), None]
        return shares[used]

    def further_metrics(self, grasp: Grasp) -> dict[str, float]:
        """Return the metrics that are computed only where they are the quality, of the last trial's grasp."""
        metrics = GraspMetrics(grasp.quality, grasp.epsilon, grasp.volume, grasp.isotropy, grasp.force_closure)
        return self._chosen.values(
            ClosedGrasp(
                grasp.T_object_tcp, grasp.outcome, grasp.contacts, grasp.hand_posture, metrics, self._count_colliding
            )
        )

    def measured_anew(self, grasp: Grasp, contacts: tuple[GraspContact, ...], settings: TrialSettings) -> Grasp:
        """Return a grasp of this simulator with other contacts and settings of the metrics.

        Args:
            grasp: a grasp with contacts.
            contacts: the ones to measure.
            settings: friction, contact model and quality to measure by.
        """
        points, normals = (np.array([getattr(c, what) for c in contacts]) for what in ("position", "normal"))
        metrics = measure(Contacts(tuple(c.link for c in contacts), points, normals), self.target, settings)
        chosen = ChosenMetric(self.target, self.hand, settings)
        if not chosen.is_basic:
            closed = ClosedGrasp(
                grasp.T_object_tcp, grasp.outcome, contacts, grasp.hand_posture, metrics, self._count_colliding
            )
            metrics = chosen.apply(closed)
        return replace(
            grasp,
            contacts=contacts,
            quality=metrics.quality,
            epsilon=metrics.epsilon,
            volume=metrics.volume,
            isotropy=metrics.isotropy,
            force_closure=metrics.force_closure,
        )

    def _count_colliding(self) -> int:
        """Count the links that overlap the object where the hand stands."""
        colliding = set()
        for shape, placed in enumerate(self._layout.shapes):
            pose = self._runner.poses["group"][self._arrays["shape_group"][shape]]
            lower, upper = hand_motion.gap_bounds(self._arrays, self._field, pose, shape)
            if upper < 0.0 or (lower <= 0.0 and exact_gap(self._engine, self._arrays, self._field, pose, shape) <= 0.0):
                colliding.add(placed.link)
        self._raise_pending()
        return len(colliding)

    def _raise_pending(self) -> None:
        if self._world is not None:
            self._world.raise_pending()

    def close(self) -> None:
        """Free the physics engine; closing twice does no harm."""
        if self._world is not None:
            self._world.close()

    def __enter__(self) -> GraspSimulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _posture(self, outcome: GraspOutcome) -> HandPosture:
        if outcome is GraspOutcome.COLLISION:
            return self._preshape
        positions = list(self._preshape.positions)
        for places, angles in zip(self._places, self._runner.poses["joints"].tolist(), strict=False):
            for place, angle in zip(places, angles, strict=False):
                positions[place] = angle
        return HandPosture(self._preshape.names, tuple(positions))

    def _grasp(
        self,
        T_object_tcp: Pose,
        outcome: GraspOutcome,
        contacts: tuple[GraspContact, ...],
        metrics: GraspMetrics,
        begun: float,
    ) -> Grasp:
        posture = self._posture(outcome)
        if not self._chosen.is_basic:
            closed = ClosedGrasp(T_object_tcp, outcome, contacts, posture, metrics, self._count_colliding)
            metrics = self._chosen.apply(closed)
        return Grasp(
            T_object_tcp,
            outcome,
            metrics.quality,
            metrics.epsilon,
            metrics.volume,
            metrics.isotropy,
            metrics.force_closure,
            contacts,
            posture,
            self.target.object_id,
            self.hand.name,
            time.perf_counter() - begun,
        )


def check_limits(hand: HandModel, posture: HandPosture) -> None:
    """Refuse a full posture of a hand with a joint beyond its limits.

    Raises:
        InvalidHandError: naming the joint, its value and its limits.
    """
    given = set(hand.description.preshape)
    for name, value, lower, upper in zip(posture.names, posture.positions, hand.lower, hand.upper, strict=True):
        # A joint at 0 by default may lie outside of its limits; that is the description's matter.
        if not lower - 1e-9 <= value <= upper + 1e-9 and (value != 0.0 or name in given):
            raise InvalidHandError(
                f"hand '{hand.name}': joint '{name}' of the posture is at {value:.4g} rad, its limits are "
                f"{lower:.4g} to {upper:.4g}"
            )
