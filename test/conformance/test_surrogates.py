"""Every kernel, warp and way of learning works in the methods that build on the common posterior."""

from typing import Any

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer
from mebo_grasp.optimization.methods.base import KERNEL_NAMES, LEARNING_NAMES, WARP_NAMES, MethodSettings
from mebo_grasp.optimization.methods.registry import METHOD_NAMES, WITHOUT_CHOICE, make_method
from mebo_grasp.optimization.methods.surrogate_choice import make_surrogate
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.optimizer import OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess
from mebo_grasp.optimization.surrogate.mixture import MixtureProcess

SURROGATES: list[dict[str, Any]] = [
    {"kernel": kernel, "warp": warp, "learning": learning}
    for kernel in KERNEL_NAMES
    for warp in WARP_NAMES
    for learning in LEARNING_NAMES
    if kernel != "evidence" or (warp, learning) == ("none", "empirical_bayes")
]
SAMPLED: dict[str, Any] = {
    "kernel": "additive_squared_exponential",
    "warp": "kumaraswamy",
    "learning": "mcmc",
}
PAIRS = [("mebo", choice) for choice in SURROGATES] + [
    ("bo_thompson", SAMPLED),
    ("cl_mebo", SAMPLED),
    ("local_penalization", {"kernel": "evidence"}),
    ("robot", SAMPLED),
    ("constraint_active_search", SAMPLED),
]


def space_of(dim):
    return SearchSpace(tuple(f"x{i}" for i in range(dim)), np.full(dim, -3.0), np.linspace(1.0, 40.0, dim))


def objective(x):
    return float(np.sum(np.sin(x)) - 0.01 * np.sum(x * x))


def label(value):
    return "-".join(value.values()) if isinstance(value, dict) else value


@pytest.mark.parametrize(("name", "choice"), PAIRS, ids=label)
def test_a_run_passes_learning_and_resumes_to_the_same_trace(name, choice, tmp_path):
    settings = OptimizerSettings(budget=15, n_initial=9, burn_in=5, relearn_period=2, num_solutions=2, **choice)
    full, part = tmp_path / "full.jsonl", tmp_path / "part.jsonl"
    run = LoggedOptimizer.create(full, space_of(2), name, settings, 3)
    trace = []
    while not run.finished:
        for trial in run.ask():
            trace.append(trial.x)
            run.tell(trial.id, objective(trial.x))
    assert len(np.unique(trace, axis=0)) == 15
    assert all(space_of(2).contains(x) for x in trace)
    lines = full.read_bytes().splitlines(keepends=True)
    part.write_bytes(b"".join(lines[:13]))
    resumed = LoggedOptimizer.resume(part)
    while not resumed.finished:
        for trial in resumed.pending or resumed.ask():
            resumed.tell(trial.id, objective(trial.x))
    assert part.read_bytes() == full.read_bytes()


def test_each_choice_is_a_surrogate_of_its_own():
    known = Observations(2)
    for u in np.random.default_rng(0).random((12, 2)):
        known.add(u, objective(u * 5.0))
    seen = set()
    for choice in SURROGATES:
        surrogate = make_surrogate(2, MethodSettings(**choice))
        posterior = surrogate.update(known, np.random.default_rng(0))
        assert isinstance(posterior, GaussianProcess | MixtureProcess)
        member = posterior if isinstance(posterior, GaussianProcess) else posterior.members[0]
        seen.add((member.kernel.name, isinstance(posterior, GaussianProcess), choice["kernel"] == "evidence"))
    assert len(seen) == len(SURROGATES) == 17


@pytest.mark.parametrize(
    ("choice", "named"),
    [
        ({"learning": "guess"}, "mcmc"),
        ({"kernel": "cubic"}, "additive_matern52"),
        ({"warp": "bent"}, "kumaraswamy"),
        ({"kernel": "evidence", "learning": "mcmc"}, "leave these at their defaults"),
        ({"kernel": "evidence", "warp": "kumaraswamy"}, "leave these at their defaults"),
    ],
)
def test_unknown_and_contradicting_choices_are_refused_with_what_is_known(choice, named):
    with pytest.raises(InvalidSettingsError, match=named):
        MethodSettings(**choice)


@pytest.mark.parametrize("name", ["basin_search", "random", "sobol"])
def test_a_choice_that_a_method_would_ignore_is_refused(name):
    with pytest.raises(InvalidSettingsError, match=f"{name}.*leave kernel at 'matern52'"):
        make_method(name, space_of(2), MethodSettings(kernel="additive_matern52"))


def test_every_other_method_takes_a_choice():
    settings = MethodSettings(kernel="additive_matern52")
    takers = [name for name in METHOD_NAMES if name not in WITHOUT_CHOICE]
    assert len(takers) == len(METHOD_NAMES) - 3
    for name in takers:
        method: Any = make_method(name, space_of(2), settings)
        assert method.surrogate._kernel.name == "additive_matern52"


@pytest.mark.parametrize(
    "choice",
    [
        {},
        {"learning": "mcmc"},
        {"surrogate": "treed_gp", "min_leaf": 8},
        {"warp": "kumaraswamy", "learning": "mcmc"},
    ],
)
def test_a_known_noise_is_not_learned_however_noisy_the_values_are(choice):
    rng = np.random.default_rng(0)
    known = Observations(2)
    for u in np.repeat(rng.random((12, 2)), 2, axis=0):
        known.add(u, float(u[0] + rng.standard_normal()))
    noise = {}
    for variance in (None, 1e-4):
        surrogate = make_surrogate(2, MethodSettings(noise_variance=variance, **choice))
        posterior = surrogate.update(known, np.random.default_rng(1))
        noise[variance] = posterior.noise_sd / posterior.scale
    assert noise[1e-4] == pytest.approx(1e-2)
    assert noise[None] > 0.1
