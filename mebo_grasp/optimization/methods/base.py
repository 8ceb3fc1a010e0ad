"""What a method is: it proposes points in the unit cube and names the solution set, given what is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.observations import LEAST_NOISE, MOST_NOISE, Observations

IndexArray = npt.NDArray[np.int64]

DEFAULT_METHOD = "basin_search"
"""The method of the library, the command line and the node where none is named. It stands here and not in the
registry because a node's settings need the name without all methods' code."""

EVIDENCE, KUMARASWAMY, MCMC = "evidence", "kumaraswamy", "mcmc"
KERNEL_NAMES = (
    "matern52", "squared_exponential", "additive_matern52", "additive_squared_exponential", EVIDENCE
)  # fmt: skip
WARP_NAMES = ("none", KUMARASWAMY)
LEARNING_NAMES = ("empirical_bayes", MCMC)
GP, TREED_GP = "gp", "treed_gp"
SURROGATE_NAMES = (GP, TREED_GP)
DEFAULT_INPUT_SD = 0.03
"""Standard deviation of the inputs where none is given, sides of the cube (UBO paper, section V-B: grasps)."""


@dataclass(frozen=True)
class MethodSettings:
    """Settings of all methods; each uses those it needs.

    Args:
        batch_size: points of a batch B (thesis 7.2: 3).
        budget: evaluations in all N, the initial design included (thesis 7.2: 250).
        n_initial: points of the initial design I (thesis 7.2: 25).
        ucb_beta: weight of the standard deviation in UCB (thesis 7.2: 2).
        boltzmann_beta: inverse temperature of Boltzmann selection on the standardized acquisition.
        burn_in: discarded Metropolis–Hastings proposals per dimension and query (thesis 7.2: 250).
        chains: Metropolis–Hastings chains side by side for one query.
        proportional_selection: draw in proportion to the acquisition itself, as the thesis's code does.
        cluster_share: share of M clusters with which CL-MEBO is content when no decile gives M (thesis 5.3.1: 0.75;
            its code: 0.5).
        relearn_period: iterations from one learning of the hyperparameters to the next (thesis 7.2: 5).
        num_solutions: solutions wanted M, if known.
        min_distance: distance tau at which two solutions count as different: Euclidean, real units times the
            space's ``distance_weights``.
        threshold: least value of a good point, for methods that seek all points above one.
        kernel: covariance function, of ``KERNEL_NAMES``; ``evidence`` compares all of them, with and without
            warp, and weighs them by what the data say. For every method with a surrogate but ``basin_search``,
            which always goes by evidence; so ``warp`` and ``learning``.
        warp: learned monotone map of each input before the kernel, of ``WARP_NAMES``.
        learning: how the hyperparameters are learned, of ``LEARNING_NAMES``.
        noise_variance: of the values, as a share of their variance, where it is known; None to learn it. For every
            method whose kernel the settings name.
        safe: choose trials and solutions by what they are expected to yield under ``input_noise`` (``ubo`` always
            does). For every method with a surrogate.
        input_noise: how far a trial may miss its point.
        surrogate: ``gp``, or ``treed_gp`` for one Gaussian process a region, of ``SURROGATE_NAMES``.
        min_leaf: observations that a region of the treed surrogate has at least (paper: 8 to 20).
        tree_weight_power: k in the weights (2 / (1 + depth difference))^k of the likelihoods along a region's path to
            the root; None for infinity, its own observations alone.
        particles: draws m of the hyperparameters, for ``learning: mcmc``.
        improvement_margin: what ``bo`` and ``ubo`` want to improve on the best value by, standard deviations of the
            values (UBO paper's code: 0.01); 0 refines one summit for long before it looks for another.

    Raises:
        InvalidSettingsError: a number is out of its range, a name unknown, or two choices contradict.
    """

    batch_size: int = 3
    budget: int = 250
    n_initial: int = 25
    ucb_beta: float = 2.0
    boltzmann_beta: float = 3.0
    burn_in: int = 250
    chains: int = 16
    proportional_selection: bool = False
    cluster_share: float = 0.75
    relearn_period: int = 5
    num_solutions: int | None = None
    min_distance: float | None = None
    threshold: float | None = None
    kernel: str = "matern52"
    warp: str = "none"
    learning: str = "empirical_bayes"
    noise_variance: float | None = None
    safe: bool = False
    input_noise: InputNoise = field(default_factory=lambda: InputNoise((DEFAULT_INPUT_SD,)))
    surrogate: str = GP
    min_leaf: int = 20
    tree_weight_power: float | None = None
    particles: int = 10
    improvement_margin: float = 0.0

    def __post_init__(self) -> None:
        for name in ("batch_size", "budget", "burn_in", "chains", "relearn_period", "particles"):
            self._check_whole(name, 1)
        self._check_whole("n_initial", 0)
        if self.n_initial > self.budget:
            raise InvalidSettingsError(
                f"n_initial must lie between 0 and the budget {self.budget}, got {self.n_initial}"
            )
        for name in ("ucb_beta", "boltzmann_beta", "improvement_margin"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise InvalidSettingsError(f"{name} must be finite and at least 0, got {getattr(self, name)}")
        self._check_solutions()
        self._check_kernel()
        self._check_tree()

    def _check_whole(self, name: str, least: int) -> None:
        """Refuse all but a whole number; a numpy integer becomes a plain one, which JSON knows."""
        value = getattr(self, name)
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
            raise InvalidSettingsError(f"{name} must be a whole number of at least {least}, got {value!r}")
        object.__setattr__(self, name, int(value))

    def _check_solutions(self) -> None:
        if self.num_solutions is not None:
            self._check_whole("num_solutions", 1)
        if not 0.0 < self.cluster_share <= 1.0:
            raise InvalidSettingsError(f"cluster_share must lie above 0 and up to 1, got {self.cluster_share}")
        if self.threshold is not None and not math.isfinite(self.threshold):
            raise InvalidSettingsError(f"threshold must be finite or unset, got {self.threshold}")
        if self.min_distance is not None and not 0.0 < self.min_distance < math.inf:
            raise InvalidSettingsError(f"min_distance must be finite and above 0 or unset, got {self.min_distance}")

    def _check_kernel(self) -> None:
        choices = (("kernel", KERNEL_NAMES), ("warp", WARP_NAMES), ("learning", LEARNING_NAMES))
        for name, known in choices:
            if getattr(self, name) not in known:
                raise InvalidSettingsError(f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}")
        if self.noise_variance is not None and not LEAST_NOISE <= self.noise_variance <= MOST_NOISE:
            raise InvalidSettingsError(
                f"noise_variance must lie between {LEAST_NOISE:g} and {MOST_NOISE:g}, or be unset to learn it, got "
                f"{self.noise_variance}"
            )
        if self.kernel != EVIDENCE:
            return
        if (self.warp, self.learning) != (WARP_NAMES[0], LEARNING_NAMES[0]):
            raise InvalidSettingsError(
                f"kernel {EVIDENCE} chooses the warp itself and learns by {LEARNING_NAMES[0]}, got warp "
                f"{self.warp!r} and learning {self.learning!r}: leave these at their defaults or name a kernel"
            )
        if self.noise_variance is not None:
            raise InvalidSettingsError(
                f"kernel {EVIDENCE} learns the noise itself: leave noise_variance unset or name a kernel"
            )

    def _check_tree(self) -> None:
        if self.surrogate not in SURROGATE_NAMES:
            raise InvalidSettingsError(f"surrogate must be one of {', '.join(SURROGATE_NAMES)}, got {self.surrogate!r}")
        if self.surrogate == TREED_GP and self.kernel == EVIDENCE:
            raise InvalidSettingsError(
                f"surrogate {TREED_GP} needs a kernel of its own, got {EVIDENCE}: name another kernel"
            )
        self._check_whole("min_leaf", 2)
        if self.tree_weight_power is not None and not 0.0 <= self.tree_weight_power < math.inf:
            raise InvalidSettingsError(
                f"tree_weight_power must be at least 0, or unset for infinity, got {self.tree_weight_power}"
            )

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """Read back what ``dataclasses.asdict`` and JSON made of them; absent ones have their defaults.

        Raises:
            InvalidSettingsError: a value is out of its range.
            TypeError: a name is unknown.
        """
        noise = values.get("input_noise")
        return cls(**values) if noise is None else cls(**{**values, "input_noise": InputNoise.from_json(noise)})


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What is expected of points when they are carried out with input noise.

    Args:
        expected: expected value, shape (n,), units of y.
        sd: its standard deviation over executions, shape (n,).
        worst: worst value at the sigma points, shape (n,).
        ranking: by what solutions are ranked, shape (n,), a larger one first: the expected value, less what a method
            takes off for the standard deviation.
    """

    expected: FloatArray
    sd: FloatArray
    worst: FloatArray
    ranking: FloatArray


class Method(Protocol):
    """A named way to explore. Its state is JSON, so that a killed run can continue with the same trace."""

    @property
    def name(self) -> str:
        """The name in the registry."""

    @property
    def phase(self) -> str:
        """What the latest proposal was for, in a word or two."""

    def propose(self, observations: Observations, count: int, rng: np.random.Generator) -> FloatArray:
        """Return the next points to try, shape (count, d), unit cube.

        ``observations`` may hold any number of values, none included, failed points and open trials.
        """

    def solution_set(
        self, observations: Observations, size: int | None = None, min_distance: float | None = None
    ) -> IndexArray:
        """Return indices into ``observations.U`` of the good and diverse points, best first.

        Args:
            observations: what is known.
            size: largest number of points; default ``num_solutions`` of the settings, else the method's own.
            min_distance: smallest distance between two of them, see ``MethodSettings``; default that of the settings.
        """

    def outcomes(self, observations: Observations) -> Outcomes | None:
        """What is expected of the points of ``observations.U`` under input noise; None unless the run is safe."""

    def state(self) -> dict[str, Any]:
        """What ``restore`` needs, as JSON values."""

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned.

        Raises:
            RunLogError: the state does not fit.
        """


def state_int(state: dict[str, Any], key: str) -> int:
    """Return a counter of a method's state.

    Raises:
        RunLogError: it is absent or no integer >= 0.
    """
    value = state.get(key)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise RunLogError(f"the method's state needs an integer {key} >= 0, got {value!r}")
    return value


def state_part(state: dict[str, Any], key: str) -> dict[str, Any]:
    """Return the state of a part of a method.

    Raises:
        RunLogError: it is absent or no record.
    """
    part = state.get(key)
    if not isinstance(part, dict):
        raise RunLogError(f"the method's state needs a record {key}, got {part!r}")
    return part
