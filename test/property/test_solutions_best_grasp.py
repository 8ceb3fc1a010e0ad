"""The archive's answers are those of a plain loop over all stored grasps."""

import math
from statistics import NormalDist

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mebo_grasp.grasp import Grasp, Pose, StampedGrasp
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspAnswer, BestGraspQuery
from mebo_grasp.solutions.diversity import PoseMetric
from mebo_grasp.solutions.occlusion import Occlusion, Sphere
from mebo_grasp.solutions.ranking import Ranking
from test.property.solution_strategies import OBJECT, many_grasps, occlusions, trials

METRIC = PoseMetric(rotation_weight=0.05)


def plain_distance(a: Pose, b: Pose, metric: PoseMetric) -> float:
    if metric.symmetry_axis is not None:
        return metric.distance(a, b)  # checked by itself in test_solutions_metric
    relative = Rotation.from_quat(a.quaternion_xyzw).inv() * Rotation.from_quat(b.quaternion_xyzw)
    return math.hypot(math.dist(a.position, b.position), metric.rotation_weight * float(relative.magnitude()))


def is_blocked(query: BestGraspQuery, stamped: StampedGrasp) -> bool:
    point = stamped.grasp.T_object_tcp.position
    return any(occlusion.contains(point[None])[0] for occlusion in query.occlusions)


def figure(query: BestGraspQuery, grasp: Grasp) -> float | None:
    """What ranks a grasp; None when it is not known."""
    known = grasp.under_noise
    if query.ranking is Ranking.OBSERVED:
        return grasp.quality
    if known is None:
        return None
    lower = known.expected + NormalDist().inv_cdf(query.quantile) * known.sd
    return {"expected": known.expected, "worst": known.worst, "quantile": lower}[query.ranking]


def plain_answer(
    query: BestGraspQuery, stored: list[StampedGrasp], metric: PoseMetric = METRIC
) -> tuple[list[int], int, int]:
    """Stamps, considered, occluded, from one loop over the grasps sorted by figure and stamp."""
    chosen: list[StampedGrasp] = []
    considered = occluded = 0
    graspable = [(figure(query, s.grasp), s) for s in stored if s.grasp.quality > 0]
    good = [(y, s) for y, s in graspable if y is not None and y > 0 and y >= query.min_quality]
    for _, stamped in sorted(good, key=lambda pair: (-pair[0], pair[1].stamp_ns)):
        if len(chosen) == query.max_grasps:
            break
        considered += 1
        if is_blocked(query, stamped):
            occluded += 1
        elif all(
            plain_distance(stamped.grasp.T_object_tcp, c.grasp.T_object_tcp, metric) >= query.min_diversity
            for c in chosen
        ):
            chosen.append(stamped)
    return [stamped.stamp_ns for stamped in chosen], considered, occluded


def check(
    answer: BestGraspAnswer,
    query: BestGraspQuery,
    stored: list[StampedGrasp],
    metric: PoseMetric = METRIC,
) -> None:
    stamps, considered, occluded = plain_answer(query, stored, metric)
    assert [stamped.stamp_ns for stamped in answer.grasps] == stamps
    assert (answer.considered, answer.occluded) == (considered, occluded)
    assert sum(count for _, count in answer.blocked_by) == occluded
    tcps = np.array([s.grasp.T_object_tcp.position for s in stored]).reshape(-1, 3)
    for name, count in answer.blocked_by:
        (blocker,) = (occlusion for occlusion in query.occlusions if occlusion.id == name)
        assert count <= blocker.contains(tcps).sum()
    assert bool(answer.explanation) == (not answer.grasps)
    graspable = [s.grasp for s in stored if s.grasp.quality > 0]
    assert answer.passed_over == sum(figure(query, grasp) is None for grasp in graspable)
    assert (str(answer.passed_over) in answer.remark) == (answer.passed_over > 0)


queries = st.builds(
    BestGraspQuery,
    occlusions=occlusions(),
    max_grasps=st.integers(1, 6),
    min_quality=st.sampled_from([0.0, 0.1, 0.25, 2.0]),
    min_diversity=st.sampled_from([0.0, 0.02, 0.1, 0.3]),
    ranking=st.sampled_from(Ranking),
    quantile=st.sampled_from([0.05, 0.3, 0.5]),
)


@settings(deadline=None)
@given(stored=trials(), asked=st.lists(queries, min_size=1, max_size=3))
def test_the_answer_is_that_of_a_loop_over_all_grasps(stored: list[StampedGrasp], asked: list[BestGraspQuery]) -> None:
    with SolutionArchive(":memory:", OBJECT, METRIC) as archive:
        for count, stamped in enumerate(stored, start=1):
            archive.add(stamped)
            if count % 7 == 0:  # a question in between sees every trial stored before it
                check(archive.best(asked[0]), asked[0], stored[:count])
        for query in asked:
            check(archive.best(query), query, stored)


@settings(deadline=None, max_examples=25)
@given(query=queries, seed=st.integers(0, 2**32 - 1))
def test_the_answer_over_thousands_of_grasps_is_that_of_a_loop(query: BestGraspQuery, seed: int) -> None:
    stored = many_grasps(3000, np.random.default_rng(seed))
    with SolutionArchive(":memory:", OBJECT, METRIC) as archive:
        archive.add_many(stored[:-100])
        for stamped in stored[-100:]:
            archive.add(stamped)
        check(archive.best(query), query, stored)


@settings(deadline=None, max_examples=50)
@given(stored=trials(), size=st.integers(1, 5), min_distance=st.sampled_from([0.0, 0.05, 0.2]))
def test_the_set_is_greedy_and_mutually_diverse_after_every_trial(
    stored: list[StampedGrasp], size: int, min_distance: float
) -> None:
    query = BestGraspQuery(max_grasps=size, min_diversity=min_distance)
    with SolutionArchive(":memory:", OBJECT, METRIC) as archive:
        for count, stamped in enumerate(stored, start=1):
            archive.add(stamped)
            solutions = archive.solution_set(size, min_distance)
            expected, _, _ = plain_answer(query, stored[:count])
            assert [s.stamp_ns for s in solutions.grasps] == expected


@settings(deadline=None, max_examples=5)
@given(query=queries, seed=st.integers(0, 2**32 - 1), axis=st.sampled_from([None, (0.0, 0.6, 0.8)]))
def test_the_answer_stays_right_while_trees_are_made_in_the_background(
    query: BestGraspQuery, seed: int, axis: tuple[float, float, float] | None
) -> None:
    stored = many_grasps(6000, np.random.default_rng(seed))
    metric = PoseMetric(0.05, axis)
    with SolutionArchive(":memory:", OBJECT, metric) as archive:
        archive.add_many(stored[:5000])
        for count in range(5000, 6000):
            archive.add(stored[count])
            if count % 250 == 0:
                check(archive.best(query), query, stored[: count + 1], metric)
        archive.add_many(stored)
        check(archive.best(query), query, stored, metric)


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), wanted=st.integers(1, 20))
def test_more_shapes_than_a_node_can_rule_out_are_all_asked(seed: int, wanted: int) -> None:
    rng = np.random.default_rng(seed)
    stored = many_grasps(600, rng)
    scattered = tuple(Occlusion(f"o{i}", Sphere(0.02), Pose(rng.uniform(-0.15, 0.15, 3))) for i in range(100))
    query = BestGraspQuery(scattered, wanted)
    with SolutionArchive(":memory:", OBJECT) as archive:
        archive.add_many(stored)
        check(archive.best(query), query, stored)
