"""The upper confidence bound (thesis, section 3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import MomentAcquisition


@dataclass(frozen=True)
class UpperConfidenceBound(MomentAcquisition):
    """UCB: mean + beta sd.

    Args:
        beta: weight of the standard deviation, at least 0 (thesis 7.2: 2).

    Raises:
        InvalidSettingsError: beta is negative or not finite.
    """

    beta: float = 2.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.beta < float("inf"):
            raise InvalidSettingsError(f"ucb beta must be finite and at least 0, got {self.beta}")

    @property
    def name(self) -> str:
        """Name for logs and reports."""
        return "ucb"

    def value(self, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Upper confidence bound, shape (m,), units of y."""
        return mean + self.beta * sd

    def partials(self, mean: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """1 and beta."""
        return np.ones_like(mean), np.full_like(sd, self.beta)
