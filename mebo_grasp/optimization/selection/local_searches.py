"""Local searches around the best diverse points, by steps whose length shrinks while they find nothing better there.

In many dimensions most of the space stays uncertain for ever, and the improvement that it might hold would draw all
trials to its corners; where the function has a plateau, nearly all of these end on it. So each trial belongs to one
of the points of the greedy diverse set and stays near it (one search for each diverse point: ROBOT, Maus et al. 2022).
It is a step of a few coordinates, the best of a handful as the surrogate sees it (pre-selection in an evolution
strategy: Emmerich et al. 2002). Of many more it would take those about which the surrogate is mistaken, most of all
beyond a cliff. A search has no state of its own: the length of its steps follows from the trials that were made
nearest to its centre since that was found.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.improvement import log_normalized_improvement
from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set, slot_values
from mebo_grasp.optimization.surrogate.belief import Belief

CANDIDATES = 16
"""Steps among which the surrogate chooses."""
STEP_SDS = (0.1, 0.05, 0.025, 0.0125)
"""Standard deviations of a step's coordinates, sides of the cube, in turn; the last is followed by the first."""
MOVED_SHARE = 0.5
"""Share of the coordinates that a step moves."""
PATIENCE = 8
"""Trials near a centre that do not improve on it, after which its steps take the next length."""
BEST_PERIOD = 4
"""At least one trial in this many goes to the best point of all, however many are wanted."""
EXPLORATION_PERIOD = 6
"""One trial in this many is an exploration: it belongs to none of the best diverse points."""
EXPLORATION = -1


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

    def candidates(self, rank: int, rng: np.random.Generator) -> FloatArray:
        """Steps of a search, shape (CANDIDATES, d); anywhere in the cube while fewer points are found.

        An exploration's begin at any further diverse point.

        Args:
            rank: which search, 0 that of the best point, or ``EXPLORATION``.
            rng: source of randomness.
        """
        shape = CANDIDATES, len(self.sides)
        others = self._diverse[self.size :]
        if rank == EXPLORATION and len(others):
            centre, sd = rng.choice(others), STEP_SDS[0]
        elif rank == EXPLORATION or rank >= len(self.centres):
            return rng.random(shape)
        else:
            centre, sd = self.centres[rank], STEP_SDS[self._idle_trials[rank] // PATIENCE % len(STEP_SDS)]
        moved = rng.random(shape) < MOVED_SHARE
        moved[np.arange(CANDIDATES), rng.integers(shape[1], size=CANDIDATES)] = True
        return np.clip(self.U[centre] + sd * moved * rng.standard_normal(shape), 0.0, 1.0)

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
        """The step of a search with the highest expected improvement on its incumbent, shape (d,).

        Args:
            belief: what is believed, open trials included.
            rank: which search, or ``EXPLORATION``.
            rng: source of randomness.
        """
        points = self.candidates(rank, rng)
        mean, sd = belief.predict(points)
        gain = (mean - self.incumbents(points, rank)) / sd
        value = np.log(sd) + log_normalized_improvement(gain) + belief.log_chances(points)
        best: FloatArray = points[int(np.argmax(value))]
        return best
