"""When the hyperparameters are learned again, and what the surrogates with one kernel share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

import numpy as np

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.gaussian_process import Hyperparameters
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel, LogNormalPrior
from mebo_grasp.optimization.surrogate.posterior import Posterior

AnyPosterior = TypeVar("AnyPosterior", bound=Posterior)


class RelearningSchedule:
    """Counts iterations from one learning to the next (thesis 7.2: every 5 iterations).

    Args:
        period: iterations from one learning to the next.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(self, period: int) -> None:
        if period < 1:
            raise InvalidSettingsError(f"relearn_period must be at least 1 iteration, got {period}")
        self._period = period
        self.iterations: int | None = None
        """Iterations since the latest learning; None before the first. Part of a surrogate's state."""

    @property
    def has_learned(self) -> bool:
        """Whether anything has been learned yet."""
        return self.iterations is not None

    def is_due(self, y: FloatArray) -> bool:
        """Whether this iteration, with values y of shape (n,), is to learn.

        Nothing can be learned from fewer than two values or from equal ones: the prior stays.
        """
        due = self.iterations is None or self.iterations >= self._period
        return due and len(y) >= 2 and bool(np.ptp(y) > 0.0)

    def count(self, learned: bool) -> None:
        """Note that an iteration is over, and whether it learned."""
        if learned:
            self.iterations = 0
        if self.iterations is not None:
            self.iterations += 1


class RelearningSurrogate(ABC, Generic[AnyPosterior]):
    """A surrogate with one kernel that learns its hyperparameters again every few iterations.

    Args:
        dim: number of dimensions.
        relearn_period: iterations from one learning to the next.
        kernel: covariance function.
        noise: prior of the noise variance of standardized values; default that of a simulated trial.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(
        self,
        dim: int,
        relearn_period: int = 5,
        kernel: Kernel = MATERN52,
        noise: LogNormalPrior | None = None,
    ) -> None:
        self._kernel = kernel
        self._noise = noise
        self._schedule = RelearningSchedule(relearn_period)
        self._default = Hyperparameters.default(dim, kernel)

    def update(self, observations: Observations, rng: np.random.Generator) -> AnyPosterior:
        """Return the posterior given all values; learns anew when due. To be called once an iteration."""
        due = self._schedule.is_due(observations.y)
        if due:
            self._learn(observations, rng)
        self._schedule.count(due)
        return self.posterior(observations)

    @abstractmethod
    def posterior(self, observations: Observations) -> AnyPosterior:
        """Return the posterior given all values with what is learned as it is."""

    @abstractmethod
    def _learn(self, observations: Observations, rng: np.random.Generator) -> None:
        """Learn from all values; what was known before is a place to start from if the schedule has learned."""

    @abstractmethod
    def _learned(self) -> dict[str, Any]:
        """What is learned, as JSON values."""

    @abstractmethod
    def _restore_learned(self, state: dict[str, Any]) -> None:
        """Take over what ``_learned`` returned.

        Raises:
            RunLogError: it does not fit.
            KeyError, TypeError, ValueError: it is unreadable.
        """

    def _draws_of(self, vectors: Any) -> list[Hyperparameters]:
        """Hyperparameters from their vectors in a state, any number of shape (p + 1,).

        Raises:
            RunLogError: these are none, of another size or not finite.
            TypeError, ValueError: these are no numbers.
        """
        size = self._default.vector.size
        draws = np.array(vectors, dtype=np.float64)
        if draws.ndim != 2 or draws.shape[1] != size or not len(draws) or not np.all(np.isfinite(draws)):
            raise RunLogError(f"the surrogate's state needs draws of {size} finite parameters, got {vectors}")
        return [Hyperparameters.from_vector(draw) for draw in draws]

    def state(self) -> dict[str, Any]:
        """What ``restore`` needs, as JSON values."""
        return {**self._learned(), "iterations_since_learning": self._schedule.iterations}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned.

        Raises:
            RunLogError: the state does not fit.
        """
        try:
            count = state["iterations_since_learning"]
            iterations = None if count is None else int(count)
            self._restore_learned(state)
        except (KeyError, TypeError, ValueError) as error:
            raise RunLogError(f"the surrogate's state is unreadable: {error!r}") from error
        self._schedule.iterations = iterations
