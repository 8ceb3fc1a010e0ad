"""Local searches around the best diverse points, each in a box that shrinks while it finds nothing better there.

In many dimensions most of the space stays uncertain for ever, and the improvement that it might hold would draw all
trials to its corners; where the function has a plateau, nearly all of these end on it. So each trial belongs to one
of the points of the greedy diverse set and stays near it (trust regions: TuRBO, Eriksson et al. 2019; one for each
diverse point: ROBOT, Maus et al. 2022). Here a box has no state of its own: its length follows from the trials
that were made nearest to its centre since that was found.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.improvement import log_normalized_improvement
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.selection.basin_views import refine
from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set, slot_values
from mebo_grasp.optimization.selection.trust_region import TrustRegion
from mebo_grasp.optimization.surrogate.belief import Belief

NET_SIZE = 512
LENGTHS = (0.4, 0.2, 0.1, 0.05)
"""Sides of the box, in turn; the last is followed by the first."""
PATIENCE = 8
"""Trials near a centre that do not improve on it, after which its box takes the next length."""
BEST_PERIOD = 4
"""At least one trial in this many goes to the best point of all, however many are wanted."""
EXPLORATION_PERIOD = 6
"""One trial in this many is an exploration: it belongs to none of the best diverse points."""
EXPLORATION = -1
LONGEST_SCALE = 4.0
"""Lengthscales beyond this stand for dimensions without influence; they must not stretch the box without end."""


def rank_of(turn: int, size: int) -> int:
    """Which of ``size`` searches has this turn, counted from 0, or ``EXPLORATION``."""
    rounds, place = divmod(turn, EXPLORATION_PERIOD)
    if place == EXPLORATION_PERIOD - 1:
        return EXPLORATION
    turn -= rounds
    period = min(BEST_PERIOD, size)
    rounds, place = divmod(turn, period)
    if place == 0:
        return 0
    return 1 + (rounds * (period - 1) + place - 1) % (size - 1)


@dataclass(frozen=True, eq=False)
class LocalSearches:
    """The best diverse points found so far, each the centre of a search.

    Args:
        U: points with a known value in the order of their trials, shape (n, d), unit cube.
        y: their values, shape (n,).
        floor: value of the plateau; no search is centred there.
        sides: lengths of the cube's sides in which distances count, shape (d,).
        size: number of points wanted.
        min_distance: smallest distance between two of them.
    """

    U: FloatArray
    y: FloatArray
    floor: float
    sides: FloatArray
    size: int
    min_distance: float

    @cached_property
    def _diverse(self) -> npt.NDArray[np.int64]:
        """Indices of all diverse points off the plateau, best first."""
        off = np.flatnonzero(self.y > self.floor)
        return off[greedy_diverse_set(self.U[off] * self.sides, self.y[off], None, self.min_distance)]

    @property
    def centres(self) -> npt.NDArray[np.int64]:
        """Indices of the best diverse points, as many of ``size`` as lie off the plateau, best first."""
        return self._diverse[: self.size]

    def box(
        self, rank: int, lengthscales: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Corners of a search's box, shape (d,) each; the whole cube while fewer points are found.

        An exploration's box lies around any further diverse point.

        Args:
            rank: which search, 0 that of the best point, or ``EXPLORATION``.
            lengthscales: of the surrogate, shape (d,); the box is longer where the function varies less.
            rng: source of randomness.
        """
        others = self._diverse[self.size :]
        if rank == EXPLORATION and len(others):
            return TrustRegion(LENGTHS[0]).box(self.U[rng.choice(others)], lengthscales)
        if rank == EXPLORATION or rank >= len(self.centres):
            return np.zeros(len(self.sides)), np.ones(len(self.sides))
        length = LENGTHS[self._idle_trials[rank] // PATIENCE % len(LENGTHS)]
        return TrustRegion(length).box(self.U[self.centres[rank]], lengthscales)

    @cached_property
    def _idle_trials(self) -> npt.NDArray[np.int64]:
        """Trials made nearest to each centre since it was found, shape (number of centres,)."""
        nearest = np.argmin(cdist(self.U * self.sides, self.U[self.centres] * self.sides), axis=1)
        later = np.arange(len(self.U)) > self.centres[nearest]
        return np.bincount(nearest[later], minlength=len(self.centres))

    def incumbents(self, points: FloatArray, rank: int) -> FloatArray:
        """Value that each point, shape (m, d), has to exceed to be of use, shape (m,).

        A search is to improve the diverse set; an exploration whatever was found near the point, however low.
        """
        size = self.size if rank != EXPLORATION else len(self.y) + 1
        return slot_values(self.U * self.sides, self.y, points * self.sides, size, self.min_distance)

    def pick(self, belief: Belief, rank: int, rng: np.random.Generator) -> FloatArray:
        """The point in a search's box with the highest expected improvement on its incumbent, shape (d,).

        Args:
            belief: what is believed, open trials included.
            rank: which search, or ``EXPLORATION``.
            rng: source of randomness.
        """
        lengthscales = np.exp(belief.value.hyperparameters.theta[: belief.dim])
        lower, upper = self.box(rank, np.minimum(lengthscales, LONGEST_SCALE), rng)
        points = lower + (upper - lower) * sobol(NET_SIZE, belief.dim, rng)
        own = self.incumbents(points, rank)
        mean, sd = belief.predict(points)
        value = np.log(sd) + log_normalized_improvement((mean - own) / sd) + belief.log_chances(points)
        best = int(np.argmax(value))
        refined = refine(belief, points[best], float(own[best]), None, (lower, upper))
        # The climb knows one incumbent only. Where it has left that one's neighbourhood, it may have gained nothing.
        stayed = self.incumbents(refined[None], rank)[0] <= own[best]
        return refined if stayed else points[best]
