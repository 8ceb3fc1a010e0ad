"""Basin search, the default method: one trial confirms a basin, the next goes elsewhere.

The surrogate's structure is chosen by evidence. Candidates are the local maxima of the optimistic posterior
(mean plus standard deviation) and of the mean. Each has a local incumbent, the best observation in the same
basin. A candidate's score is the expected improvement on its own incumbent times the probability that it
reaches the level of the best. A basin that has been confirmed has little left to improve, so the search
turns to the others by itself, and when all are confirmed it refines them. A quarter of the trials of that last
stage goes instead to where an unconfirmed basin of the top level is least improbable, because a surrogate
that is too sure of itself would never look there; and a quarter, half when refining promises nothing any more,
polishes incumbents without a model, because a smooth surrogate never finds the summit of a kink.

Where the function has a plateau, as a grasp's quality has, most of the space is of no use, and the search is
by local searches around the best diverse points instead; until there are a few, the space is filled. Where it has no
plateau and the number of solutions is given, one trial in three goes to the set of that many diverse points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import logsumexp

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import best_candidate
from mebo_grasp.optimization.methods.base import IndexArray, MethodSettings, state_int, state_part
from mebo_grasp.optimization.methods.common import (
    DEFAULT_NUM_SOLUTIONS,
    MethodBase,
    check_count,
    without_repeats,
)
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection import basins
from mebo_grasp.optimization.selection.basin_views import View, find_candidates, level_of, look, refine
from mebo_grasp.optimization.selection.basins import NO_INCUMBENT
from mebo_grasp.optimization.selection.local_searches import EXPLORATION, LocalSearches, rank_of, steps_from
from mebo_grasp.optimization.selection.polishing import polish
from mebo_grasp.optimization.selection.solution_set import slot_values
from mebo_grasp.optimization.surrogate.belief import Belief, Beliefs, PlateauSurrogate, shows_too_little

SAME_PLACE = 1e-3
"""A pick this near to an observation, in every coordinate of the cube, does not open a new basin."""
LATE_TURNS = ("refinement", "exploration", "refinement", "polishing")
REFINED_TURNS = ("exploration", "exploration", "polishing", "polishing")
"""What trials are for, in turn, when the best candidate's basin is confirmed; and when no refinement promises more."""
IN_VAIN = 0.1
"""A refinement is in vain if a worse point was tried this much nearer to it than the incumbent."""
SET_PERIOD, SET_TURN = 3, 2
"""Without a plateau one trial in this many goes to the set of diverse points if their number is given."""


class BasinSearch(MethodBase):
    """Multisolution search by basins with local incumbents.

    Args:
        space: the search space.
        settings: settings of the run.
    """

    name = "basin_search"

    def __init__(self, space: SearchSpace, settings: MethodSettings) -> None:
        super().__init__(space, settings)
        self.surrogate = PlateauSurrogate(space.dim, settings.relearn_period)
        self._refinements = 0
        self._proposed = 0

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Return the next points, shape (count, d)."""
        check_count(count)
        if observations.n == 0:
            self._phase = "no data"
            return rng.random((count, observations.dim))
        if shows_too_little(observations.y):
            return without_repeats(self._look_around(observations, count, rng), observations, rng)
        beliefs = self.surrogate.update(observations.U, observations.y, rng)
        if len(observations.without_value):
            beliefs = beliefs.condition_on(observations.without_value)
        if beliefs.best.chance is not None:
            points = self._search_locally(beliefs.best, observations, count, rng)
        else:
            points = self._select(beliefs, count, rng)
        return without_repeats(points, observations, rng)

    def _look_around(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Fill the space until enough lies off the plateau; each second trial steps from the best that does."""
        centre, length = self._local_searches(observations).reach(0, rng)
        steps = [centre is not None and (self._proposed + i) % 2 == 0 for i in range(count)]
        self._proposed += count
        self._phase = "improvement" if steps[0] else "exploration"
        taken = observations.taken
        for is_step in steps:
            point = steps_from(centre, length, observations.dim, rng)[0] if is_step else best_candidate(taken, rng)
            taken = np.concatenate([taken, point[None]])
        return taken[-count:]

    def _local_searches(self, observations: Observations) -> LocalSearches:
        U, y = observations.U, observations.y
        size, (sides, distance) = self.settings.num_solutions or DEFAULT_NUM_SOLUTIONS, self.metric()
        return LocalSearches(U, y, float(np.min(y)), sides, size, distance)

    def _search_locally(
        self, belief: Belief, observations: Observations, count: int, rng: np.random.Generator
    ) -> FloatArray:
        searches = self._local_searches(observations)
        picks: list[FloatArray] = []
        for _ in range(count):
            rank = rank_of(self._proposed, searches.size)
            self._proposed += 1
            point = searches.pick(belief, rank, rng)
            if not picks:
                self._phase = {0: "improvement", EXPLORATION: "exploration"}.get(rank, "solution set")
            picks.append(point)
            belief = belief.condition_on(point[None])
        return np.stack(picks)

    def _select(self, beliefs: Beliefs, count: int, rng: np.random.Generator) -> FloatArray:
        levels = [level_of(belief) for belief in beliefs.members]
        candidates = np.concatenate(
            [find_candidates(belief, level, rng) for belief, level in zip(beliefs.members, levels, strict=True)]
        )
        views = [look(belief, candidates, level) for belief, level in zip(beliefs.members, levels, strict=True)]
        picks: list[FloatArray] = []
        for _ in range(count):
            turn = self._proposed % SET_PERIOD
            self._proposed += 1
            if turn == SET_TURN and self.settings.num_solutions is not None:
                point, phase = self._pick_for_set(beliefs, views, self.settings.num_solutions), "solution set"
            else:
                point, phase = pick(beliefs, views, self._refinements % len(LATE_TURNS), rng)
                self._refinements += phase != "search"
            self._phase = self._phase if picks else phase
            picks.append(point)
            beliefs = beliefs.condition_on(point[None])
            views = [view.after(belief) for view, belief in zip(views, beliefs.members, strict=True)]
        return np.stack(picks)

    def _pick_for_set(self, beliefs: Beliefs, views: list[View], size: int) -> FloatArray:
        """The candidate that promises most for the set of ``size`` diverse points, refined, shape (d,)."""
        sides, distance = self.metric()
        slots = [
            slot_values(view.belief.U * sides, view.belief.y, view.candidates * sides, size, distance) for view in views
        ]
        return most_promising(beliefs, views, slots)

    def solution_set(
        self, observations: Observations, size: int | None = None, min_distance: float | None = None
    ) -> IndexArray:
        """Best observation of each basin, best first; at ``min_distance`` from each other if given."""
        size = size if size is not None else self.settings.num_solutions
        distance = min_distance if min_distance is not None else self.settings.min_distance
        if observations.n == 0:
            return np.empty(0, dtype=np.int64)
        if distance is not None:
            return super().solution_set(observations, size, distance)
        belief = self.surrogate.belief(observations.U, observations.y)
        level = level_of(belief)
        floor = level.best - 0.5 * level.spread
        return basins.representatives(belief, observations.U, observations.y, 10 * level.slack, size, floor)

    def state(self) -> dict[str, Any]:
        """Phase and the surrogate's state."""
        return {
            **super().state(),
            "refinements": self._refinements,
            "proposed": self._proposed,
            "surrogate": self.surrogate.state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        super().restore(state)
        self._refinements = state_int(state, "refinements")
        self._proposed = state_int(state, "proposed")
        self.surrogate.restore(state_part(state, "surrogate"))


def most_promising(beliefs: Beliefs, views: list[View], incumbents: list[FloatArray]) -> FloatArray:
    """The candidate that promises most beyond its incumbent, whether or not that is the top; refined, shape (d,).

    Args:
        beliefs: what is believed.
        views: one a member, of the same m candidates.
        incumbents: values to improve on, shape (m,) for each member.
    """
    value = np.stack([view.log_gains(own) for view, own in zip(views, incumbents, strict=True)])
    value += np.log(beliefs.shares)[:, None]
    best = int(np.argmax(logsumexp(value, axis=0)))
    member = int(np.argmax(value[:, best]))
    view = views[member]
    return refine(view.belief, view.candidates[best], float(incumbents[member][best]), None)


def pick(beliefs: Beliefs, views: list[View], late_turn: int, rng: np.random.Generator) -> tuple[FloatArray, str]:
    """The candidate with the highest expected score, refined, shape (d,), and why it is taken.

    Args:
        beliefs: what is believed.
        views: one a member, of the same candidates.
        late_turn: which of ``LATE_TURNS`` it is if the best candidate's basin is confirmed.
        rng: source of randomness.
    """
    # All members fit the same values, so their scores have the same units and may be averaged.
    value = np.stack([view.log_scores for view in views]) + np.log(beliefs.shares)[:, None]
    best = int(np.argmax(logsumexp(value, axis=0)))
    # The member that expects most of this candidate places the point.
    view = views[int(np.argmax(value[:, best]))]
    point = refine(view.belief, view.candidates[best], float(view.own[best]), view.level.top)
    known = np.any(np.all(np.abs(view.belief.U - point) <= SAME_PLACE, axis=1))
    if not view.confirmed[best] and not known:
        return point, "search"
    refined = value[:, best].max() <= np.log(view.level.resolution)
    turn = (REFINED_TURNS if refined else LATE_TURNS)[late_turn]
    if turn == "refinement" and _was_in_vain(view, best, point):
        turn = "polishing"
    if turn == "polishing":
        first, level = views[0], views[0].level
        known_values = first.belief.U, first.belief.y
        polished = polish(*known_values, first.incumbents, level.top, level.resolution, rng)
        if polished is not None:
            return polished, turn
    if turn == "exploration" or refined:
        reach = np.max([np.where(view.unknown, view.log_reach, -np.inf) for view in views], axis=0)
        if np.any(np.isfinite(reach)):
            return view.candidates[int(np.argmax(reach))], "exploration"
    return point, "refinement"


def _was_in_vain(view: View, candidate: int, point: FloatArray) -> bool:
    """Whether a refinement, shape (d,), goes where the model has been wrong: beside a worse point, far from the best.

    Beside a kink a smooth model goes on to promise a summit where there is none, whatever it is told.
    """
    incumbent = view.index[candidate]
    if incumbent == NO_INCUMBENT:
        return False
    gaps = np.linalg.norm(view.belief.U - point, axis=1)
    worse = view.belief.y < view.own[candidate]
    return bool(np.min(gaps[worse], initial=np.inf) < IN_VAIN * gaps[incumbent])
