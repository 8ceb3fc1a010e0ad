"""What a method recommends after each batch, and what comes of it in execution: notes in the run's log."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from mebo_grasp.experiments.objective import Evaluator, NoisyOutcome, Recommendation
from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer

_WHAT = "recommended"


class RecommendationJudge:
    """Asks a run after each batch what it recommends, has it judged and notes it.

    That is the observed point with the highest expected value where the method counts with noise (UBO paper, eq. 15),
    else the best one. Nothing happens if the objective judges no points.

    Args:
        evaluator: the opened objective.
        optimizer: the run; a batch of it that is not noted yet, because it was killed there, is noted at once.
        known: earlier notes of a run that continues.
    """

    def __init__(self, evaluator: Evaluator, optimizer: LoggedOptimizer, known: Sequence[Recommendation] = ()) -> None:
        self._judge = evaluator.judge
        self._optimizer = optimizer
        self._last = known[-1] if known else None
        self.note()

    def note(self) -> float:
        """Note the present recommendation; returns the optimizer's share of the CPU time, seconds."""
        optimizer = self._optimizer.optimizer
        evaluations = optimizer.n_told + optimizer.n_failed
        is_due = evaluations > optimizer.settings.n_initial and not optimizer.pending
        if self._judge is None or not is_due or (self._last and self._last.evaluations == evaluations):
            return 0.0
        begin = time.process_time()
        chosen = optimizer.safe_incumbent or optimizer.incumbent
        cpu = time.process_time() - begin
        if chosen is None:
            return cpu
        if self._last is not None and np.array_equal(self._last.x, chosen.x):
            outcome = self._last.outcome
        else:
            outcome = self._judge(chosen.x)
        self._last = Recommendation(evaluations, chosen.x, outcome)
        self._optimizer.note({"what": _WHAT, "evaluations": evaluations, "x": chosen.x.tolist(), **asdict(outcome)})
        return cpu


def recommendation_in(note: dict[str, Any]) -> Recommendation | None:
    """What a note of a run's log says of a recommended point; None if it is of something else."""
    if note.get("what") != _WHAT:
        return None
    outcome = NoisyOutcome(float(note["mean"]), float(note["sd"]), float(note["worst"]))
    return Recommendation(int(note["evaluations"]), np.array(note["x"], dtype=np.float64), outcome)
