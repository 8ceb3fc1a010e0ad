"""Trials with the real PyBullet: the same pose gives the same bits, and outcomes are what they must be."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from mebo_grasp.grasp import Grasp, GraspOutcome, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import EngineName, TrialSettings

TARGET, HAND = TargetObject.builtin("bottle"), HandModel.load("icub_left")
SPACE = position_space(TARGET, HAND)


def poses(count: int, seed: int = 3) -> list[Pose]:
    rng = np.random.default_rng(seed)
    return [SPACE.to_pose(rng.uniform(SPACE.lower, SPACE.upper)) for _ in range(count)]


def figures(grasp: Grasp) -> tuple[object, ...]:
    contacts = tuple((c.link, *c.position.tolist(), *c.normal.tolist()) for c in grasp.contacts)
    metrics = (grasp.quality, grasp.epsilon, grasp.volume, grasp.isotropy, grasp.force_closure)
    return (grasp.outcome, *metrics, contacts, grasp.hand_posture)


@pytest.fixture(scope="module")
def tried() -> list[tuple[Pose, Grasp]]:
    with GraspSimulator(TARGET, HAND) as simulator:
        return [(pose, simulator.trial(pose)) for pose in poses(40)]


def test_the_same_pose_gives_the_same_bits_in_any_order_and_world(tried: list[tuple[Pose, Grasp]]) -> None:
    with GraspSimulator(TARGET, HAND) as simulator:
        again = [simulator.trial(pose) for pose, _ in reversed(tried)][::-1]
    assert [figures(grasp) for grasp in again] == [figures(grasp) for _, grasp in tried]


def test_another_process_gives_the_same_bits(tried: list[tuple[Pose, Grasp]]) -> None:
    program = (
        "from test.physics.test_trial import *\n"
        "with GraspSimulator(TARGET, HAND) as simulator:\n"
        "    print('figures:', [figures(simulator.trial(pose)) for pose in poses(5)])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=240, check=True)
    expected = [figures(grasp) for _, grasp in tried[:5]]
    assert done.stdout.split("figures: ")[1].strip() == str(expected)


def test_closed_hands_keep_their_limits_and_their_outcomes(tried: list[tuple[Pose, Grasp]]) -> None:
    outcomes = {grasp.outcome for _, grasp in tried}
    assert GraspOutcome.GRASPED in outcomes
    for _, grasp in tried:
        joints = np.array(grasp.hand_posture.positions)
        assert np.all(joints >= HAND.lower - 1e-12)
        assert np.all(joints <= HAND.upper + 1e-12)
        assert grasp.force_closure == (grasp.epsilon > 0.0)
        assert bool(grasp.contacts) == (grasp.outcome is GraspOutcome.GRASPED)
        if grasp.outcome is not GraspOutcome.GRASPED:
            assert grasp.quality == 0.0


@pytest.mark.parametrize("engine", ["bullet", "fast"])
@pytest.mark.parametrize("name", ["bottle", "mug"])
def test_no_joint_of_a_closed_hand_can_move_on(name: str, engine: EngineName) -> None:
    target = TargetObject.builtin(name)
    space, rng, joints = position_space(target, HAND), np.random.default_rng(4), 0
    with GraspSimulator(target, HAND, TrialSettings(engine=engine, compute_volume=False)) as simulator:
        for x in rng.uniform(space.lower, space.upper, (100, space.dimension)):
            if simulator.trial(space.to_pose(x)).outcome is GraspOutcome.COLLISION:
                continue
            shares = simulator.free_shares()
            joints += shares.size
            assert shares.max() <= 0.01
    assert joints > 300


def test_far_away_nothing_is_touched_and_inside_the_hand_collides() -> None:
    with GraspSimulator(TARGET, HAND) as simulator:
        far = simulator.trial(Pose(np.array([100.0, -40.0, 7.0])))
        inside = simulator.trial(Pose(np.zeros(3)))
    assert (far.outcome, far.quality, far.contacts) == (GraspOutcome.NO_CONTACT, 0.0, ())
    assert (inside.outcome, inside.quality, inside.contacts) == (GraspOutcome.COLLISION, 0.0, ())


def test_normals_point_into_the_object(tried: list[tuple[Pose, Grasp]]) -> None:
    for _, grasp in tried:
        for contact in grasp.contacts:
            # The bottle is a body of revolution: inwards is towards the axis, or along it at its ends.
            outward = np.array([contact.position[0], contact.position[1], 0.0])
            towards_axis = -contact.normal @ outward / np.linalg.norm(outward)
            at_an_end = abs(abs(contact.position[2]) - TARGET.bounds[1, 2]) < 0.02
            assert towards_axis > 0.3 or at_an_end
