"""What the archive keeps, counts, refuses and answers."""

import math
from pathlib import Path

import numpy as np
import pytest

from mebo_grasp.errors import ArchiveError, InvalidQueryError
from mebo_grasp.grasp import Grasp, GraspOutcome, Pose, StampedGrasp
from mebo_grasp.solutions.archive import AddStatus, SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspQuery
from mebo_grasp.solutions.occlusion import Box, Occlusion, Sphere
from mebo_grasp.solutions.ranking import Ranking, figures_under_noise

EVERYWHERE = Occlusion("everywhere", Sphere(10.0), Pose.identity())


def trial(stamp_ns: int, quality: float, x: float = 0.0, object_id: str = "bottle") -> StampedGrasp:
    pose = Pose(np.array([x, 0.0, 0.0]))
    if math.isnan(quality):
        return StampedGrasp(stamp_ns, Grasp.failed(pose, "no answer", object_id))
    return StampedGrasp(stamp_ns, Grasp(pose, GraspOutcome.GRASPED, quality, object_id=object_id))


@pytest.fixture
def archive() -> SolutionArchive:
    return SolutionArchive(":memory:", "bottle")


def stamps(archive: SolutionArchive, **query: object) -> list[int]:
    return [s.stamp_ns for s in archive.best(BestGraspQuery(**query)).grasps]  # type: ignore[arg-type]


def test_statuses_are_true_when_stored(archive: SolutionArchive) -> None:
    assert archive.add(trial(1, 0.2)) is AddStatus.IMPROVED
    assert archive.add(trial(2, 0.1)) is AddStatus.STORED
    assert archive.add(trial(3, 0.3)) is AddStatus.IMPROVED
    assert archive.add(trial(3, 0.9)) is AddStatus.DUPLICATE
    assert [bool(status) for status in AddStatus] == [False, True, True]
    assert stamps(archive, max_grasps=9) == [3, 1, 2]


def test_failed_and_worthless_trials_are_stored_but_never_answers(archive: SolutionArchive) -> None:
    for stamped in (trial(1, math.nan), trial(2, 0.0), trial(3, -0.1)):
        assert archive.add(stamped) is AddStatus.STORED
    assert len(archive) == 3
    assert next(s.grasp.outcome for s in archive.grasps) is GraspOutcome.FAILED
    answer = archive.best()
    assert (answer.grasps, answer.considered, answer.occluded) == ((), 0, 0)
    assert "no grasp" in answer.explanation


def test_equal_qualities_come_in_the_order_of_their_stamps(archive: SolutionArchive) -> None:
    for stamp in (5, 3, 4, 1):
        archive.add(trial(stamp, 0.5))
    archive.add(trial(2, 0.6))
    assert stamps(archive, max_grasps=9) == [2, 1, 3, 4, 5]


def test_occluded_grasps_are_counted_and_named(archive: SolutionArchive) -> None:
    for stamp, x in ((1, 0.0), (2, 0.1), (3, 0.2)):
        archive.add(trial(stamp, 1.0 - 0.1 * stamp, x))
    cup = Occlusion("cup", Box((0.05, 0.05, 0.05)), Pose(np.array([0.0, 0.0, 0.0])))
    answer = archive.best(BestGraspQuery((cup,), max_grasps=1))
    assert [s.stamp_ns for s in answer.grasps] == [2]
    assert (answer.considered, answer.occluded, answer.blocked_by) == (2, 1, (("cup", 1),))
    assert answer.explanation == ""


def test_when_nothing_is_left_the_answer_says_what_blocked_it(archive: SolutionArchive) -> None:
    archive.add(trial(1, 0.5))
    answer = archive.best(BestGraspQuery((EVERYWHERE,)))
    assert (answer.considered, answer.occluded) == (1, 1)
    assert "'everywhere' (1)" in answer.explanation


def test_the_least_quality_counts_inclusively(archive: SolutionArchive) -> None:
    archive.add(trial(1, 0.5))
    archive.add(trial(2, 0.4))
    assert stamps(archive, max_grasps=9, min_quality=0.5) == [1]
    assert stamps(archive, max_grasps=9, min_quality=0.51) == []


def test_the_solution_set_has_its_figures(archive: SolutionArchive) -> None:
    for stamp, quality, x in ((1, 0.8, 0.0), (2, 0.7, 0.01), (3, 0.4, 0.1)):
        archive.add(trial(stamp, quality, x))
    solutions = archive.solution_set(4, 0.04)
    assert [s.stamp_ns for s in solutions.grasps] == [1, 3]
    assert solutions.diverse == 2
    assert solutions.mean_min_distance == pytest.approx(0.1)
    assert solutions.mean_quality == pytest.approx(0.6)
    assert solutions.qd == pytest.approx(2 * 0.1 * (0.4 + 0.6))
    assert archive.solution_set(4, 0.04, (EVERYWHERE,)).grasps == ()


def test_a_trial_of_another_object_is_refused_and_one_without_name_is_taken(
    archive: SolutionArchive,
) -> None:
    with pytest.raises(ArchiveError, match="'mug'"):
        archive.add(trial(1, 0.5, object_id="mug"))
    archive.add(trial(1, 0.5, object_id=""))
    assert [s.grasp.object_id for s in archive.best().grasps] == ["bottle"]


def test_reset_needs_the_name_of_the_object(archive: SolutionArchive) -> None:
    archive.add(trial(1, 0.5))
    archive.add(trial(2, math.nan))
    with pytest.raises(ArchiveError, match="nothing was deleted"):
        archive.reset("mug")
    assert len(archive) == 2
    assert archive.reset("bottle") == 2
    assert len(archive) == 0
    assert archive.best().grasps == ()
    assert archive.add(trial(1, 0.5)) is AddStatus.IMPROVED


def test_one_file_holds_several_objects(tmp_path: Path) -> None:
    path = tmp_path / "grasps.db"
    for object_id in ("bottle", "mug"):
        with SolutionArchive(path, object_id) as archive:
            archive.add(trial(7, 0.5, object_id=object_id))
    with SolutionArchive(path, "mug") as archive:
        assert archive.object_counts() == {"bottle": 1, "mug": 1}
        assert archive.reset("mug") == 1
    with SolutionArchive(path, "bottle") as archive:
        assert len(archive) == 1
        assert archive.object_counts() == {"bottle": 1, "mug": 0}


def test_closing_twice_is_harmless_and_questions_after_it_are_refused(archive: SolutionArchive) -> None:
    archive.close()
    archive.close()
    for ask in (archive.best, lambda: archive.add(trial(1, 0.5)), lambda: archive.reset("bottle")):
        with pytest.raises(ArchiveError, match="closed"):
            ask()


@pytest.mark.parametrize("stamp_ns", [-1, 2**63])
def test_stamps_that_do_not_fit_are_refused(archive: SolutionArchive, stamp_ns: int) -> None:
    with pytest.raises(ArchiveError, match="cannot be stored"):
        archive.add(trial(stamp_ns, 0.5))
    assert len(archive) == 0


def test_an_archive_without_object_is_refused() -> None:
    with pytest.raises(ArchiveError, match="name of its object"):
        SolutionArchive(":memory:", "")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("max_grasps", 0),
        ("min_quality", math.nan),
        ("min_quality", -1.0),
        ("min_diversity", math.inf),
        ("quantile", 0.0),
        ("quantile", 0.6),
        ("quantile", math.nan),
    ],
)
def test_questions_out_of_range_are_refused(field: str, value: float) -> None:
    with pytest.raises(InvalidQueryError, match=field):
        BestGraspQuery(**{field: value})  # type: ignore[arg-type]


def test_the_quantile_is_that_of_a_normal_distribution() -> None:
    under_noise = np.array([[0.5, 0.1, 0.0], [math.nan] * 3])
    found = figures_under_noise(Ranking.QUANTILE, under_noise, 0.05)
    np.testing.assert_allclose(found, [0.5 - 1.6448536 * 0.1, math.nan], atol=1e-8)


def test_when_the_figure_is_known_of_no_grasp_the_answer_says_so(archive: SolutionArchive) -> None:
    archive.add(trial(1, 0.5))
    answer = archive.best(BestGraspQuery(ranking=Ranking.WORST))
    assert not answer.grasps
    assert answer.explanation == (
        "no grasp of enough worst quality is stored; 1 grasps were passed over, as their worst quality is not known"
    )
