"""The hot loops over pairs of points, compiled; every function takes inputs already divided by lengthscales.

LLVM vectorizes the loops over ``j`` only when the exponential is plain arithmetic, hence the one written
out below (relative error about 3e-16 on [-708, 0]; below that it stays at exp(-708), 3e-308).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mebo_grasp.grasp import FloatArray

# "contract" lets multiplications and additions fuse; reordering stays forbidden because the rounding to the
# nearest integer below depends on the order of its additions.
_FLAGS = {"contract", "nsz", "arcp"}
_SUMS = {"contract", "nsz", "arcp", "reassoc"}

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 0.6931471803691238
_LN2_LOW = 1.9082149292705877e-10
_ROUNDER = 6755399441055744.0  # 1.5 * 2^52: adding it leaves the nearest integer in the low bits


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def exp_in_place(x: FloatArray, power: FloatArray) -> None:
    """Replace ``x``, shape (n,), all <= 0, by its exponential; ``power``, shape (n,), is scratch."""
    bits = power.view(np.int64)
    for j in range(x.shape[0]):
        rounded = max(x[j], -708.0) * _LOG2_E + _ROUNDER
        power[j] = rounded
    for j in range(x.shape[0]):
        k = power[j] - _ROUNDER
        value = max(x[j], -708.0)
        r = (value - k * _LN2_HIGH) - k * _LN2_LOW
        p = 1.0 / 479001600.0
        p = p * r + 1.0 / 39916800.0
        p = p * r + 1.0 / 3628800.0
        p = p * r + 1.0 / 362880.0
        p = p * r + 1.0 / 40320.0
        p = p * r + 1.0 / 5040.0
        p = p * r + 1.0 / 720.0
        p = p * r + 1.0 / 120.0
        p = p * r + 1.0 / 24.0
        p = p * r + 1.0 / 6.0
        p = p * r + 0.5
        p = p * r + 1.0
        x[j] = p * r + 1.0
    for j in range(x.shape[0]):
        # The low bits of the rounded sum are k (two's complement); moved to the exponent they make 2^k.
        bits[j] = (((bits[j] & 4095) + 1023) << 52) & 9223372036854775807
    for j in range(x.shape[0]):
        x[j] *= power[j]


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def squared_distances(point: FloatArray, B_T: FloatArray, out: FloatArray) -> None:
    """Write the squared distances of ``point``, shape (d,), to the columns of ``B_T``, shape (d, n)."""
    for j in range(out.shape[0]):
        delta = point[0] - B_T[0, j]
        out[j] = delta * delta
    for q in range(1, point.shape[0]):
        for j in range(out.shape[0]):
            delta = point[q] - B_T[q, j]
            out[j] += delta * delta


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def matern52(A: FloatArray, B_T: FloatArray, variance: float) -> FloatArray:
    """Matérn 5/2 covariances, shape (m, n), of ``A`` (m, d) and the columns of ``B_T`` (d, n)."""
    m, n = A.shape[0], B_T.shape[1]
    K = np.empty((m, n))
    factor, power = np.empty(n), np.empty(n)
    for i in range(m):
        row = K[i]
        squared_distances(A[i], B_T, row)
        for j in range(n):
            s = np.sqrt(5.0 * row[j])
            factor[j] = variance * (1.0 + s + s * s / 3.0)
            row[j] = -s
        exp_in_place(row, power)
        for j in range(n):
            row[j] *= factor[j]
    return K


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def matern52_slope(A: FloatArray, B_T: FloatArray, variance: float) -> FloatArray:
    """Return S, shape (m, n), with dk(a, b)/da_q = -S (a_q - b_q) and dk/dlog l_q = S (a_q - b_q)^2."""
    m, n = A.shape[0], B_T.shape[1]
    S = np.empty((m, n))
    factor, power = np.empty(n), np.empty(n)
    for i in range(m):
        row = S[i]
        squared_distances(A[i], B_T, row)
        for j in range(n):
            s = np.sqrt(5.0 * row[j])
            factor[j] = variance * (5.0 / 3.0) * (1.0 + s)
            row[j] = -s
        exp_in_place(row, power)
        for j in range(n):
            row[j] *= factor[j]
    return S


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def squared_exponential(A: FloatArray, B_T: FloatArray, variance: float) -> FloatArray:
    """Squared-exponential covariances, shape (m, n); it is its own slope (see ``matern52_slope``)."""
    m, n = A.shape[0], B_T.shape[1]
    K = np.empty((m, n))
    power = np.empty(n)
    for i in range(m):
        row = K[i]
        squared_distances(A[i], B_T, row)
        for j in range(n):
            row[j] *= -0.5
        exp_in_place(row, power)
        for j in range(n):
            row[j] *= variance
    return K


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def _matern52_parts(row: FloatArray, values: FloatArray, power: FloatArray, variance: float) -> None:
    """Turn squared distances ``row``, shape (n,), into slopes in place; write covariances to ``values``."""
    for j in range(row.shape[0]):
        s = np.sqrt(5.0 * row[j])
        values[j] = variance * (1.0 + s + s * s / 3.0)
        row[j] = -s
    # exp_in_place needs the exponents; the slope's factor is recovered from them afterwards.
    exponents = row.copy()
    exp_in_place(row, power)
    for j in range(row.shape[0]):
        values[j] *= row[j]
        row[j] *= variance * (5.0 / 3.0) * (1.0 - exponents[j])


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def _squared_exponential_parts(row: FloatArray, values: FloatArray, power: FloatArray, variance: float) -> None:
    """Like ``_matern52_parts`` for the squared exponential, whose slope equals its value."""
    for j in range(row.shape[0]):
        row[j] *= -0.5
    exp_in_place(row, power)
    for j in range(row.shape[0]):
        row[j] *= variance
        values[j] = row[j]


@njit(cache=True, nogil=True, fastmath=_SUMS)
def _add_weighted_sums(
    point: FloatArray,
    B_T: FloatArray,
    w: FloatArray,
    slopes: FloatArray,
    values: FloatArray,
    total: FloatArray,
) -> None:
    """Add one row's terms of the gradient by (log l_1, …, log l_d, log s²) to ``total``, shape (d + 1,)."""
    dim = point.shape[0]
    partial = 0.0
    for j in range(w.shape[0]):
        partial += w[j] * values[j]
        slopes[j] *= w[j]
    total[dim] += partial
    for q in range(dim):
        partial = 0.0
        for j in range(w.shape[0]):
            delta = point[q] - B_T[q, j]
            partial += slopes[j] * delta * delta
        total[q] += partial


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def matern52_gradient_sums(B_T: FloatArray, W: FloatArray, variance: float) -> FloatArray:
    """Return sum_ij W_ij dk_ij/dtheta, shape (d + 1,), for a symmetric W; only its upper triangle is read.

    Args:
        B_T: scaled points as columns, shape (d, n).
        W: shape (n, n).
        variance: signal variance.
    """
    dim, n = B_T.shape
    total = np.zeros(dim + 1)
    row, values, power = np.empty(n), np.empty(n), np.empty(n)
    diagonal = 0.0
    for i in range(n):
        diagonal += W[i, i]
        point = B_T[:, i].copy()
        others = B_T[:, i + 1 :]
        squared_distances(point, others, row[i + 1 :])
        _matern52_parts(row[i + 1 :], values[i + 1 :], power[i + 1 :], variance)
        _add_weighted_sums(point, others, W[i, i + 1 :], row[i + 1 :], values[i + 1 :], total)
    total *= 2.0
    total[dim] += variance * diagonal
    return total


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def squared_exponential_gradient_sums(B_T: FloatArray, W: FloatArray, variance: float) -> FloatArray:
    """Like ``matern52_gradient_sums`` for the squared exponential."""
    dim, n = B_T.shape
    total = np.zeros(dim + 1)
    row, values, power = np.empty(n), np.empty(n), np.empty(n)
    diagonal = 0.0
    for i in range(n):
        diagonal += W[i, i]
        point = B_T[:, i].copy()
        others = B_T[:, i + 1 :]
        squared_distances(point, others, row[i + 1 :])
        _squared_exponential_parts(row[i + 1 :], values[i + 1 :], power[i + 1 :], variance)
        _add_weighted_sums(point, others, W[i, i + 1 :], row[i + 1 :], values[i + 1 :], total)
    total *= 2.0
    total[dim] += variance * diagonal
    return total


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def evidence_weights(inverse: FloatArray, weights: FloatArray) -> None:
    """Replace the upper triangle of K⁻¹, shape (n, n), by that of weights weightsᵀ - K⁻¹."""
    for i in range(inverse.shape[0]):
        for j in range(i, inverse.shape[0]):
            inverse[i, j] = weights[i] * weights[j] - inverse[i, j]


@njit(cache=True, nogil=True, fastmath=_SUMS)
def weighted_differences(A: FloatArray, B_T: FloatArray, W: FloatArray, S: FloatArray) -> FloatArray:
    """Return sum_j W_ij S_ij (a_iq - b_jq), shape (m, d)."""
    total = np.empty(A.shape)
    product = np.empty(B_T.shape[1])
    for i in range(A.shape[0]):
        for j in range(B_T.shape[1]):
            product[j] = W[i, j] * S[i, j]
        for q in range(A.shape[1]):
            partial = 0.0
            for j in range(B_T.shape[1]):
                partial += product[j] * (A[i, q] - B_T[q, j])
            total[i, q] = partial
    return total
