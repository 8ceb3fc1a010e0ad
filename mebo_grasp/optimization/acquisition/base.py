"""What every acquisition function offers, and how it is evaluated on a posterior."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.posterior import Posterior


class Acquisition(Protocol):
    """A worth of points, given where they are and the posterior there."""

    @property
    def name(self) -> str:
        """Name for logs and reports."""

    def value_at(self, A: FloatArray, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Worth, shape (m,), of points A, shape (m, d), with posterior ``mean`` and ``sd``, shape (m,)."""


class MomentAcquisition(ABC):
    """A worth that depends on a point only through the posterior's mean and standard deviation there."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name for logs and reports."""

    @abstractmethod
    def value(self, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Worth, shape (m,), of points with posterior ``mean`` and ``sd``, each shape (m,), units of y."""

    @abstractmethod
    def partials(self, mean: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the worth by mean and by sd, each shape (m,)."""

    def value_at(self, A: FloatArray, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Worth, shape (m,); where the points are does not matter."""
        del A
        return self.value(mean, sd)


class PointFunction(Protocol):
    """A worth of points that is to be maximized; several points at once, with gradients."""

    def __call__(self, A: FloatArray) -> FloatArray:
        """Values, shape (m,), at points A, shape (m, d)."""

    def with_gradient(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, shape (m,), and gradients, shape (m, d)."""


class OnPosterior:
    """An acquisition function of points: ``acquisition`` evaluated on ``posterior``."""

    def __init__(self, acquisition: MomentAcquisition, posterior: Posterior) -> None:
        self._acquisition = acquisition
        self._posterior = posterior

    def __call__(self, A: FloatArray) -> FloatArray:
        """Values, shape (m,), at points A, shape (m, d)."""
        return self._acquisition.value(*self._posterior.predict(A))

    def with_gradient(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, shape (m,), and gradients, shape (m, d), by the chain rule."""
        mean, sd, d_mean, d_sd = self._posterior.predict_with_gradients(A)
        by_mean, by_sd = self._acquisition.partials(mean, sd)
        gradient = by_mean[:, None] * d_mean + by_sd[:, None] * d_sd
        return self._acquisition.value(mean, sd), np.asarray(gradient)
