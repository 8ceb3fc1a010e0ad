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
"""Points of the net, and observations, the best ones without noise, that are looked at with noise, which costs more."""
NEIGHBOURS = 8
"""Points around each of the best observations, at draws of the noise."""
CLIMBS = 2
NEAR = 0.5
"""An observation this near, in standard deviations of the noise, stands for a point itself."""


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


def pick_safe(belief: Belief, noise: UnscentedTransform, rng: np.random.Generator) -> FloatArray:
    """Where to try next to learn which point does best under input noise, shape (d,).

    That is the point that is optimistically expected to do best or, once it was tried, the one within its noise of
    whose value least is known: to try it again and again would say nothing about what lies around it.

    Args:
        belief: what is believed, open trials included.
        noise: draws of it.
        rng: source of the net.
    """
    centre = most_hopeful(belief, noise, rng)
    if not is_tried(belief.U, centre, noise):
        return centre
    around = noise.points(centre[None])
    return around[int(np.argmax(deviation(belief, around)))]


def is_tried(U: FloatArray, point: FloatArray, noise: UnscentedTransform) -> bool:
    """Whether an observation of U, shape (n, d), is within ``NEAR`` deviations of the noise of a point, shape (d,)."""
    sd = np.sqrt(noise.weights @ noise.shifts**2)
    # Without noise in a direction nothing is near but the point itself.
    offsets = (U - point) / np.maximum(sd, 1e-9)
    return bool(np.any(np.linalg.norm(offsets, axis=1) <= NEAR))


def deviation(belief: Belief, A: FloatArray) -> FloatArray:
    """Standard deviation of the function's value, plateau included, shape (m,), at points A, shape (m, d)."""
    mean, sd = belief.predict(A)
    if belief.chance is None:
        return sd
    chance, gain = np.exp(belief.log_chances(A)), mean - belief.floor
    total: FloatArray = np.sqrt(chance * (sd**2 + (1.0 - chance) * gain**2))
    return total


def most_hopeful(belief: Belief, noise: UnscentedTransform, rng: np.random.Generator) -> FloatArray:
    """The point that is optimistically expected to do best under input noise, shape (d,)."""
    dim = belief.dim
    plain = OptimisticBelief(belief)
    expected = Unscented(plain, noise)
    net = sobol(NET_PER_DIM * dim, dim, rng)
    hopeful = net[np.argsort(-plain(net), kind="stable")[:HOPEFUL]]
    known = belief.U[np.argsort(-belief.y, kind="stable")[:HOPEFUL]]
    outcomes = noise.mean(belief.predict_mean(noise.points(known)))
    best = known[np.argsort(-outcomes, kind="stable")[:CLIMBS]]
    # Steps of the noise's own size: within it the expected value hardly changes.
    steps = rng.choice(noise.shifts, (len(best), NEIGHBOURS))
    near = np.clip(best[:, None] + steps, 0.0, 1.0).reshape(-1, dim)
    candidates = np.concatenate([hopeful, best, near])
    order = np.argsort(-expected(candidates), kind="stable")
    lower, upper = np.zeros(dim), np.ones(dim)
    ends = [climb(expected, candidates[i], lower, upper, 20) for i in order[:CLIMBS]]
    return max(ends, key=lambda end: end[1])[0]
