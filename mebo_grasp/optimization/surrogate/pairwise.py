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


@njit(cache=True, fastmath=_FLAGS)
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


@njit(cache=True, fastmath=_FLAGS)
def squared_distances(point: FloatArray, B_T: FloatArray, out: FloatArray) -> None:
    """Write the squared distances of ``point``, shape (d,), to the columns of ``B_T``, shape (d, n)."""
    for j in range(out.shape[0]):
        delta = point[0] - B_T[0, j]
        out[j] = delta * delta
    for q in range(1, point.shape[0]):
        for j in range(out.shape[0]):
            delta = point[q] - B_T[q, j]
            out[j] += delta * delta


@njit(cache=True, fastmath=_FLAGS)
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


@njit(cache=True, fastmath=_FLAGS)
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


@njit(cache=True, fastmath=_FLAGS)
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


@njit(cache=True, fastmath=_SUMS)
def weighted_squared_differences(A: FloatArray, B_T: FloatArray, W: FloatArray, S: FloatArray) -> FloatArray:
    """Return sum_ij W_ij S_ij (a_iq - b_jq)^2 for each dimension q, shape (d,)."""
    total = np.zeros(A.shape[1])
    product = np.empty(B_T.shape[1])
    for i in range(A.shape[0]):
        for j in range(B_T.shape[1]):
            product[j] = W[i, j] * S[i, j]
        for q in range(A.shape[1]):
            partial = 0.0
            for j in range(B_T.shape[1]):
                delta = A[i, q] - B_T[q, j]
                partial += product[j] * delta * delta
            total[q] += partial
    return total


@njit(cache=True, fastmath=_SUMS)
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
