import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from mebo_grasp.optimization.methods.random_search import RandomSearch
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


class Watched(RandomSearch):
    """Random search that notes how many threads the linear algebra has while it computes."""

    def __init__(self, *args):
        super().__init__(*args)
        self.seen = []

    def propose(self, *args):
        self.seen.append(threads())
        return super().propose(*args)

    def outcomes(self, *args):
        self.seen.append(threads())
        return super().outcomes(*args)


@pytest.mark.parametrize("before", [1, 2])
def test_linear_algebra_has_one_thread_while_an_optimizer_computes_and_its_own_afterwards(before):
    space, settings = SearchSpace(("x",), np.zeros(1), np.ones(1)), OptimizerSettings(budget=4, n_initial=1)
    method = Watched(space, settings)
    optimizer = Optimizer(space, method, settings, 1)
    with threadpool_limits(before, user_api="blas"):
        for trial in optimizer.ask(4):
            optimizer.tell(trial.id, 1.0)
        optimizer.solution_set()
        assert optimizer.safe_incumbent is None
        assert threads() == {before}
    assert len(method.seen) >= 3
    assert all(seen == {1} for seen in method.seen)
