"""By which figure of a grasp the best one is told."""

from __future__ import annotations

from enum import StrEnum
from statistics import NormalDist

from mebo_grasp.grasp import FloatArray

DEFAULT_QUANTILE = 0.05
"""Share of executions that may be worse."""


class Ranking(StrEnum):
    """Figure of a grasp by which the best is told; grasps for which it is not known are passed over."""

    OBSERVED = "observed"
    """The quality of its trial."""
    EXPECTED = "expected"
    """Its expected quality under noise."""
    WORST = "worst"
    """The lowest quality that was seen under noise."""
    QUANTILE = "quantile"
    """The quality that all but a share of executions exceed, if they are normally distributed."""


def figures_under_noise(ranking: Ranking, under_noise: FloatArray, quantile: float) -> FloatArray:
    """Return the figures that rank grasps under noise.

    Args:
        ranking: any but ``OBSERVED``.
        under_noise: expected, sd and worst quality, NaN when not known, shape (n, 3).
        quantile: share of executions that may be worse, for ``QUANTILE``.

    Returns:
        A new array, shape (n,); NaN when not known.
    """
    expected, sd, worst = under_noise.T
    if ranking is Ranking.WORST:
        return worst.copy()
    if ranking is Ranking.EXPECTED:
        return expected.copy()
    lower: FloatArray = expected + NormalDist().inv_cdf(quantile) * sd
    return lower
