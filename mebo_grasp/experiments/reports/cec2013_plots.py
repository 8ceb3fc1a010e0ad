"""Pictures of a benchmark: optima found over evaluations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mebo_grasp.experiments.published import thesis
from mebo_grasp.experiments.scores.result_set import ResultSet
from mebo_grasp.grasp import FloatArray


def padded_curves(results: Sequence[dict[str, Any]]) -> FloatArray:
    """Optima found after each evaluation, shape (runs, longest); a shorter run keeps its last count."""
    longest = max(len(r["curve"]) for r in results)
    curves = np.empty((len(results), longest))
    for row, result in enumerate(results):
        curve = np.asarray(result["curve"], dtype=np.float64)
        curves[row, : len(curve)] = curve
        curves[row, len(curve) :] = curve[-1] if len(curve) else 0.0
    return curves


def plot_found_optima(results: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw one panel a problem and one line a method: mean over runs, with the range of the runs.

    Args:
        results: finished runs.
        path: the picture to write; its suffix decides the format.
    """
    # Imported here so that the benchmark runs without a drawing library's start-up time; Figure is used
    # without pyplot, which would keep a global state and look for a display.
    from matplotlib.figure import Figure

    runs = ResultSet(tuple(results))
    problems = runs.problems()
    methods = runs.methods(problems)
    columns = min(3, len(problems))
    rows = -(-len(problems) // columns)
    figure = Figure(figsize=(5.0 * columns, 3.4 * rows), layout="constrained")
    for index, label in enumerate(problems):
        axes = figure.add_subplot(rows, columns, index + 1)
        _draw_problem(axes, runs, label, methods)
    figure.axes[0].legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _draw_problem(axes: Any, runs: ResultSet, label: str, methods: Sequence[str]) -> None:
    n_optima = 0
    for color, method in enumerate(methods):
        picked = runs.pick(method, label)
        if not picked:
            continue
        n_optima = picked[0]["n_optima"]
        curves = padded_curves(picked)
        evaluations = np.arange(1, curves.shape[1] + 1)
        axes.plot(evaluations, np.mean(curves, axis=0), label=method, color=f"C{color % 10}", lw=1.2,
                  ls=("-", "--", ":")[color // 10 % 3])  # fmt: skip
        axes.fill_between(
            evaluations, np.min(curves, axis=0), np.max(curves, axis=0), color=f"C{color % 10}", alpha=0.08
        )
    axes.axhline(n_optima, color="0.6", lw=0.8)
    axes.set_title(thesis.TITLES.get(label, label), fontsize=9)
    axes.set_xlabel("evaluations", fontsize=8)
    axes.set_ylabel("optima found", fontsize=8)
    axes.set_ylim(bottom=0)
