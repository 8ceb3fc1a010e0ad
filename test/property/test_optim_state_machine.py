"""Whatever the order of asks, tells, failures and foreign results, the optimizer's books balance."""

import math

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from mebo_grasp.errors import InvalidSettingsError, TrialStateError
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace

SPACE = SearchSpace(("x", "y"), np.array([-2.0, 10.0]), np.array([3.0, 11.0]))
VALUES = st.floats(-1e9, 1e9)


class AskAndTell(RuleBasedStateMachine):
    def __init__(self):
        super().__init__()
        self.budget = 20
        self.optimizer = Optimizer(
            SPACE, "mebo", OptimizerSettings(budget=self.budget, n_initial=4, burn_in=3, chains=4), 0
        )
        self.open, self.told, self.failed, self.foreign = {}, {}, [], []

    @precondition(lambda self: self.optimizer.n_asked < self.budget)
    @rule(count=st.one_of(st.none(), st.integers(1, 6)))
    def ask(self, count):
        for trial in self.optimizer.ask(count):
            assert SPACE.contains(trial.x)
            assert trial.id not in self.open
            self.open[trial.id] = trial

    @precondition(lambda self: self.optimizer.n_asked == self.budget)
    @rule()
    def ask_beyond_the_budget(self):
        try:
            self.optimizer.ask()
        except TrialStateError:
            return
        raise AssertionError("the budget was exceeded")

    @precondition(lambda self: self.open)
    @rule(data=st.data(), value=VALUES)
    def tell(self, data, value):
        trial_id = data.draw(st.sampled_from(sorted(self.open)))
        self.optimizer.tell(trial_id, value)
        self.told[trial_id] = (self.open.pop(trial_id).x, value)

    @precondition(lambda self: self.open)
    @rule(data=st.data())
    def fail(self, data):
        trial_id = data.draw(st.sampled_from(sorted(self.open)))
        self.optimizer.tell_failed(trial_id, "lost")
        self.failed.append(self.open.pop(trial_id))

    @rule(trial_id=st.integers(-3, 40), value=st.sampled_from([0.0, math.nan, math.inf]))
    def tell_nonsense(self, trial_id, value):
        if trial_id in self.open and math.isfinite(value):
            return
        try:
            self.optimizer.tell(trial_id, value)
        except (TrialStateError, InvalidSettingsError):
            return
        raise AssertionError("nonsense was accepted")

    @rule(share=st.tuples(st.floats(0, 1), st.floats(0, 1)), value=VALUES)
    def observe(self, share, value):
        x = SPACE.from_unit(np.array(share))
        self.optimizer.observe(x, value)
        self.foreign.append((x, value))

    @invariant()
    def books_balance(self):
        optimizer = self.optimizer
        assert {trial.id for trial in optimizer.pending} == set(self.open)
        assert (optimizer.n_told, optimizer.n_failed) == (len(self.told), len(self.failed))
        assert optimizer.n_asked == len(self.told) + len(self.failed) + len(self.open) <= self.budget
        assert optimizer.finished == (optimizer.n_asked == self.budget and not self.open)
        assert optimizer.observations.n == len(self.told) + len(self.foreign)

    @invariant()
    def incumbent_is_the_best_told(self):
        values = [value for _, value in [*self.told.values(), *self.foreign]]
        incumbent = self.optimizer.incumbent
        assert (incumbent is None) == (not values)
        if incumbent is not None:
            assert incumbent.value == max(values)


AskAndTell.TestCase.settings = settings(max_examples=25, stateful_step_count=25, deadline=None)
TestAskAndTell = AskAndTell.TestCase
