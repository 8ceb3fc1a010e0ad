"""Whether one method is better than another over the same seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

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
    method = stats.PermutationMethod(n_resamples=_RESAMPLES, rng=np.random.default_rng(0))
    return float(stats.wilcoxon(differences, method=method).pvalue)


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
