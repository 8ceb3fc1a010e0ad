"""Local searches around the best diverse points, each within a reach that shrinks while it finds nothing better there.

In many dimensions most of the space stays uncertain for ever, and the improvement that it might hold would draw all
trials to its corners; where the function has a plateau, nearly all of these end on it. So each trial belongs to one
of the points of the greedy diverse set and stays near it (trust regions: TuRBO, Eriksson et al. 2019; one for each
diverse point: ROBOT, Maus et al. 2022).

Half of the trials, by chance, are the most promising point of a box around the centre, as far as the surrogate knows.
Where the function is smooth that is a short way to its summit, but among many points the surrogate prefers those
about which it is mistaken, most of all beyond a cliff. So the others are steps of a few coordinates, the best of a
handful (a surrogate that chooses among the offspring of an evolution strategy: Emmerich et al. 2002).

While fewer points are found than wanted, the turns of the missing ones are drawn from the whole space, in favour of
where most may be hoped for. Mostly that is around known points; unknown ones are found by explorations.

A search has no state of its own: its reach follows from the trials that were made nearest to its centre since that
was found.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist
from scipy.special import softmax

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.improvement import log_normalized_improvement
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.selection.basin_views import refine
from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set, slot_values
from mebo_grasp.optimization.selection.trust_region import TrustRegion
from mebo_grasp.optimization.surrogate.belief import Belief

BOX_SHARE = 0.5
"""Share of the trials that are the most promising point of a box; the others are steps."""
NET_SIZE = 512
"""Points of a box that are looked at."""
NUM_STEPS = 16
"""Steps that are looked at."""
LENGTHS = (0.4, 0.2, 0.1, 0.05)
"""Sides of the box, in turn; the last is followed by the first."""
STEP_SD = 0.25
"""Standard deviation of a step's coordinates, sides of the box."""
MOVED_SHARE = 0.5
"""Share of the coordinates that a step moves."""
PATIENCE = 8
"""Trials near a centre that do not improve on it, after which its box takes the next length."""
BEST_PERIOD = 2
"""At least one trial in this many goes to the best point of all, however many are wanted."""
DRAW_BETA = 3.0
"""Inverse temperature of a draw from the whole space, on the standardized optimistic value (as MEBO's)."""
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

    def reach(self, rank: int, rng: np.random.Generator) -> tuple[FloatArray | None, float]:
        """Centre of a search, shape (d,), and the length of its box; no centre while fewer points are found.

        An exploration is centred at any further diverse point.

        Args:
            rank: which search, 0 that of the best point, or ``EXPLORATION``.
            rng: source of randomness.
        """
        others = self._diverse[self.size :]
        if rank == EXPLORATION and len(others):
            return self.U[rng.choice(others)], LENGTHS[0]
        if rank == EXPLORATION or rank >= len(self.centres):
            return None, 1.0
        return self.U[self.centres[rank]], LENGTHS[self._idle_trials[rank] // PATIENCE % len(LENGTHS)]

    @cached_property
    def _idle_trials(self) -> npt.NDArray[np.int64]:
        """Trials made nearest to each centre since it was found, shape (number of centres,)."""
        nearest = np.argmin(cdist(self.U * self.sides, self.U[self.centres] * self.sides), axis=1)
        later = np.arange(len(self.U)) > self.centres[nearest]
        return np.bincount(nearest[later], minlength=len(self.centres))

    def incumbents(self, points: FloatArray, rank: int) -> FloatArray:
        """Value that each point, shape (m, d), has to exceed to be of use, shape (m,).

        A search is to improve the diverse set; an exploration the diverse point nearby, however low.
        """
        size = self.size if rank != EXPLORATION else len(self.y) + 1
        return slot_values(self.U * self.sides, self.y, points * self.sides, size, self.min_distance)

    def pick(self, belief: Belief, rank: int, rng: np.random.Generator) -> FloatArray:
        """A promising point within a search's reach, shape (d,).

        Args:
            belief: what is believed, open trials included.
            rank: which search, or ``EXPLORATION``.
            rng: source of randomness.
        """
        centre, length = self.reach(rank, rng)
        if centre is None and rank != EXPLORATION:
            return draw_from_cube(belief, rng)
        if rng.random() < BOX_SHARE:
            return self._best_of_box(belief, rank, box_around(centre, length, belief), rng)
        points = steps_from(centre, length, belief.dim, rng)
        best: FloatArray = points[int(np.argmax(self._log_gains(belief, points, rank)))]
        return best

    def _log_gains(self, belief: Belief, points: FloatArray, rank: int) -> FloatArray:
        """Log of (expected improvement on the own incumbent × chance to be off the plateau), shape (m,)."""
        mean, sd = belief.predict(points)
        improvement = log_normalized_improvement((mean - self.incumbents(points, rank)) / sd)
        value: FloatArray = np.log(sd) + improvement + belief.log_chances(points)
        return value

    def _best_of_box(
        self, belief: Belief, rank: int, box: tuple[FloatArray, FloatArray], rng: np.random.Generator
    ) -> FloatArray:
        """The point of a box with the highest expected improvement times chance, shape (d,)."""
        lower, upper = box
        points = lower + (upper - lower) * sobol(NET_SIZE, belief.dim, rng)
        best = points[int(np.argmax(self._log_gains(belief, points, rank)))]
        own = float(self.incumbents(best[None], rank)[0])
        refined = refine(belief, best, own, None, box)
        # The climb knows one incumbent only. Where it has left that one's neighbourhood, it may have gained nothing.
        stayed = self.incumbents(refined[None], rank)[0] <= own
        return refined if stayed else best


def draw_from_cube(belief: Belief, rng: np.random.Generator) -> FloatArray:
    """One of many uniform points, drawn by a Boltzmann policy on its optimistic value, shape (d,).

    The largest gain in the cube is where the surrogate is mistaken, most often beside a cliff.
    """
    points = rng.random((NET_SIZE, belief.dim))
    values, _ = belief.optimistic(points)
    spread = float(np.std(values)) or 1.0
    drawn: FloatArray = points[rng.choice(NET_SIZE, p=softmax(DRAW_BETA * values / spread))]
    return drawn


def box_around(centre: FloatArray | None, length: float, belief: Belief) -> tuple[FloatArray, FloatArray]:
    """Corners of a search's box, shape (d,) each, longer where the function varies less; the cube without a centre.

    Args:
        centre: of the search, shape (d,), if it has one.
        length: base side length.
        belief: what is believed.
    """
    if centre is None:
        return np.zeros(belief.dim), np.ones(belief.dim)
    return TrustRegion(length).box(centre, np.minimum(belief.value.lengthscales, LONGEST_SCALE))


def steps_from(centre: FloatArray | None, length: float, dim: int, rng: np.random.Generator) -> FloatArray:
    """Points that differ from the centre in a few coordinates, shape (NUM_STEPS, d); any points without a centre."""
    shape = NUM_STEPS, dim
    if centre is None:
        return rng.random(shape)
    moved = rng.random(shape) < MOVED_SHARE
    moved[np.arange(NUM_STEPS), rng.integers(dim, size=NUM_STEPS)] = True
    return np.clip(centre + STEP_SD * length * moved * rng.standard_normal(shape), 0.0, 1.0)
