"""Learned maps of the inputs in front of a kernel: a warp of each dimension, a turn of the axes.

A stationary kernel varies equally fast everywhere. Where the function does not, a monotone map of each
input makes it so (Snoek et al. 2014, "Input warping for Bayesian optimization of non-stationary
functions"). Where a function is simple along other axes than the given ones, a turn finds them.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.kernels import Kernel, LogNormalPrior, parameter_count

_EDGE = 1e-4
"""Inputs are drawn in by this share of the side: the warp's slope may be infinite on the border."""
WARP_SD, WARP_BOUND = 0.75, 2.5
STRETCH_PLACES, STRETCH_PLACE_SD = (-0.25, 1.25), 0.4
STRETCH_SD, STRETCH_NARROWEST = 1.5, 3e-3


class InputMap(Hashable, Protocol):
    """A map of the unit cube into itself with parameters phi, shape (k,)."""

    @property
    def name(self) -> str:
        """Name for logs and reports."""

    def prior(self, dim: int) -> LogNormalPrior:
        """Prior and search box of phi for ``dim`` dimensions; its mean is the identity or nearest to it."""

    def forward(self, U: FloatArray, phi: FloatArray) -> FloatArray:
        """Map points, shape (m, d)."""

    def pull_back(self, U: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:
        """Gradient by U, shape (m, d), of a function whose gradient by mapped points is G, shape (m, d)."""

    def parameter_gradient(self, U: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:
        """Gradient by phi, shape (k,), of a function whose gradient by mapped points is G, shape (m, d)."""

    def inverse(self, V: FloatArray, phi: FloatArray) -> FloatArray:
        """Points, shape (m, d), that are mapped to V; they may lie outside the cube."""


class Warp(InputMap, Protocol):
    """A map that acts on each dimension alone."""

    def identity(self, dim: int) -> FloatArray:
        """Parameters that change next to nothing, shape (k,) for ``dim`` dimensions."""


@dataclass(frozen=True)
class KumaraswamyWarp:
    """w(u) = 1 - (1 - u^a)^b in each dimension, phi = (log a_1, …, log a_d, log b_1, …, log b_d).

    a = b = 1 is the identity; the prior's medians are there.
    """

    name: str = "warped"

    def prior(self, dim: int) -> LogNormalPrior:
        """Normal priors around the identity."""
        bound = float(np.exp(WARP_BOUND))
        return LogNormalPrior.repeated(2 * dim, 1.0, WARP_SD, 1.0 / bound, bound)

    @staticmethod
    def _split(phi: FloatArray) -> tuple[FloatArray, FloatArray]:
        half = len(phi) // 2
        return np.exp(phi[:half]), np.exp(phi[half:])

    @staticmethod
    def _drawn_in(U: FloatArray) -> FloatArray:
        return _EDGE + (1.0 - 2.0 * _EDGE) * np.asarray(U)

    def identity(self, dim: int) -> FloatArray:
        """The parameters that change nothing, shape (2 d,)."""
        return np.zeros(2 * dim)

    def forward(self, U: FloatArray, phi: FloatArray) -> FloatArray:
        """Warped points, shape (m, d)."""
        a, b = self._split(phi)
        warped: FloatArray = -np.expm1(b * np.log1p(-(self._drawn_in(U) ** a)))
        return warped

    def pull_back(self, U: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:
        """Gradient by U; the map acts on each dimension alone."""
        a, b = self._split(phi)
        u = self._drawn_in(U)
        slope = a * b * u ** (a - 1.0) * (1.0 - u**a) ** (b - 1.0) * (1.0 - 2.0 * _EDGE)
        gradient: FloatArray = G * slope
        return gradient

    def parameter_gradient(self, U: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:
        """Gradient by (log a, log b)."""
        a, b = self._split(phi)
        u = self._drawn_in(U)
        power = u**a
        rest = 1.0 - power
        by_log_a = a * b * rest ** (b - 1.0) * power * np.log(u)
        by_log_b = -b * rest**b * np.log(rest)
        return np.concatenate([np.sum(G * by_log_a, axis=0), np.sum(G * by_log_b, axis=0)])

    def inverse(self, V: FloatArray, phi: FloatArray) -> FloatArray:
        """Unwarped points, within the cube."""
        a, b = self._split(phi)
        u = (-np.expm1(np.log1p(-np.clip(V, 0.0, 1.0 - 1e-12)) / b)) ** (1.0 / a)
        unwarped: FloatArray = np.clip((u - _EDGE) / (1.0 - 2.0 * _EDGE), 0.0, 1.0)
        return unwarped


@dataclass(frozen=True)
class StretchWarp:
    """Stretches each dimension around a place of its own, phi = (c_1, …, c_d, log s_1, …, log s_d).

    w(u) = (g(u) - g(0)) / (g(1) - g(0)) with g(u) = asinh((u - c) / s): near c it is linear, and farther than s
    from it a logarithm of the distance, so a function that varies the more slowly the farther from c becomes
    stationary. The place may be inside the cube, which a Kumaraswamy warp cannot express; a large s is the
    identity.
    """

    name: str = "stretched"

    def prior(self, dim: int) -> LogNormalPrior:
        """Places anywhere in the cube and a little beyond; widths around the side, near the identity."""
        ones = np.ones(dim)
        first, last = STRETCH_PLACES
        where = LogNormalPrior(0.5 * ones, STRETCH_PLACE_SD * ones, first * ones, last * ones)
        return where + LogNormalPrior.repeated(dim, 1.0, STRETCH_SD, STRETCH_NARROWEST, 10.0)

    @staticmethod
    def _split(phi: FloatArray) -> tuple[FloatArray, FloatArray]:
        half = len(phi) // 2
        return phi[:half], np.exp(phi[half:])

    def _range(self, phi: FloatArray) -> tuple[FloatArray, FloatArray]:
        """g(0) and g(1) - g(0), shape (d,) each."""
        c, s = self._split(phi)
        first = np.arcsinh(-c / s)
        return first, np.arcsinh((1.0 - c) / s) - first

    def identity(self, dim: int) -> FloatArray:
        """Parameters that change next to nothing, shape (2 d,)."""
        return np.repeat([0.5, np.log(3.0)], dim)

    def forward(self, U: FloatArray, phi: FloatArray) -> FloatArray:
        """Stretched points, shape (m, d)."""
        c, s = self._split(phi)
        first, total = self._range(phi)
        stretched: FloatArray = (np.arcsinh((U - c) / s) - first) / total
        return stretched

    def pull_back(self, U: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:
        """Gradient by U; the map acts on each dimension alone."""
        c, s = self._split(phi)
        gradient: FloatArray = G / (np.hypot(U - c, s) * self._range(phi)[1])
        return gradient

    def parameter_gradient(self, U: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:
        """Gradient by (c, log s)."""
        c, s = self._split(phi)
        warped, total = self.forward(U, phi), self._range(phi)[1]

        def slopes(offset: FloatArray) -> tuple[FloatArray, FloatArray]:
            by_place = -1.0 / np.hypot(offset, s)
            return by_place, offset * by_place

        sums = []
        for here, first, last in zip(slopes(U - c), slopes(-c), slopes(1.0 - c), strict=True):
            sums.append(np.sum(G * (here - first - warped * (last - first)) / total, axis=0))
        return np.concatenate(sums)

    def inverse(self, V: FloatArray, phi: FloatArray) -> FloatArray:
        """Points before the stretch, shape (m, d)."""
        c, s = self._split(phi)
        first, total = self._range(phi)
        points: FloatArray = c + s * np.sinh(first + V * total)
        return points


@dataclass(frozen=True)
class Turn:
    """A rotation of the plane about the middle, phi = (angle,); drawn in so that the corners stay inside.

    For two dimensions only: there one angle is learned from few values; a turn in d dimensions has
    d (d - 1) / 2 of them.
    """

    name: str = "turned"

    def prior(self, dim: int) -> LogNormalPrior:
        """As dense as a uniform one on a quarter turn: angles that far apart mean the same axes."""
        if dim != 2:
            raise ValueError(f"a turn needs 2 dimensions, got {dim}")
        quarter = np.pi / 2.0
        return LogNormalPrior(
            np.array([quarter / 2.0]),
            np.array([quarter / np.sqrt(2.0 * np.pi)]),
            np.array([-quarter]),
            np.array([2.0 * quarter]),
        )

    @staticmethod
    def _matrix(phi: FloatArray) -> FloatArray:
        c, s = np.cos(phi[0]) / np.sqrt(2.0), np.sin(phi[0]) / np.sqrt(2.0)
        return np.array([[c, -s], [s, c]])

    def forward(self, U: FloatArray, phi: FloatArray) -> FloatArray:
        """Turned points, shape (m, 2)."""
        turned: FloatArray = (U - 0.5) @ self._matrix(phi).T + 0.5
        return turned

    def pull_back(self, U: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:  # noqa: ARG002
        """Gradient by U: the turn is linear."""
        gradient: FloatArray = G @ self._matrix(phi)
        return gradient

    def parameter_gradient(self, U: FloatArray, phi: FloatArray, G: FloatArray) -> FloatArray:
        """Gradient by the angle."""
        by_angle = (U - 0.5) @ self._matrix(phi + np.pi / 2.0).T
        return np.array([np.sum(G * by_angle)])

    def inverse(self, V: FloatArray, phi: FloatArray) -> FloatArray:
        """Points turned back; corners of the cube come from outside."""
        points: FloatArray = 2.0 * (V - 0.5) @ self._matrix(phi) + 0.5
        return points


@dataclass(frozen=True)
class MappedKernel:
    """A kernel behind a map of its inputs; theta = (the kernel's, the map's).

    Args:
        base: the kernel.
        map: the map of its inputs.
    """

    base: Kernel
    map: InputMap

    @property
    def name(self) -> str:
        """Name for logs and reports."""
        return f"{self.map.name} {self.base.name}"

    def prior(self, dim: int) -> LogNormalPrior:
        """Prior and search box of theta."""
        return self.base.prior(dim) + self.map.prior(dim)

    def split(self, theta: FloatArray, dim: int) -> tuple[FloatArray, FloatArray]:
        """The kernel's parameters and the map's."""
        size = parameter_count(self.map, dim)
        return theta[:-size], theta[-size:]

    def matrix(self, A: FloatArray, U: FloatArray, theta: FloatArray) -> FloatArray:
        """Covariances k(a_i, u_j), shape (m, n)."""
        inner, phi = self.split(theta, U.shape[1])
        return self.base.matrix(self.map.forward(A, phi), self.map.forward(U, phi), inner)

    def diagonal(self, A: FloatArray, theta: FloatArray) -> FloatArray:
        """Variances, shape (m,)."""
        return self.base.diagonal(A, self.split(theta, A.shape[1])[0])

    def parameter_gradient(self, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_ij W_ij dk(u_i, u_j)/dtheta, shape (p,); only the upper triangle of W is read."""
        inner, phi = self.split(theta, U.shape[1])
        V = self.map.forward(U, phi)
        symmetric = np.triu(W, 1)
        symmetric += symmetric.T
        G = 2.0 * self.base.input_gradient(V, V, inner, symmetric)
        return np.concatenate([self.base.parameter_gradient(V, inner, W), self.map.parameter_gradient(U, phi, G)])

    def input_gradient(self, A: FloatArray, U: FloatArray, theta: FloatArray, W: FloatArray) -> FloatArray:
        """Return sum_j W_ij dk(a_i, u_j)/da_i, shape (m, d)."""
        inner, phi = self.split(theta, U.shape[1])
        G = self.base.input_gradient(self.map.forward(A, phi), self.map.forward(U, phi), inner, W)
        return self.map.pull_back(A, phi, G)

    def sample_features(
        self, dim: int, theta: FloatArray, count: int, rng: np.random.Generator
    ) -> Callable[[FloatArray], FloatArray]:
        """Draw the kernel's features and evaluate them on mapped points."""
        inner, phi = self.split(theta, dim)
        features = self.base.sample_features(dim, inner, count, rng)
        return lambda A: features(self.map.forward(A, phi))
