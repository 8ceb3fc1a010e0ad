"""Which methods can be run by name, and with which settings: registry, variants, acquisition study, peers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.runs.acquisition_study import STUDY_NAMES
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.peers import PEER_NAMES
from mebo_grasp.experiments.runs.run_costs import slow_peers
from mebo_grasp.optimization.methods.base import DEFAULT_METHOD, LEARNING_NAMES, MCMC, MethodSettings
from mebo_grasp.optimization.methods.registry import METHOD_NAMES


@dataclass(frozen=True)
class Variant:
    """A method under a name of its own in the tables.

    Args:
        method: name in the registry of methods.
        settings: fields of ``MethodSettings`` that differ from the defaults.
        note: what differs, for the tables' legend.
        group: of variants that are chosen together, and no part of ``all``; empty for the others.
    """

    method: str
    settings: dict[str, Any] = field(default_factory=dict)
    note: str = ""
    group: str = ""


_ON_ACQUISITION = "Metropolis-Hastings on the acquisition itself, as the thesis's code does, not on exp(beta alpha)"
SURROGATES, SAFE = "surrogates", "safe"
GROUPS = (SURROGATES, SAFE)


def _treed(power: float | None, learning: str) -> Variant:
    settings = {"surrogate": "treed_gp", "tree_weight_power": power, "learning": learning}
    by = "by slice sampling" if learning == MCMC else "the most probable"
    return Variant("bo", settings, f"treed Gaussian process, k = {power or 'infinity'}, hyperparameters {by}", SAFE)


VARIANTS: dict[str, Variant] = {
    "mebo_code": Variant("mebo", {"proportional_selection": True}, _ON_ACQUISITION),
    "e_mebo_code": Variant("e_mebo", {"proportional_selection": True}, _ON_ACQUISITION),
    "cl_mebo_code": Variant(
        "cl_mebo",
        {"proportional_selection": True, "cluster_share": 0.5},
        f"{_ON_ACQUISITION}, and content with half of M clusters, not three quarters",
    ),
    "mebo_se": Variant("mebo", {"kernel": "squared_exponential"}, "squared exponential kernel", SURROGATES),
    "mebo_additive": Variant("mebo", {"kernel": "additive_matern52"}, "additive Matérn 5/2 kernel", SURROGATES),
    "mebo_warped": Variant("mebo", {"warp": "kumaraswamy"}, "inputs warped", SURROGATES),
    "mebo_mcmc": Variant("mebo", {"learning": "mcmc"}, "hyperparameters by slice sampling", SURROGATES),
    "mebo_evidence": Variant("mebo", {"kernel": "evidence"}, "structure chosen by evidence", SURROGATES),
    "bo_mcmc": Variant("bo", {"learning": MCMC}, "hyperparameters by slice sampling", SAFE),
    "ubo_mcmc": Variant("ubo", {"learning": MCMC}, "hyperparameters by slice sampling", SAFE),
    **{
        f"tgp_w{name}{suffix}": _treed(power, learning)
        for suffix, learning in (("", LEARNING_NAMES[0]), ("_mcmc", MCMC))
        for name, power in (("1", 1.0), ("2", 2.0), ("3", 3.0), ("inf", None))
    },
    f"{DEFAULT_METHOD}_safe": Variant(DEFAULT_METHOD, {"safe": True}, "by what is expected under input noise", SAFE),
}
"""Variants beside the methods' defaults; a variant whose method is absent is not offered."""


def settings_of(job: Job) -> tuple[str, MethodSettings]:
    """Name in the registry and settings of a job's method.

    Raises:
        InvalidSettingsError: a setting of the variant or of the objective is out of range.
    """
    variant = VARIANTS.get(job.method, Variant(job.method))
    settings = MethodSettings(
        batch_size=job.batch_size,
        budget=job.budget,
        n_initial=job.n_initial,
        **{**job.objective.told(variant.method, job.seed), **variant.settings},
    )
    return variant.method, settings


def known_methods() -> tuple[str, ...]:
    """Everything that ``--methods`` accepts by name: methods, variants, the acquisition study, peers."""
    variants = tuple(name for name, variant in VARIANTS.items() if variant.method in METHOD_NAMES)
    return (*METHOD_NAMES, *variants, *STUDY_NAMES, *PEER_NAMES)


def select_methods(names: Iterable[str], installed_peers: Sequence[str]) -> list[str]:
    """Expand method names, ``default``, ``all``, ``peers``, ``surrogates`` and ``safe``, without repeats.

    Args:
        names: what was asked for.
        installed_peers: peers that can run here; ``peers`` takes these, ``all`` only the quick ones of them.

    Raises:
        InvalidSettingsError: a name is unknown.
    """
    special = {g: tuple(n for n, variant in VARIANTS.items() if variant.group == g) for g in GROUPS}
    apart = {name for names in special.values() for name in names}
    ours = tuple(name for name in known_methods() if name not in apart and name not in PEER_NAMES)
    slow = slow_peers(installed_peers)
    groups = {
        "all": (*ours, *(peer for peer in installed_peers if peer not in slow)),
        "peers": tuple(installed_peers),
        **special,
        "default": (DEFAULT_METHOD,),
    }
    chosen: dict[str, None] = {}
    for name in names:
        for member in groups.get(name, (name,)):
            if member not in known_methods():
                raise InvalidSettingsError(
                    f"method must be one of {', '.join((*groups, *known_methods()))}, got {member!r}"
                )
            chosen[member] = None
    return list(chosen)
