"""What sets the methods apart, each seen from its proposals."""

import numpy as np
import pytest

from mebo_grasp.optimization.methods.base import MethodSettings
from mebo_grasp.optimization.methods.common import without_repeats
from mebo_grasp.optimization.methods.mebo import Mebo
from mebo_grasp.optimization.methods.registry import make_method
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace

SPACE = SearchSpace.unit_cube(2)
PEAKS = np.array([[0.25, 0.3], [0.75, 0.7]])


def two_peaks(u):
    """Equal maxima of 1 at both peaks."""
    return float(np.exp(-np.min(np.sum((PEAKS - u) ** 2, axis=1)) / 0.05))


def run(name, budget=60, seed=0, objective=two_peaks, **kwargs):
    settings = OptimizerSettings(budget=budget, n_initial=12, **kwargs)
    optimizer = Optimizer(SPACE, name, settings, seed)
    batches = []
    while not optimizer.finished:
        trials = optimizer.ask()
        batches.append(np.array([trial.x for trial in trials]))
        for trial in trials:
            optimizer.tell(trial.id, objective(trial.x))
    return optimizer, batches[4:]


@pytest.mark.parametrize("name", ["bo", "bo_pi", "bo_ucb", "bo_thompson", "local_penalization", "robot"])
def test_optimizers_reach_an_optimum(name):
    optimizer, _ = run(name)
    assert optimizer.incumbent is not None
    assert optimizer.incumbent.value > 0.995


def test_robot_finds_both_peaks_and_keeps_them_apart():
    optimizer, _ = run("robot", num_solutions=2, min_distance=0.4)
    found = optimizer.solution_set()
    assert [s.value > 0.98 for s in found] == [True, True]
    assert np.linalg.norm(found[0].x - found[1].x) >= 0.4


def test_robot_shrinks_its_regions_while_nothing_improves_and_forgets_nothing_on_resume():
    method = make_method("robot", SPACE, MethodSettings(num_solutions=1, min_distance=0.4, budget=60))
    known = Observations(2)
    known.add([0.5, 0.5], 1.0)
    known.add([0.1, 0.1], 0.0)
    lengths = []
    for seed in range(10):
        for u in method.propose(known, 1, np.random.default_rng(seed)):
            known.add(u, 0.2)
        lengths.append(method.state()["regions"][0][0])
    assert lengths[0] == 0.8
    assert lengths[-1] == 0.2


def test_local_penalization_spreads_a_batch_over_both_peaks():
    _, batches = run("local_penalization")
    late = batches[-6:]
    nearest = [np.linalg.norm(b[:, None] - PEAKS[None], axis=2).argmin(axis=1) for b in late]
    assert sum(len(set(n)) == 2 for n in nearest) >= 4


def test_pending_points_keep_greedy_methods_away():
    for name in ("bo", "bo_ucb", "local_penalization", "constraint_active_search"):
        optimizer = Optimizer(SPACE, name, OptimizerSettings(budget=60, n_initial=12), 0)
        for trial in optimizer.ask(12):
            optimizer.tell(trial.id, two_peaks(trial.x))
        asked = np.array([optimizer.ask(1)[0].x for _ in range(4)])
        gaps = np.linalg.norm(asked[:, None] - asked[None], axis=2) + 10.0 * np.eye(4)
        assert gaps.min() > 0.01, name


@pytest.mark.parametrize("name", ["bo", "bo_ucb", "local_penalization"])
def test_greedy_methods_leave_a_place_where_trials_fail(name):
    optimizer = Optimizer(SPACE, name, OptimizerSettings(budget=30, n_initial=12, batch_size=1), 0)
    failed = []
    while not optimizer.finished:
        for trial in optimizer.ask():
            if np.linalg.norm(trial.x - PEAKS[0]) < 0.2:
                failed.append(trial.x)
                optimizer.tell_failed(trial.id)
            else:
                optimizer.tell(trial.id, two_peaks(trial.x))
    gaps = np.linalg.norm(np.array(failed)[:, None] - np.array(failed)[None], axis=2) + 9.0 * np.eye(len(failed))
    assert np.median(gaps.min(axis=1)) > 0.01
    assert optimizer.incumbent is not None
    assert np.linalg.norm(optimizer.incumbent.x - PEAKS[1]) < 0.05


def test_constraint_active_search_covers_the_good_region_with_points_apart():
    optimizer, batches = run(
        "constraint_active_search",
        budget=72,
        objective=lambda u: -float(np.abs(u - 0.5).max()),
        threshold=-0.25,
        min_distance=0.12,
    )
    found = np.concatenate(batches)
    good = found[np.abs(found - 0.5).max(axis=1) <= 0.25]
    grid = np.stack(np.meshgrid(*2 * [np.linspace(0.27, 0.73, 24)]), axis=-1).reshape(-1, 2)
    covered = np.linalg.norm(grid[:, None] - good[None], axis=2).min(axis=1) < 0.12
    assert covered.mean() > 0.95
    gaps = np.linalg.norm(good[:, None] - good[None], axis=2) + 10.0 * np.eye(len(good))
    assert np.median(gaps.min(axis=1)) > 0.05
    assert optimizer.finished


def test_mebo_draws_one_of_three_by_improvement_whatever_the_batch():
    method = Mebo(SPACE, MethodSettings(burn_in=5))
    known = Observations(2)
    for u in np.random.default_rng(0).random((10, 2)):
        known.add(u, two_peaks(u))
    names = []
    for count in (3, 1, 1, 1, 2, 4):
        names += [a.name for a in method.acquisitions(known, count)]
        method.propose(known, count, np.random.default_rng(0))
    assert names == ["ei", "ucb", "ucb"] * 4


def test_robot_continues_with_the_region_whose_turn_it_is():
    settings = MethodSettings(num_solutions=2, min_distance=0.4)
    known = Observations(2)
    for u in np.random.default_rng(0).random((20, 2)):
        known.add(u, two_peaks(u))
    method, twin = (make_method("robot", SPACE, settings) for _ in range(2))
    method.propose(known, 1, np.random.default_rng(0))
    twin.restore(method.state())
    for i in range(1, 4):
        expected = method.propose(known, 1, np.random.default_rng(i))
        assert np.array_equal(twin.propose(known, 1, np.random.default_rng(i)), expected)
        assert twin.phase == method.phase == f"region {i % 2 + 1}"


def test_tried_failed_and_open_points_are_moved_away_from():
    known = Observations(2)
    known.add([0.1, 0.1], 0.0)
    known.add_failed([0.2, 0.2])
    known.open(0, [1.0, 1.0])
    wanted = np.array([[0.1, 0.1], [0.2, 0.2], [1.0, 1.0], [0.5, 0.5], [0.5, 0.5]])
    moved = without_repeats(wanted, known, np.random.default_rng(0))
    points = np.vstack([known.taken, moved])
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2) + 9.0 * np.eye(len(points))
    assert gaps.min() > 1e-9
    assert np.all((moved >= 0.0) & (moved <= 1.0))
    assert np.abs(moved - wanted).max() < 0.01
    assert np.array_equal(moved[3], wanted[3])
