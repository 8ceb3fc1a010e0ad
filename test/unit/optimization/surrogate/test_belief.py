"""Beliefs about functions with a plateau, against functions whose plateau is known."""

import json

import numpy as np
import pytest

from mebo_grasp.errors import RunLogError
from mebo_grasp.optimization.surrogate.belief import Belief, PlateauSurrogate, shows_too_little


def cliff(U):
    """Rises towards 0.6 along the first axis and falls to a plateau at 0 beyond it and below 0.3."""
    return np.where((U[:, 0] > 0.3) & (U[:, 0] < 0.6), 1.0 + U[:, 0], 0.0)


@pytest.fixture(scope="module")
def belief():
    U = np.random.default_rng(0).random((80, 2))
    return PlateauSurrogate(2).update(U, cliff(U), np.random.default_rng(1)).best


def test_plateau_is_where_it_is(belief):
    inside = belief.log_chances(np.array([[0.45, 0.5], [0.4, 0.2]]))
    outside = belief.log_chances(np.array([[0.85, 0.5], [0.1, 0.2]]))
    assert np.all(np.exp(inside) > 0.9)
    assert np.all(np.exp(outside) < 0.1)


def ragged(U):
    """A hill off the plateau whose edge waves along the third of six axes; the last two tell nothing."""
    edge = ((U[:, 0] - 0.5) / 0.3) ** 2 + ((U[:, 1] - 0.5) / 0.35) ** 2 + 0.3 * np.sin(9.0 * U[:, 2])
    return np.where(edge < 1.0, 1.0 + U[:, 3], 0.0)


def test_chances_are_believed_no_more_than_they_hold():
    """Log loss on fresh points: 0.61 for the share off the plateau alone, 0.32 for labels taken as exact."""
    losses = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        U, A = rng.random((80, 6)), rng.random((2000, 6))
        log_chances = PlateauSurrogate(6).update(U, ragged(U), rng).best.log_chances(A)
        off = ragged(A) > 0.0
        losses.append(-np.mean(np.where(off, log_chances, np.log1p(-np.exp(log_chances)))))
    assert np.mean(losses) < 0.25


def test_values_beside_the_cliff_are_not_drawn_to_the_plateau(belief):
    A = np.array([[0.55, 0.5], [0.35, 0.4]])
    mean, _ = belief.predict(A)
    np.testing.assert_allclose(mean, cliff(A), atol=0.02)


def test_mean_of_the_function_is_the_plateau_s_value_on_the_plateau(belief):
    np.testing.assert_allclose(belief.predict_mean(np.array([[0.9, 0.5], [0.1, 0.2]])), 0.0, atol=0.1)


def differences(function, A):
    """Gradient by central differences, shape (m, 2); with shorter steps rounding would show."""
    steps = 1e-5 * np.eye(2)
    return np.stack([(function(A + step) - function(A - step)) / 2e-5 for step in steps], axis=1)


def test_gradients_agree_with_differences(belief):
    A = np.array([[0.45, 0.5], [0.62, 0.3], [0.25, 0.7]])
    cases = [
        (lambda A: belief.optimistic(A)[0], belief.optimistic(A)[1]),
        (belief.log_chances, belief.log_chances_with_gradients(A)[1]),
        (belief.predict_mean, belief.mean_gradient(A)),
    ]
    for function, gradient in cases:
        np.testing.assert_allclose(differences(function, A), gradient, rtol=1e-3, atol=1e-4)


def test_without_a_plateau_it_is_the_gaussian_process():
    U = np.random.default_rng(0).random((20, 2))
    y = np.sin(5.0 * U[:, 0]) + U[:, 1]
    belief = PlateauSurrogate(2).update(U, y, np.random.default_rng(1)).best
    A = np.random.default_rng(2).random((5, 2))
    assert belief.chance is None
    np.testing.assert_array_equal(belief.log_chances(A), np.zeros(5))
    np.testing.assert_array_equal(belief.predict_mean(A), belief.value.predict_mean(A))


def test_one_value_off_the_plateau_is_too_few_to_model_by_itself():
    U = np.random.default_rng(0).random((20, 2))
    y = np.zeros(20)
    y[3] = 1.0
    assert PlateauSurrogate(2).update(U, y, np.random.default_rng(1)).best.chance is None


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.0] * 25, True),
        ([0.0] * 23 + [1.0, 2.0], True),
        ([0.0] * 22 + [1.0, 2.0, 3.0], False),
        ([0.0, 1.0, 2.0], False),
        ([0.0] * 3, False),
        ([], False),
    ],
)
def test_plateau_with_next_to_nothing_off_it_shows_too_little(values, expected):
    assert shows_too_little(np.array(values)) is expected


def test_plateau_is_not_forgotten_when_the_search_has_left_it():
    rng = np.random.default_rng(0)
    early, late = np.zeros(8), rng.uniform(1.0, 2.0, 72)
    U = rng.random((80, 2))
    y = np.concatenate([early[:4], late[:4], early[4:], late[4:]])
    assert PlateauSurrogate(2).update(U, y, rng).best.chance is not None
    spread_out = np.concatenate([late[:36], early, late[36:]])
    assert PlateauSurrogate(2).update(U, spread_out, rng).best.chance is not None
    few_among_many = np.concatenate([late, early])
    assert PlateauSurrogate(2).update(U, few_among_many, rng).best.chance is None


def test_assumed_points_extend_both_parts(belief):
    A = np.array([[0.5, 0.5]])
    after = belief.condition_on(A)
    assert after.y[-1] == pytest.approx(belief.value.predict_mean(A)[0])
    for before, part in zip(belief.parts, after.parts, strict=True):
        assert part.n == before.n + 1
        assert part.predict(A)[1][0] < before.predict(A)[1][0]
        assert part.predict_mean(A)[0] == pytest.approx(before.predict_mean(A)[0], rel=1e-6)
    np.testing.assert_array_equal(after.U[-1], A[0])


def test_state_survives_json():
    U = np.random.default_rng(0).random((60, 2))
    y = cliff(U)
    one, two = PlateauSurrogate(2), PlateauSurrogate(2)
    one.update(U, y, np.random.default_rng(1))
    two.restore(json.loads(json.dumps(one.state())))
    A = np.random.default_rng(3).random((5, 2))
    first, second = one.belief(U, y), two.belief(U, y)
    assert isinstance(first, Belief)
    np.testing.assert_array_equal(first.predict(A)[0], second.predict(A)[0])
    np.testing.assert_array_equal(first.log_chances(A), second.log_chances(A))


def test_unreadable_state_is_refused():
    with pytest.raises(RunLogError, match="labels"):
        PlateauSurrogate(2).restore({**PlateauSurrogate(2).state(), "labels": None})
