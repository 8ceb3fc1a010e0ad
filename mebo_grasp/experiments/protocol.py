"""What is run: methods with their settings, problems, seeds, and the thesis's protocol."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.acquisition_study import STUDY_NAMES
from mebo_grasp.experiments.peers import PEER_NAMES
from mebo_grasp.experiments.problems import (
    CLASSIC_FUNCTIONS,
    Problem,
    get_classic,
    get_problem,
    transform,
)
from mebo_grasp.optimization.methods.base import MethodSettings
from mebo_grasp.optimization.methods.registry import METHOD_NAMES

BUDGET, N_INITIAL, BATCH_SIZE, SEEDS = 250, 25, 3, 10
"""The protocol of the thesis, section 7.2."""

TOLD_METHODS = frozenset({"cl_mebo", "robot"})
"""Methods that are given M and tau, as in the thesis (section 7.3); no other is told anything."""
_THESIS_M = {"vincent_2d": 20, "uneven_maxima": 2}
_THESIS_TAU = {
    "uneven_maxima": 0.15,
    "five_uneven_peak_trap": 15.0,
    "equal_maxima": 0.15,
    "himmelblau": 2.0,
    "modified_rastrigin": 0.25,
    "vincent_2d": 2.0,
}
_OTHER_TAU_SHARE = 0.5


@dataclass(frozen=True)
class Variant:
    """A method under a name of its own in the tables.

    Args:
        method: name in the registry of methods.
        settings: fields of ``MethodSettings`` that differ from the defaults.
        note: what differs, for the tables' legend.
        of_surrogate: whether the surrogate differs; such variants are a group of their own, not part of ``all``.
    """

    method: str
    settings: dict[str, Any] = field(default_factory=dict)
    note: str = ""
    of_surrogate: bool = False


_ON_ACQUISITION = (
    "Metropolis-Hastings on the acquisition itself, as the thesis's code does, not on exp(beta alpha)"
)
VARIANTS: dict[str, Variant] = {
    "mebo_code": Variant("mebo", {"proportional_selection": True}, _ON_ACQUISITION),
    "e_mebo_code": Variant("e_mebo", {"proportional_selection": True}, _ON_ACQUISITION),
    "cl_mebo_code": Variant(
        "cl_mebo",
        {"proportional_selection": True, "cluster_share": 0.5},
        f"{_ON_ACQUISITION}, and content with half of M clusters, not three quarters",
    ),
    "mebo_se": Variant("mebo", {"kernel": "squared_exponential"}, "squared exponential kernel", True),
    "mebo_additive": Variant("mebo", {"kernel": "additive_matern52"}, "additive Matérn 5/2 kernel", True),
    "mebo_warped": Variant("mebo", {"warp": "kumaraswamy"}, "inputs warped", True),
    "mebo_mcmc": Variant("mebo", {"learning": "mcmc"}, "hyperparameters by slice sampling", True),
    "mebo_evidence": Variant("mebo", {"kernel": "evidence"}, "structure chosen by evidence", True),
}
"""Variants beside the methods' defaults; a variant whose method is absent is not offered."""


@dataclass(frozen=True)
class Job:
    """One run: a method on a problem with a seed.

    Args:
        method: a method, a variant or a peer.
        problem: name of the problem.
        seed: seed of the run; also of the transform.
        budget: evaluations, initial design included.
        n_initial: size of the initial design.
        batch_size: points a batch.
        transformed: whether the problem is shifted, scaled and turned by the seed's draw.
    """

    method: str
    problem: str
    seed: int
    budget: int = BUDGET
    n_initial: int = N_INITIAL
    batch_size: int = BATCH_SIZE
    transformed: bool = False

    @property
    def problem_label(self) -> str:
        """The problem's name in folders and tables."""
        return f"{self.problem}~t" if self.transformed else self.problem

    @property
    def key(self) -> str:
        """What tells this run from every other, also its path below the folder of runs."""
        protocol = f"b{self.budget}-i{self.n_initial}-q{self.batch_size}"
        return f"{self.problem_label}/{self.method}/{protocol}/seed-{self.seed:03d}"

    def log_path(self, out: Path) -> Path:
        """File of the run's log below the experiment's folder."""
        return out / "runs" / f"{self.key}.jsonl"

    def as_dict(self) -> dict[str, Any]:
        """The fields, as JSON values."""
        return asdict(self)


def make_problem(job: Job) -> Problem:
    """Build the problem of a job, transformed by its seed if it says so.

    Raises:
        InvalidSettingsError: the problem is unknown.
    """
    build = get_classic if job.problem in CLASSIC_FUNCTIONS else get_problem
    problem = build(job.problem)
    return transform(problem, job.seed) if job.transformed else problem


def _told(problem: Problem) -> dict[str, Any]:
    """M and tau for the methods that need them: the thesis's, else all optima and half their smallest gap."""
    if problem.name in _THESIS_TAU:
        tau = _THESIS_TAU[problem.name]
        return {
            "num_solutions": _THESIS_M.get(problem.name, problem.n_optima),
            "min_distance": tau * problem.scale,
        }
    gaps = np.linalg.norm(problem.optima[:, None] - problem.optima[None], axis=2)
    gaps = gaps[gaps > 0.0]
    # A lone optimum has no gap; any distance will do then.
    tau = float(np.min(gaps)) if len(gaps) else float(np.max(problem.upper - problem.lower))
    return {"num_solutions": problem.n_optima, "min_distance": _OTHER_TAU_SHARE * tau}


def settings_of(job: Job, problem: Problem) -> tuple[str, MethodSettings]:
    """Name in the registry and settings of a job's method.

    Raises:
        InvalidSettingsError: a setting of the variant is out of range.
    """
    variant = VARIANTS.get(job.method, Variant(job.method))
    told = _told(problem) if variant.method in TOLD_METHODS else {}
    settings = MethodSettings(
        batch_size=job.batch_size,
        budget=job.budget,
        n_initial=job.n_initial,
        **{**told, **variant.settings},
    )
    return variant.method, settings


def known_methods() -> tuple[str, ...]:
    """Everything that ``--methods`` accepts by name: methods, variants, the acquisition study, peers."""
    variants = tuple(name for name, variant in VARIANTS.items() if variant.method in METHOD_NAMES)
    return (*METHOD_NAMES, *variants, *STUDY_NAMES, *PEER_NAMES)


def select_methods(
    names: Iterable[str], default: str, installed_peers: Sequence[str], slow_peers: Sequence[str] = ()
) -> list[str]:
    """Expand method names, ``default``, ``all``, ``peers`` and ``surrogates``, without repeats.

    Args:
        names: what was asked for.
        default: the method that ``default`` stands for.
        installed_peers: peers that can run here; ``peers`` takes these.
        slow_peers: of these, those that ``all`` leaves out.

    Raises:
        InvalidSettingsError: a name is unknown.
    """
    surrogates = tuple(name for name, variant in VARIANTS.items() if variant.of_surrogate)
    ours = tuple(name for name in known_methods() if name not in (*surrogates, *PEER_NAMES))
    groups = {
        "all": (*ours, *(peer for peer in installed_peers if peer not in slow_peers)),
        "peers": tuple(installed_peers),
        "surrogates": surrogates,
        "default": (default,),
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


def make_jobs(
    methods: Sequence[str], problems: Sequence[str], seeds: Iterable[int], **protocol: Any
) -> list[Job]:
    """All combinations, seeds outermost, so that an unfinished experiment is balanced over the cells."""
    return [
        Job(method=method, problem=problem, seed=seed, **protocol)
        for seed in seeds
        for problem in problems
        for method in methods
    ]
