import json
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError, TrialStateError
from mebo_grasp.optimization.methods.random_search import RandomSearch
from mebo_grasp.optimization.methods.registry import DEFAULT_METHOD, METHOD_NAMES
from mebo_grasp.optimization.optimizer import INITIAL_PHASE, LARGEST_VALUE, Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace

SPACE = SearchSpace(("x", "y"), np.array([-5.0, 100.0]), np.array([5.0, 300.0]))


def small(method="random", budget=12, n_initial=4, **kwargs):
    return Optimizer(SPACE, method, OptimizerSettings(budget=budget, n_initial=n_initial, **kwargs), 1)


def test_initial_design_comes_in_batches_and_fills_the_box_evenly():
    optimizer = small(n_initial=7)
    batches = [optimizer.ask() for _ in range(3)]
    assert [len(batch) for batch in batches] == [3, 3, 1]
    assert {trial.phase for batch in batches for trial in batch} == {INITIAL_PHASE}
    points = SPACE.to_unit([trial.x for batch in batches for trial in batch])
    assert np.array_equal(np.sort(np.floor(points * 7), axis=0), np.tile(np.arange(7.0)[:, None], 2))
    assert {trial.phase for trial in optimizer.ask()} == {"random"}


def test_an_explicit_count_crosses_the_end_of_the_initial_design_but_not_of_the_budget():
    optimizer = small(budget=9, n_initial=4)
    phases = [trial.phase for trial in optimizer.ask(6)]
    assert phases == [INITIAL_PHASE] * 4 + ["random"] * 2
    assert len(optimizer.ask(10)) == 3
    with pytest.raises(TrialStateError, match="budget of 9"):
        optimizer.ask()


def test_an_ask_that_breaks_off_opens_no_trial():
    class Interrupted(RandomSearch):
        calls = 0

        def propose(self, *args):
            self.calls += 1
            if self.calls == 1:
                raise KeyboardInterrupt
            return super().propose(*args)

    settings = OptimizerSettings(budget=9, n_initial=4)
    optimizer = Optimizer(SPACE, Interrupted(SPACE, settings), settings, 1)
    optimizer.ask(3)
    with pytest.raises(KeyboardInterrupt):
        optimizer.ask(3)
    assert [trial.id for trial in optimizer.pending] == [0, 1, 2]
    assert len(optimizer.observations.pending) == 3
    assert [(trial.id, trial.phase) for trial in optimizer.ask(2)] == [(3, INITIAL_PHASE), (4, "random")]


def test_ids_are_unique_and_increasing_and_points_are_read_only_and_in_the_box():
    optimizer = small()
    trials = optimizer.ask(12)
    assert [trial.id for trial in trials] == list(range(12))
    assert all(SPACE.contains(trial.x) for trial in trials)
    with pytest.raises(ValueError, match="read-only"):
        trials[0].x[0] = 0.0


def test_tells_in_any_order_are_counted_and_finish_the_run():
    optimizer = small()
    trials = optimizer.ask(12)
    assert not optimizer.finished
    for trial in reversed(trials[1:]):
        optimizer.tell(trial.id, float(trial.id))
    assert [trial.id for trial in optimizer.pending] == [0]
    optimizer.tell_failed(0, "no answer")
    assert (optimizer.n_told, optimizer.n_failed, optimizer.pending) == (11, 1, ())
    assert optimizer.finished
    assert optimizer.incumbent.value == 11.0
    assert np.array_equal(optimizer.incumbent.x, trials[11].x)


def test_unknown_and_repeated_ids_are_refused_and_change_nothing():
    optimizer = small()
    optimizer.ask()
    optimizer.tell(1, 0.5)
    for action in (lambda: optimizer.tell(1, 0.7), lambda: optimizer.tell_failed(1)):
        with pytest.raises(TrialStateError, match="already"):
            action()
    for unknown in (3, -1, "1", None, 1.5):
        with pytest.raises(TrialStateError, match="unknown"):
            optimizer.tell(unknown, 0.5)
    assert optimizer.n_told == 1
    assert optimizer.incumbent.value == 0.5


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_leave_the_trial_open(value):
    optimizer = small()
    optimizer.ask()
    with pytest.raises(InvalidSettingsError, match="tell_failed"):
        optimizer.tell(0, value)
    assert len(optimizer.pending) == 3
    optimizer.tell(0, 1.0)


@pytest.mark.parametrize("method", ["basin_search", "bo", "mebo"])
def test_values_may_be_huge_up_to_a_limit(method):
    optimizer = small(method, budget=9, n_initial=6, burn_in=5)
    for trial in optimizer.ask(6):
        optimizer.tell(trial.id, trial.x[0] * LARGEST_VALUE / 5.0)
    trial = optimizer.ask(1)[0]
    for value in (1.01 * LARGEST_VALUE, -1e200):
        with pytest.raises(InvalidSettingsError, match=r"at most 1e\+100 in size.*scale the objective"):
            optimizer.tell(trial.id, value)
    assert [t.id for t in optimizer.pending] == [trial.id]


def test_results_of_other_optimizers_are_learned_without_costing_budget():
    optimizer = small()
    optimizer.observe([1.0, 200.0], 42.0)
    assert optimizer.incumbent.value == 42.0
    assert (optimizer.n_asked, optimizer.n_told, optimizer.n_failed) == (0, 0, 0)
    for x in ([6.0, 200.0], [np.nan, 200.0], [1.0]):
        with pytest.raises(InvalidSettingsError, match="outside"):
            optimizer.observe(x, 1.0)


def test_before_the_first_value():
    optimizer = small()
    assert optimizer.incumbent is None
    assert optimizer.solution_set() == []
    assert optimizer.phase == INITIAL_PHASE


def test_solution_set_in_real_units():
    optimizer = small(budget=50)
    for trial in optimizer.ask(50):
        optimizer.tell(trial.id, float(trial.x[1]))
    best = optimizer.solution_set(3, min_distance=20.0)
    assert best[0].value == optimizer.incumbent.value
    assert [s.value for s in best] == sorted((s.value for s in best), reverse=True)
    assert min(np.linalg.norm(a.x - b.x) for a in best for b in best if a is not b) >= 20.0
    for bad in ({"size": 0}, {"min_distance": 0.0}, {"min_distance": np.nan}):
        with pytest.raises(InvalidSettingsError):
            optimizer.solution_set(**bad)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"batch_size": 0}, "batch_size"),
        ({"budget": 0}, "budget"),
        ({"n_initial": 13, "budget": 12}, "n_initial"),
        ({"ucb_beta": -1.0}, "ucb_beta"),
        ({"boltzmann_beta": float("nan")}, "boltzmann_beta"),
        ({"num_solutions": 0}, "num_solutions"),
        ({"min_distance": 0.0}, "min_distance"),
        ({"relearn_period": 0}, "relearn_period"),
        ({"budget": float("nan")}, "budget must be a whole number of at least 1, got nan"),
        ({"batch_size": 2.5}, "batch_size must be a whole number of at least 1, got 2.5"),
        ({"num_solutions": True}, "num_solutions must be a whole number"),
        ({"n_initial": -1}, "n_initial must be a whole number of at least 0, got -1"),
    ],
)
def test_settings_are_checked(bad, message):
    with pytest.raises(InvalidSettingsError, match=message):
        OptimizerSettings(**bad)


def test_whole_numbers_may_come_from_numpy():
    counts: dict[str, Any] = {"budget": np.int64(9), "n_initial": np.int32(3)}
    settings = OptimizerSettings(**counts)
    assert json.loads(json.dumps(asdict(settings)))["budget"] == 9


def test_unknown_method_lists_the_known_ones():
    with pytest.raises(InvalidSettingsError, match=r"mebo.*random"):
        small("simulated annealing")


def test_asking_for_nothing_is_refused():
    with pytest.raises(InvalidSettingsError, match="at least 1"):
        small().ask(0)


def test_the_default_method_is_the_registry_s():
    assert DEFAULT_METHOD in METHOD_NAMES
    assert Optimizer(SearchSpace.unit_cube(2)).method.name == DEFAULT_METHOD
