"""Where a worth is greatest: DIRECT or a Sobol net for the region, L-BFGS-B for the summit (thesis 3.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import direct, minimize

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import PointFunction
from mebo_grasp.optimization.initial_design import sobol


class NumericGradient:
    """A worth without analytic gradient: central differences, evaluated as one batch.

    Args:
        function: points (m, d) to values (m,); a larger value is better.
        step: half the difference, sides of the cube.
    """

    def __init__(self, function: Callable[[FloatArray], FloatArray], step: float = 1e-6) -> None:
        self._function = function
        self._step = step

    def __call__(self, A: FloatArray) -> FloatArray:
        """Values, shape (m,), at points A, shape (m, d)."""
        return self._function(A)

    def with_gradient(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, shape (m,), and gradients, shape (m, d)."""
        m, dim = A.shape
        shifts = self._step * np.concatenate([np.zeros((1, dim)), np.eye(dim), -np.eye(dim)])
        values = self._function((A[:, None, :] + shifts[None]).reshape(-1, dim)).reshape(m, 2 * dim + 1)
        with np.errstate(invalid="ignore"):  # -inf minus -inf, where a log worth vanishes
            gradient = (values[:, 1 : dim + 1] - values[:, dim + 1 :]) / (2.0 * self._step)
        return values[:, 0], gradient


@dataclass(frozen=True)
class MaximizerSettings:
    """How the maximum is sought.

    Args:
        direct_evaluations: evaluations of DIRECT per dimension; 0 leaves it out.
        net_evaluations: points of the Sobol net per dimension.
        refinements: points from which L-BFGS-B climbs.
        max_iterations: of each climb.

    Raises:
        InvalidSettingsError: a number is negative, or nothing is evaluated.
    """

    direct_evaluations: int = 50
    net_evaluations: int = 256
    refinements: int = 2
    max_iterations: int = 30

    def __post_init__(self) -> None:
        numbers = (self.direct_evaluations, self.net_evaluations, self.refinements, self.max_iterations)
        if min(numbers) < 0 or self.direct_evaluations + self.net_evaluations == 0:
            raise InvalidSettingsError(f"need non-negative numbers and some evaluations, got {self}")


def climb(
    function: PointFunction, start: FloatArray, lower: FloatArray, upper: FloatArray, max_iterations: int = 50
) -> tuple[FloatArray, float]:
    """Climb from ``start``, shape (d,), inside the box by L-BFGS-B. Returns (point (d,), value)."""

    def objective(u: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = function.with_gradient(u[None])
        if not np.isfinite(value[0]):
            return 1e300, np.zeros_like(u)
        return -float(value[0]), -np.nan_to_num(gradient[0])

    bounds = list(zip(lower, upper, strict=True))
    result = minimize(objective, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": max_iterations})
    point = np.clip(result.x, lower, upper)
    return point, float(function(point[None])[0])


def maximize(
    function: PointFunction,
    lower: FloatArray,
    upper: FloatArray,
    rng: np.random.Generator,
    settings: MaximizerSettings | None = None,
    candidates: FloatArray | None = None,
) -> tuple[FloatArray, float]:
    """Find the greatest value in a box.

    Args:
        function: the worth.
        lower: corner of the box, shape (d,).
        upper: corner of the box, shape (d,).
        rng: scrambles the net.
        settings: how to search.
        candidates: further points to start from, shape (k, d), e.g. around the incumbent.

    Returns:
        (point (d,), value).
    """
    settings = settings or MaximizerSettings()
    dim = len(lower)
    pool = [lower + (upper - lower) * sobol(settings.net_evaluations * dim, dim, rng)]
    if candidates is not None:
        pool.append(np.clip(candidates, lower, upper))
    if settings.direct_evaluations:
        pool.append(_direct(function, lower, upper, settings.direct_evaluations * dim)[None])
    points = np.concatenate(pool)
    values = np.nan_to_num(function(points), nan=-np.inf)
    order = np.argsort(-values, kind="stable")
    best, best_value = points[order[0]], float(values[order[0]])
    for start in _spread(points[order], settings.refinements, 0.05 * (upper - lower)):
        point, value = climb(function, start, lower, upper, settings.max_iterations)
        if value > best_value:
            best, best_value = point, value
    return best, best_value


def _direct(function: PointFunction, lower: FloatArray, upper: FloatArray, evaluations: int) -> FloatArray:
    def objective(u: FloatArray) -> float:
        value = float(function(np.asarray(u)[None])[0])
        # DIRECT needs finite values everywhere: a log worth may be minus infinity.
        return -max(value, -1e300) if np.isfinite(value) else 1e300

    bounds = list(zip(lower, upper, strict=True))
    result = direct(objective, bounds, maxfun=evaluations, locally_biased=True)
    return np.clip(np.asarray(result.x, dtype=np.float64), lower, upper)


def _spread(ranked: FloatArray, count: int, distance: FloatArray) -> list[FloatArray]:
    """The best ``count`` points of which no two lie within ``distance`` in every coordinate."""
    chosen: list[FloatArray] = []
    for point in ranked:
        if len(chosen) >= count:
            break
        if all(np.any(np.abs(point - other) > distance) for other in chosen):
            chosen.append(point)
    return chosen
