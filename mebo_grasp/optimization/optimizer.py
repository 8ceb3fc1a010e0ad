"""The ask/tell state machine: any number of open trials, told in any order. It does no IO."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError, TrialStateError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.blas_threads import one_blas_thread
from mebo_grasp.optimization.initial_design import latin_hypercube
from mebo_grasp.optimization.methods.base import IndexArray, Method, MethodSettings, Outcomes
from mebo_grasp.optimization.methods.registry import DEFAULT_METHOD, make_method
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace, read_only

INITIAL_PHASE = "initial design"

LARGEST_VALUE = 1e100
"""In size: squares of values, which variances are, have to stay finite."""

OptimizerSettings = MethodSettings
"""One record for the optimizer and its method, so that budget and batch size cannot contradict each other."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A point to evaluate.

    Args:
        id: unique number, counted from 0 in the order of asking.
        x: the point, shape (d,), real units, read-only.
        phase: why it is asked for.
    """

    id: int
    x: FloatArray
    phase: str


@dataclass(frozen=True, eq=False)
class Incumbent:
    """A point with its value, and in a safe run what is expected when it is carried out with input noise.

    Args:
        x: where, shape (d,), real units, read-only.
        value: the value told.
        expected: expected value under input noise; NaN unless the run is safe, as the next two.
        sd: standard deviation over executions.
        worst: worst value at the sigma points of the noise.
    """

    x: FloatArray
    value: float
    expected: float = math.nan
    sd: float = math.nan
    worst: float = math.nan


class Optimizer:
    """Chooses where to evaluate next, for maximization.

    First come ``n_initial`` Latin-hypercube points, then what the method proposes. The budget counts trials
    asked for, failed ones included; results of other optimizers (``observe``) do not count. The same
    generator state and the same asks and tells give the same trace, bit for bit, on one machine.

    Args:
        space: the search space.
        method: a method or the name of one.
        settings: budget, initial design, batch size and what the method needs.
        rng: source of all randomness; a generator or a seed.

    Raises:
        InvalidSettingsError: the method is unknown.
    """

    def __init__(
        self,
        space: SearchSpace,
        method: str | Method = DEFAULT_METHOD,
        settings: OptimizerSettings | None = None,
        rng: np.random.Generator | int = 0,
    ) -> None:
        self.space = space
        self.settings = settings or OptimizerSettings()
        self.method = make_method(method, space, self.settings) if isinstance(method, str) else method
        self.rng = rng if isinstance(rng, np.random.Generator) else np.random.default_rng(rng)
        self._initial = latin_hypercube(self.settings.n_initial, space.dim, self.rng)
        self._observations = Observations(space.dim)
        self._open: dict[int, Trial] = {}
        self._n_asked = 0
        self._n_told = 0
        self._phase = INITIAL_PHASE if self.settings.n_initial else self.method.phase

    @property
    def observations(self) -> Observations:
        """What is known, in the unit cube; for reading only."""
        return self._observations

    @property
    def pending(self) -> tuple[Trial, ...]:
        """Open trials in the order of asking."""
        return tuple(self._open.values())

    @property
    def n_asked(self) -> int:
        """Trials asked for."""
        return self._n_asked

    @property
    def n_told(self) -> int:
        """Own trials told with a value."""
        return self._n_told

    @property
    def n_failed(self) -> int:
        """Own trials told as failed."""
        return self._n_asked - self._n_told - len(self._open)

    @property
    def finished(self) -> bool:
        """Whether the budget is used up and no trial is open."""
        return self._n_asked >= self.settings.budget and not self._open

    @property
    def phase(self) -> str:
        """Why the latest trials were asked for."""
        return self._phase

    @property
    def incumbent(self) -> Incumbent | None:
        """The best point with a value, the earliest of equals; None before the first value."""
        if self._observations.n == 0:
            return None
        return self._solution(int(np.argmax(self._observations.y)), None)

    @property
    def safe_incumbent(self) -> Incumbent | None:
        """The observed point with the highest expected value under input noise (UBO paper, eq. 15).

        The default method takes a share of the standard deviation off the expected value.
        None before the first value, and unless the run is safe.
        """
        if not self._observations.n:
            return None
        with one_blas_thread():
            outcomes = self.method.outcomes(self._observations)
        return None if outcomes is None else self._solution(int(np.argmax(outcomes.ranking)), outcomes)

    def _solution(self, index: int, outcomes: Outcomes | None) -> Incumbent:
        """An observed point by its index, with what is expected of it if that is known."""
        known = self._observations
        x, value = read_only(self.space.from_unit(known.U[index])), float(known.y[index])
        if outcomes is None:
            return Incumbent(x, value)
        parts = (outcomes.expected, outcomes.sd, outcomes.worst)
        return Incumbent(x, value, *(float(part[index]) for part in parts))

    def ask(self, count: int | None = None) -> list[Trial]:
        """Open new trials.

        Args:
            count: how many; default a batch, cut where the initial design or the budget ends. An explicit
                count is cut only where the budget ends.

        Returns:
            The new trials, at least one.

        Raises:
            TrialStateError: the budget is used up.
            InvalidSettingsError: count is below 1.
        """
        if count is not None and count < 1:
            raise InvalidSettingsError(f"ask for at least 1 trial, got {count}")
        left = self.settings.budget - self._n_asked
        if left <= 0:
            raise TrialStateError(
                f"the budget of {self.settings.budget} trials is used up; check `finished` before asking"
            )
        rest = len(self._initial) - self._n_asked
        wanted = min(left, self._default_count(rest) if count is None else count)
        n_initial = max(0, min(rest, wanted))
        trials = self._open_trials(self._initial[self._n_asked : self._n_asked + n_initial], INITIAL_PHASE)
        if wanted > n_initial:
            try:
                with one_blas_thread():
                    points = self.method.propose(self._observations, wanted - n_initial, self.rng)
            except BaseException:
                # Nobody would ever tell them: the caller gets no trial.
                self._take_back(trials)
                raise
            trials += self._open_trials(points, self.method.phase)
        return trials

    def _take_back(self, trials: list[Trial]) -> None:
        """Close the latest trials as if they had not been asked for."""
        for trial in trials:
            self._observations.close(trial.id)
            del self._open[trial.id]
        self._n_asked -= len(trials)

    def reopen(
        self,
        trials: list[tuple[int, list[float], str]],
        method_state: dict[str, Any],
        rng: np.random.Generator,
    ) -> None:
        """Repeat a recorded ask without computing it; for resuming a run from its log.

        Args:
            trials: (id, point in the unit cube, phase) of each trial.
            method_state: the method's state after that ask.
            rng: generator in its state after that ask.

        Raises:
            TrialStateError: the ids do not continue those asked for so far.
            RunLogError: the method does not understand the state.
        """
        for trial_id, u, phase in trials:
            if trial_id != self._n_asked:
                raise TrialStateError(f"expected trial {self._n_asked} next, got {trial_id}")
            self._open_trials(np.array([u], dtype=np.float64), phase)
        self.method.restore(method_state)
        self.rng = rng

    def _default_count(self, initial_rest: int) -> int:
        batch = self.settings.batch_size
        return min(batch, initial_rest) if initial_rest > 0 else batch

    def _open_trials(self, points: FloatArray, phase: str) -> list[Trial]:
        trials = []
        for u in points:
            trial = Trial(self._n_asked, read_only(self.space.from_unit(u)), phase)
            self._observations.open(trial.id, u)
            self._open[trial.id] = trial
            self._n_asked += 1
            self._phase = phase
            trials.append(trial)
        return trials

    def tell(self, trial_id: int, value: float) -> None:
        """Report the value of an open trial.

        Raises:
            TrialStateError: no open trial has this id.
            InvalidSettingsError: the value is not finite or beyond ``LARGEST_VALUE``.
        """
        self._check_open(trial_id)
        value = self._checked_value(value)
        self._observations.add(self._observations.close(trial_id), value)
        del self._open[trial_id]
        self._n_told += 1

    def tell_failed(self, trial_id: int, reason: str = "") -> None:
        """Report that an open trial gave no value; its point is remembered and not proposed again.

        Raises:
            TrialStateError: no open trial has this id.
        """
        del reason  # Kept for the log of a run; the state machine needs only the fact.
        self._check_open(trial_id)
        self._observations.add_failed(self._observations.close(trial_id))
        del self._open[trial_id]

    def observe(self, x: npt.ArrayLike, value: float) -> None:
        """Learn a result that another optimizer asked for (distributed mode, thesis 5.2).

        Raises:
            InvalidSettingsError: the point lies outside the box, or the value is as ``tell`` refuses it.
        """
        if not self.space.contains(x):
            raise InvalidSettingsError(
                f"the point {np.asarray(x).tolist()} is outside the search space "
                f"{self.space.lower.tolist()} to {self.space.upper.tolist()}"
            )
        self._observations.add(self.space.to_unit(x), self._checked_value(value))

    def solution_set(self, size: int | None = None, min_distance: float | None = None) -> list[Incumbent]:
        """Return good and diverse points among those observed, best first; in a safe run by expected value.

        Args:
            size: largest number; default that of the settings, else the method decides.
            min_distance: smallest distance between two, see ``MethodSettings``; default that of the settings.

        Raises:
            InvalidSettingsError: size is below 1 or the distance is not finite and positive.
        """
        if size is not None and size < 1:
            raise InvalidSettingsError(f"a solution set needs a size of at least 1, got {size}")
        if min_distance is not None and not 0.0 < min_distance < math.inf:
            raise InvalidSettingsError(f"min_distance must be finite and above 0, got {min_distance}")
        with one_blas_thread():
            indices: IndexArray = self.method.solution_set(self._observations, size, min_distance)
            outcomes = self.method.outcomes(self._observations)
        return [self._solution(int(i), outcomes) for i in indices]

    def _check_open(self, trial_id: int) -> None:
        if trial_id in self._open:
            return
        if isinstance(trial_id, (int, np.integer)) and 0 <= trial_id < self._n_asked:
            raise TrialStateError(f"trial {trial_id} was told already")
        raise TrialStateError(f"trial {trial_id!r} is unknown; {self._n_asked} trials were asked for so far")

    @staticmethod
    def _checked_value(value: float) -> float:
        number = float(value)
        if not math.isfinite(number):
            raise InvalidSettingsError(f"the value of a trial must be finite, got {number}; or tell_failed")
        if abs(number) > LARGEST_VALUE:
            raise InvalidSettingsError(
                f"the value of a trial must be at most {LARGEST_VALUE:g} in size, got {number}; scale the objective"
            )
        return number
