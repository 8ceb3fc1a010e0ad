"""What every method must do when its run is to be safe, and with a treed surrogate."""

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer
from mebo_grasp.optimization.methods.registry import METHOD_NAMES, WITHOUT_SURROGATE, make_method
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace

SAFE_METHODS = [name for name in METHOD_NAMES if name not in WITHOUT_SURROGATE]
RUNS = [(name, "ridge") for name in SAFE_METHODS] + [("basin_search", "island"), ("mebo", "island")]
TREED_METHODS = (
    "mebo",
    "cl_mebo",
    "bo",
    "bo_thompson",
    "ubo",
    "local_penalization",
    "robot",
    "constraint_active_search",
)
SPACE = SearchSpace(("x", "roll"), np.array([-3.0, 0.0]), np.array([1.0, 2.0]), ("m", "rad"))


def settings(**kwargs):
    return OptimizerSettings(
        **{"budget": 24, "n_initial": 12, "burn_in": 12, "relearn_period": 3, "num_solutions": 3, **kwargs}
    )


def ridge(x):
    """A broad hill at (-2, 1) and a higher and narrow one at (0, 1.5)."""
    u = SPACE.to_unit(x)
    broad = np.exp(-np.sum(((u - [0.25, 0.5]) / 0.3) ** 2))
    return float(broad + 1.1 * np.exp(-np.sum(((u - [0.75, 0.75]) / 0.06) ** 2)))


def island(x):
    """0 on more than half of the box, with a cliff."""
    return float(2.0 + np.cos(x[0])) if x[1] > 1.2 else 0.0


OBJECTIVES = {"ridge": ridge, "island": island}


def run(optimizer, objective):
    while not optimizer.finished:
        for trial in optimizer.pending or optimizer.ask():
            optimizer.tell(trial.id, objective(trial.x))
    return optimizer


@pytest.mark.parametrize(("name", "objective_name"), RUNS)
def test_solutions_are_ranked_by_what_is_expected_and_a_killed_run_resumes(name, objective_name, tmp_path):
    objective = OBJECTIVES[objective_name]
    noise = InputNoise.of_pose(0.4, 0.1)
    full, part = tmp_path / "full.jsonl", tmp_path / "part.jsonl"
    chosen = settings(safe=True, input_noise=noise)
    logged = run(LoggedOptimizer.create(full, SPACE, name, chosen, 3), objective)
    lines = full.read_bytes().splitlines(keepends=True)
    part.write_bytes(b"".join(lines[: int(0.7 * len(lines))]))
    resumed = LoggedOptimizer.resume(part)
    assert resumed.optimizer.settings == chosen
    run(resumed, objective)
    assert part.read_bytes() == full.read_bytes()
    found = logged.optimizer.solution_set()
    expected = [solution.expected for solution in found]
    assert np.all(np.isfinite(expected))
    best = logged.optimizer.safe_incumbent
    assert best is not None
    if name != "cl_mebo":  # Its set is the most diverse one, in the order of its clusters.
        assert expected[0] == pytest.approx(best.expected)
        # The first may be the safest of those that the default method cannot tell apart.
        rest = expected[1:] if name == "basin_search" else expected
        assert rest == sorted(rest, reverse=True)
    assert all(s.worst <= s.expected + 1e-9 and s.sd >= 0.0 for s in found)


@pytest.mark.parametrize("name", SAFE_METHODS)
def test_a_needle_is_not_recommended(name):
    """The narrow hill's top is among the observations, and the surrogate has seen how narrow it is."""
    safe, plain = (
        Optimizer(SPACE, name, settings(safe=on, input_noise=InputNoise((0.08,)), num_solutions=2), 0)
        for on in (True, False)
    )
    needle, offsets = np.array([0.75, 0.75]), 0.1 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    grid = np.stack(np.meshgrid(np.linspace(0.05, 0.95, 7), np.linspace(0.05, 0.95, 7)), axis=-1).reshape(-1, 2)
    for optimizer in (safe, plain):
        for u in np.concatenate([grid, [needle], needle + offsets]):
            x = SPACE.from_unit(u)
            optimizer.observe(x, ridge(x))
        optimizer.method.propose(optimizer.observations, 1, np.random.default_rng(0))
    at = SPACE.to_unit(plain.solution_set(1)[0].x)
    assert np.allclose(at, needle) == (name != "ubo")  # ubo minds the noise whatever the settings say
    assert np.linalg.norm(SPACE.to_unit(safe.solution_set(1)[0].x) - [0.25, 0.5]) < 0.2


@pytest.mark.parametrize("name", WITHOUT_SURROGATE)
def test_methods_without_a_surrogate_refuse(name):
    with pytest.raises(InvalidSettingsError, match=f"{name} has no surrogate"):
        make_method(name, SPACE, settings(safe=True))


def test_without_safe_nothing_is_expected():
    optimizer = run(Optimizer(SPACE, "mebo", settings(), 0), ridge)
    assert optimizer.safe_incumbent is None
    assert all(np.isnan([s.expected, s.sd, s.worst]).all() for s in optimizer.solution_set())


@pytest.mark.parametrize("name", TREED_METHODS)
def test_every_method_takes_a_treed_surrogate(name, tmp_path):
    path = tmp_path / "run.jsonl"
    chosen = settings(surrogate="treed_gp", min_leaf=5, tree_weight_power=2.0)
    run(LoggedOptimizer.create(path, SPACE, name, chosen, 3), ridge)
    lines = path.read_bytes().splitlines(keepends=True)
    part = tmp_path / "part.jsonl"
    part.write_bytes(b"".join(lines[: int(0.8 * len(lines))]))
    run(LoggedOptimizer.resume(part), ridge)
    assert part.read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("kwargs", "word"),
    [
        ({"surrogate": "forest"}, "forest"),
        ({"surrogate": "treed_gp", "kernel": "evidence"}, "evidence"),
        ({"min_leaf": 1}, "min_leaf"),
        ({"particles": 0}, "particles"),
        ({"tree_weight_power": -1.0}, "tree_weight_power"),
        ({"improvement_margin": float("nan")}, "improvement_margin"),
        ({"noise_variance": 0.0}, "noise_variance must lie between 1e-07 and 1"),
        ({"noise_variance": 1e-4, "kernel": "evidence"}, "leave noise_variance unset"),
    ],
)
def test_bad_settings_are_refused(kwargs, word):
    with pytest.raises(InvalidSettingsError, match=word):
        settings(**kwargs)
