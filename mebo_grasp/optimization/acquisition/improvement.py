"""Improvement-based acquisition (thesis, section 3.3), with log forms that stay exact far in the tail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erfcx, log_ndtr, ndtr

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.acquisition.base import MomentAcquisition

_LOG_ROOT_2PI = 0.5 * np.log(2.0 * np.pi)


def normal_density(t: FloatArray) -> FloatArray:
    """Standard normal density."""
    density: FloatArray = np.exp(-0.5 * t * t - _LOG_ROOT_2PI)
    return density


def log_normalized_improvement(t: FloatArray) -> FloatArray:
    """Return log(phi(t) + t Phi(t)), the log expected improvement for sd 1.

    Below t = -1 the sum cancels, so it is written with the scaled complementary error function, and below
    -1e5 by its asymptote phi(t) / t². Ament et al. 2023 ("Unexpected improvements…") treat the same loss.
    """
    t = np.asarray(t, dtype=np.float64)
    result = np.empty_like(t)
    near = t > -1.0
    result[near] = np.log(normal_density(t[near]) + t[near] * ndtr(t[near]))
    far = ~near
    tail = t[far]
    # Phi(t) = phi(t) sqrt(pi/2) erfcx(|t|/sqrt2), so the improvement is phi(t) (1 - |t| sqrt(pi/2) erfcx(…)).
    ratio = np.sqrt(np.pi / 2.0) * erfcx(-tail / np.sqrt(2.0)) * -tail
    with np.errstate(divide="ignore"):
        share = np.where(tail > -1e3, np.log1p(-np.minimum(ratio, 1.0)), -2.0 * np.log(-tail))
    result[far] = -0.5 * tail * tail - _LOG_ROOT_2PI + share
    return result


@dataclass(frozen=True)
class ExpectedImprovement(MomentAcquisition):
    """EI over ``incumbent``: (mean - y*) Phi(t) + sd phi(t) with t = (mean - y*) / sd.

    Args:
        incumbent: the value y* to improve on, units of y.
    """

    incumbent: float

    @property
    def name(self) -> str:
        """Name for logs and reports."""
        return "ei"

    def value(self, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Expected improvement, shape (m,), units of y."""
        t = (mean - self.incumbent) / sd
        improvement: FloatArray = sd * (normal_density(t) + t * ndtr(t))
        return np.maximum(improvement, 0.0)

    def partials(self, mean: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """dEI/dmean = Phi(t), dEI/dsd = phi(t)."""
        t = (mean - self.incumbent) / sd
        return ndtr(t), normal_density(t)


@dataclass(frozen=True)
class LogExpectedImprovement(MomentAcquisition):
    """log EI over ``incumbent``; same maximizer as EI, but with a slope where EI underflows.

    Args:
        incumbent: the value y* to improve on, units of y.
    """

    incumbent: float

    @property
    def name(self) -> str:
        """Name for logs and reports."""
        return "log_ei"

    def value(self, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Log expected improvement, shape (m,)."""
        return np.log(sd) + log_normalized_improvement((mean - self.incumbent) / sd)

    def partials(self, mean: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives by mean, Phi(t) / EI, and by sd, phi(t) / EI, from their logarithms."""
        t = (mean - self.incumbent) / sd
        log_ei = np.log(sd) + log_normalized_improvement(t)
        return np.exp(log_ndtr(t) - log_ei), np.exp(-0.5 * t * t - _LOG_ROOT_2PI - log_ei)


@dataclass(frozen=True)
class ProbabilityOfImprovement(MomentAcquisition):
    """PI over ``incumbent``: Phi((mean - y*) / sd).

    Args:
        incumbent: the value y* to improve on, units of y.
    """

    incumbent: float

    @property
    def name(self) -> str:
        """Name for logs and reports."""
        return "pi"

    def value(self, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Probability of improvement, shape (m,)."""
        probability: FloatArray = ndtr((mean - self.incumbent) / sd)
        return probability

    def partials(self, mean: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """phi(t) / sd and -t phi(t) / sd."""
        t = (mean - self.incumbent) / sd
        slope = normal_density(t) / sd
        return slope, -t * slope


@dataclass(frozen=True)
class LogProbabilityOfImprovement(MomentAcquisition):
    """log PI over ``incumbent``; same maximizer as PI, but with a slope where PI underflows.

    Args:
        incumbent: the value y* to improve on, units of y.
    """

    incumbent: float

    @property
    def name(self) -> str:
        """Name for logs and reports."""
        return "log_pi"

    def value(self, mean: FloatArray, sd: FloatArray) -> FloatArray:
        """Log probability of improvement, shape (m,)."""
        log_probability: FloatArray = log_ndtr((mean - self.incumbent) / sd)
        return log_probability

    def partials(self, mean: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives by mean and by sd, from the inverse Mills ratio."""
        t = (mean - self.incumbent) / sd
        mills = np.exp(-0.5 * t * t - _LOG_ROOT_2PI - log_ndtr(t)) / sd
        return mills, -t * mills
