"""What the optimizer's thread was told and has not counted yet is known."""

import queue

import numpy as np

from mebo_grasp.nodes.optimizer_worker import OptimizerWorker, Order
from mebo_grasp.optimization.optimizer import Optimizer, OptimizerSettings
from mebo_grasp.optimization.search_space import SearchSpace


def test_a_tell_is_open_until_its_event_is_taken() -> None:
    rang: queue.SimpleQueue[None] = queue.SimpleQueue()
    settings = OptimizerSettings(budget=4, n_initial=4, batch_size=2)
    optimizer = Optimizer(SearchSpace(("x",), np.zeros(1), np.ones(1)), "sobol", settings, np.random.default_rng(1))
    worker = OptimizerWorker(optimizer, lambda: rang.put(None))
    worker.ask()
    rang.get(timeout=60)
    (asked,) = worker.events()
    assert asked.order is Order.ASK
    assert worker.untold == 0

    first, second = asked.trials
    worker.tell(first.id, 1.0)
    worker.tell_failed(second.id, "slipped")
    assert worker.untold == 2
    assert worker.progress.told == 0
    for _ in range(2):
        rang.get(timeout=60)
    told = worker.events()
    assert [event.progress.told for event in told] == [1, 2]
    assert worker.untold == 0
    worker.stop()
