"""What an experiment maximizes: a small value that names it, and what evaluates it once it is opened.

An objective is a frozen dataclass whose fields are its settings, so that it can be sent to another process, written
down as JSON and read from YAML. A package of your own adds one by an entry point of the group
``mebo_grasp.objectives`` (docs/experiments.md); nothing else of it needs to be known here.
"""

from __future__ import annotations

import hashlib
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import MISSING, asdict, dataclass, fields
from typing import Any

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.search_space import SearchSpace

BatchFunction = Callable[[FloatArray], FloatArray]
"""Maps points of shape (n, d) to values of shape (n,)."""


@dataclass(frozen=True, eq=False)
class NoisyOutcome:
    """What came of a point that was carried out many times with noise.

    Args:
        mean, sd, worst: of the values; sd with n - 1 in the divisor.
    """

    mean: float
    sd: float
    worst: float


@dataclass(frozen=True, eq=False)
class Evaluator:
    """An opened objective.

    Args:
        space: the box that is searched.
        function: maps points of shape (n, d), real units, to values of shape (n,); larger is better. A value that is
            not finite says that the trial failed. ``pointwise`` makes one of a function of a single point.
        judge: if given, what comes of a point, shape (d,), in execution: it is asked of the point that a method
            recommends after each batch.
    """

    space: SearchSpace
    function: BatchFunction
    judge: Callable[[FloatArray], NoisyOutcome] | None = None

    def __call__(self, X: FloatArray) -> FloatArray:
        """Evaluate points of shape (n, d); returns values of shape (n,), NaN for a failed trial.

        Raises:
            InvalidSettingsError: the function gave another number of values.
        """
        values = np.array(self.function(X), dtype=np.float64)
        if values.shape != (len(X),):
            raise InvalidSettingsError(f"{len(X)} points need as many values, the objective gave {values.shape}")
        values[~np.isfinite(values)] = math.nan
        return values


@dataclass(frozen=True)
class WantedSet:
    """The set of solutions that an objective asks for.

    Args:
        size: M, how many solutions.
        distance: tau, smallest distance between two of them: Euclidean, real units times the space's
            ``distance_weights``; 0 for any.
    """

    size: int = 1
    distance: float = 0.0


def pointwise(function: Callable[[FloatArray], float]) -> BatchFunction:
    """Turn a function of one point, shape (d,), into one of many."""

    def batch(X: FloatArray) -> FloatArray:
        return np.array([float(function(x)) for x in X], dtype=np.float64)

    return batch


@dataclass(frozen=True, eq=False)
class Recommendation:
    """The point that a method would have carried out, had the run ended there.

    Args:
        evaluations: how many there were.
        x: the point, shape (d,), real units.
        outcome: what came of it.
    """

    evaluations: int
    x: FloatArray
    outcome: NoisyOutcome


@dataclass(frozen=True, eq=False)
class Trace:
    """What a run evaluated, in the order of asking.

    Args:
        X: points, shape (n, d), real units.
        y: values, shape (n,); NaN for failed trials.
        batches: for each ask after the initial design the rows of its points.
        solutions: points of the set that the method returned, shape (m, d), best first.
        recommended: one after each batch since the initial design, where the objective judges them.
        names: of the dimensions; may be missing.
        weights: of the dimensions in distances, shape (d,); 1 each if None.
        first_split: after how many values a treed surrogate divided the space; None if it never did, or is no tree.
    """

    X: FloatArray
    y: FloatArray
    batches: list[list[int]]
    solutions: FloatArray
    recommended: tuple[Recommendation, ...] = ()
    names: tuple[str, ...] = ()
    weights: FloatArray | None = None
    first_split: int | None = None


@dataclass(frozen=True)
class Objective(ABC):
    """Base of all objectives; a subclass is a frozen dataclass whose fields are its settings."""

    @property
    @abstractmethod
    def label(self) -> str:
        """Name in folders and tables: letters, digits and ``._~-``, with ``/`` between folders."""

    @property
    def column(self) -> str:
        """Head of its columns in tables."""
        return self.label

    @property
    def group(self) -> str:
        """What its values are measured in; only objectives of one group stand in one table."""
        return ""

    def check(self) -> None:  # noqa: B027  most objectives have nothing to refuse
        """Refuse settings that are out of range, quickly: it is asked when an experiment is read.

        Raises:
            InvalidSettingsError: naming the setting, its value and those allowed.
        """

    @abstractmethod
    def open(self, seed: int) -> AbstractContextManager[Evaluator]:
        """Make what evaluates it.

        Args:
            seed: the run's seed, for objectives that are drawn at random.

        Raises:
            InvalidSettingsError: a setting does not fit.
        """

    def wanted_set(self, seed: int) -> WantedSet:
        """How many solutions, and how far apart; by default one."""
        del seed
        return WantedSet()

    def told(self, method: str, seed: int) -> dict[str, Any]:
        """Fields of ``MethodSettings`` that a method is told of this objective; by default the wanted set."""
        del method
        wanted = self.wanted_set(seed)
        if wanted.size < 2:
            return {}
        return {"num_solutions": wanted.size, "min_distance": wanted.distance or None}

    def describe(self, trace: Trace, seed: int, budget: int) -> dict[str, Any]:
        """Fields of its own, as JSON values, in the result of a finished run."""
        del trace, seed, budget
        return {}

    def as_dict(self) -> dict[str, Any]:
        """The settings as JSON values."""
        return asdict(self)


def settings_digest(objective: Objective, shown: frozenset[str]) -> str:
    """Return ``-`` and eight digits for the settings that a label does not show, or "" if all have their defaults.

    Args:
        objective: the objective.
        shown: fields that the label shows.
    """
    hidden = {
        item.name: getattr(objective, item.name)
        for item in fields(objective)
        if item.name not in shown and getattr(objective, item.name) != _default(item)
    }
    if not hidden:
        return ""
    return "-" + hashlib.sha256(json.dumps(hidden, sort_keys=True).encode()).hexdigest()[:8]


def _default(item: Any) -> Any:
    return item.default_factory() if item.default_factory is not MISSING else item.default


def checked_choice(name: str, value: Any, known: tuple[str, ...]) -> None:
    """Refuse a setting that is none of its values.

    Raises:
        InvalidSettingsError: naming the value and those allowed.
    """
    if value not in known:
        raise InvalidSettingsError(f"{name} must be one of {', '.join(known)}, got {value!r}")
