"""Whether one method is better than another over the same seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from mebo_grasp.optimization.initial_design import rng_argument

LEVEL = 0.05
_RESAMPLES = 9999


def mean_sd(values: Sequence[float]) -> tuple[float, float]:
    """Return mean and sample standard deviation (n - 1; 0 for one value)."""
    array = np.array(values, dtype=np.float64)
    return float(np.mean(array)), float(np.std(array, ddof=1)) if len(array) > 1 else 0.0


def paired_p(a: Mapping[int, float], b: Mapping[int, float]) -> float:
    """Return the two-sided p-value of Wilcoxon's signed-rank test over the seeds that both have.

    Up to 13 seeds all signs are gone through, so that ties and zeros do no harm; with fewer than six no p-value gets
    below 0.05.

    Args:
        a: values of one method by seed.
        b: values of the other.
    """
    seeds = sorted(a.keys() & b.keys())
    differences = np.array([a[seed] - b[seed] for seed in seeds], dtype=np.float64)
    differences = differences[differences != 0.0]
    if len(differences) < 2:
        return 1.0
    # scipy.stats.wilcoxon itself goes through the signs from release 1.13 on only.
    ranks = stats.rankdata(np.abs(differences))
    found = stats.permutation_test(
        (differences,),
        lambda d, axis: np.sum((d > 0.0) * ranks, axis=axis),
        permutation_type="samples",
        n_resamples=_RESAMPLES,
        axis=-1,
        **rng_argument(stats.permutation_test, np.random.default_rng(0)),
    )
    return float(found.pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values adjusted for the number of tests by Holm's step-down rule, in the order given."""
    order = np.argsort(p_values, kind="stable")
    adjusted, highest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(order):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = highest
    return adjusted


def against_best(
    cells: Mapping[str, Mapping[int, float]], higher_is_better: bool
) -> tuple[str | None, dict[str, float]]:
    """Find the best method of a column and compare every other with it.

    Args:
        cells: by method its values by seed.
        higher_is_better: whether the greatest mean is the best.

    Returns:
        The method with the best mean, None without a value; and of each other the p-value, adjusted by Holm's rule.
    """
    means = {method: mean_sd(list(values.values()))[0] for method, values in cells.items() if values}
    if not means:
        return None, {}
    best = (max if higher_is_better else min)(means, key=means.__getitem__)
    others = [method for method in means if method != best]
    return best, dict(zip(others, holm([paired_p(cells[best], cells[m]) for m in others]), strict=True))
