"""Results of finished runs, picked by method and problem and summarized."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mebo_grasp.experiments.problems.metrics import RunScore, Summary, summarize
from mebo_grasp.experiments.runs.results import Result


@dataclass(frozen=True)
class ResultSet:
    """Results that can be picked by method and problem.

    Args:
        results: finished runs.
    """

    results: tuple[Result, ...]

    def pick(self, method: str, problem: str) -> list[Result]:
        """Runs of a method on a problem, as it is labelled."""
        return [r for r in self.results if r["job"]["method"] == method and label_of(r) == problem]

    def methods(self, problems: Iterable[str]) -> list[str]:
        """Methods that have a run on one of the problems, in the order of their first run."""
        wanted = set(problems)
        return list(dict.fromkeys(r["job"]["method"] for r in self.results if label_of(r) in wanted))

    def runs_text(self, method: str, problems: Iterable[str]) -> str:
        """Number of a method's runs on each of the problems, or the least and the most."""
        counts = sorted({len(self.pick(method, problem)) for problem in problems})
        return str(counts[0]) if len(counts) == 1 else f"{counts[0]}-{counts[-1]}"

    def problems(self) -> list[str]:
        """Labels of the problems, in the order of their first run."""
        return list(dict.fromkeys(label_of(r) for r in self.results))


def label_of(result: Result) -> str:
    """Label of the problem that a result is of."""
    return f"{result['job']['problem']}~t" if result["job"]["transformed"] else str(result["job"]["problem"])


def summary_of(results: Sequence[Result]) -> Summary:
    """The thesis's metrics over runs, from their results.

    Raises:
        InvalidSettingsError: there is no run.
    """
    return summarize([
        RunScore(
            r["n_optima"],
            r["found"],
            np.array(r["found_values"]),
            r["first_all"],
            r["last_change"],
            np.array(r["curve"], dtype=np.int64),
        )
        for r in results
    ])  # fmt: skip
