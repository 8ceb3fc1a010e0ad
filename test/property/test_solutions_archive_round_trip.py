"""What goes into the archive comes out of it, from memory and from the disk."""

import tempfile
from pathlib import Path

from hypothesis import given, settings

from mebo_grasp.grasp import StampedGrasp
from mebo_grasp.solutions.archive import AddStatus, SolutionArchive
from test.property.solution_strategies import OBJECT, same_grasp, trials


@settings(deadline=None, max_examples=50)
@given(stored=trials(max_size=12))
def test_every_trial_comes_back_whole_after_a_restart(stored: list[StampedGrasp]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "archive.db"
        with SolutionArchive(path, OBJECT) as archive:
            for stamped in stored:
                assert archive.add(stamped) is not AddStatus.DUPLICATE
                assert archive.add(stamped) is AddStatus.DUPLICATE
            best_before = archive.best()
        with SolutionArchive(path, OBJECT) as archive:
            found = list(archive.grasps)
            assert len(archive) == len(found) == len(stored)
            best_after = archive.best()
        assert [s.stamp_ns for s in best_after.grasps] == [s.stamp_ns for s in best_before.grasps]
        for given_trial, read in zip(sorted(stored, key=lambda s: s.stamp_ns), found, strict=True):
            assert given_trial.stamp_ns == read.stamp_ns
            assert same_grasp(given_trial.grasp, read.grasp)


@settings(deadline=None, max_examples=50)
@given(stored=trials(max_size=12))
def test_an_added_trial_counts_as_improved_when_none_was_better(stored: list[StampedGrasp]) -> None:
    best = 0.0
    with SolutionArchive(":memory:", OBJECT) as archive:
        for stamped in stored:
            improves = stamped.grasp.quality > best
            assert archive.add(stamped) is (AddStatus.IMPROVED if improves else AddStatus.STORED)
            best = max(best, stamped.grasp.quality) if improves else best
