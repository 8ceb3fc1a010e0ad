"""The bench of grasps: what it measures, and that it does not repeat runs that are on file."""

import json

import numpy as np
import pytest

from mebo_grasp.benchmarks import grasps as bench_grasps
from mebo_grasp.benchmarks.grasps import Scene, occluded, retention
from mebo_grasp.grasping.hand_model import HandModel


@pytest.fixture(scope="module")
def scene():
    return Scene.of("bottle", "pose", HandModel.load("icub_left"))


def test_retention_is_the_best_left_outside_the_radius_over_the_best():
    X = np.array([[0.0, 0.0], [0.015, 0.0], [0.03, 0.0], [0.05, 0.0]])
    assert retention(X, np.array([0.2, 0.19, 0.15, 0.1])) == pytest.approx([0.75, 0.5])
    assert retention(X[:2], np.array([0.2, 0.19])) == [0.0, 0.0]
    assert retention(X, np.zeros(4)) == [0.0, 0.0]


def test_large_occlusion_leaves_only_what_lies_below(scene):
    blocked = Scene(scene.target, scene.hand, scene.poses, scene.settings, (-0.1, 0.1))
    X = np.zeros((4, 6))
    X[:, 2] = [0.0, 0.2, -0.2, -0.05]
    assert occluded(X, np.array([0.9, 0.5, 0.3, 0.8]), blocked) == [0.5, 0.3]
    assert occluded(X, np.ones(4), scene) == []


def test_a_metre_counts_as_twenty_radians(scene):
    assert scene.search_space.distance_weights.tolist() == [1.0] * 3 + [0.05] * 3


def test_runs_on_file_are_not_repeated(tmp_path, capsys, monkeypatch):
    out = str(tmp_path / "runs.jsonl")
    arguments = ["--objects", "bottle", "--spaces", "position", "--methods", "random", "--out", out, "--seeds"]
    assert bench_grasps.main([*arguments, "1"]) == 0
    seeds = [json.loads(line)["seed"] for line in (tmp_path / "runs.jsonl").read_text().splitlines()]
    assert seeds == [0]
    explored = []
    explore = bench_grasps.explore

    def counted(scene, method, seed):
        explored.append(seed)
        return explore(scene, method, seed)

    monkeypatch.setattr(bench_grasps, "explore", counted)
    assert bench_grasps.main([*arguments, "2"]) == 0
    assert explored == [1]
    assert "2 seeds" in capsys.readouterr().out.splitlines()[-1]


def test_no_seed_is_refused(capsys):
    with pytest.raises(SystemExit, match="2"):
        bench_grasps.main(["--seeds", "0"])
    assert "--seeds must be at least 1" in capsys.readouterr().err
