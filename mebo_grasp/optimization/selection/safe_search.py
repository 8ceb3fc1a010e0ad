"""Where a query is expected to do best under input noise, on the belief of the default method."""

from __future__ import annotations

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.maximizer import climb
from mebo_grasp.optimization.acquisition.unscented import Unscented, UnscentedTransform
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.surrogate.belief import Belief

NET_PER_DIM = 256
HOPEFUL = 48
"""Points of the net, the best ones without noise, that are looked at with noise, which costs 2 d + 1 times as much."""
NEIGHBOURS, NEIGHBOURHOOD = 8, 1.0
"""Points around each of the best observations, and their deviation in that of the noise."""
CLIMBS = 2


class OptimisticBelief:
    """Mean plus standard deviation, brought down by the chance not to be off the plateau.

    Args:
        belief: what is believed.
    """

    def __init__(self, belief: Belief) -> None:
        self._belief = belief

    def __call__(self, A: FloatArray) -> FloatArray:
        """Values, shape (m,), at points A, shape (m, d)."""
        mean, sd = self._belief.predict(A)
        return self._belief.lifted(mean + sd, self._belief.log_chances(A))

    def with_gradient(self, A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values, shape (m,), and gradients, shape (m, d)."""
        return self._belief.optimistic(A)


def pick_safe(belief: Belief, transform: UnscentedTransform, rng: np.random.Generator) -> FloatArray:
    """Where to try next to learn which point does best under input noise, shape (d,).

    First comes the point that is optimistically expected to do best; then, of it and its sigma points, the one of whose
    value least is known. To try the point itself again and again would say nothing about what lies around it.

    Args:
        belief: what is believed, open trials included.
        transform: the noise.
        rng: source of the net.
    """
    centre = most_hopeful(belief, transform, rng)
    points = transform.points(centre[None])
    doubts = transform.weights * deviation(belief, points)
    return points[int(np.argmax(doubts))]


def deviation(belief: Belief, A: FloatArray) -> FloatArray:
    """Standard deviation of the function's value, plateau included, shape (m,), at points A, shape (m, d)."""
    mean, sd = belief.predict(A)
    chance, gain = np.exp(belief.log_chances(A)), mean - belief.floor
    if belief.chance is None:
        return sd
    variance = chance * (sd**2 + (1.0 - chance) * gain**2)
    return np.sqrt(variance)


def most_hopeful(belief: Belief, transform: UnscentedTransform, rng: np.random.Generator) -> FloatArray:
    """The point that is optimistically expected to do best under input noise, shape (d,)."""
    dim = belief.dim
    plain = OptimisticBelief(belief)
    expected = Unscented(plain, transform)
    net = sobol(NET_PER_DIM * dim, dim, rng)
    hopeful = net[np.argsort(-plain(net), kind="stable")[:HOPEFUL]]
    outcomes = transform.mean(belief.predict_mean(transform.points(belief.U)))
    best = belief.U[np.argsort(-outcomes, kind="stable")[:CLIMBS]]
    # Steps of the noise's own size: within it the expected value hardly changes.
    steps = NEIGHBOURHOOD * rng.standard_normal((CLIMBS, NEIGHBOURS, dim)) @ _root(transform)
    near = np.clip(best[:, None] + steps[: len(best)], 0.0, 1.0).reshape(-1, dim)
    candidates = np.concatenate([hopeful, near])
    order = np.argsort(-expected(candidates), kind="stable")
    lower, upper = np.zeros(dim), np.ones(dim)
    ends = [climb(expected, candidates[i], lower, upper, 20) for i in order[:CLIMBS]]
    return max(ends, key=lambda end: end[1])[0]


def _root(transform: UnscentedTransform) -> FloatArray:
    """Square root of the noise's covariance, shape (d, d)."""
    half = transform.shifts[1 : 1 + transform.size // 2]
    root: FloatArray = half * np.sqrt(2.0 * transform.weights[1])
    return root
