"""Random shifts, scales and rotations of a problem within its own box.

A method that profits from optima on a grid, on the axes or in the middle of the box must do as well
on the transformed problem. The map is a similarity: the optima keep their number and value, and the
niche radius scales with it. The published domain becomes a smaller, turned domain inside the box;
outside of it the function goes on as the value at the nearest domain point, minus a fall with the
distance, so that no maximum is added and none is lost. The fall begins as steep as the function
itself (so that an optimum on the domain's border stays a peak) and levels off (so that the outside
is no pit that dwarfs the function).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from mebo_grasp.experiments.problems.problem import Problem, VectorFunction
from mebo_grasp.grasp import FloatArray

SMALLEST_SCALE = 0.8
"""Share of the largest scale at which the turned domain still fits into the box."""
_DIFFERENCE_STEP = 1e-5
"""Step of the central differences that estimate the steepness, share of the box."""


@dataclass(frozen=True, eq=False)
class _Similarity:
    """Maps the published domain into the box: new = target + scale * R (old - middle)."""

    scale: float
    R: FloatArray
    middle: FloatArray
    target: FloatArray

    def forward(self, X: FloatArray) -> FloatArray:
        return np.asarray(self.target + self.scale * (X - self.middle) @ self.R.T)

    def backward(self, X: FloatArray) -> FloatArray:
        return np.asarray(self.middle + (X - self.target) @ self.R / self.scale)


def _random_turn(dim: int, rng: np.random.Generator) -> FloatArray:
    """A rotation by a uniform angle in two dimensions, reflections of random axes in others, shape (d, d)."""
    if dim == 2:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.diag(rng.choice([-1.0, 1.0], size=dim))


def _draw_similarity(problem: Problem, rng: np.random.Generator) -> _Similarity:
    width = problem.upper - problem.lower
    middle = 0.5 * (problem.upper + problem.lower)
    R = _random_turn(problem.dim, rng)
    extent = np.abs(R) @ width
    scale = float(np.min(width / extent)) * rng.uniform(SMALLEST_SCALE, 1.0)
    room = 0.5 * (width - scale * extent)
    return _Similarity(scale, R, middle, middle + rng.uniform(-1.0, 1.0, problem.dim) * room)


def _spread_and_slope(problem: Problem) -> tuple[float, float]:
    """Optimum minus median value, and median length of the gradient, over a fixed net of the box."""
    width = problem.upper - problem.lower
    unit = qmc.Sobol(problem.dim, scramble=False).random_base2(8)
    X = problem.lower + width * np.clip(unit, _DIFFERENCE_STEP, 1.0 - _DIFFERENCE_STEP)
    slopes = np.empty_like(X)
    for axis, step in enumerate(_DIFFERENCE_STEP * width):
        offset = np.zeros(problem.dim)
        offset[axis] = step
        slopes[:, axis] = (problem.function(X + offset) - problem.function(X - offset)) / (2.0 * step)
    spread = problem.optimum_value - float(np.median(problem.function(X)))
    return spread, float(np.median(np.linalg.norm(slopes, axis=1)))


def _continued(problem: Problem, similarity: _Similarity) -> VectorFunction:
    spread, slope = _spread_and_slope(problem)
    lower, upper, function = problem.lower, problem.upper, problem.function

    def evaluate(X: FloatArray) -> FloatArray:
        old = similarity.backward(X)
        nearest = np.clip(old, lower, upper)
        distance = np.linalg.norm(old - nearest, axis=1)
        return np.asarray(function(nearest) + spread * np.expm1(-slope * distance / spread))

    return evaluate


def transform(problem: Problem, seed: int) -> Problem:
    """Shift, scale and turn a problem at random within its box.

    Args:
        problem: a problem as published.
        seed: decides the draw; the same seed and problem give the same transformed problem.

    Returns:
        The problem on the same box, with the optima, the niche radius and the function mapped.
    """
    rng = np.random.default_rng([seed, problem.number, problem.dim])
    similarity = _draw_similarity(problem, rng)
    moved = similarity.forward(problem.optima)
    return replace(
        problem,
        niche_radius=problem.niche_radius * similarity.scale,
        function=_continued(problem, similarity),
        optima=np.clip(moved, problem.lower, problem.upper),
        variant=f"t{seed}",
        scale=similarity.scale,
    )
