"""What every registered method must do; a new name in the registry is tested without a line added here."""

import json

import numpy as np
import pytest

from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer
from mebo_grasp.optimization.methods.registry import METHOD_NAMES, make_method
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace

pytestmark = pytest.mark.parametrize("name", METHOD_NAMES)


def space_of(dim):
    return SearchSpace(tuple(f"x{i}" for i in range(dim)), np.full(dim, -3.0), np.linspace(1.0, 40.0, dim))


def quick(**kwargs):
    """Settings that let a run pass through every phase of every method in little time."""
    defaults = {"budget": 30, "n_initial": 9, "burn_in": 12, "relearn_period": 3, "num_solutions": 3}
    return OptimizerSettings(**{**defaults, **kwargs})


def smooth(x):
    return float(np.sum(np.sin(x)) - 0.01 * np.sum(x * x))


def plateau(x):
    """Zero on most of the box, as grasp quality is."""
    return float(max(0.0, 1.0 - np.sum(np.abs(x + 1.0))))


def island(x):
    """Zero on about half of the box and falling by a cliff to it."""
    return float(2.0 + np.sum(np.cos(x))) if x[0] > -1.2 else 0.0


def constant(_):
    return 0.0


def run(optimizer, objective):
    trace = []
    while not optimizer.finished:
        for trial in optimizer.ask():
            trace.append(trial.x)
            optimizer.tell(trial.id, objective(trial.x))
    return np.array(trace)


CASES = [(smooth, dim) for dim in (1, 3, 4, 5, 6)] + [(plateau, 1), (plateau, 2), (island, 3), (constant, 2)]


@pytest.mark.parametrize(("objective", "dim"), CASES, ids=[f"{f.__name__}-{dim}d" for f, dim in CASES])
def test_whole_run_stays_in_the_box_and_never_repeats_a_point(name, objective, dim):
    space = space_of(dim)
    trace = run(Optimizer(space, name, quick(min_distance=0.5), 0), objective)
    assert trace.shape == (30, dim)
    assert all(space.contains(x) for x in trace)
    assert len(np.unique(trace, axis=0)) == 30


@pytest.mark.parametrize("n_initial", [0, 1, 2])
def test_almost_no_initial_design(name, n_initial):
    trace = run(Optimizer(space_of(2), name, quick(n_initial=n_initial, budget=12), 0), smooth)
    assert len(np.unique(trace, axis=0)) == 12


@pytest.mark.parametrize("count", [1, 5])
def test_any_batch_size(name, count):
    optimizer = Optimizer(space_of(2), name, quick(budget=27), 0)
    while not optimizer.finished:
        trials = optimizer.ask(count)
        assert len(trials) == min(count, 27 - trials[0].id)
        for trial in trials:
            optimizer.tell(trial.id, smooth(trial.x))


def test_neither_number_nor_distance_is_needed(name):
    trace = run(Optimizer(space_of(2), name, quick(num_solutions=None), 0), smooth)
    assert len(trace) == 30


@pytest.mark.filterwarnings("error")
def test_a_dimension_may_count_nothing_in_distances(name):
    space = SearchSpace(("x", "roll"), np.zeros(2), np.ones(2), distance_weights=np.array([1.0, 0.0]))
    optimizer = Optimizer(space, name, quick(budget=15, min_distance=0.2), 0)
    assert len(np.unique(run(optimizer, smooth), axis=0)) == 15
    x = np.sort([solution.x[0] for solution in optimizer.solution_set()])
    if name != "cl_mebo":  # Its set is the one with the greatest QD, however near two of it are.
        assert np.all(np.diff(x) >= 0.2)


def test_same_seed_same_trace_other_seed_other_trace(name):
    first, second, other = (run(Optimizer(space_of(3), name, quick(), seed), smooth) for seed in (5, 5, 6))
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)


def test_neither_global_randomness_nor_a_second_run_disturbs_it(name):
    settings = quick()
    expected = run(Optimizer(space_of(2), name, settings, 5), smooth)
    mine, other = (Optimizer(space_of(2), name, settings, seed) for seed in (5, 77))
    trace: list[np.ndarray] = []
    while not mine.finished:
        np.random.seed(len(trace))  # noqa: NPY002
        for optimizer in (mine, other):
            for trial in optimizer.ask():
                optimizer.tell(trial.id, smooth(trial.x))
                trace += [trial.x] if optimizer is mine else []
    assert np.array_equal(trace, expected)


@pytest.mark.parametrize(("kept_share", "objective"), [(0.4, smooth), (0.75, smooth), (0.6, island)])
def test_a_killed_run_resumes_to_the_same_trace(name, kept_share, objective, tmp_path):
    full = tmp_path / "full.jsonl"
    logged = LoggedOptimizer.create(full, space_of(2), name, quick(), 11)
    run(logged, objective)
    lines = full.read_bytes().splitlines(keepends=True)
    part = tmp_path / "part.jsonl"
    part.write_bytes(b"".join(lines[: int(kept_share * len(lines))]))
    resumed = LoggedOptimizer.resume(part)
    while not resumed.finished:
        for trial in resumed.pending or resumed.ask():
            resumed.tell(trial.id, objective(trial.x))
    assert part.read_bytes() == full.read_bytes()


def test_state_is_json_and_a_restored_method_proposes_the_same(name):
    settings = quick()
    known = Observations(2)
    for u in np.random.default_rng(0).random((30, 2)):
        known.add(u, smooth(u))
    method = make_method(name, space_of(2), settings)
    method.propose(known, 3, np.random.default_rng(1))
    twin = make_method(name, space_of(2), settings)
    twin.restore(json.loads(json.dumps(method.state())))
    expected = method.propose(known, 3, np.random.default_rng(2))
    assert np.array_equal(twin.propose(known, 3, np.random.default_rng(2)), expected)
    assert twin.phase == method.phase


def test_failed_and_pending_points_are_not_proposed_again(name):
    optimizer = Optimizer(space_of(1), name, quick(budget=30, n_initial=6), 0)
    asked = []
    while optimizer.n_asked < 30:
        for trial in optimizer.ask():
            asked.append(float(trial.x[0]))
            if trial.id % 3 == 0:
                optimizer.tell_failed(trial.id, "broken")
            elif trial.id % 3 == 1:
                optimizer.tell(trial.id, smooth(trial.x))
    assert len(optimizer.pending) == 10
    assert len(set(asked)) == 30


def test_every_trial_fails(name):
    optimizer = Optimizer(space_of(2), name, quick(), 0)
    while not optimizer.finished:
        for trial in optimizer.ask():
            optimizer.tell_failed(trial.id)
    assert optimizer.n_failed == 30
    assert optimizer.incumbent is None
    assert optimizer.solution_set() == []


def test_late_tells_in_reverse_order(name):
    optimizer = Optimizer(space_of(2), name, quick(), 0)
    while not optimizer.finished:
        if optimizer.n_asked < 30:
            optimizer.ask()
        if len(optimizer.pending) > 9 or optimizer.n_asked == 30:
            trial = optimizer.pending[-1]
            optimizer.tell(trial.id, smooth(trial.x))
    assert optimizer.n_told == 30


def test_values_of_any_magnitude(name):
    for scale, offset in ((1e-12, 0.0), (1e12, 1e6)):
        optimizer = Optimizer(space_of(2), name, quick(), 0)
        trace = run(optimizer, lambda x, s=scale, o=offset: s * smooth(x) + o)
        assert np.all(np.isfinite(trace))


def test_results_of_others_are_used(name):
    optimizer = Optimizer(space_of(2), name, quick(budget=9, n_initial=0), 0)
    for x in space_of(2).from_unit(np.random.default_rng(0).random((25, 2))):
        optimizer.observe(x, smooth(x))
    trials = optimizer.ask()
    assert len(trials) == 3
    assert optimizer.solution_set(1)[0].value == max(optimizer.observations.y)


@pytest.mark.parametrize("objective", [smooth, constant], ids=lambda f: f.__name__)
def test_solution_set_is_valid(name, objective):
    optimizer = Optimizer(space_of(2), name, quick(min_distance=0.5), 0)
    run(optimizer, objective)
    for size, distance in ((None, None), (1, None), (4, 0.2), (1000, 1e9)):
        found = optimizer.solution_set(size, distance)
        assert 1 <= len(found) <= (size or 3)
        assert len({tuple(s.x) for s in found}) == len(found)
        assert found[0].value == max(s.value for s in found)
