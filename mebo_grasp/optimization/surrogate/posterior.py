"""What methods need of a fitted surrogate, whichever it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, Self

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.observations import Observations


class Posterior(Protocol):
    """A belief about the objective. Points A have shape (m, d), unit cube; values are in units of y."""

    @property
    def dim(self) -> int:
        """Number of dimensions."""

    @property
    def U(self) -> FloatArray:  # noqa: N802
        """Observed points, shape (n, d)."""

    @property
    def centre(self) -> float:
        """Mean of the observed values."""

    @property
    def scale(self) -> float:
        """Standard deviation of the observed values."""

    @property
    def noise_sd(self) -> float:
        """Standard deviation of the learned noise."""

    @property
    def lengthscales(self) -> FloatArray:
        """How far the function stays alike along each axis, shape (d,), sides of the (mapped) cube."""

    def predict(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, shape (m,) each."""

    def predict_mean(self, A: FloatArray) -> FloatArray:
        """Mean, shape (m,)."""

    def mean_gradient(self, A: FloatArray) -> FloatArray:
        """Gradient of the mean, shape (m, d)."""

    def predict_with_gradients(self, A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean, standard deviation, shape (m,) each, and their gradients, shape (m, d) each."""

    def condition_on(self, A: FloatArray, values: FloatArray) -> Self:
        """The belief with further points and values, shape (m,)."""

    def sample_path(self, rng: np.random.Generator, n_features: int = 1024) -> Callable[[FloatArray], FloatArray]:
        """Draw one function."""


class Surrogate(Protocol):
    """Learns from observations, keeps its hyperparameters between iterations."""

    def update(self, observations: Observations, rng: np.random.Generator) -> Posterior:
        """Return the posterior given all values; to be called once an iteration."""

    def posterior(self, observations: Observations) -> Posterior:
        """Return the posterior given all values with the hyperparameters as they are."""

    def state(self) -> dict[str, Any]:
        """What ``restore`` needs, as JSON values."""

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned."""
