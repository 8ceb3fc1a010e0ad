"""What runs are expected to take, before and while they are made."""

from __future__ import annotations

from collections.abc import Sequence

from mebo_grasp.experiments.runs.job import BUDGET, Job

SECONDS = {
    "basin_search": 7.0, "mebo": 0.7, "e_mebo": 0.7, "cl_mebo": 1.2, "mebo_code": 0.7,
    "e_mebo_code": 0.7, "cl_mebo_code": 1.2, "mebo_ei": 0.7, "mebo_ucb": 0.7,
    "bo": 3.2, "bo_pi": 2.5, "bo_ucb": 1.9, "bo_thompson": 2.7, "local_penalization": 2.2, "robot": 2.4,
    "constraint_active_search": 4.9, "ubo": 12.0, "random": 0.01, "sobol": 0.03,
    "cma_bipop": 0.05, "optuna_tpe": 0.4, "botorch_qlogei": 26.0, "botorch_qucb": 20.0, "optuna_gp": 25.0,
    "skopt": 250.0,
}  # fmt: skip
"""CPU seconds of a run of 250 evaluations, mean over the thesis's six functions. Only the size matters: what
this machine takes replaces it as runs end."""
UNKNOWN = 5.0
SLOW_PEER = 10.0
"""Peers that take longer a run are not part of ``all``: they would take most of its hours."""


def expected_seconds(job: Job) -> float:
    """CPU seconds that a run may take; that of a surrogate grows about with the square of the evaluations."""
    return SECONDS.get(job.method, UNKNOWN) * (job.budget / BUDGET) ** 2


def slow_peers(peers: Sequence[str]) -> tuple[str, ...]:
    """Those of the peers that take too long to be part of ``all``."""
    return tuple(name for name in peers if SECONDS.get(name, UNKNOWN) > SLOW_PEER)


class CostEstimate:
    """Learns from finished runs what the others will take."""

    def __init__(self) -> None:
        self._cells: dict[str, list[float]] = {}
        self._methods: dict[str, list[float]] = {}

    def finished(self, job: Job, seconds: float) -> None:
        """Note what a run took, seconds of whichever clock."""
        self._cells.setdefault(job.cell, []).append(seconds)
        self._methods.setdefault(job.method, []).append(seconds / expected_seconds(job))

    def seconds(self, job: Job) -> float:
        """What a job will take.

        By runs of the same method on the same objective, if there are any; else what is expected, times the factor
        by which the method's other runs, or all runs, took longer than expected.
        """
        cell = self._cells.get(job.cell)
        if cell:
            return sum(cell) / len(cell)
        if not self._methods:
            return expected_seconds(job)
        factors = self._methods.get(job.method) or [f for own in self._methods.values() for f in own]
        return expected_seconds(job) * sum(factors) / len(factors)

    def total(self, jobs: Sequence[Job]) -> float:
        """Seconds of all jobs, one after the other."""
        return sum(self.seconds(job) for job in jobs)
