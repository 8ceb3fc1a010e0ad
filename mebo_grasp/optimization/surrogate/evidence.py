"""The structure chosen by evidence, for every method that works on the common posterior."""

from __future__ import annotations

from typing import Any

import numpy as np

from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.mixture import MixtureProcess
from mebo_grasp.optimization.surrogate.structure import StructuredSurrogate


class EvidenceSurrogate:
    """The family of ``structure`` behind the interface of the other surrogates.

    As long as the evidence does not decide, the posterior is the mixture of the members that are believed.

    Args:
        dim: number of dimensions.
        relearn_period: iterations from one learning of the hyperparameters to the next.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(self, dim: int, relearn_period: int = 5) -> None:
        self._family = StructuredSurrogate(dim, relearn_period)

    def update(self, observations: Observations, rng: np.random.Generator) -> MixtureProcess:
        """Return the posterior given all values; relearns when due. To be called once an iteration."""
        believed = self._family.update(observations.U, observations.y, rng)
        return MixtureProcess(believed.posteriors, believed.shares)

    def posterior(self, observations: Observations) -> MixtureProcess:
        """Return that of the most probable member given all values, without learning anything."""
        return MixtureProcess.equal([self._family.posterior(observations.U, observations.y)])

    def state(self) -> dict[str, Any]:
        """What ``restore`` needs, as JSON values."""
        return self._family.state()

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned.

        Raises:
            RunLogError: the state does not fit.
        """
        self._family.restore(state)
