"""Synergies: principal components by hand and by a second library, postures from amplitudes, the shipped basis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sklearn.decomposition import PCA

from mebo_grasp.errors import InvalidHandError, InvalidSettingsError
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.synergies import (
    closing_trajectory,
    hand_synergies,
    principal_components,
    read_synergies,
    synergies_text,
)

HAND = HandModel.load("icub_left")


def test_components_are_those_of_scikit_learn() -> None:
    rng = np.random.default_rng(1)
    data = rng.normal(size=(200, 5)) @ rng.normal(size=(5, 5))
    own, other = principal_components("abcde", data, 3), PCA(3).fit(data)
    np.testing.assert_allclose(own.mean, other.mean_, atol=1e-12)
    np.testing.assert_allclose(np.abs(own.components), np.abs(other.components_), atol=1e-9)
    np.testing.assert_allclose(own.deviations**2, other.explained_variance_, rtol=1e-9)
    np.testing.assert_allclose(own.explained, other.explained_variance_ratio_, rtol=1e-9)


def test_two_joints_that_move_together_by_hand() -> None:
    """Postures t (3, 4) / 5 with t of -2, 0, 2: one component, with a standard deviation of 2."""
    basis = principal_components(("a", "b"), np.outer([-2.0, 0.0, 2.0], [0.6, 0.8]) + np.array([1.0, 2.0]), 1)
    np.testing.assert_allclose(basis.mean, [1.0, 2.0])
    np.testing.assert_allclose(basis.components, [[0.6, 0.8]], atol=1e-12)
    np.testing.assert_allclose(basis.deviations, [2.0])
    np.testing.assert_allclose(basis.explained, [1.0])


def test_a_closing_trajectory_by_hand() -> None:
    way = closing_trajectory([0.0, 1.0, 0.5], [1.0, 0.8, 0.5], 6)
    np.testing.assert_allclose(way[:, 0], [0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    np.testing.assert_allclose(way[:, 1], [1.0, 0.8, 0.8, 0.8, 0.8, 0.8])
    np.testing.assert_allclose(way[:, 2], 0.5)


def test_amplitudes_and_postures_are_inverse_where_no_limit_cuts() -> None:
    basis = hand_synergies(HAND)
    for amplitudes in ([0.2, -0.3, 0.1, 0.2], [0.0, 0.0, 0.0, 0.0], [-0.3, 0.2, 0.1, 0.0]):
        posture = basis.posture(HAND, amplitudes)
        np.testing.assert_allclose(basis.amplitudes(posture), amplitudes, atol=1e-5)


def test_postures_keep_the_limits_whatever_the_amplitude() -> None:
    basis = hand_synergies(HAND)
    for amplitude in (-50.0, 50.0):
        joints = np.array(basis.posture(HAND, [amplitude]).positions)
        assert np.all(joints >= HAND.lower)
        assert np.all(joints <= HAND.upper)


def test_the_shipped_basis_is_one_and_both_hands_have_the_same() -> None:
    left, right = hand_synergies(HAND), hand_synergies(HandModel.load("icub_right"))
    np.testing.assert_allclose(left.components @ left.components.T, np.eye(left.count), atol=1e-5)
    np.testing.assert_array_equal(left.components, right.components)
    assert [name[1:] for name in left.joints] == [name[1:] for name in right.joints]
    assert np.all(np.diff(left.explained) < 0.0)
    assert left.explained.sum() <= 1.0
    # The first bends all fingers: a power grasp.
    assert np.all(left.components[0] >= 0.0)


def test_a_basis_is_read_as_it_was_written(tmp_path: Path) -> None:
    basis = hand_synergies(HAND)
    path = tmp_path / "basis.yaml"
    path.write_text(synergies_text(basis, "# a comment"))
    again = read_synergies(path)
    assert again.joints == basis.joints
    np.testing.assert_array_equal(again.components, basis.components)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "joints: [a]",
        "joints: [a]\nmean: [0]\ncomponents: [[1, 0]]\ndeviations: [1]\nexplained: [1]",
        "joints: [a]\nmean: [.nan]\ncomponents: [[1]]\ndeviations: [1]\nexplained: [1]",
        "joints: [a]\nmean: [0]\ncomponents: []\ndeviations: []\nexplained: []",
    ],
)
def test_broken_files_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "basis.yaml").write_text(text)
    with pytest.raises(InvalidHandError):
        read_synergies(tmp_path / "basis.yaml")


def test_what_cannot_be_is_refused() -> None:
    basis = hand_synergies(HAND)
    with pytest.raises(InvalidSettingsError, match="at most 4"):
        basis.posture(HAND, np.zeros(5))
    with pytest.raises(InvalidSettingsError, match="finite"):
        basis.posture(HAND, [np.nan])
    with pytest.raises(InvalidHandError, match="l_thumb_0"):
        basis.posture(HandModel.load("icub_right"), [0.0])
    with pytest.raises(InvalidSettingsError, match="cannot come"):
        principal_components("ab", np.zeros((2, 2)), 2)
