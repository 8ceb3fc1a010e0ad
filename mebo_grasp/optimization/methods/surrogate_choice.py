"""The surrogate that the settings ask for: kernel, warp of the inputs, way of learning."""

from __future__ import annotations

from mebo_grasp.optimization.methods.base import EVIDENCE, KUMARASWAMY, MCMC, MethodSettings
from mebo_grasp.optimization.surrogate.additive import ADDITIVE_MATERN52, ADDITIVE_SQUARED_EXPONENTIAL
from mebo_grasp.optimization.surrogate.empirical_bayes import EmpiricalBayesSurrogate
from mebo_grasp.optimization.surrogate.evidence import EvidenceSurrogate
from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL, Kernel
from mebo_grasp.optimization.surrogate.marginalized import MarginalizedSurrogate
from mebo_grasp.optimization.surrogate.posterior import Surrogate
from mebo_grasp.optimization.surrogate.warping import KumaraswamyWarp, MappedKernel

_KERNELS: dict[str, Kernel] = {
    kernel.name: kernel
    for kernel in (MATERN52, SQUARED_EXPONENTIAL, ADDITIVE_MATERN52, ADDITIVE_SQUARED_EXPONENTIAL)
}


def make_surrogate(dim: int, settings: MethodSettings) -> Surrogate:
    """Build the surrogate of a method that works on the common posterior."""
    if settings.kernel == EVIDENCE:
        return EvidenceSurrogate(dim, settings.relearn_period)
    kernel = _KERNELS[settings.kernel]
    if settings.warp == KUMARASWAMY:
        kernel = MappedKernel(kernel, KumaraswamyWarp())
    if settings.learning == MCMC:
        return MarginalizedSurrogate(dim, settings.relearn_period, kernel)
    return EmpiricalBayesSurrogate(dim, settings.relearn_period, kernel)
