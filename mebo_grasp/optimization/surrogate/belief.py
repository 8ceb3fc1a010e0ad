"""What is believed of a function that may have a plateau: whether a point is off it, and how good it is then.

A grasp's quality is 0 wherever the open hand collides or the closed one does not hold, which is most of the
space, and varies smoothly on the rest. One stationary Gaussian process can only take the cliff between the two
for short lengthscales everywhere. Here one part is learned from the values off the plateau alone, and another
from labels, +1 off the plateau and -1 on it (least-squares classification, Rasmussen and Williams 2006, section
6.5). The function is off the plateau where the second part's latent function is positive (a hurdle model, Mullahy
1986).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import log_ndtr

from mebo_grasp.errors import RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.empirical_bayes import EmpiricalBayesSurrogate
from mebo_grasp.optimization.surrogate.family import PLATEAU_SHARE, PLATEAU_SIZE, Structure
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess
from mebo_grasp.optimization.surrogate.kernels import MATERN52, LogNormalPrior
from mebo_grasp.optimization.surrogate.structure import StructuredSurrogate

BoolArray = npt.NDArray[np.bool_]

LABEL_NOISE = (0.3, 0.5, 0.1, 1.0)
"""Median, spread and bounds of the noise variance of standardized labels."""
FEWEST_VALUES = 3
"""Values off the plateau from which on they are modelled by themselves."""


def label_noise_prior() -> LogNormalPrior:
    """Prior of the noise variance of standardized labels.

    Labels jump from -1 to +1 at a cliff. A smooth function that has to pass through all of them needs short
    lengthscales along dimensions that tell nothing, and overshoots beyond the cliff.
    """
    return LogNormalPrior.repeated(1, *LABEL_NOISE)


@dataclass(frozen=True, eq=False)
class Belief:
    """A Gaussian process of the values, with the chance that a point is off the plateau if there is one.

    Args:
        U: observed and assumed points, shape (n, d), unit cube.
        y: their values, shape (n,).
        value: the values' posterior; where there is a plateau, of those off it.
        chance: posterior of the labels; None without a plateau.
        floor: value on the plateau.
    """

    U: FloatArray
    y: FloatArray
    value: GaussianProcess
    chance: GaussianProcess | None = None
    floor: float = 0.0

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return self.value.dim

    @property
    def parts(self) -> tuple[GaussianProcess, ...]:
        """The Gaussian processes that it consists of."""
        return (self.value,) if self.chance is None else (self.value, self.chance)

    def predict(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation off the plateau, shape (m,) each, at A, shape (m, d)."""
        return self.value.predict(A)

    def predict_observed(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation off the plateau at the own points U, shape (n,) each."""
        return self.value.predict_observed() if self.chance is None else self.value.predict(self.U)

    def predict_with_gradients(self, A: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean and standard deviation off the plateau, shape (m,), and their gradients, shape (m, d)."""
        return self.value.predict_with_gradients(A)

    def log_chances(self, A: FloatArray) -> FloatArray:
        """Log probability to be off the plateau, shape (m,)."""
        if self.chance is None:
            return np.zeros(len(A))
        mean, sd = self.chance.predict(A)
        value: FloatArray = log_ndtr(mean / np.hypot(sd, self.chance.noise_sd))
        return value

    def log_chances_with_gradients(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log probability to be off the plateau, shape (m,), and its gradient, shape (m, d)."""
        if self.chance is None:
            return np.zeros(len(A)), np.zeros_like(A)
        mean, sd, d_mean, d_sd = self.chance.predict_with_gradients(A)
        total = np.hypot(sd, self.chance.noise_sd)
        t = mean / total
        value = log_ndtr(t)
        mills = np.exp(-0.5 * t * t - 0.5 * np.log(2.0 * np.pi) - value)
        d_t = d_mean / total[:, None] - (t * sd / total**2)[:, None] * d_sd
        return value, mills[:, None] * d_t

    def predict_mean(self, A: FloatArray) -> FloatArray:
        """Mean of the function, plateau included, shape (m,)."""
        mean = self.value.predict_mean(A)
        if self.chance is None:
            return mean
        total: FloatArray = self.floor + self._mean_chances(self.chance, A)[0] * (mean - self.floor)
        return total

    def mean_gradient(self, A: FloatArray) -> FloatArray:
        """Gradient of ``predict_mean``, shape (m, d)."""
        d_mean = self.value.mean_gradient(A)
        if self.chance is None:
            return d_mean
        chance, open_ends = self._mean_chances(self.chance, A)
        d_chance = np.where(open_ends[:, None], 0.5 * self.chance.mean_gradient(A), 0.0)
        gain = self.value.predict_mean(A) - self.floor
        gradient: FloatArray = chance[:, None] * d_mean + gain[:, None] * d_chance
        return gradient

    @staticmethod
    def _mean_chances(labels: GaussianProcess, A: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Chances by the mean label alone, and whether they lie between 0 and 1, shape (m,) each.

        The mean label is 2 p - 1. That is rougher than ``log_chances``, but needs no variance.
        """
        chance = 0.5 * (1.0 + labels.predict_mean(A))
        return np.clip(chance, 0.0, 1.0), (chance > 0.0) & (chance < 1.0)

    def lifted(self, values: FloatArray, log_chances: FloatArray) -> FloatArray:
        """Values off the plateau, shape (m,), brought down to it by the chance not to be off it, shape (m,)."""
        return self.floor + np.exp(log_chances) * (values - self.floor) if self.chance is not None else values

    def optimistic(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean plus standard deviation, times the chance, above the plateau: values (m,) and gradients (m, d)."""
        mean, sd, d_mean, d_sd = self.value.predict_with_gradients(A)
        high, d_high = mean + sd, d_mean + d_sd
        if self.chance is None:
            return high, d_high
        log_chances, d_log_chances = self.log_chances_with_gradients(A)
        gain, chance = high - self.floor, np.exp(log_chances)
        return self.floor + chance * gain, chance[:, None] * (d_high + gain[:, None] * d_log_chances)

    def condition_on(self, A: FloatArray) -> Belief:
        """With the own mean off the plateau, and the own label, assumed at A, shape (m, d)."""
        assumed = self.value.predict_mean(A)
        chance = self.chance
        if chance is not None:
            chance = chance.condition_on(A, chance.predict_mean(A))
        return Belief(
            np.concatenate([self.U, A]),
            np.concatenate([self.y, assumed]),
            self.value.condition_on(A, assumed),
            chance,
            self.floor,
        )


@dataclass(frozen=True, eq=False)
class Beliefs:
    """What the members of the family believe, each with its share of the evidence.

    Args:
        members: the most probable first, at least one.
        shares: shape (len(members),), sum 1.
    """

    members: tuple[Belief, ...]
    shares: FloatArray

    @property
    def best(self) -> Belief:
        """The most probable one."""
        return self.members[0]

    def condition_on(self, A: FloatArray) -> Beliefs:
        """Each with its own mean assumed at A, shape (m, d), for trials whose values are not known."""
        return Beliefs(tuple(member.condition_on(A) for member in self.members), self.shares)


class PlateauSurrogate:
    """Learns values and, if they have a plateau, where it is.

    Args:
        dim: number of dimensions.
        relearn_period: iterations from one learning of the hyperparameters to the next.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(self, dim: int, relearn_period: int = 5) -> None:
        self._whole = StructuredSurrogate(dim, relearn_period)
        self._above = StructuredSurrogate(dim, relearn_period, structures=(Structure(MATERN52),))
        self._labels = EmpiricalBayesSurrogate(dim, relearn_period, noise=label_noise_prior())

    def belief(self, U: FloatArray, y: FloatArray) -> Belief:
        """What the most probable member believes, without learning anything."""
        off = _off_plateau(y)
        if off is None:
            return Belief(U, y, self._whole.posterior(U, y))
        hyper = self._labels.hyperparameters
        chance = GaussianProcess.fit(U, np.where(off, 1.0, -1.0), hyper)
        return Belief(U, y, self._above.posterior(U[off], y[off]), chance, float(np.min(y)))

    def update(self, U: FloatArray, y: FloatArray, rng: np.random.Generator) -> Beliefs:
        """Return what is believed given all values; relearns when due. To be called once an iteration."""
        off = _off_plateau(y)
        if off is None:
            mixture = self._whole.update(U, y, rng)
            return Beliefs(tuple(Belief(U, y, value) for value in mixture.posteriors), mixture.shares)
        labels = Observations(U.shape[1])
        for u, is_off in zip(U, off, strict=True):
            labels.add(u, 1.0 if is_off else -1.0)
        chance = self._labels.update(labels, rng)
        mixture = self._above.update(U[off], y[off], rng)
        floor = float(np.min(y))
        return Beliefs(tuple(Belief(U, y, value, chance, floor) for value in mixture.posteriors), mixture.shares)

    def state(self) -> dict[str, Any]:
        """What ``restore`` needs, as JSON values."""
        return {
            "whole": self._whole.state(),
            "above": self._above.state(),
            "labels": self._labels.state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned.

        Raises:
            RunLogError: the state does not fit.
        """
        for name in ("whole", "above", "labels"):
            if not isinstance(state.get(name), dict):
                raise RunLogError(f"the surrogate's state needs the part {name!r}, got {state.get(name)!r}")
        self._whole.restore(state["whole"])
        self._above.restore(state["above"])
        self._labels.restore(state["labels"])


def shows_too_little(y: FloatArray) -> bool:
    """Whether values, shape (n,), have a plateau and next to nothing off it, so that nothing can be learned."""
    off = y > np.min(y, initial=np.inf)
    return _showed_plateau(~off) and int(np.count_nonzero(off)) < FEWEST_VALUES


def _off_plateau(y: FloatArray) -> BoolArray | None:
    """Which values are off the plateau, shape (n,); None if there is no plateau or hardly a value off it."""
    off: BoolArray = y > np.min(y, initial=np.inf)
    return off if _showed_plateau(~off) and np.count_nonzero(off) >= FEWEST_VALUES else None


def _showed_plateau(lowest: BoolArray) -> bool:
    """Whether the values ever looked like a plateau, given which of them equal the lowest, shape (n,).

    The search leaves a plateau, so that its share of the trials falls below any bound although it is still there.
    """
    counts = np.cumsum(lowest)
    trials = np.arange(1, len(lowest) + 1)
    return bool(np.any((counts >= PLATEAU_SIZE) & (counts >= PLATEAU_SHARE * trials)))
