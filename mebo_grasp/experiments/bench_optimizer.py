"""Prints what choosing a point costs: ``python -m mebo_grasp.experiments.bench_optimizer``.

The protocol is that of the measured peers: n points are known, then rounds of one batch are asked and told,
so that ten rounds contain two learnings of the hyperparameters with the period of five. CPU time is what
counts on a shared machine; wall time is printed beside it.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.methods.registry import DEFAULT_METHOD, METHOD_NAMES
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace

BENCH_METHODS = ("mebo", "e_mebo", "cl_mebo", DEFAULT_METHOD)


@dataclass(frozen=True)
class Cost:
    """Milliseconds a chosen point, mean over the rounds of one repetition.

    Args:
        cpu: CPU time.
        wall: wall time.
        slowest: CPU time of the slowest round, a learning one, per point of its batch.
    """

    cpu: float
    wall: float
    slowest: float


def objective(u: FloatArray) -> float:
    """A smooth multimodal function with a plateau at 0, as a grasp quality has, shape (d,)."""
    return max(0.0, float(np.prod(0.6 + 0.4 * np.sin(5.0 * u + np.arange(len(u)))) - 0.05))


def measure(method: str, n: int, dim: int, rounds: int, batch: int, seed: int) -> Cost:
    """Time ``rounds`` batches with n points known at the start."""
    settings = OptimizerSettings(budget=n + rounds * batch, n_initial=n, batch_size=batch)
    optimizer = Optimizer(SearchSpace.unit_cube(dim), method, settings, seed)
    for trial in optimizer.ask(n):
        optimizer.tell(trial.id, objective(trial.x))
    cpu, wall = np.empty(rounds), np.empty(rounds)
    for i in range(rounds):
        cpu_start, wall_start = time.process_time(), time.perf_counter()
        trials = optimizer.ask()
        cpu[i], wall[i] = time.process_time() - cpu_start, time.perf_counter() - wall_start
        for trial in trials:
            optimizer.tell(trial.id, objective(trial.x))
    scale = 1e3 / batch
    return Cost(scale * cpu.mean(), scale * wall.mean(), scale * cpu.max())


def report(costs: Sequence[Cost]) -> str:
    """Mean and range over the repetitions."""
    cpu = np.array([cost.cpu for cost in costs])
    wall = np.array([cost.wall for cost in costs])
    slowest = max(cost.slowest for cost in costs)
    return (
        f"{cpu.mean():8.1f} [{cpu.min():.1f} to {cpu.max():.1f}]   "
        f"wall {wall.mean():8.1f}   slowest round {slowest:8.1f}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print one line a method and size."""
    parser = argparse.ArgumentParser(description="CPU milliseconds a chosen point, relearning included")
    parser.add_argument("--methods", nargs="+", choices=METHOD_NAMES, default=list(BENCH_METHODS))
    parser.add_argument("--sizes", nargs="+", type=int, default=[250, 500])
    parser.add_argument("--dim", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--batch", type=int, default=3)
    parser.add_argument("--repetitions", type=int, default=3)
    options = parser.parse_args(arguments)
    write = sys.stdout.write
    write(f"d = {options.dim}, batch {options.batch}; CPU ms a point: mean [range of repetitions]\n")
    for method in options.methods:
        measure(method, 30, options.dim, 2, options.batch, 0)  # compiles the loops
        for n in options.sizes:
            costs = [
                measure(method, n, options.dim, options.rounds, options.batch, seed)
                for seed in range(options.repetitions)
            ]
            write(f"{method:28s} n = {n:5d}  {report(costs)}\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
