"""What is read of the runs of an experiment: metrics by name, computed from each run's log.

Scores are made when a report is made, so that another metric needs no other run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.objective import Trace
from mebo_grasp.experiments.objectives.grasp import GraspObjective
from mebo_grasp.experiments.problems.metrics import mean_batch_variance
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.run_trace import read_trace
from mebo_grasp.experiments.scores import set_metrics
from mebo_grasp.grasp import FloatArray

RETENTION_RADII_MM = (20, 40, 60)
"""Of the ball about the best grasp that is blocked."""
FARTHEST = 2.0
"""Up to how many tau the hypervolume asks for distance."""


@dataclass(frozen=True, eq=False)
class Run:
    """A finished run.

    Args:
        job: what was run.
        result: its line of ``results.jsonl``.
        trace: what it evaluated and returned.
    """

    job: Job
    result: dict[str, Any]
    trace: Trace

    @classmethod
    def load(cls, job: Job, result: dict[str, Any], out: Path) -> Run:
        """Read a run's log.

        Raises:
            RunLogError: the log is gone or unreadable.
        """
        trace = read_trace(job.log_path(out))
        solutions = np.array(result["solutions"], dtype=np.float64).reshape(-1, trace.X.shape[1])
        return cls(job, result, replace(trace, solutions=solutions))

    @property
    def solution_values(self) -> FloatArray:
        """Values of the returned set, shape (m,)."""
        trace = self.trace
        if not len(trace.solutions):
            return np.empty(0)
        rows = np.argmin(cdist(trace.solutions, trace.X), axis=1)
        return np.asarray(trace.y[rows])

    @property
    def diverse(self) -> int:
        """M_d of the returned set, of its best M where it has more."""
        wanted = self.job.objective.wanted_set(self.job.seed)
        return set_metrics.diverse_count(self.weighted(self.trace.solutions[: wanted.size]), wanted.distance)

    def weighted(self, points: FloatArray) -> FloatArray:
        """Points, shape (n, d), in the unit of distances."""
        weights = self.trace.weights
        return points if weights is None else points * weights


@dataclass(frozen=True)
class Column:
    """A number of a metric.

    Args:
        name: how it is headed.
        higher_is_better: None where no value is better than another.
        digits: decimals shown.
    """

    name: str
    higher_is_better: bool | None = True
    digits: int = 3


@dataclass(frozen=True)
class Metric:
    """A table's worth of numbers about a run.

    Args:
        title: of the table.
        columns: its numbers.
        compute: the numbers of a run by column; {} where the metric does not apply to its objective.
        note: how the numbers are to be read.
    """

    title: str
    columns: tuple[Column, ...]
    compute: Callable[[Run], dict[str, float]]
    note: str


def _best(run: Run) -> dict[str, float]:
    return {"best": set_metrics.best_value(run.trace.y)}


def _set(run: Run) -> dict[str, float]:
    wanted, values = run.job.objective.wanted_set(run.job.seed), run.solution_values
    if wanted.size < 2:
        return {}
    mean = float(np.mean(values[: wanted.size])) if len(values) else 0.0
    return {"M_d": float(run.diverse), "MGOs": mean}


def _occlusion(run: Run) -> dict[str, float]:
    objective = run.job.objective
    if not isinstance(objective, GraspObjective):
        return {}
    available = objective.available(run.trace.X)
    return {name: set_metrics.occluded_best(run.trace.y, free) for name, free in available.items()}


def _retention(run: Run) -> dict[str, float]:
    if not isinstance(run.job.objective, GraspObjective):
        return {}
    sources = {
        "set": (run.trace.solutions[:, :3], run.solution_values),
        "archive": (run.trace.X[:, :3], run.trace.y),
    }
    return {
        f"{name} {radius} mm": set_metrics.retention(positions, y, radius / 1000.0)
        for name, (positions, y) in sources.items()
        for radius in RETENTION_RADII_MM
    }


def _hypervolume(run: Run) -> dict[str, float]:
    wanted = run.job.objective.wanted_set(run.job.seed)
    if wanted.size < 2 or wanted.distance <= 0.0:
        return {}
    volume = set_metrics.quality_diversity_volume(
        run.weighted(run.trace.X), run.trace.y, wanted.size, FARTHEST * wanted.distance
    )
    return {"hypervolume": volume}


def _optima(run: Run) -> dict[str, float]:
    result = run.result
    if "n_optima" not in result:
        return {}
    values = result["found_values"]
    return {
        "PR": result["found"] / result["n_optima"],
        "SR": float(result["found"] >= result["n_optima"]),
        "CS": result["first_all"],
        "CS code": result["last_change"],
        "MGOs": float(np.mean(values)) if values else float("nan"),
    }


def _outcome(run: Run) -> dict[str, float]:
    if not run.trace.recommended:
        return {}
    last = run.trace.recommended[-1].outcome
    return {"mean": last.mean, "sd": last.sd, "worst": last.worst}


def _batch_variance(run: Run) -> dict[str, float]:
    variance = mean_batch_variance(run.trace.X, run.trace.batches)
    return {} if variance is None else dict(zip(("x", "y"), variance.tolist(), strict=False))


def _cost(run: Run) -> dict[str, float]:
    return {} if run.result["resumed"] else {"optimizer CPU s": float(run.result["optimizer_cpu_seconds"])}


METRICS = {
    "best": Metric("Best value", (Column("best"),), _best, "Best value that a run found."),
    "set": Metric(
        "Solution set", (Column("M_d", digits=2), Column("MGOs")), _set,
        "The set that the method returned, of at most M solutions. M_d: how many of them are diverse; MGOs: their mean "
        "quality, which a set that is not diverse gets cheaply.",
    ),
    "occlusion": Metric(
        "Best grasp under an occlusion", (Column("small"), Column("large")), _occlusion,
        "Best of all tried grasps that the thesis's small or large occlusion leaves.",
    ),
    "retention": Metric(
        "Occlusion retention",
        tuple(Column(f"{s} {r} mm") for s in ("set", "archive") for r in RETENTION_RADII_MM), _retention,
        "Best grasp left over best grasp, when all within a radius of the best one's TCP are dropped; from the "
        "returned set and from all tried grasps.",
    ),
    "hypervolume": Metric(
        "Hypervolume of quality and diversity", (Column("hypervolume"),), _hypervolume,
        f"Mean quality of the greedy set of M of all tried points over the least distance asked for, 0 to {FARTHEST:g} "
        "tau, as a hypervolume over tau's range.",
    ),
    "optima": Metric(
        "Optima found",
        (
            Column("PR"), Column("SR", digits=2), Column("CS", False), Column("CS code", False),
            Column("MGOs", digits=4),
        ),
        _optima,
        "Counted as in docs/benchmark.md. MGOs: mean over runs, not weighted by the optima found.",
    ),
    "outcome": Metric(
        "Outcome of the recommended point",
        (Column("mean", digits=4), Column("sd", False, 4), Column("worst", digits=4)), _outcome,
        "The point that a method recommends in the end, carried out many times with input noise: mean, standard "
        "deviation and worst of the values.",
    ),
    "batch_variance": Metric(
        "Batch variance", (Column("x", None, 4), Column("y", None, 4)), _batch_variance,
        "Mean over batches of the population variance of a batch's points in the first two dimensions.",
    ),
    "cost": Metric(
        "Cost of the optimizer", (Column("optimizer CPU s", False, 1),), _cost,
        "CPU time in the optimizer alone; runs that were resumed are left out.",
    ),
}  # fmt: skip
"""All metrics by the name that a definition calls them by."""


def check_metrics(names: Sequence[str]) -> None:
    """Refuse an unknown metric.

    Raises:
        InvalidSettingsError: naming it and those that are known.
    """
    for name in names:
        if name not in METRICS:
            raise InvalidSettingsError(f"metric must be one of {', '.join(METRICS)}, got {name!r}")
