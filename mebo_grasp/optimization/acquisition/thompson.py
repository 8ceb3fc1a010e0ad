"""Thompson sampling: a point is worth its value in one function drawn from the posterior (thesis 3.3)."""

from __future__ import annotations

import numpy as np

from mebo_grasp.optimization.acquisition.maximizer import NumericGradient
from mebo_grasp.optimization.surrogate.posterior import Posterior


def thompson(posterior: Posterior, rng: np.random.Generator, n_features: int = 512) -> NumericGradient:
    """Draw one function by spectral sampling and return it as a worth to be maximized.

    Args:
        posterior: the surrogate.
        rng: source of randomness.
        n_features: random Fourier features of the prior part.
    """
    return NumericGradient(posterior.sample_path(rng, n_features))
