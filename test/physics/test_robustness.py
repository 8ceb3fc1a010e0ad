"""Repeated executions with noise: what the noise is, what is reported, and that the seed says it all."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mebo_grasp.cli.main import EXIT_USAGE, main
from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import GraspContact, GraspOutcome, Pose
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.robustness import (
    ExecutionNoise,
    InexactHand,
    execute,
    execute_candidate_repeatedly,
    execute_repeatedly,
    perturb_point,
    perturb_pose,
    tilt_normal,
)
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject

BOTTLE, HAND = TargetObject.builtin("bottle"), HandModel.load("icub_left")
SPACE = position_space(BOTTLE, HAND)
POSE = Pose.from_rpy([-0.045, 0.05, 0.01], [-math.pi / 2.0, 0.0, 0.0])


def test_noise_in_the_cube_has_its_size_and_stays_in_the_box() -> None:
    rng = np.random.default_rng(1)
    lower, upper = np.array([0.0, -2.0]), np.array([1.0, 8.0])
    inner = np.array([perturb_point([0.5, 3.0], lower, upper, 0.03, rng) for _ in range(4000)])
    np.testing.assert_allclose(inner.std(axis=0), [0.03, 0.3], rtol=0.05)
    np.testing.assert_allclose(inner.mean(axis=0), [0.5, 3.0], atol=0.03)
    edge = np.array([perturb_point([0.0, 8.0], lower, upper, 0.03, rng) for _ in range(400)])
    assert np.all((edge >= lower) & (edge <= upper))
    # Half of the noise would leave the box; the coordinate then keeps its noise-free value exactly.
    assert 0.4 < np.mean(edge[:, 0] == 0.0) < 0.6


def test_noise_on_the_pose_has_its_size() -> None:
    rng = np.random.default_rng(2)
    moved = [perturb_pose(POSE, 0.004, 0.05, rng) for _ in range(3000)]
    offsets = np.array([pose.position - POSE.position for pose in moved])
    turns = np.array([(POSE.rotation.inv() * pose.rotation).as_rotvec() for pose in moved])
    np.testing.assert_allclose(offsets.std(axis=0), 0.004, rtol=0.06)
    np.testing.assert_allclose(turns.std(axis=0), 0.05, rtol=0.06)


def test_tilted_normals_are_units_at_the_angle_asked_for() -> None:
    rng = np.random.default_rng(3)
    contact = GraspContact("link", np.zeros(3), np.array([0.6, 0.0, -0.8]))
    angles = [math.acos(min(1.0, float(tilt_normal(contact, 0.1, rng).normal @ contact.normal))) for _ in range(4000)]
    # The length of two Gaussians is Rayleigh distributed: mean sd * sqrt(pi / 2).
    assert np.mean(angles) == pytest.approx(0.1 * math.sqrt(math.pi / 2.0), rel=0.05)
    np.testing.assert_allclose(tilt_normal(contact, 0.0, rng).normal, contact.normal, atol=1e-15)


def test_mean_sd_and_worst_are_those_of_the_single_executions() -> None:
    noise = ExecutionNoise(position=0.005, rotation=0.05)
    with GraspSimulator(BOTTLE, HAND) as simulator:
        found = execute_repeatedly(simulator, POSE, noise, 25, np.random.default_rng(5))
        rng = np.random.default_rng(5)
        single = [execute(simulator, POSE, noise, rng).quality for _ in range(25)]
        exact = execute_repeatedly(simulator, POSE, ExecutionNoise(), 3, rng)
        plain = simulator.trial(POSE).quality
    np.testing.assert_array_equal(found.qualities, single)
    known, repeated = found.under_noise, exact.under_noise
    assert known is not None
    assert repeated is not None
    assert known.expected == pytest.approx(sum(single) / 25)
    assert known.sd == pytest.approx(math.sqrt(sum((q - known.expected) ** 2 for q in single) / 24))
    assert (known.worst, known.samples) == (min(single), 25)
    assert found.outcomes.total() == 25
    assert known.sd > 0.0
    np.testing.assert_allclose([repeated.expected, repeated.sd, repeated.worst], [plain, 0.0, plain], atol=1e-12)


def test_noise_on_friction_and_normals_changes_the_measure_and_not_the_contacts_places() -> None:
    with GraspSimulator(BOTTLE, HAND) as simulator:
        plain = simulator.trial(POSE)
        noisy = execute(simulator, POSE, ExecutionNoise(friction=0.2, normal=0.1), np.random.default_rng(2))
        same = simulator.measured_anew(plain, plain.contacts, simulator.settings)
    assert plain.outcome is GraspOutcome.GRASPED
    for a, b in zip(plain.contacts, noisy.contacts, strict=True):
        np.testing.assert_array_equal(a.position, b.position)
        assert not np.array_equal(a.normal, b.normal)
    assert plain.force_closure
    assert noisy.epsilon != plain.epsilon
    # Hard contacts pass all three components of a force, whatever their normals are.
    assert noisy.isotropy == pytest.approx(plain.isotropy, rel=1e-9)
    assert (same.epsilon, same.isotropy, same.volume) == (plain.epsilon, plain.isotropy, plain.volume)


def test_a_candidate_of_a_space_is_executed_with_noise_on_its_coordinates() -> None:
    x = (SPACE.lower + SPACE.upper) / 2.0
    with GraspSimulator(BOTTLE, HAND) as simulator:
        runs = [
            execute_candidate_repeatedly(
                simulator, SPACE, x, ExecutionNoise(unit=0.03), 10, np.random.default_rng(seed)
            ).qualities
            for seed in (1, 1, 2)
        ]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_what_cannot_be_is_refused() -> None:
    for name in ("unit", "position", "rotation", "friction", "normal"):
        for value in (-0.1, math.nan, math.inf):
            with pytest.raises(InvalidSettingsError, match=name):
                ExecutionNoise(**{name: value})
    with GraspSimulator(BOTTLE, HAND) as simulator:
        with pytest.raises(InvalidSettingsError, match="repeats"):
            execute_repeatedly(simulator, POSE, ExecutionNoise(), 0, np.random.default_rng(1))
        with pytest.raises(InvalidSettingsError, match="search space"):
            execute_repeatedly(simulator, POSE, ExecutionNoise(unit=0.1), 2, np.random.default_rng(1))


def test_the_command_line_repeats_a_trial(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["trial", "--repeat", "5", "--position-noise", "0.003", "--seed", "4", "--engine", "fast"]
    printed = []
    for _ in range(2):
        assert main(arguments) == 0
        printed.append(capsys.readouterr().out.split("executed 5 times")[1])
    assert printed[0] == printed[1]
    assert "standard deviation" in printed[0]
    assert main([*arguments, "--normal-noise", "-1"]) == EXIT_USAGE


def test_an_inexact_hand_is_executed_elsewhere_than_it_says() -> None:
    noise = ExecutionNoise(position=0.003, rotation=0.03, normal=0.05)
    with GraspSimulator(BOTTLE, HAND) as simulator:
        rng = np.random.default_rng(8)
        executed = [execute(simulator, POSE, noise, rng) for _ in range(3)]
        hand = InexactHand(simulator, noise, np.random.default_rng(8))
        told = [hand.trial(POSE) for _ in range(3)]
        exact = InexactHand(simulator, ExecutionNoise(), np.random.default_rng(8)).trial(POSE)
        plain = simulator.trial(POSE)
    assert all(grasp.T_object_tcp is POSE for grasp in told)
    assert not any(np.array_equal(grasp.T_object_tcp.position, POSE.position) for grasp in executed)
    assert [grasp.quality for grasp in told] == [grasp.quality for grasp in executed]
    assert len({grasp.hand_posture for grasp in told}) == 3
    assert (exact.quality, exact.hand_posture) == (plain.quality, plain.hand_posture)


def test_a_repeated_grasp_carries_what_its_further_executions_came_to() -> None:
    noise, far = ExecutionNoise(position=0.004, rotation=0.05), Pose.from_rpy([0.0, 0.6, 0.0], [0.0, 0.0, 0.0])
    with GraspSimulator(BOTTLE, HAND) as simulator:
        rng = np.random.default_rng(8)
        first, *further = [execute(simulator, POSE, noise, rng).quality for _ in range(6)]
        hand = InexactHand(simulator, noise, np.random.default_rng(8), repetitions=5)
        grasp, missed = hand.trial(POSE), hand.trial(far)
    assert grasp.quality == first > 0.0
    assert grasp.under_noise is not None
    assert grasp.under_noise.samples == 5
    assert grasp.under_noise.expected == pytest.approx(np.mean(further))
    assert grasp.under_noise.sd == pytest.approx(np.std(further, ddof=1))
    assert grasp.under_noise.worst == min(further)
    assert (missed.quality, missed.under_noise) == (0.0, None)


@pytest.mark.parametrize(("repetitions", "noise"), [(-1, ExecutionNoise(position=0.01)), (3, ExecutionNoise())])
def test_repetitions_that_could_not_tell_anything_are_refused(repetitions: int, noise: ExecutionNoise) -> None:
    with GraspSimulator(BOTTLE, HAND) as simulator, pytest.raises(InvalidSettingsError, match="repetitions is"):
        InexactHand(simulator, noise, np.random.default_rng(1), repetitions)
