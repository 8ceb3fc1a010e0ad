"""What runs are expected to take, and how the time left is told."""

import io

import pytest

from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.peers import PEER_NAMES
from mebo_grasp.experiments.runs.progress import Progress
from mebo_grasp.experiments.runs.protocol import VARIANTS, known_methods
from mebo_grasp.experiments.runs.run_costs import SECONDS, CostEstimate, expected_seconds, slow_peers

VINCENT, TRAP = Job("mebo", Cec2013("vincent_2d"), 0), Job("mebo", Cec2013("five_uneven_peak_trap"), 0)


def test_every_method_of_all_and_every_peer_has_an_expected_cost() -> None:
    apart = {name for name, variant in VARIANTS.items() if variant.group}
    assert set(known_methods()) - apart == set(SECONDS)


def test_a_run_of_four_times_the_evaluations_is_expected_to_take_sixteen_times_as_long() -> None:
    long = Job("mebo", Cec2013("cf1_2d"), 0, budget=1000)
    assert expected_seconds(long) == pytest.approx(16.0 * expected_seconds(VINCENT))


def test_peers_of_minutes_a_run_are_slow_and_those_of_a_second_are_not() -> None:
    assert set(slow_peers(PEER_NAMES)) == {"skopt", "botorch_qlogei", "botorch_qucb", "optuna_gp"}


def test_measured_runs_replace_what_was_expected() -> None:
    costs = CostEstimate()
    assert costs.seconds(VINCENT) == expected_seconds(VINCENT)
    costs.finished(TRAP, 2.0 * expected_seconds(TRAP))
    # The same method elsewhere, and any other method, is expected to take twice as long too.
    assert costs.seconds(VINCENT) == pytest.approx(2.0 * expected_seconds(VINCENT))
    bo = Job("bo", Cec2013("vincent_2d"), 0)
    assert costs.seconds(bo) == pytest.approx(2.0 * expected_seconds(bo))
    costs.finished(VINCENT, 10.0)
    costs.finished(Job("mebo", Cec2013("vincent_2d"), 1), 30.0)
    assert costs.seconds(Job("mebo", Cec2013("vincent_2d"), 2)) == pytest.approx(20.0)
    assert costs.seconds(Job("mebo", Cec2013("vincent_2d"), 2, budget=500)) != pytest.approx(20.0)


def test_time_left_is_shared_by_the_workers() -> None:
    bar = Progress(total=6, workers=2, stream=io.StringIO())
    bar.finished(VINCENT, 20.0)
    assert bar.seconds_left([VINCENT, VINCENT, VINCENT]) == pytest.approx(30.0)


def test_a_failed_run_counts_as_done_and_teaches_nothing() -> None:
    stream = io.StringIO()
    bar = Progress(total=2, workers=1, stream=stream)
    bar.finished(TRAP, None)
    bar.show([VINCENT], force=True)
    assert "1/2 runs" in stream.getvalue()
    assert bar.seconds_left([VINCENT]) == expected_seconds(VINCENT)


def test_progress_names_what_is_to_come_done_and_left() -> None:
    stream = io.StringIO()
    bar = Progress(total=2, workers=1, stream=stream)
    bar.announce([Job("skopt", Cec2013("vincent_2d"), 0), Job("skopt", Cec2013("vincent_2d"), 1)])
    assert "2 runs to make, roughly 8:20 of CPU time" in stream.getvalue()
    bar.finished(VINCENT, 3700.0)
    bar.show([VINCENT], force=True)
    assert "1/2 runs" in stream.getvalue()
    assert "about 1:01:40 left" in stream.getvalue()
