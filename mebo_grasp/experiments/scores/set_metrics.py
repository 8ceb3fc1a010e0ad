"""What a set or an archive of solutions is worth: quality, diversity, and what is left when a part is blocked.

Notation: n evaluated points X, shape (n, d), with values y, shape (n,), NaN for failed trials; larger is better.
Lengths are in the units of the space.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.selection.solution_set import greedy_diverse_set
from mebo_grasp.solutions.diversity import mutually_diverse_count

HYPERVOLUME_STEPS = 20


def best_so_far(y: FloatArray) -> FloatArray:
    """Return the best value after each evaluation, shape (n,); NaN before the first value."""
    return np.asarray(np.fmax.accumulate(y)) if len(y) else np.empty(0)


def best_value(y: FloatArray) -> float:
    """Return the best value; NaN if no trial gave one."""
    values = y[np.isfinite(y)]
    return float(np.max(values)) if len(values) else float("nan")


def diverse_count(X: FloatArray, min_distance: float) -> int:
    """Return M_d: points closer than tau, also by a chain, count as one (thesis, sections 5.3.1 and 7.4.2).

    Args:
        X: the set, shape (m, d).
        min_distance: tau.
    """
    return mutually_diverse_count(cdist(X, X), min_distance) if len(X) else 0


def occluded_best(y: FloatArray, available: npt.NDArray[np.bool_]) -> float:
    """Return the best value among the points that an occlusion leaves; 0 if it leaves none (thesis, 7.4.3)."""
    best = best_value(y[available])
    return 0.0 if np.isnan(best) else best


def retention(positions: FloatArray, y: FloatArray, radius: float) -> float:
    """Return the best value left, over the best, when every point within a radius of the best one is blocked.

    Args:
        positions: where, shape (n, k).
        y: values.
        radius: of the blocked ball; a point on its surface is blocked.

    Returns:
        A share in [0, 1]; 0 if nothing above 0 is left, NaN if there is no value above 0 at all.
    """
    best = best_value(y)
    if not best > 0.0:
        return float("nan")
    center = positions[int(np.nanargmax(y))]
    left = best_value(y[np.linalg.norm(positions - center, axis=1) > radius])
    return max(left, 0.0) / best if np.isfinite(left) else 0.0


def hypervolume(points: FloatArray) -> float:
    """Return the area dominated by points of two objectives, both maximized, over the origin.

    Args:
        points: shape (n, 2); what is not above 0 in both dominates nothing.
    """
    area, height = 0.0, 0.0
    for first, second in sorted(points.tolist(), reverse=True):
        if first > 0.0 and second > height:
            area += first * (second - height)
            height = second
    return area


def quality_diversity_volume(X: FloatArray, y: FloatArray, size: int, farthest: float) -> float:
    """Return the hypervolume of quality and diversity that an archive offers, in the unit of quality.

    For each least distance between 0 and ``farthest`` the greedy set of M points is taken; its two objectives are
    that distance and the mean quality over M places, empty places counting 0. The area is divided by ``farthest``: an
    archive whose sets keep a quality q at every distance has q.

    Args:
        X: points, shape (n, d).
        y: values.
        size: M.
        farthest: the greatest least distance asked for.
    """
    valued = np.isfinite(y)
    X, y = X[valued], y[valued]
    if not len(y):
        return 0.0
    points = []
    for distance in np.linspace(0.0, farthest, HYPERVOLUME_STEPS + 1)[1:]:
        rows = greedy_diverse_set(X, y, size, float(distance))
        points.append((distance / farthest, float(np.sum(np.maximum(y[rows], 0.0))) / size))
    return hypervolume(np.array(points))
