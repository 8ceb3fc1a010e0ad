"""Every metric as the quality of whole trials, against the metric computed from the contacts that the trial reports."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import Grasp, GraspOutcome, Pose
from mebo_grasp.grasping import wrench_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.metrics import simox
from mebo_grasp.grasping.metrics.chosen import FACES_SEED
from mebo_grasp.grasping.metrics.contact_models import model_wrenches
from mebo_grasp.grasping.metrics.uniformity import uniformity
from mebo_grasp.grasping.minkowski_sum import sum_origin_distance
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import CONTACT_MODELS, ContactModel, QualityName, TrialSettings

BOTTLE, HAND = TargetObject.builtin("bottle"), HandModel.load("icub_left")
LENGTH = BOTTLE.longest_side / 2.0


def grasps(settings: TrialSettings, count: int = 12) -> list[Grasp]:
    space = position_space(BOTTLE, HAND)
    points = np.random.default_rng(7).uniform(space.lower, space.upper, (count, 3))
    with GraspSimulator(BOTTLE, HAND, settings) as simulator:
        found = [simulator.trial(space.to_pose(x)) for x in points]
    assert sum(grasp.outcome is GraspOutcome.GRASPED for grasp in found) >= count // 2
    return found


def expected_quality(name: str, grasp: Grasp) -> float:
    """Return a metric from a grasp's own contacts, by the functions of its module."""
    points, normals = (np.array([getattr(c, what) for c in grasp.contacts]) for what in ("position", "normal"))
    wrenches = wrench_space.contact_wrenches(points, normals, 0.5, 8, BOTTLE.center_of_mass, LENGTH)
    if name == "epsilon_linf":
        return sum_origin_distance(wrenches.reshape(len(points), 8, 6))
    if name == "uniformity":
        return uniformity(HAND, grasp.hand_posture, grasp.T_object_tcp, grasp.contacts, BOTTLE.center_of_mass, LENGTH)
    unit = simox.object_wrench_space(BOTTLE, np.random.default_rng(FACES_SEED))
    own = simox.simox_wrenches(points, normals, BOTTLE)
    values = {
        "epsilon": lambda: wrench_space.epsilon(wrenches),
        "penalized_epsilon": lambda: wrench_space.epsilon(wrenches),
        "force_closure_epsilon": lambda: wrench_space.epsilon(wrenches),
        "volume": lambda: wrench_space.volume(wrenches),
        "isotropy": lambda: wrench_space.isotropy(points, normals, BOTTLE.center_of_mass, LENGTH),
        "simox_epsilon": lambda: simox.simox_epsilon(own, unit),
        "simox_volume": lambda: simox.simox_volume(own, unit),
    }
    return values[name]()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "simox_volume")) for name in get_args(QualityName)]
)
def test_each_metric_can_be_the_quality(name: QualityName) -> None:
    found = grasps(TrialSettings(quality=name), 6 if name == "simox_volume" else 12)
    for grasp in found:
        if grasp.outcome is GraspOutcome.GRASPED:
            assert grasp.quality == pytest.approx(expected_quality(name, grasp), rel=1e-9, abs=1e-12)
        elif grasp.outcome is GraspOutcome.NO_CONTACT:
            assert grasp.quality == 0.0
    assert any(grasp.quality > 0.0 for grasp in found)


def test_the_basic_metrics_do_not_depend_on_the_chosen_one() -> None:
    plain, other = grasps(TrialSettings()), grasps(TrialSettings(quality="uniformity"))
    for a, b in zip(plain, other, strict=True):
        assert (a.outcome, a.epsilon, a.volume, a.isotropy) == (b.outcome, b.epsilon, b.volume, b.isotropy)


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_contact_models_change_the_metrics_as_their_wrenches_say(model: ContactModel) -> None:
    for grasp in grasps(TrialSettings(contact_model=model)):
        if grasp.outcome is not GraspOutcome.GRASPED:
            continue
        points, normals = (np.array([getattr(c, what) for c in grasp.contacts]) for what in ("position", "normal"))
        wrenches = model_wrenches(model, points, normals, 0.5, 8, BOTTLE.center_of_mass, LENGTH, 0.002)
        assert grasp.epsilon == pytest.approx(wrench_space.epsilon(wrenches), abs=1e-12)


def test_a_collision_has_a_penalty_that_grows_with_the_links_that_collide() -> None:
    """Backing away from the axis along the palm's normal, ever fewer links overlap the bottle."""
    settings = TrialSettings(quality="penalized_epsilon", penalty_rate=0.2)
    with GraspSimulator(BOTTLE, HAND, settings) as simulator:
        poses = [Pose.from_rpy([-0.05, y, -0.03], [-math.pi / 2.0, 0.0, 0.0]) for y in np.linspace(0.02, 0.08, 25)]
        found = [simulator.trial(pose) for pose in poses]
    collided = [grasp.quality for grasp in found if grasp.outcome is GraspOutcome.COLLISION]
    free = [grasp.quality for grasp in found if grasp.outcome is not GraspOutcome.COLLISION]
    assert len(collided) >= 2
    assert len(free) >= 2
    assert max(collided) < 0.0 <= min(free)
    counts = [-math.log1p(value) / 0.2 for value in collided]
    assert counts == pytest.approx(np.round(counts), abs=1e-9)
    assert max(counts) <= 18
    assert counts[0] > counts[-1]


@pytest.mark.parametrize(
    ("field", "value"), [("contact_model", "sticky"), ("torsion", -1.0), ("penalty_rate", 0.0), ("quality", "beauty")]
)
def test_settings_out_of_range_are_named(field: str, value: object) -> None:
    with pytest.raises(InvalidSettingsError, match=field):
        TrialSettings(**{field: value})  # type: ignore[arg-type]
