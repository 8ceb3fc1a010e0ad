"""Three real nodes with an inexact hand: a safe exploration, and the best grasps by what is expected of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mebo_grasp_interfaces.msg import GraspQuality
from mebo_grasp_interfaces.srv import GetBestGrasp
from scipy.stats import norm

from mebo_grasp.cli.main import main
from mebo_grasp.optimization.run_log import RunLog

from .harness import Probe, wait_until
from .scenes import OBJECT, Scene

pytestmark = pytest.mark.nodes

BUDGET, REPETITIONS = 30, 4


def test_a_safe_exploration_answers_by_expected_quality_and_by_quantile(
    launch, probe: Probe, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(launch, probe, tmp_path, BUDGET)
    scene.parameters["hand_node"] |= {"position_noise": 0.004, "repetitions": REPETITIONS}
    scene.parameters["optimizer_node"] |= {"safe": True, "input_noise_position": 0.004, "trial_timeout": 20.0}
    scene.start()
    final = scene.wait_until_finished()
    assert (final.evaluations, final.failed) == (BUDGET, 0)
    header = RunLog.load(tmp_path / "run.jsonl")[0]
    assert header["settings"]["safe"] is True
    assert header["settings"]["input_noise"]["values"] == [0.004, 0.0]

    qualities = scene.qualities.wait_for_count(BUDGET)
    # Only what is a grasp is repeated.
    good = [q for q in qualities if q.noise_samples > 0]
    assert {q.header.stamp.nanosec for q in good} == {q.header.stamp.nanosec for q in qualities if q.quality > 0.0}
    assert good
    assert all(q.noise_samples == REPETITIONS and q.worst_quality <= q.expected_quality + 1e-12 for q in good)
    wait_until(lambda: scene.stored() == BUDGET)

    def asked(ranking: int, quantile: float = 0.0) -> GraspQuality:
        request = GetBestGrasp.Request(ranking=ranking, quantile=quantile)
        reply = probe.call(GetBestGrasp, "get_best_grasp", request)
        assert reply.error_code == reply.NONE
        return reply.grasps[0]

    expected = [q.expected_quality for q in good]
    assert asked(GetBestGrasp.Request.RANK_EXPECTED).expected_quality == max(expected)
    quantiles = [q.expected_quality + norm.ppf(0.2) * q.quality_sd for q in good]
    best = good[int(np.argmax(quantiles))]
    assert asked(GetBestGrasp.Request.RANK_QUANTILE, 0.2).header.stamp == best.header.stamp

    assert all(node.stop() == 0 for node in scene.nodes.values())
    assert main(["best", str(tmp_path / "trials.db"), "--object", OBJECT, "--rank-by", "expected", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["expected_quality"] == max(expected)
