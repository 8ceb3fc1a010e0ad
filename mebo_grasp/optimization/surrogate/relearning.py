"""When the hyperparameters are learned again."""

from __future__ import annotations

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray


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
