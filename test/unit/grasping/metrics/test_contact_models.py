"""Contact models against wrenches and singular values found by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.metrics.contact_models import (
    grasp_matrix,
    model_wrenches,
    singular_ratio,
)
from mebo_grasp.grasping.wrench_space import contact_frames, contact_wrenches, epsilon, isotropy

ORIGIN = np.zeros(3)
LINE = (np.array([[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0]]), np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))


def ring(count: int, radius: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    angles = 2.0 * np.pi * np.arange(count) / count
    outward = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
    return radius * outward, -outward


def test_a_soft_contact_by_hand() -> None:
    """A push of 1 along -x carries a torque of gamma about x either way, over the torque length."""
    wrenches = model_wrenches("soft", [[0.05, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], 0.5, 4, ORIGIN, 0.1, 0.004)
    assert wrenches.shape == (6, 6)
    np.testing.assert_allclose(wrenches[:4, 0], -1.0 / math.sqrt(1.25), atol=1e-12)
    np.testing.assert_allclose(wrenches[4:], [[-1, 0, 0, -0.04, 0, 0], [-1, 0, 0, 0.04, 0, 0]], atol=1e-15)


def test_the_hard_model_is_the_plain_one_and_the_frictionless_has_normals_only() -> None:
    positions, normals = ring(3)
    hard = model_wrenches("hard", positions, normals, 0.5, 8, ORIGIN, 0.1)
    np.testing.assert_array_equal(hard, contact_wrenches(positions, normals, 0.5, 8, ORIGIN, 0.1))
    bare = model_wrenches("frictionless", positions, normals, 0.5, 8, ORIGIN, 0.1)
    np.testing.assert_allclose(bare, np.hstack([normals, np.zeros((3, 3))]), atol=1e-15)


def test_two_soft_fingers_hold_what_two_hard_ones_let_turn() -> None:
    """About their line hard contacts resist no torque, soft ones do: the textbook's reason for soft fingers."""
    hard = model_wrenches("hard", *LINE, 0.5, 8, ORIGIN, 0.1)
    soft = model_wrenches("soft", *LINE, 0.5, 8, ORIGIN, 0.1, 0.004)
    assert epsilon(hard) == 0.0
    assert 0.0 < epsilon(soft) <= 0.04
    # Pure torque about the line: the largest is gamma / L, from pushes that cancel.
    assert max(soft[:, 3]) == pytest.approx(0.04)


def test_more_torsion_never_makes_a_grasp_worse() -> None:
    positions, normals = ring(3)
    values = [
        epsilon(model_wrenches("soft", positions, normals, 0.5, 8, ORIGIN, 0.05, gamma))
        for gamma in (0.0, 0.002, 0.01, 0.05)
    ]
    assert values == sorted(values)
    # Without torsion the two added wrenches are pushes along the normal, which reach beyond the pyramid's base.
    assert values[0] >= epsilon(model_wrenches("hard", positions, normals, 0.5, 8, ORIGIN, 0.05))


def test_contact_frames_are_right_angled() -> None:
    rng = np.random.default_rng(2)
    normals = np.vstack([rng.normal(size=(20, 3)), [[0, 0, 1.0], [0, 0, -1.0]]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    frames = contact_frames(normals)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (22, 1, 1)), atol=1e-9)
    np.testing.assert_array_equal(frames[:, 0], normals)


def test_isotropy_of_the_hard_grasp_matrix_is_the_basic_one_and_soft_adds_torsion() -> None:
    positions, normals = ring(3)
    for length in (0.02, 0.05, 0.2):
        G = grasp_matrix("hard", positions, normals, ORIGIN, length)
        assert singular_ratio(G) == pytest.approx(isotropy(positions, normals, ORIGIN, length), abs=1e-12)
    # At L = radius GG' = diag(3, 3, 3, 1.5, 1.5, 3); the torques about the three normals add 1.5 about x and y.
    soft = grasp_matrix("soft", positions, normals, ORIGIN, 0.05)
    np.testing.assert_allclose(soft @ soft.T, np.diag([3.0, 3.0, 3.0, 3.0, 3.0, 3.0]), atol=1e-12)
    assert singular_ratio(soft) == pytest.approx(1.0, abs=1e-12)
    assert singular_ratio(grasp_matrix("frictionless", positions, normals, ORIGIN, 0.05)) == 0.0


def test_an_unknown_model_and_a_torsion_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidSettingsError, match="sticky"):
        model_wrenches("sticky", *LINE, 0.5, 8, ORIGIN, 0.1)
    for torsion in (-1.0, math.nan, math.inf):
        with pytest.raises(InvalidSettingsError, match="torsion"):
            model_wrenches("soft", *LINE, 0.5, 8, ORIGIN, 0.1, torsion)
