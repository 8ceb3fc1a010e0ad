"""The structures that a surrogate may have, where the search for their parameters starts, and what they are worth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import sobol
from mebo_grasp.optimization.surrogate.additive import (
    ADDITIVE_MATERN52,
    ADDITIVE_SQUARED_EXPONENTIAL,
    SumKernel,
)
from mebo_grasp.optimization.surrogate.hyperparameters import (
    climb_coupled,
    climb_posterior,
    height,
    log_posterior_and_gradient,
)
from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL, Kernel, LogNormalPrior
from mebo_grasp.optimization.surrogate.warping import KumaraswamyWarp, MappedKernel, StretchWarp, Turn, Warp

START_LENGTHSCALES = (0.08, 0.25, 0.8)
"""Where the searches start: a lengthscale of 0.08 follows a function with about six periods a side."""
START_ANGLES = tuple(np.linspace(0.0, np.pi / 2.0, 8, endpoint=False))
SCREENED, SCREENED_KEPT = 256, 8
SCREENED_LENGTHSCALES, SCREENED_WIDTHS, SCREENED_NOISE = (0.03, 0.2), (0.01, 0.2), 0.01
"""A stretch along turned axes is sought from the best of many points: lengthscales and widths between these, places and
angle anywhere. The noise lets a map pass that is about right."""
PLATEAU_SHARE, PLATEAU_SIZE = 0.15, 4
"""A share and a number of values equal to the lowest that mean that the function has a plateau there."""
MAX_WARPED_DIM = 3
"""Above, a warp's two parameters a dimension cost more to learn and compare than values can tell about them."""
SMALL_REST = 0.05
"""Variance at which a coupled rest starts."""
_HESSIAN_STEP = 1e-3

ADDITIVE_AND_COUPLED = SumKernel(ADDITIVE_SQUARED_EXPONENTIAL, MATERN52)
"""For a function that is additive but for a coupled rest."""


@dataclass(frozen=True)
class Structure:
    """A member of the family; theta = (the base's, the warp's, the angle).

    Args:
        base: kernel behind the maps.
        warp: map of each dimension, if any.
        turned: whether the axes are turned (before the warp).
    """

    base: Kernel
    warp: Warp | None = None
    turned: bool = False

    @property
    def kernel(self) -> Kernel:
        """The kernel with its maps."""
        kernel = MappedKernel(self.base, self.warp) if self.warp is not None else self.base
        return MappedKernel(kernel, Turn()) if self.turned else kernel

    @property
    def tail(self) -> int:
        """Entries of a hyperparameter vector behind the warp's: the angle, if any, and the noise."""
        return 2 if self.turned else 1


def family(dim: int) -> tuple[Structure, ...]:
    """The structures that are compared in ``dim`` dimensions; simpler ones before those built on them.

    Along the given axes the warp is Kumaraswamy's: what it stretches is an end of a side. Along turned axes it is
    the stretch, because there the part of the cube in which the function varies fast may lie anywhere. Only the
    Matérn 5/2 is stretched: between the values the map is a guess, and a squared exponential behind a wrong one is sure
    of what it promises where there are none.
    """
    coupled = [Structure(MATERN52), Structure(SQUARED_EXPONENTIAL)]
    additive: list[Structure] = []
    if dim > 1:
        bases: list[Kernel] = [ADDITIVE_MATERN52, ADDITIVE_SQUARED_EXPONENTIAL, ADDITIVE_AND_COUPLED]
        turns = (False, True) if dim == 2 else (False,)
        additive = [Structure(base, turned=turned) for turned in turns for base in bases]
    plain = coupled + additive
    if dim > MAX_WARPED_DIM:
        return tuple(plain)
    warped = [replace(structure, warp=KumaraswamyWarp()) for structure in plain if not structure.turned]
    if dim == 2:
        warped.append(Structure(ADDITIVE_MATERN52, StretchWarp(), turned=True))
    return (*plain, *warped)


def is_stretched(structure: Structure) -> bool:
    """Whether it is stretched along turned axes."""
    return structure.turned and isinstance(structure.warp, StretchWarp)


def has_plateau(y: FloatArray) -> bool:
    """Whether many of the values, shape (n,), equal the lowest."""
    lowest = int(np.count_nonzero(y == np.min(y)))
    return lowest >= PLATEAU_SIZE and lowest >= PLATEAU_SHARE * len(y)


def prior_of(kernel: Kernel, dim: int) -> LogNormalPrior:
    """Prior of (theta, log noise): trials are near deterministic, but any noise may be learned."""
    return kernel.prior(dim) + LogNormalPrior.repeated(1, 1e-6, 2.0, 1e-9, 1.0)


def starts(structure: Structure, dim: int, known: dict[Structure, FloatArray]) -> list[FloatArray]:
    """Starting points of a search, each shape (p + 1,).

    Args:
        structure: whose hyperparameters are sought.
        dim: number of dimensions.
        known: hyperparameters of simpler structures. What is built on them starts from them, with a warp
            that is the identity or a coupled rest that is small, so it hardly does worse.
    """
    extended = []
    if structure.warp is not None:
        simpler = known.get(replace(structure, warp=None))
        if simpler is not None:
            extended.append(_inserted(simpler, structure.warp.identity(dim), structure.tail))
    if isinstance(structure.base, SumKernel):
        simpler = known.get(replace(structure, base=structure.base.first))
        if simpler is not None:
            rest = structure.base.second.prior(dim).mean.copy()
            rest[-1] = np.log(SMALL_REST)
            behind = structure.tail + (2 * dim if structure.warp is not None else 0)
            extended.append(_inserted(simpler, rest, behind))
    return extended or _cold_starts(structure, dim)


def screened(structure: Structure, U: FloatArray, z: FloatArray) -> list[FloatArray]:
    """The best of many starting points of a stretch along turned axes, shape (p + 1,) each.

    Angle, places and widths only make sense together: at a wrong angle no place is better than another, so neither is
    found from what a simpler structure learned.

    Args:
        structure: a stretched and turned one.
        U: points, shape (n, 2).
        z: standardized values, shape (n,).
    """
    prior = prior_of(structure.kernel, 2)
    places = len(prior.mean) - structure.tail - 4
    shares = sobol(SCREENED, 7, np.random.default_rng(0))
    points = np.tile(prior.mean, (SCREENED, 1))
    points[:, :2] = _between(SCREENED_LENGTHSCALES, shares[:, :2])
    points[:, places : places + 2] = shares[:, 2:4]
    points[:, places + 2 : places + 4] = _between(SCREENED_WIDTHS, shares[:, 4:6])
    points[:, -2] = 0.5 * np.pi * shares[:, 6]
    points[:, -1] = np.log(SCREENED_NOISE)
    heights = [height(point, U, z, structure.kernel, prior) for point in points]
    return [points[i] for i in np.argsort(heights)[::-1][:SCREENED_KEPT]]


def _between(ends: tuple[float, float], shares: FloatArray) -> FloatArray:
    """Logarithms evenly between those of two lengths."""
    first, last = np.log(ends)
    values: FloatArray = first + (last - first) * shares
    return values


def _inserted(vector: FloatArray, part: FloatArray, behind: int) -> FloatArray:
    return np.concatenate([vector[:-behind], part, vector[-behind:]])


def _cold_starts(structure: Structure, dim: int) -> list[FloatArray]:
    prior = prior_of(structure.kernel, dim)
    root = 1.0 if structure.base.name.startswith("additive") else np.sqrt(dim)
    points = []
    for lengthscale in START_LENGTHSCALES:
        for angle in START_ANGLES if structure.turned else (None,):
            point = prior.mean.copy()
            point[:dim] = np.log(lengthscale * root)
            if angle is not None:
                point[-2] = angle
            points.append(point)
    return points


def climb(kernel: Kernel, U: FloatArray, z: FloatArray, start: FloatArray, iterations: int) -> tuple[FloatArray, float]:
    """Climb the log posterior density from ``start``; return where it ends and its value there."""
    prior = prior_of(kernel, U.shape[1])
    if not isinstance(kernel, MappedKernel):
        return climb_posterior(start, U, z, kernel, prior, iterations)
    return climb_coupled(
        lambda vector: log_posterior_and_gradient(vector, U, z, kernel, prior), prior, start, iterations
    )


def laplace_evidence(kernel: Kernel, U: FloatArray, z: FloatArray, vector: FloatArray, value: float) -> float:
    """Log evidence by Laplace's approximation around ``vector``, up to a constant common to all kernels.

    With the parameters in units of their prior's standard deviation the normalized prior density is
    exp(-t²/2) / sqrt(2 pi) each, so the evidence is the posterior density's height times the root of the
    inverse curvature. Curvatures below 1 are those of the prior itself.
    """
    prior = prior_of(kernel, U.shape[1])
    size = len(vector)
    curvature = np.empty((size, size))
    try:
        for i in range(size):
            step = np.zeros(size)
            step[i] = _HESSIAN_STEP
            ahead = log_posterior_and_gradient(vector + step, U, z, kernel, prior)[1]
            behind = log_posterior_and_gradient(vector - step, U, z, kernel, prior)[1]
            curvature[i] = (behind - ahead) / (2.0 * _HESSIAN_STEP)
    except InvalidSettingsError:
        return -np.inf
    scaled = 0.5 * (curvature + curvature.T) * prior.sd[:, None] * prior.sd
    eigenvalues = np.linalg.eigvalsh(scaled)
    return value - 0.5 * float(np.sum(np.log(np.maximum(eigenvalues, 1.0))))
