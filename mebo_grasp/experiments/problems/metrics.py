"""How many optima a run has found, by the thesis's rule, its text, the competition and a stricter count.

The rules differ, and each answers another question:

- ``thesis_score``: the rule that the thesis's tables are computed with. A value within 5 % of the
  optimum's size is a hit; with a list of optima, a hit goes to the nearest of them, however far;
  without one (modified Rastrigin), hits are told apart by a radius.
- ``text_count``: the rule as the thesis's section 7.1 words it: the evaluated point nearest to an
  optimum is within 5 %.
- ``competition_count``: the suite's own count, seeds by niche radius within an accuracy.
- ``strict_count``: the competition's seeds, each credited only to the optimum whose basin it lies in,
  and never two to one basin; for returned solution sets at tight accuracies.

Failed trials have the value NaN and are never hits.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.problems import Problem
from mebo_grasp.grasp import FloatArray

IntArray = npt.NDArray[np.int64]

THESIS_SHARE = 0.05
"""A value is a hit within this share of the optimum's size (absolute where the optimum is 0)."""
STRICT_ACCURACIES = (1e-1, 1e-2, 1e-3)

_WITH_OPTIMUM_LIST = frozenset({1, 2, 3, 4, 5, 7})
"""Problems for which the thesis's code credits hits to listed optima; the others go by radius."""
_THESIS_RADIUS = {6: 0.5, 8: 0.5, 9: 0.2, 10: 0.2}
_THESIS_OTHER_RADIUS = 0.01
_SEGMENT_POINTS = 65
_NEAREST_OPTIMA = 3


@dataclass(frozen=True, eq=False)
class RunScore:
    """What one run found by the thesis's rule.

    Args:
        n_optima: global optima of the problem.
        found: optima found in the end.
        found_values: best value at each found optimum, shape (found,).
        first_all: share of the budget used when all had been found for the first time; 1 if never.
            This is the convergence speed as the thesis's text defines it.
        last_change: share of the budget at the last evaluation that found an optimum or improved a
            found one; 1 if not all were found. This is the convergence speed that the thesis's code
            computes (for problems without a list of optima it equals ``first_all``).
        curve: optima found after each evaluation, shape (n,).
    """

    n_optima: int
    found: int
    found_values: FloatArray
    first_all: float
    last_change: float
    curve: IntArray

    @property
    def success(self) -> bool:
        """Whether all optima were found."""
        return self.found >= self.n_optima


@dataclass(frozen=True)
class Summary:
    """A table cell: the thesis's metrics over the runs of one method on one problem.

    Args:
        runs: number of runs.
        peak_ratio: PR, found optima over all optima of all runs.
        success_rate: SR, share of runs that found all.
        speed_text: CS by the text, mean share of the budget until all were found for the first time.
        speed_code: CS by the code, mean share until the last improvement of a found optimum.
        mean_optimum: MGOs, mean value of the found optima; NaN if none was found.
        peak_ratio_sd: standard deviation of the runs' peak ratios (n - 1; 0 for one run).
        speed_text_sd: standard deviation of the runs' ``first_all``.
    """

    runs: int
    peak_ratio: float
    success_rate: float
    speed_text: float
    speed_code: float
    mean_optimum: float
    peak_ratio_sd: float
    speed_text_sd: float


def _checked(problem: Problem, X: npt.ArrayLike, y: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    points, values = np.asarray(X, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != problem.dim or values.shape != (len(points),):
        raise InvalidSettingsError(
            f"a trace on {problem.name} needs points (n, {problem.dim}) and values (n,), "
            f"got {points.shape} and {values.shape}"
        )
    return points, values


def _distances(A: FloatArray, B: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.sum((A[:, None, :] - B[None, :, :]) ** 2, axis=2)))


def thesis_accuracy(problem: Problem) -> float:
    """Largest deviation from the optimum's value that still is a hit by the thesis's rule."""
    return THESIS_SHARE * abs(problem.optimum_value) if problem.optimum_value != 0.0 else THESIS_SHARE


def _hits(problem: Problem, y: FloatArray, accuracy: float) -> npt.NDArray[np.bool_]:
    # NaN compares false: a failed trial is no hit.
    return np.asarray(np.abs(y - problem.optimum_value) <= accuracy)


def thesis_score(problem: Problem, X: npt.ArrayLike, y: npt.ArrayLike, budget: int | None = None) -> RunScore:
    """Score a trace by the rule of the thesis's tables 7.2 to 7.7.

    Args:
        problem: what was maximized.
        X: evaluated points in order, shape (n, d).
        y: their values, shape (n,); NaN for a failed trial.
        budget: evaluations allowed; the length of the trace if None.

    Raises:
        InvalidSettingsError: the shapes do not fit, or the trace is longer than the budget.
    """
    points, values = _checked(problem, X, y)
    total = len(values) if budget is None else budget
    if total < max(len(values), 1):
        raise InvalidSettingsError(f"budget must be at least the {len(values)} evaluations made, got {total}")
    if problem.number in _WITH_OPTIMUM_LIST:
        return _score_by_list(problem, points, values, total)
    return _score_by_radius(problem, points, values, total)


def _score_by_list(problem: Problem, X: FloatArray, y: FloatArray, total: int) -> RunScore:
    best = np.full(problem.n_optima, -np.inf)
    curve = np.zeros(len(y), dtype=np.int64)
    hits = _hits(problem, y, thesis_accuracy(problem))
    owners = np.argmin(_distances(X, problem.optima), axis=1)
    first_all = last_change = total
    for i in range(len(y)):
        if hits[i] and y[i] > best[owners[i]]:
            best[owners[i]] = y[i]
            last_change = i + 1
        curve[i] = np.count_nonzero(np.isfinite(best))
        if curve[i] == problem.n_optima and first_all == total:
            first_all = i + 1
    found_values = best[np.isfinite(best)]
    if len(found_values) < problem.n_optima:
        first_all = last_change = total
    return RunScore(problem.n_optima, len(found_values), found_values, first_all / total, last_change / total, curve)


def _score_by_radius(problem: Problem, X: FloatArray, y: FloatArray, total: int) -> RunScore:
    radius = _THESIS_RADIUS.get(problem.number, _THESIS_OTHER_RADIUS) * problem.scale
    accuracy = thesis_accuracy(problem)
    seeds = _seeds_within(problem, X, y, accuracy, radius)[: problem.n_optima]
    hits = _hits(problem, y, accuracy)
    distinct: list[int] = []
    curve = np.zeros(len(y), dtype=np.int64)
    for i in range(len(y)):
        if hits[i] and not np.any(np.linalg.norm(X[distinct] - X[i], axis=1) <= radius):
            distinct.append(i)
        curve[i] = min(len(distinct), problem.n_optima)
    speed = (distinct[problem.n_optima - 1] + 1) / total if len(distinct) >= problem.n_optima else 1.0
    return RunScore(problem.n_optima, len(seeds), y[seeds], speed, speed, curve)


def _seeds_within(problem: Problem, X: FloatArray, y: FloatArray, accuracy: float, radius: float) -> list[int]:
    """Indices of the species seeds that are hits, best first (Li et al. 2013, algorithm 1).

    Only hits are sorted: a point that is not a hit has a lower value than every hit (no value exceeds
    the optimum by more than rounding), so it never shadows one.
    """
    candidates = np.flatnonzero(_hits(problem, y, accuracy))
    order = candidates[np.argsort(-y[candidates], kind="stable")]
    seeds: list[int] = []
    for i in order:
        if not seeds or np.min(np.linalg.norm(X[seeds] - X[i], axis=1)) > radius:
            seeds.append(int(i))
    return seeds


def competition_count(problem: Problem, X: npt.ArrayLike, y: npt.ArrayLike, accuracy: float) -> int:
    """Optima found by the competition's count at an accuracy, at most ``n_optima``.

    Seeds are taken greedily by value; two are distinct if farther apart than the niche radius.
    """
    points, values = _checked(problem, X, y)
    return min(len(_seeds_within(problem, points, values, accuracy, problem.niche_radius)), problem.n_optima)


def text_count(problem: Problem, X: npt.ArrayLike, y: npt.ArrayLike) -> int:
    """Optima whose nearest evaluated point is within 5 % (thesis, section 7.1, as worded)."""
    points, values = _checked(problem, X, y)
    if len(values) == 0:
        return 0
    nearest = np.argmin(_distances(problem.optima, points), axis=1)
    return int(np.count_nonzero(_hits(problem, values[nearest], thesis_accuracy(problem))))


def basin(problem: Problem, x: FloatArray, accuracy: float) -> int | None:
    """Index of the global optimum in whose basin a point lies; None if it is in none.

    A point is in an optimum's basin if the function never falls by more than the accuracy below the
    lower end on the straight way between them. The nearest few optima are tried, nearest first.

    Args:
        problem: what was maximized.
        x: the point, shape (d,).
        accuracy: dip that is forgiven; the accuracy at which the point is a hit.
    """
    order = np.argsort(np.linalg.norm(problem.optima - x, axis=1), kind="stable")[:_NEAREST_OPTIMA]
    steps = np.linspace(0.0, 1.0, _SEGMENT_POINTS)[:, None]
    for k in order:
        way = problem.function((1.0 - steps) * x + steps * problem.optima[k])
        if min(way[0], way[-1]) - np.min(way) <= accuracy:
            return int(k)
    return None


def strict_count(problem: Problem, solutions: npt.ArrayLike, accuracy: float) -> int:
    """Optima that a returned solution set holds at an accuracy, one at most a basin.

    Args:
        problem: what was maximized.
        solutions: the returned set, shape (m, d); the values are computed here, not taken on trust.
        accuracy: largest deviation from the optimum's value.
    """
    points = np.asarray(solutions, dtype=np.float64).reshape(-1, problem.dim)
    values = problem(points)
    seeds = _seeds_within(problem, points, values, accuracy, problem.niche_radius)
    basins = {basin(problem, points[i], accuracy) for i in seeds}
    return len(basins - {None})


def summarize(scores: Sequence[RunScore]) -> Summary:
    """Aggregate runs as the thesis's tables do (section 7.1).

    Raises:
        InvalidSettingsError: there is no run.
    """
    if not scores:
        raise InvalidSettingsError("a summary needs at least one run, got none")
    ratios = np.array([s.found / s.n_optima for s in scores])
    speeds = np.array([s.first_all for s in scores])
    found = sum(s.found for s in scores)
    total_value = sum(float(np.sum(s.found_values)) for s in scores)
    return Summary(
        runs=len(scores),
        peak_ratio=float(np.mean(ratios)),
        success_rate=float(np.mean([s.success for s in scores])),
        speed_text=float(np.mean(speeds)),
        speed_code=float(np.mean([s.last_change for s in scores])),
        mean_optimum=total_value / found if found else float("nan"),
        peak_ratio_sd=_sample_sd(ratios),
        speed_text_sd=_sample_sd(speeds),
    )


def _sample_sd(values: FloatArray) -> float:
    return float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


def mean_batch_variance(X: FloatArray, batches: Iterable[Sequence[int]]) -> FloatArray | None:
    """Mean over batches of the population variance of a batch's points (thesis, tables 7.4 and D.1).

    Args:
        X: evaluated points in order, shape (n, d).
        batches: rows of each batch's points; those of one point or with a row not evaluated are left out.

    Returns:
        One variance a dimension, shape (d,); None without a batch.
    """
    variances = [np.var(X[list(b)], axis=0) for b in batches if len(b) > 1 and max(b) < len(X)]
    return np.asarray(np.mean(variances, axis=0)) if variances else None
