"""Shapes that nobody here made: a sample of the sweep over pybullet_data, and what the sweep does when one is bad."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest
import trimesh

from mebo_grasp.benchmarks import object_sweep
from mebo_grasp.benchmarks.object_sweep import (
    EXTRAS,
    RANDOM_SHAPES,
    SweepResult,
    Worker,
    all_objects,
    main,
    summary,
    sweep,
    try_object,
)
from mebo_grasp.experiments.objectives.installed_files import package_folder

SAMPLE = ("random_urdfs/000/000.obj", "random_urdfs/377/377.obj", "random_urdfs/741/741.obj", *EXTRAS)


def test_the_sweep_knows_every_shape_of_the_package() -> None:
    objects = all_objects()
    assert len(objects) == RANDOM_SHAPES + 3
    assert all((package_folder("pybullet_data") / name).is_file() for name in objects)


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLE)
def test_a_sample_gives_grasps(name: str) -> None:
    result = try_object(package_folder("pybullet_data") / name, name, all_objects()[name], "bullet", 32, 1)
    assert result.verdict == "grasps", result
    assert result.grasped + result.collided <= result.tried
    assert (result.best > 0.0) == (result.closed > 0)


def test_the_empty_shape_is_refused_with_a_reason() -> None:
    name = "random_urdfs/168/168.obj"
    result = try_object(package_folder("pybullet_data") / name, name, all_objects()[name], "fast", 8, 1)
    assert result.verdict == "refused"
    assert "168" in result.reason


def test_an_object_that_is_hardly_in_reach_says_how_its_trials_ended(tmp_path: Path) -> None:
    """A crate of one metre, which the side approach mostly meets with the palm; few poses are too few."""
    trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / "crate.stl")
    result = try_object(tmp_path / "crate.stl", "crate", 1.0, "fast", 1, 1)
    assert (result.verdict, result.tried, result.collided) == ("none", object_sweep.MORE, object_sweep.MORE)
    assert result.reason == "8 of 8 poses collide, 0 touch nothing"


def misbehave(path: Path, name: str, scale: float, engine: str, poses: int, seed: int) -> SweepResult:
    """Die, dawdle or raise, as the name says."""
    if name == "die":
        os._exit(3)
    if name == "dawdle":
        time.sleep(600.0)
    if name == "raise":
        raise ZeroDivisionError("as told")
    return SweepResult(f"{path.name} {scale} {engine} {poses} {seed}", "grasps")


def test_a_crash_and_a_hang_are_told_and_end_only_the_worker(tmp_path: Path) -> None:
    worker = Worker(tmp_path, "fast", 5, 7, misbehave)
    try:
        assert worker.try_object("sound", 2.0, 120.0) == SweepResult("sound 2.0 fast 5 7", "grasps")
        died = worker.try_object("die", 1.0, 120.0)
        assert (died.verdict, died.reason) == ("crash", "the process ended with code 3")
        raised = worker.try_object("raise", 1.0, 120.0)
        assert (raised.verdict, raised.reason) == ("crash", "ZeroDivisionError: as told")
        assert worker.try_object("dawdle", 1.0, 0.2).verdict == "hang"
        assert worker.try_object("sound", 2.0, 120.0).verdict == "grasps"
    finally:
        worker.stop()


def test_a_sweep_goes_on_where_its_file_ends(tmp_path: Path) -> None:
    worker, out = Worker(tmp_path, "fast", 1, 1, misbehave), tmp_path / "sweep.jsonl"
    out.write_text('{"name": "a", "verdict": "none", "reason": "tried before"}\n')
    try:
        found = list(sweep(worker, {"a": 1.0, "raise": 1.0}, out, 120.0))
    finally:
        worker.stop()
    assert [(result.name, result.verdict) for result in found] == [("a", "none"), ("raise", "crash")]
    assert [SweepResult(**json.loads(line)) for line in out.read_text().splitlines()] == found


def test_the_summary_names_what_gave_no_grasp() -> None:
    results = [SweepResult("a", "grasps", tried=4, grasped=2, closed=1, best=0.1), SweepResult("b", "refused", "empty")]
    text = summary(results)
    assert "2 objects: 1 grasps, 1 refused" in text
    assert "b: refused: empty" in text


def test_the_exit_code_tells_of_crashes(tmp_path: Path) -> None:
    out = tmp_path / "sweep.jsonl"
    out.write_text('{"name": "objects/mug.obj", "verdict": "crash", "reason": "for the test"}\n')
    assert main(["--count", "1", "--out", str(out)]) == 1
    out.write_text('{"name": "objects/mug.obj", "verdict": "none", "reason": "for the test"}\n')
    assert main(["--count", "1", "--out", str(out)]) == 0
