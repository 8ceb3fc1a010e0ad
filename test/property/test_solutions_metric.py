"""The distance between poses: a metric, and with a symmetry axis the least one over all turns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mebo_grasp.errors import InvalidQueryError
from mebo_grasp.grasp import FloatArray, Pose
from mebo_grasp.solutions.diversity import PoseMetric
from test.property.solution_strategies import poses, unit_vectors

weights = st.sampled_from([0.0, 0.02, 0.05, 0.3])


@st.composite
def metrics(draw: st.DrawFn) -> PoseMetric:
    axis = draw(st.one_of(st.none(), unit_vectors(3)))
    return PoseMetric(draw(weights), None if axis is None else (axis[0], axis[1], axis[2]))


def turned(pose: Pose, axis: FloatArray, angle: float) -> Pose:
    turn = Rotation.from_rotvec(angle * axis)
    return Pose(turn.apply(np.array(pose.position)), (turn * pose.rotation).as_quat())


@given(metric=metrics(), a=poses(), b=poses(), c=poses())
def test_it_is_a_metric(metric: PoseMetric, a: Pose, b: Pose, c: Pose) -> None:
    assert metric.distance(a, a) < 1e-7
    assert metric.distance(a, b) >= 0.0
    assert metric.distance(a, b) == pytest.approx(metric.distance(b, a), abs=1e-6)
    assert metric.distance(a, c) <= metric.distance(a, b) + metric.distance(b, c) + 1e-6


@given(w=weights, a=poses(), b=poses(), c=poses())
def test_it_does_not_depend_on_the_frame(w: float, a: Pose, b: Pose, c: Pose) -> None:
    metric = PoseMetric(w)
    assert metric.distance(c @ a, c @ b) == pytest.approx(metric.distance(a, b), abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(w=weights, axis=unit_vectors(3), a=poses(), b=poses())
def test_with_an_axis_it_is_the_least_over_all_turns(w: float, axis: FloatArray, a: Pose, b: Pose) -> None:
    symmetric = PoseMetric(w, (axis[0], axis[1], axis[2])).distance(a, b)
    angles = np.linspace(-np.pi, np.pi, 3601)
    turns = Rotation.from_rotvec(angles[:, None] * axis)
    plain = np.sqrt(
        np.sum((a.position - turns.apply(np.array(b.position))) ** 2, axis=1)
        + (w * (a.rotation.inv() * (turns * b.rotation)).magnitude()) ** 2
    )
    # Between two of the tried turns the distance changes by at most (lever + w) times half a step.
    step = angles[1] - angles[0]
    assert symmetric <= plain.min() + 1e-9
    assert symmetric >= plain.min() - (np.linalg.norm(b.position) + w) * step / 2


@settings(deadline=None)
@given(w=weights, axis=unit_vectors(3), a=poses(), angle=st.floats(-7, 7))
def test_a_turn_of_the_object_about_its_axis_is_the_same_grasp(
    w: float, axis: FloatArray, a: Pose, angle: float
) -> None:
    metric = PoseMetric(w, (axis[0], axis[1], axis[2]))
    assert metric.distance(a, turned(a, axis, angle)) < 1e-6


@pytest.mark.parametrize("axis", [(0.0, 0.0, 0.0), (np.nan, 0.0, 1.0), (1.0, 0.0)])
def test_an_axis_that_is_none_is_refused(axis: tuple[float, ...]) -> None:
    with pytest.raises(InvalidQueryError, match="symmetry_axis"):
        PoseMetric(0.05, axis)  # type: ignore[arg-type]
