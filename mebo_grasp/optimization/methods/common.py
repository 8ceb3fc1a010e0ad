"""Parts that several methods share: the default solution set and points where nothing has been tried."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.unscented import UnscentedTransform, unscented_outcomes
from mebo_grasp.optimization.methods.base import IndexArray, MethodSettings, Outcomes
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.selection.solution_set import DEFAULT_SHARE, greedy_diverse_set

DEFAULT_NUM_SOLUTIONS = 4
"""Number of solutions M of methods that need one, where none is given (thesis 7.4 for bottle and vase)."""

SAME_POINT = 1e-9
"""Points closer than this in every coordinate of the unit cube count as the same point."""


class MethodBase:
    """Holds space and settings and answers the solution set greedily; a method may do better.

    Args:
        space: the search space.
        settings: settings of the run.

    Raises:
        InvalidSettingsError: the run is to be safe and the noise does not fit the space.
    """

    name = "base"

    safe = False
    """Whether input noise counts whatever the settings say."""

    def __init__(self, space: SearchSpace, settings: MethodSettings) -> None:
        self.space = space
        self.settings = settings
        self._phase = self.name
        self.transform: UnscentedTransform | None = None
        if settings.safe or self.safe:
            self.transform = UnscentedTransform.of_noise(settings.input_noise, space)

    def predictor(self, observations: Observations) -> Callable[[FloatArray], FloatArray]:
        """The surrogate's mean given all values, points (m, d) to means (m,), without learning anything.

        Raises:
            InvalidSettingsError: the method has no surrogate, so that a run cannot be safe.
        """
        del observations  # For those that have one.
        raise InvalidSettingsError(f"method {self.name} has no surrogate: choose another, or leave out safe")

    def outcomes(self, observations: Observations) -> Outcomes | None:
        """What is expected of the observed points under input noise (UBO paper, eq. 14); None if not asked for."""
        if self.transform is None:
            return None
        predict_mean = self.predictor(observations)
        expected, sd, worst = unscented_outcomes(predict_mean, observations.U, self.transform)
        return Outcomes(expected, sd, worst, expected)

    def ranking(self, observations: Observations) -> FloatArray:
        """By what solutions are ranked, shape (n,): expected value under input noise if that counts, else value."""
        outcomes = self.outcomes(observations)
        return observations.y if outcomes is None else outcomes.ranking

    def metric(self, min_distance: float | None = None) -> tuple[FloatArray, float]:
        """How different two points are, and when they count as different solutions.

        Args:
            min_distance: see ``MethodSettings``; default that of the settings, else a tenth of the cube's diagonal.

        Returns:
            (lengths of the cube's sides, shape (d,), smallest Euclidean distance in these).
        """
        distance = min_distance if min_distance is not None else self.settings.min_distance
        if distance is None:
            return np.ones(self.space.dim), DEFAULT_SHARE * float(np.sqrt(self.space.dim))
        return self.space.weighted_sides, distance

    @property
    def phase(self) -> str:
        """What the latest proposal was for."""
        return self._phase

    def solution_set(
        self, observations: Observations, size: int | None = None, min_distance: float | None = None
    ) -> IndexArray:
        """Best points down that keep the distance; see ``greedy_diverse_set``."""
        size = size if size is not None else self.settings.num_solutions
        sides, distance = self.metric(min_distance)
        return greedy_diverse_set(observations.U * sides, self.ranking(observations), size, distance)

    def state(self) -> dict[str, Any]:
        """Nothing but the phase."""
        return {"phase": self._phase}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue with the phase of ``state``."""
        self._phase = str(state.get("phase", self.name))


def without_repeats(points: FloatArray, observations: Observations, rng: np.random.Generator) -> FloatArray:
    """Move points that were tried or are being tried already.

    The trials are deterministic, so a repeated point teaches nothing, and a failed one would fail again. A
    repeat is moved by a small Gaussian step, a larger one each time it still coincides.

    Args:
        points: proposals, shape (count, d), unit cube.
        observations: what is known.
        rng: source of randomness.

    Returns:
        Points in the unit cube, shape (count, d), distinct from each other and from those taken.
    """
    taken = observations.taken
    result = np.clip(points, 0.0, 1.0)
    for i in range(len(result)):
        step = 1e-4
        while np.any(np.all(np.abs(np.concatenate([taken, result[:i]]) - result[i]) <= SAME_POINT, axis=1)):
            result[i] = np.clip(points[i] + step * rng.standard_normal(points.shape[1]), 0.0, 1.0)
            step = min(2.0 * step, 1.0)
    return result


def check_count(count: int) -> None:
    """Refuse to propose fewer than one point.

    Raises:
        InvalidSettingsError: count is below 1.
    """
    if count < 1:
        raise InvalidSettingsError(f"propose at least 1 point, got {count}")
