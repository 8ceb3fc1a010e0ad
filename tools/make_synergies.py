"""Derive the iCub hands' synergies: principal components of closing trajectories on the built-in objects.

Hands stand at random poses of each object's 6-D space with a random thumb opposition, close, and end where they touch;
each way from open to closed is sampled evenly in time. The left hand closes; the right one, its mirror image with
joints of the same sign, gets the same numbers.

Run: python tools/make_synergies.py mebo_grasp/grasping/hands
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from mebo_grasp.grasp import GraspOutcome
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import pose_space_6d
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.synergies import (
    SynergyBasis,
    closing_trajectory,
    principal_components,
    synergies_text,
)
from mebo_grasp.grasping.target_object import BUILTIN_OBJECTS, TargetObject
from mebo_grasp.grasping.trial import TrialSettings

SEED = 1
GRASPS_AN_OBJECT = 60
SAMPLES = 12
COMPONENTS = 4
OPPOSITION = (0.5, np.radians(90.0))
"""Range of the thumb's opposition, radians: within the real hand's 10 to 90 degrees, where it faces the fingers."""
COMMENT = """\
# Synergies of the iCub {side} hand: mean, and principal components of {count} postures on the ways of {grasps}
# simulated closings (light left hand, built-in objects, random poses and thumb oppositions, seed {seed}). Radians. Not
# measured on people or on a robot. Written by tools/make_synergies.py."""


def closings(target: TargetObject, hand: HandModel, joints: list[str], rng: np.random.Generator) -> list[np.ndarray]:
    """Return the trajectories of closings that ended in a grasp, each (SAMPLES, d)."""
    space = pose_space_6d(target, hand)
    found: list[np.ndarray] = []
    with GraspSimulator(target, hand, TrialSettings(engine="fast", compute_volume=False)) as simulator:
        while len(found) < GRASPS_AN_OBJECT:
            start = hand.posture({"l_thumb_0": rng.uniform(*OPPOSITION)})
            grasp = simulator.trial(space.to_pose(rng.uniform(space.lower, space.upper)), start)
            if grasp.outcome is GraspOutcome.GRASPED:
                first, last = (
                    [dict(zip(p.names, p.positions, strict=True))[name] for name in joints]
                    for p in (start, grasp.hand_posture)
                )
                found.append(closing_trajectory(first, last, SAMPLES))
    return found


def main() -> None:
    """Write both hands' files into the folder given as the only argument."""
    hand, rng = HandModel.load("icub_left"), np.random.default_rng(SEED)
    joints = [name for name in hand.joint_names if not name.endswith("_0") or "thumb" in name]
    ways = [way for name in BUILTIN_OBJECTS for way in closings(TargetObject.builtin(name), hand, joints, rng)]
    postures = np.vstack(ways)
    basis = principal_components(joints, postures, COMPONENTS)
    for side in ("left", "right"):
        named = tuple(f"{side[0]}{name[1:]}" for name in joints)
        own = SynergyBasis(named, basis.mean, basis.components, basis.deviations, basis.explained)
        comment = COMMENT.format(side=side, count=len(postures), grasps=len(ways), seed=SEED)
        (Path(sys.argv[1]) / f"icub_{side}_synergies.yaml").write_text(synergies_text(own, comment))
    print("explained:", np.round(basis.explained, 3))


if __name__ == "__main__":
    main()
