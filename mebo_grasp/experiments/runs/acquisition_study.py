"""MEBO with one acquisition for the whole batch: the rows EI and UCB of the thesis's tables 7.2 to 7.4.

They are of use for that comparison only, so they are no methods of the registry; the row EI-UCB is
``mebo`` itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import Acquisition
from mebo_grasp.optimization.acquisition.confidence_bound import UpperConfidenceBound
from mebo_grasp.optimization.acquisition.improvement import ExpectedImprovement
from mebo_grasp.optimization.methods.base import MethodSettings
from mebo_grasp.optimization.methods.mebo import Mebo
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.optimizer import Optimizer
from mebo_grasp.optimization.search_space import SearchSpace


class MeboByImprovement(Mebo):
    """Every query of a batch drawn by expected improvement."""

    name = "mebo_ei"

    def acquisitions(self, observations: Observations, count: int) -> Sequence[Acquisition]:
        """Expected improvement on the best value, once a query."""
        return [ExpectedImprovement(float(np.max(observations.y)))] * count


class MeboByBound(Mebo):
    """Every query of a batch drawn by the upper confidence bound."""

    name = "mebo_ucb"

    def acquisitions(self, observations: Observations, count: int) -> Sequence[Acquisition]:
        """The upper confidence bound, once a query."""
        del observations
        return [UpperConfidenceBound(self.settings.ucb_beta)] * count


_STUDIED: dict[str, Callable[[SearchSpace, MethodSettings], Mebo]] = {
    MeboByImprovement.name: MeboByImprovement,
    MeboByBound.name: MeboByBound,
}
STUDY_NAMES: tuple[str, ...] = tuple(_STUDIED)
"""Names of the study's methods."""


class StudyOptimizer:
    """One of the study's methods behind the ask/tell of the peers.

    Args:
        name: one of ``STUDY_NAMES``.
        space: the box.
        settings: the run's settings.
        seed: the run's seed.

    Raises:
        InvalidSettingsError: there is no such method.
    """

    def __init__(self, name: str, space: SearchSpace, settings: MethodSettings, seed: int) -> None:
        if name not in _STUDIED:
            raise InvalidSettingsError(f"studied method must be one of {', '.join(STUDY_NAMES)}, got {name!r}")
        self._optimizer = Optimizer(space, _STUDIED[name](space, settings), settings, seed)

    def ask(self, left: int) -> FloatArray:
        """The next batch, shape (m, d); the optimizer counts the budget itself."""
        del left
        return np.array([trial.x for trial in self._optimizer.ask()])

    def tell(self, points: FloatArray, values: FloatArray) -> None:
        """Learn the values of the open trials, in the order of asking."""
        del points
        for trial, value in zip(self._optimizer.pending, values, strict=True):
            self._optimizer.tell(trial.id, float(value))
