"""The paired test and its correction, against values found by hand."""

from __future__ import annotations

import pytest

from mebo_grasp.experiments.scores.statistics import against_best, holm, mean_sd, paired_p


def _seeds(*values: float) -> dict[int, float]:
    return dict(enumerate(values))


@pytest.mark.parametrize(("n", "expected"), [(5, 2 / 32), (6, 2 / 64), (10, 2 / 1024)])
def test_a_difference_at_every_seed_has_the_least_p_value(n: int, expected: float) -> None:
    worse = _seeds(*[0.1 * k for k in range(n)])
    better = {seed: value + 1.0 + 0.01 * seed for seed, value in worse.items()}
    assert paired_p(better, worse) == pytest.approx(expected)
    assert paired_p(worse, better) == pytest.approx(expected)


def test_signed_ranks_by_hand() -> None:
    # Differences 1, 2, 3, -4: ranks of the positive ones sum to 6 of 10. Of 16 sign patterns 7 have a sum of at most 4
    # (0, 1, 2, 3, 3, 4, 4) and as many one of at least 6.
    assert paired_p(_seeds(1, 2, 3, 0), _seeds(0, 0, 0, 4)) == pytest.approx(14 / 16)


def test_only_seeds_of_both_count_and_equal_values_tell_nothing() -> None:
    assert paired_p(_seeds(1, 1, 1), _seeds(1, 1, 1)) == 1.0
    assert paired_p({0: 5.0, 1: 6.0}, {7: 1.0}) == 1.0


def test_holm_by_hand() -> None:
    # Smallest times 3, next times 2, last times 1, never falling, at most 1.
    assert holm([0.04, 0.01, 0.03]) == pytest.approx([0.06, 0.03, 0.06])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_the_best_is_by_mean_and_direction() -> None:
    cells = {"a": _seeds(1, 2, 3, 4, 5, 6), "b": _seeds(2, 3, 4, 5, 6, 8), "c": _seeds(9, 0, 0, 0, 0, 1)}
    best, p = against_best(cells, higher_is_better=True)
    assert best == "b"
    # Ties of the differences do not matter: all six have one sign.
    assert p["a"] == pytest.approx(2 * 2 / 64)
    assert set(p) == {"a", "c"}
    assert against_best(cells, higher_is_better=False)[0] == "c"
    assert against_best({"a": {}}, higher_is_better=True) == (None, {})


def test_mean_and_sample_deviation() -> None:
    assert mean_sd([1.0, 3.0]) == pytest.approx((2.0, 2.0**0.5))
    assert mean_sd([4.0]) == (4.0, 0.0)
