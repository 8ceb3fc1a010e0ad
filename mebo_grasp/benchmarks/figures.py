"""Timings of trials and figures beside what is asked, for the benchmarks of the hand."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from mebo_grasp.grasp import FloatArray, Grasp, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import EngineName, TrialSettings

T = TypeVar("T")
R = TypeVar("R")

ENGINES: tuple[EngineName, ...] = ("bullet", "fast")
HAND = "icub_left"
EDGES = 8
WARM_UP = 30


@dataclass(frozen=True)
class Target:
    """A figure that is asked of this machine's kind, one core.

    Args:
        name: what is measured.
        limit: the figure asked for.
        at_least: whether more is better.
    """

    name: str
    limit: float
    at_least: bool = True

    def verdict(self, value: float) -> str:
        """Return the figure beside what is asked, and whether it is reached."""
        if np.isnan(value):
            return f"{self.name}: not defined on these poses"
        reached = value >= self.limit if self.at_least else value <= self.limit
        sign = ">=" if self.at_least else "<="
        return f"{self.name}: {value:.4g} (asked {sign} {self.limit:g}; {'reached' if reached else 'MISSED'})"


@dataclass(frozen=True)
class Timing:
    """Seconds of each call: wall and CPU, shape (n,)."""

    wall: FloatArray
    cpu: FloatArray

    def line(self) -> str:
        """Rates and the spread of the wall time."""
        low, middle, high = 1e3 * np.quantile(self.wall, [0.05, 0.5, 0.95])
        n = len(self.wall)
        return (
            f"{n / self.wall.sum():7.0f}/s wall, {n / self.cpu.sum():7.0f}/s CPU; "
            f"ms median {middle:7.3f}, 5-95 % {low:.3f} to {high:.3f}; mean wall {1e3 * self.wall.mean():.3f}, "
            f"CPU {1e3 * self.cpu.mean():.3f}"
        )


def timed(call: Callable[[T], R], inputs: Sequence[T]) -> tuple[list[R], Timing]:
    """Call with each input in turn and time each call."""
    results, wall, cpu = [], np.empty(len(inputs)), np.empty(len(inputs))
    for i, value in enumerate(inputs):
        cpu_start, wall_start = time.process_time(), time.perf_counter()
        results.append(call(value))
        wall[i], cpu[i] = time.perf_counter() - wall_start, time.process_time() - cpu_start
    return results, Timing(wall, cpu)


def try_all(
    target: TargetObject, hand: HandModel, settings: TrialSettings, poses: Sequence[Pose]
) -> tuple[list[Grasp], Timing]:
    """Try all poses, after a warm-up on the first ones that is not timed."""
    with GraspSimulator(target, hand, settings) as simulator:
        for pose in poses[:WARM_UP]:
            simulator.trial(pose)
        return timed(simulator.trial, poses)
