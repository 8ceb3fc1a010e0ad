"""All stored grasps of an object in memory, so that no question has to wait for the disk."""

from __future__ import annotations

import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import FloatArray, Pose, StampedGrasp
from mebo_grasp.solutions.best_first import node_bounds, search, sort_leaves
from mebo_grasp.solutions.best_grasp import BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.bounding_tree import BoundingTree, build_tree
from mebo_grasp.solutions.column import Column
from mebo_grasp.solutions.diversity import IntArray, PoseMetric
from mebo_grasp.solutions.grasp_columns import Grasps, NodeBounds, Wanted
from mebo_grasp.solutions.hand_volume import PackedVolume, bounding_balls
from mebo_grasp.solutions.occlusion import Occlusion, Sphere, make_scene
from mebo_grasp.solutions.ranking import Ranking, figures_under_noise
from mebo_grasp.solutions.stored_grasps import StoredGrasps

LEAF_SIZE = 48
UNCOVERED = 512
UNCOVERED_SHARE = 64
"""A new tree is made when more than ``UNCOVERED`` grasps, and more than one in ``UNCOVERED_SHARE``, are
not in the tree; until then a search looks at them one by one."""
BACKGROUND_SIZE = 4_000
"""From this number of grasps on a new tree is made in a thread, while the old one still answers."""


@dataclass(frozen=True)
class Found:
    """What a search found: stamps best first, and what it looked at on the way.

    Args:
        stamps_ns: of the grasps found, best first.
        considered: grasps of enough quality that were looked at.
        blocked: shape (number of occlusions,), how many of them each occlusion blocked.
        passed_over: grasps for which the figure that ranks is not known.
    """

    stamps_ns: tuple[int, ...]
    considered: int
    blocked: IntArray
    passed_over: int = 0


_NONE, _NOTHING, _NOWHERE = np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 3))
NO_TREE = BoundingTree(_NONE, _NONE, _NONE, _NONE, _NOWHERE, _NOWHERE)
NO_BOUNDS = NodeBounds(_NOTHING, _NOTHING, _NOTHING, _NOTHING)


class Covering:
    """The tree of one blocking rule, made anew when too many grasps are not in it."""

    def __init__(self) -> None:
        self.tree, self.bounds = NO_TREE, NO_BOUNDS
        self._order = Column.of(_NONE)
        self._pending: Future[tuple[BoundingTree, NodeBounds]] | None = None
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="grasp_index")

    @property
    def order(self) -> IntArray:
        """Rows leaf by leaf, then those that are not in the tree, best first."""
        return self._order.array

    def refresh(self, grasps: Grasps) -> None:
        """Take in new grasps, and make a new tree if it is time to.

        Answers stay the same, only their time changes.

        Args:
            grasps: all; their ``order`` is not read.
        """
        covered, known, n = len(self.tree.order), len(self.order), len(grasps.qualities)
        if self._pending is not None and self._pending.done():
            self._use(*self._pending.result(), grasps)
            self._pending = None
        elif n - known == 1:
            rank = _rank(grasps, self.order[covered:], known)
            self._order.insert(covered + rank, known)
        elif n > known:
            self._use(self.tree, self.bounds, grasps)
        covered = len(self.tree.order)
        if self._pending is not None or n - covered <= max(UNCOVERED, n // UNCOVERED_SHARE):
            return
        if covered == 0 or n < BACKGROUND_SIZE:
            self._use(*_cover(grasps), grasps)
        else:
            self._pending = self._worker.submit(_cover, grasps)

    def _use(self, tree: BoundingTree, bounds: NodeBounds, grasps: Grasps) -> None:
        self.tree, self.bounds = tree, bounds
        rest = np.arange(len(tree.order), len(grasps.qualities))
        rest = rest[np.lexsort((grasps.stamps[rest], -grasps.qualities[rest]))]
        self._order = Column.of(np.concatenate([tree.order, rest]))

    def close(self) -> None:
        """Let the worker end."""
        self._worker.shutdown(wait=False, cancel_futures=True)


def _rank(grasps: Grasps, rows: IntArray, new: int) -> int:
    """Return how many of the sorted rows come before a new one."""
    qualities = -grasps.qualities[rows]
    first = int(np.searchsorted(qualities, -grasps.qualities[new], side="left"))
    last = int(np.searchsorted(qualities, -grasps.qualities[new], side="right"))
    return first + int(np.searchsorted(grasps.stamps[rows[first:last]], grasps.stamps[new]))


def _cover(grasps: Grasps) -> tuple[BoundingTree, NodeBounds]:
    tree = build_tree(grasps.points, grasps.points, LEAF_SIZE)
    sort_leaves(tree, grasps.qualities, grasps.stamps)
    return tree, node_bounds(tree, grasps)


class GraspIndex:
    """Grasps with a quality above zero, ready for questions under each blocking rule.

    Args:
        stored: what is stored already; it grows with what is added.
    """

    def __init__(self, stored: StoredGrasps) -> None:
        self._stored = stored
        n = len(stored.stamps_ns)
        self._no_radius = Column.of(np.zeros(n))
        balls = bounding_balls(
            stored.positions.array,
            stored.quaternions.array,
            stored.first_capsule.array,
            stored.capsules.array,
        )
        self._centers, self._inner, self._outer = (Column.of(values) for values in balls)
        self._coverings = {BlockingRule.TCP: Covering()}
        if stored.has_volumes:
            self._coverings[BlockingRule.HAND] = Covering()
        self._best = float(stored.qualities.array.max()) if n else 0.0
        self._cover_all()
        self._warm_up()

    def _warm_up(self) -> None:
        # Compiled code is made or loaded at its first use: that must not fall into the first question.
        somewhere = Occlusion("warm-up", Sphere(1e-6), Pose(np.full(3, 1e3)))
        for rule in self._coverings:
            query = BestGraspQuery((somewhere,), rule=rule)
            self.search(query, PoseMetric(), np.array([0.0, 0.0, 1.0]))

    def __len__(self) -> int:
        return len(self._stored.stamps_ns)

    @property
    def best_quality(self) -> float:
        """The best quality, 0 when nothing is stored."""
        return self._best

    def add(self, trial: StampedGrasp, volume: PackedVolume | None) -> None:
        """Add one grasp; its quality must be above zero and its stamp new."""
        grasp, pose, known = trial.grasp, trial.grasp.T_object_tcp, trial.grasp.under_noise
        position, quaternion = pose.position[None], pose.quaternion_xyzw[None]
        capsules = np.empty((0, 7), dtype=np.int16) if volume is None else volume
        balls = bounding_balls(position, quaternion, np.array([0, len(capsules)]), capsules)
        stored = self._stored
        stored.capsules.extend(capsules)
        stored.first_capsule.extend(np.array([len(stored.capsules)]))
        for column, values in zip((self._centers, self._inner, self._outer), balls, strict=True):
            column.extend(values)
        self._no_radius.extend(np.zeros(1))
        stored.stamps_ns.extend(np.array([trial.stamp_ns]))
        stored.positions.extend(position)
        stored.quaternions.extend(quaternion)
        figures = (math.nan,) * 3 if known is None else (known.expected, known.sd, known.worst)
        stored.under_noise.extend(np.array([figures]))
        stored.qualities.extend(np.array([grasp.quality]))
        self._best = max(self._best, grasp.quality)
        self._refresh()

    def _refresh(self) -> None:
        for rule, covering in self._coverings.items():
            covering.refresh(self._grasps(rule))

    def _cover_all(self) -> None:
        """Make the first trees, side by side: the compiled code holds no lock."""
        grasps = [self._grasps(rule) for rule in self._coverings]
        with ThreadPoolExecutor(max_workers=len(grasps)) as pool:
            list(pool.map(Covering.refresh, self._coverings.values(), grasps))

    def _grasps(self, rule: BlockingRule) -> Grasps:
        by_hand, stored = rule is BlockingRule.HAND, self._stored
        return Grasps(
            self._coverings[rule].order,
            stored.stamps_ns.array,
            stored.qualities.array,
            stored.positions.array,
            stored.quaternions.array,
            self._centers.array if by_hand else stored.positions.array,
            self._inner.array if by_hand else self._no_radius.array,
            self._outer.array if by_hand else self._no_radius.array,
            stored.first_capsule.array,
            stored.capsules.array,
        )

    def search(self, query: BestGraspQuery, metric: PoseMetric, approach_axis: FloatArray) -> Found:
        """Find the best grasps that are free of occlusions and, if asked, mutually diverse.

        Args:
            query: what is wanted.
            metric: distance between grasps.
            approach_axis: unit direction of the approach in the TCP's frame, shape (3,).

        Raises:
            InvalidQueryError: the hand's volume is asked for but not known.
        """
        if query.rule not in self._coverings:
            raise InvalidQueryError("the rule 'hand' needs the volume of the hand: open the archive with hand_volume")
        covering, grasps = self._coverings[query.rule], self._grasps(query.rule)
        tree, bounds, passed_over = covering.tree, covering.bounds, 0
        if query.ranking is not Ranking.OBSERVED:
            # Few grasps were repeated: sorted for each question, and looked at one by one without a tree.
            tree, bounds = NO_TREE, NO_BOUNDS
            grasps, passed_over = self._ranked_anew(grasps, query)
        by_hand = query.rule is BlockingRule.HAND
        wanted = Wanted(
            max(1, min(query.max_grasps, len(self))),
            query.min_quality,
            query.min_diversity,
            metric.rotation_weight,
            metric.axis,
            by_hand,
            -query.approach_length * approach_axis if by_hand else np.zeros(3),
        )
        rows, considered, blocked = search(tree, bounds, grasps, make_scene(query.occlusions), wanted)
        return Found(tuple(grasps.stamps[rows].tolist()), int(considered), blocked, passed_over)

    def _ranked_anew(self, grasps: Grasps, query: BestGraspQuery) -> tuple[Grasps, int]:
        """Return the grasps with the figure that ranks in place of the quality, and how many have none."""
        values = figures_under_noise(query.ranking, self._stored.under_noise.array, query.quantile)
        unknown = int(np.isnan(values).sum())
        values[~(values > 0.0)] = math.nan  # never an answer, nor counted
        rows = np.flatnonzero(values > 0.0)
        order = rows[np.lexsort((grasps.stamps[rows], -values[rows]))]
        return grasps._replace(order=order, qualities=values), unknown

    def close(self) -> None:
        """Let the workers end."""
        for covering in self._coverings.values():
            covering.close()
