"""The hot loops of the additive kernels, compiled; inputs are already divided by lengthscales."""

from __future__ import annotations

import numpy as np
from numba import njit

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.pairwise import exp_in_place

_FLAGS = {"contract", "nsz", "arcp"}
_SUMS = {"contract", "nsz", "arcp", "reassoc"}


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def _parts(x: float, column: FloatArray, smooth: bool, value: FloatArray, slope: FloatArray, power: FloatArray) -> None:
    """Write k(x, b_j) and S_j = -dk/dx / (x - b_j) for one dimension and variance 1, each shape (n,)."""
    n = column.shape[0]
    if smooth:
        for j in range(n):
            delta = x - column[j]
            value[j] = -0.5 * delta * delta
        exp_in_place(value, power)
        for j in range(n):
            slope[j] = value[j]
        return
    root5 = np.sqrt(5.0)
    for j in range(n):
        slope[j] = root5 * abs(x - column[j])
        value[j] = -slope[j]
    exp_in_place(value, power)
    for j in range(n):
        s, e = slope[j], value[j]
        value[j] = e * (1.0 + s + s * s / 3.0)
        slope[j] = e * (5.0 / 3.0) * (1.0 + s)


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def additive_values(A: FloatArray, B_T: FloatArray, variances: FloatArray, smooth: bool) -> FloatArray:
    """Return sum_q v_q k(a_q, b_q), shape (m, n).

    Args:
        A: scaled points, shape (m, d).
        B_T: scaled points as columns, shape (d, n).
        variances: v, shape (d,).
        smooth: squared exponential instead of Matérn 5/2.
    """
    m, n = A.shape[0], B_T.shape[1]
    K = np.zeros((m, n))
    value, slope, power = np.empty(n), np.empty(n), np.empty(n)
    for i in range(m):
        for q in range(A.shape[1]):
            _parts(A[i, q], B_T[q], smooth, value, slope, power)
            v = variances[q]
            for j in range(n):
                K[i, j] += v * value[j]
    return K


@njit(cache=True, nogil=True, fastmath=_SUMS)
def additive_input_gradient(
    A: FloatArray, B_T: FloatArray, variances: FloatArray, smooth: bool, W: FloatArray
) -> FloatArray:
    """Return sum_j W_ij dk(a_i, b_j)/da_iq in scaled units, shape (m, d), for W of shape (m, n)."""
    m, n = A.shape[0], B_T.shape[1]
    total = np.empty((m, A.shape[1]))
    value, slope, power = np.empty(n), np.empty(n), np.empty(n)
    for i in range(m):
        for q in range(A.shape[1]):
            column = B_T[q]
            _parts(A[i, q], column, smooth, value, slope, power)
            partial = 0.0
            for j in range(n):
                partial -= W[i, j] * slope[j] * (A[i, q] - column[j])
            total[i, q] = variances[q] * partial
    return total


@njit(cache=True, nogil=True, fastmath=_SUMS)
def additive_gradient_sums(B_T: FloatArray, W: FloatArray, variances: FloatArray, smooth: bool) -> FloatArray:
    """Return sum_ij W_ij dk_ij/dtheta, shape (2 d,), for (log l_1 …, log v_1 …); upper triangle of W only."""
    dim, n = B_T.shape
    total = np.zeros(2 * dim)
    value, slope, power = np.empty(n), np.empty(n), np.empty(n)
    trace = 0.0
    for i in range(n):
        trace += W[i, i]
        w = W[i, i + 1 :]
        size = n - i - 1
        for q in range(dim):
            column = B_T[q, i + 1 :]
            x = B_T[q, i]
            _parts(x, column, smooth, value[:size], slope[:size], power[:size])
            by_scale, by_variance = 0.0, 0.0
            for j in range(size):
                delta = x - column[j]
                by_scale += w[j] * slope[j] * delta * delta
                by_variance += w[j] * value[j]
            total[q] += by_scale
            total[dim + q] += by_variance
    for q in range(dim):
        total[q] *= 2.0 * variances[q]
        total[dim + q] = variances[q] * (2.0 * total[dim + q] + trace)
    return total
