"""Pictures of an experiment: best values over evaluations, and what comes of the recommended point.

The former are the thesis's figures 7.3 to 7.5 and the UBO paper's 4 and 8, the latter the UBO paper's 5, 6 and 9 to 12.
A dashed line marks where treed surrogates divide the space for the first time, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from mebo_grasp.experiments.scores.set_metrics import best_so_far
from mebo_grasp.experiments.scores.study_scores import Run
from mebo_grasp.grasp import FloatArray

MOST_COLUMNS = 5
MEASURES = {"mean": "mean outcome", "sd": "standard deviation of the outcomes", "worst": "worst outcome"}


def mean_curves(runs: Sequence[Run]) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation over runs of the best value so far, each of shape (n,).

    A run that ended earlier keeps its last value; before a run's first value it does not count.
    """
    longest = max(len(run.trace.y) for run in runs)
    curves = np.full((len(runs), longest), np.nan)
    for row, run in zip(curves, runs, strict=True):
        curve = best_so_far(run.trace.y)
        row[: len(curve)] = curve
        row[len(curve) :] = curve[-1] if len(curve) else np.nan
    counted = np.isfinite(curves)
    n = np.maximum(counted.sum(axis=0), 1)
    mean = np.where(counted.any(axis=0), np.where(counted, curves, 0.0).sum(axis=0) / n, np.nan)
    square = np.where(counted, (curves - mean) ** 2, 0.0).sum(axis=0)
    return mean, np.sqrt(square / np.maximum(n - 1, 1))


def outcome_curves(runs: Sequence[Run], measure: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what came of the recommended points over evaluations.

    Args:
        runs: finished runs.
        measure: "mean", "sd" or "worst".

    Returns:
        Evaluations after which all runs have a recommendation, the mean over runs there, and the half width of its
        95 % confidence interval (Student's t; NaN for a single run), each of shape (n,).
    """
    by_run = [{r.evaluations: getattr(r.outcome, measure) for r in run.trace.recommended} for run in runs]
    evaluations = sorted(set.intersection(*(set(known) for known in by_run)))
    values = np.array([[known[n] for n in evaluations] for known in by_run]).reshape(len(runs), -1)
    n = len(runs)
    half = np.full(len(evaluations), np.nan)
    if n > 1:
        half = student_t.ppf(0.975, n - 1) * values.std(axis=0, ddof=1) / np.sqrt(n)
    return np.array(evaluations, dtype=np.float64), values.mean(axis=0), half


def plot_outcomes(runs: Sequence[Run], group: str, path: Path) -> None:
    """Draw one row an objective, a panel a measure, a line a method: mean over runs with its 95 % confidence interval.

    Args:
        runs: finished runs of one group, all with recommendations.
        group: what they have in common.
        path: picture to write; its suffix says the format.
    """
    from matplotlib.figure import Figure

    objectives = list(dict.fromkeys(run.job.objective for run in runs))
    methods = list(dict.fromkeys(run.job.method for run in runs))
    figure = Figure(figsize=(4.2 * len(MEASURES), 3.2 * len(objectives) + 0.5), layout="constrained")
    for row, objective in enumerate(objectives):
        for place, (measure, label) in enumerate(MEASURES.items()):
            axes = figure.add_subplot(len(objectives), len(MEASURES), row * len(MEASURES) + place + 1)
            for number, method in enumerate(methods):
                picked = [r for r in runs if (r.job.objective, r.job.method) == (objective, method)]
                if picked:
                    _draw_band(axes, *outcome_curves(picked, measure), method, number)
            axes.set_title(objective.column, fontsize=9)
            _label(axes, label)
    _finish(figure, group, path)


def plot_best_values(runs: Sequence[Run], group: str, path: Path) -> None:
    """Draw one panel an objective and one line a method: mean over runs, with a standard deviation to each side.

    Args:
        runs: finished runs of one group.
        group: what they have in common.
        path: picture to write; its suffix says the format.
    """
    # Imported here so that a run needs no drawing library; Figure without pyplot keeps no global state.
    from matplotlib.figure import Figure

    objectives = list(dict.fromkeys(run.job.objective for run in runs))
    methods = list(dict.fromkeys(run.job.method for run in runs))
    columns = min(MOST_COLUMNS, len(objectives))
    rows = -(-len(objectives) // columns)
    figure = Figure(figsize=(max(4.2 * columns, 6.0), 3.4 * rows + 0.5), layout="constrained")
    for index, objective in enumerate(objectives):
        axes = figure.add_subplot(rows, columns, index + 1)
        picked = [run for run in runs if run.job.objective == objective]
        _draw(axes, picked, methods)
        mark_first_split(axes, picked)
        axes.set_title(objective.column, fontsize=9)
    _finish(figure, group, path)


def mark_first_split(axes: Any, runs: Sequence[Run]) -> None:
    """Draw a dashed line at the earliest first split of the runs with a treed surrogate, if there are any.

    Args:
        axes: of evaluations.
        runs: finished runs.
    """
    splits = [run.trace.first_split for run in runs if run.trace.first_split is not None]
    if splits:
        axes.axvline(min(splits), color="C3", ls="--", lw=0.9)


def _finish(figure: Any, group: str, path: Path) -> None:
    """Legend and heading, and the file."""
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=8)
    if group:
        figure.suptitle(group, fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def _draw_band(
    axes: Any, evaluations: FloatArray, mean: FloatArray, half: FloatArray, method: str, number: int
) -> None:
    """A method's line with a band of a half width to each side."""
    style = {"color": f"C{number % 10}", "lw": 1.3, "ls": ("-", "--", ":")[number // 10 % 3]}
    axes.plot(evaluations, mean, label=method, **style)
    axes.fill_between(evaluations, mean - half, mean + half, color=style["color"], alpha=0.10, lw=0)


def _label(axes: Any, value: str) -> None:
    axes.set_xlabel("evaluations", fontsize=8)
    axes.set_ylabel(value, fontsize=8)
    axes.tick_params(labelsize=7)


def _draw(axes: Any, runs: Sequence[Run], methods: Sequence[str]) -> None:
    lowest = []
    for number, method in enumerate(methods):
        picked = [run for run in runs if run.job.method == method]
        if not picked:
            continue
        mean, sd = mean_curves(picked)
        _draw_band(axes, np.arange(1.0, len(mean) + 1), mean, sd, method, number)
        lowest.append(mean[min(max(picked[0].job.n_initial, 1), len(mean)) - 1])
    if lowest and np.all(np.isfinite(lowest)):
        # What the initial design finds is the same for all; the scale belongs to what comes after.
        axes.set_ylim(bottom=0.9 * min(lowest) if min(lowest) > 0.0 else None)
    _label(axes, "best value")
