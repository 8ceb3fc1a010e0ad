"""Prints what choosing a point costs: ``python -m mebo_grasp.benchmarks.optimizer``.

n points are known, then rounds of one batch are asked and told, so that ten rounds contain two learnings of
the hyperparameters with the period of five. Installed peers (extra ``[peers]``) stand in the same table,
measured in fewer rounds where one takes minutes. CPU time is what counts on a shared machine; wall time is
printed beside it, and the most memory that the process has held so far. ``--set`` gives our methods other settings,
e.g. ``surrogate=treed_gp`` or ``safe=true``.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import yaml

from mebo_grasp.experiments.runs.peers import PEER_NAMES, installed_peers, make_peer
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.methods.registry import DEFAULT_METHOD, METHOD_NAMES
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace

BENCH_METHODS = ("mebo", "e_mebo", "cl_mebo", DEFAULT_METHOD)
BENCH_PEERS = ("botorch_qlogei", "optuna_gp", "skopt")
PEER_ROUNDS = 2
"""Rounds of a peer: each of these learns anew in every round, so two show what more would."""
SLOWEST_PEER_SIZE = 250
"""scikit-optimize is measured up to this number of points only; there it takes seconds a point."""


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


class OurSide:
    """A method of this package with n points known.

    Args:
        method: its name.
        n: points known at the start.
        dim: number of dimensions.
        batch: points a round.
        budget: points in all.
        seed: seed of the run.
        chosen: further settings.
    """

    def __init__(
        self, method: str, n: int, dim: int, batch: int, budget: int, seed: int, chosen: Mapping[str, Any]
    ) -> None:
        settings = OptimizerSettings(budget=budget, n_initial=n, batch_size=batch, **chosen)
        self._optimizer = Optimizer(SearchSpace.unit_cube(dim), method, settings, seed)
        for trial in self._optimizer.ask(n):
            self._optimizer.tell(trial.id, objective(trial.x))

    def round(self) -> None:
        """Choose one batch and learn its values."""
        for trial in self._optimizer.ask():
            self._optimizer.tell(trial.id, objective(trial.x))


class PeerSide:
    """The same of a peer; its initial design is all n points, so no model is made before they are known."""

    def __init__(self, method: str, n: int, dim: int, batch: int, budget: int, seed: int) -> None:
        self._peer = make_peer(method, np.zeros(dim), np.ones(dim), n, batch, seed)
        self._batch, self._left = batch, budget
        while self._left > budget - n:
            self._some(self._left - (budget - n))

    def _some(self, most: int) -> int:
        points = self._peer.ask(most)
        self._peer.tell(points, np.array([objective(x) for x in points]))
        self._left -= len(points)
        return len(points)

    def round(self) -> None:
        """Choose as many points as a batch has, one after the other where the peer knows no batches."""
        left = self._batch
        while left > 0:
            left -= self._some(left)


def measure(
    method: str, n: int, dim: int, rounds: int, batch: int, seed: int, chosen: Mapping[str, Any] | None = None
) -> Cost:
    """Time ``rounds`` batches with n points known at the start, telling included: some peers learn there.

    Args:
        method: one of ours or a peer.
        n: points known at the start.
        dim: number of dimensions.
        rounds: batches.
        batch: points a round.
        seed: seed of the run.
        chosen: further settings of our methods.
    """
    size = (method, n, dim, batch, n + rounds * batch, seed)
    side = PeerSide(*size) if method in PEER_NAMES else OurSide(*size, chosen or {})
    cpu, wall = np.empty(rounds), np.empty(rounds)
    for i in range(rounds):
        cpu_start, wall_start = time.process_time(), time.perf_counter()
        side.round()
        cpu[i], wall[i] = time.process_time() - cpu_start, time.perf_counter() - wall_start
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


def peak_memory() -> float:
    """Most memory that this process has held so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def default_methods() -> list[str]:
    """Ours, then the installed ones of the peers that work with a Gaussian process."""
    return [*BENCH_METHODS, *(name for name in BENCH_PEERS if name in installed_peers())]


def _line(method: str, n: int, options: argparse.Namespace) -> str:
    """Figures of a method with n points known."""
    if method == "skopt" and n > SLOWEST_PEER_SIZE:
        return f"not measured: it takes seconds a point at {SLOWEST_PEER_SIZE}"
    is_peer = method in PEER_NAMES
    rounds, repetitions = (PEER_ROUNDS, 1) if is_peer else (options.rounds, options.repetitions)
    costs = [
        measure(method, n, options.dim, rounds, options.batch, seed, options.chosen) for seed in range(repetitions)
    ]
    return f"{report(costs)}   {peak_memory():.0f} MB"


def _setting(word: str) -> tuple[str, Any]:
    """A field of ``OptimizerSettings`` and its value, as YAML has it."""
    key, equals, value = word.partition("=")
    if not equals or key not in {item.name for item in fields(OptimizerSettings)}:
        raise argparse.ArgumentTypeError(f"{word!r} must be KEY=VALUE with a field of OptimizerSettings")
    return key, yaml.safe_load(value)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and print one line a method and size."""
    parser = argparse.ArgumentParser(description="CPU milliseconds a chosen point, relearning included")
    parser.add_argument("--methods", nargs="+", choices=(*METHOD_NAMES, *PEER_NAMES), default=default_methods())
    parser.add_argument("--sizes", nargs="+", type=int, default=[250, 500])
    parser.add_argument("--dim", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--batch", type=int, default=3)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--set", nargs="+", type=_setting, default=[], metavar="KEY=VALUE", dest="chosen")
    options = parser.parse_args(arguments)
    if min(options.dim, options.rounds, options.batch, options.repetitions, *options.sizes) < 1:
        parser.error("--sizes, --dim, --rounds, --batch and --repetitions must be at least 1")
    options.chosen = dict(options.chosen)
    write = sys.stdout.write
    write(f"d = {options.dim}, batch {options.batch}; CPU ms a point: mean [range of repetitions]\n")
    absent = [name for name in BENCH_PEERS if name not in installed_peers()]
    if absent:
        write(f"not installed (extra [peers]), so not beside ours: {', '.join(absent)}\n")
    for method in options.methods:
        measure(method, 30, options.dim, 2, options.batch, 0, options.chosen)  # compiles the loops
        for n in options.sizes:
            write(f"{method:28s} n = {n:5d}  {_line(method, n, options)}\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
