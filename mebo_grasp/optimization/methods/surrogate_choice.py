"""The surrogate that the settings ask for: kernel, warp of the inputs, way of learning."""

from __future__ import annotations

from mebo_grasp.optimization.methods.base import EVIDENCE, KUMARASWAMY, MCMC, TREED_GP, MethodSettings
from mebo_grasp.optimization.surrogate.additive import ADDITIVE_MATERN52, ADDITIVE_SQUARED_EXPONENTIAL
from mebo_grasp.optimization.surrogate.empirical_bayes import EmpiricalBayesSurrogate
from mebo_grasp.optimization.surrogate.evidence import EvidenceSurrogate
from mebo_grasp.optimization.surrogate.hyperparameters import noise_prior
from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL, Kernel
from mebo_grasp.optimization.surrogate.marginalized import MarginalizedSurrogate
from mebo_grasp.optimization.surrogate.posterior import Surrogate
from mebo_grasp.optimization.surrogate.slice_sampling import SamplingSettings
from mebo_grasp.optimization.surrogate.treed_surrogate import TreedSurrogate, TreeSettings
from mebo_grasp.optimization.surrogate.warping import KumaraswamyWarp, MappedKernel

_KERNELS: dict[str, Kernel] = {
    kernel.name: kernel for kernel in (MATERN52, SQUARED_EXPONENTIAL, ADDITIVE_MATERN52, ADDITIVE_SQUARED_EXPONENTIAL)
}


def make_surrogate(dim: int, settings: MethodSettings) -> Surrogate:
    """Build the surrogate of a method that works on the common posterior."""
    if settings.kernel == EVIDENCE:
        return EvidenceSurrogate(dim, settings.relearn_period)
    kernel = _KERNELS[settings.kernel]
    if settings.warp == KUMARASWAMY:
        kernel = MappedKernel(kernel, KumaraswamyWarp())
    noise = None if settings.noise_variance is None else noise_prior(settings.noise_variance)
    sampling = SamplingSettings(settings.particles) if settings.learning == MCMC else None
    if settings.surrogate == TREED_GP:
        tree = TreeSettings(settings.min_leaf, settings.tree_weight_power, sampling)
        return TreedSurrogate(dim, settings.relearn_period, kernel, tree, noise)
    if sampling is not None:
        return MarginalizedSurrogate(dim, settings.relearn_period, kernel, sampling, noise)
    return EmpiricalBayesSurrogate(dim, settings.relearn_period, kernel, noise=noise)
