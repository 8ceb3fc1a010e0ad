"""The collision penalty of Castanheira et al. (IROS 2018; thesis 2.2.2): a slope where a trial collides."""

from __future__ import annotations

import math


def collision_penalty(colliding: int, rate: float) -> float:
    """Return CP = 1 - exp(-lambda n), in [0, 1).

    Args:
        colliding: n, number of moving parts of the open hand that overlap the object (the thesis: joints), at least 0.
        rate: lambda, above 0.
    """
    return -math.expm1(-rate * colliding)


def penalized(epsilon: float, colliding: int, rate: float) -> float:
    """Return Q = epsilon - CP, in (-1, 1].

    The thesis prints Q = epsilon + CP; as CP is never negative, that would reward collisions, and a penalty is meant.

    Args:
        epsilon: the grasp's epsilon, 0 where the hand collides.
        colliding: see ``collision_penalty``.
        rate: see ``collision_penalty``.
    """
    return epsilon - collision_penalty(colliding, rate)
