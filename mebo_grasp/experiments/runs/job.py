"""One run of an experiment: a method on an objective with a budget, a batch and a seed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mebo_grasp.experiments.objective import Objective

BUDGET, N_INITIAL, BATCH_SIZE, SEEDS = 250, 25, 3, 10
"""The protocol of the thesis, section 7.2."""


@dataclass(frozen=True)
class Job:
    """One run.

    Args:
        method: a method, a variant or a peer.
        objective: what is maximized, and in which space.
        seed: seed of the run; also of an objective that is drawn at random.
        budget: evaluations, initial design included.
        n_initial: size of the initial design.
        batch_size: points a batch.
    """

    method: str
    objective: Objective
    seed: int
    budget: int = BUDGET
    n_initial: int = N_INITIAL
    batch_size: int = BATCH_SIZE

    @property
    def cell(self) -> str:
        """What the runs of all seeds have in common; also what their cost is estimated by."""
        return f"{self.objective.label}/{self.method}/{self.protocol}"

    @property
    def protocol(self) -> str:
        """Budget, initial design and batch."""
        return f"b{self.budget}-i{self.n_initial}-q{self.batch_size}"

    @property
    def key(self) -> str:
        """What tells this run from every other, also its path below the folder of runs."""
        return f"{self.cell}/seed-{self.seed:03d}"

    def log_path(self, out: Path) -> Path:
        """File of the run's log below the experiment's folder."""
        return out / "runs" / f"{self.key}.jsonl"

    def as_dict(self) -> dict[str, Any]:
        """The fields and the objective's settings, as JSON values."""
        return {
            "method": self.method,
            **self.objective.as_dict(),
            "seed": self.seed,
            "budget": self.budget,
            "n_initial": self.n_initial,
            "batch_size": self.batch_size,
        }


def make_jobs(
    methods: Sequence[str], objectives: Sequence[Objective], seeds: Iterable[int], **protocol: Any
) -> list[Job]:
    """All combinations, seeds outermost, so that an unfinished experiment is balanced over the cells."""
    return [
        Job(method, objective, seed, **protocol) for seed in seeds for objective in objectives for method in methods
    ]
