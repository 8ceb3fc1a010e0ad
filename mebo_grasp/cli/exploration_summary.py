"""What is printed at the end of an exploration: the set, and what is left of it under two occlusions."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from mebo_grasp.cli.report import grasp_table
from mebo_grasp.grasp import Pose, StampedGrasp
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.nodes.exploration_client import ExplorationClient
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.occlusion import Box, Occlusion

SETTLE_TIMEOUT = 10.0
"""Seconds until the solution set must have stored the last trials."""
FAR = 1.0
"""Half side, metres, of the occluding boxes of the demonstration: wide enough for every hand around."""


def print_summary(
    client: ExplorationClient, target: TargetObject, wanted: int, min_distance: float
) -> tuple[StampedGrasp, ...]:
    """Print the set and the best grasps under occlusion; return the set.

    Args:
        client: talks to the nodes.
        target: the object.
        wanted: number of grasps that the set was to have.
        min_distance: their least distance, metres.
    """
    if client.standing is None or (client.standing.evaluations == 0 and not client.services_ready()):
        return ()
    # The hand may have tried grasps before the solution set node was seen: it must not be stopped without them.
    client.wait_until(client.services_ready, SETTLE_TIMEOUT, "the solution set node")
    kept = client.solution_set()
    end = time.monotonic() + SETTLE_TIMEOUT
    while kept.stored < client.standing.evaluations and time.monotonic() < end:
        client.spin(0.05)
        kept = client.solution_set()
    print(
        f"\n{kept.stored} trials stored; {len(kept.grasps)} diverse grasps, mean quality "
        f"{kept.mean_quality:.4f}, mean distance to the nearest {1000 * kept.mean_min_distance:.0f} mm"
    )
    if 0 < len(kept.grasps) < wanted:
        print(f"{wanted} were wanted: no other grasp above 0 is {1000 * min_distance:g} mm away from all of these")
    if not kept.grasps:
        print("no grasp with a quality above 0 was found")
        return ()
    print(grasp_table(kept.grasps))
    top, middle = third_of(target, 2, "top"), third_of(target, 1, "middle")
    for occluded, occlusions in (("the top", [top]), ("top and middle", [top, middle])):
        _print_best(client, f"with {occluded} occluded, by the TCP alone", occlusions, BlockingRule.TCP)
    _print_best(client, "with the top occluded, for the whole hand", [top], BlockingRule.HAND)
    return kept.grasps


def third_of(target: TargetObject, index: int, name: str) -> Occlusion:
    """Return the occlusion of one third of an object's height and all beside it.

    Args:
        target: the object.
        index: 0 for the lowest third, 2 for the highest, which reaches far above the object.
        name: name of the occlusion.
    """
    lowest, highest = target.bounds[:, 2]
    third = (highest - lowest) / 3.0
    bottom = lowest + index * third
    top = highest + FAR if index == 2 else bottom + third
    center = np.array([*target.bounds.mean(axis=0)[:2], (bottom + top) / 2.0])
    return Occlusion(name, Box((2 * FAR, 2 * FAR, float(top - bottom))), Pose(center))


def _print_best(client: ExplorationClient, title: str, occlusions: Sequence[Occlusion], rule: BlockingRule) -> None:
    answer = client.best_grasp(occlusions, rule)
    print(f"\nbest grasp {title} ({answer.occluded} of {answer.considered} grasps looked at are blocked):")
    print(f"  none: {answer.message}" if answer.best is None else grasp_table([answer.best]))
