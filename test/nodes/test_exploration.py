"""Three real nodes over DDS: a whole exploration, and one in which a node dies."""

from __future__ import annotations

import math
import signal
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import ExplorationStatus, GraspQuality
from mebo_grasp_interfaces.msg import SolutionSet as SolutionSetMsg
from mebo_grasp_interfaces.srv import GetBestGrasp
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from mebo_grasp.nodes import qos
from mebo_grasp.solutions.archive import SolutionArchive
from msg_adapters.time import from_time_msg

from .harness import Probe, wait_until
from .scenes import OBJECT, Scene

pytestmark = pytest.mark.nodes

BUDGET = 40


@pytest.fixture
def scene(launch, probe: Probe, tmp_path: Path) -> Scene:
    return Scene(launch, probe, tmp_path, BUDGET)


def stamps_of(messages: list[GraspQuality]) -> list[int]:
    return [from_time_msg(message.header.stamp) for message in messages]


def test_forty_trials_from_candidate_to_best_grasp(scene: Scene, probe: Probe) -> None:
    # No trial is given twice on a busy machine, and none before the probe is known to the optimizer: candidates are
    # not kept for late listeners, and the answer to a request says that the way is open.
    scene.parameters["optimizer_node"] |= {"trial_timeout": 60.0, "autostart": False}
    scene.start()
    probe.call(Trigger, "/optimizer_node/start", Trigger.Request())
    final = scene.wait_until_finished()
    assert (final.evaluations, final.failed, final.pending) == (BUDGET, 0, 0)

    qualities = scene.qualities.wait_for_count(BUDGET)
    stamps = stamps_of(qualities)
    assert len(qualities) == BUDGET
    assert stamps == sorted(set(stamps))
    asked = scene.candidates.wait_for_count(BUDGET)
    assert [from_time_msg(candidate.header.stamp) for candidate in asked] == stamps
    assert [candidate.pose for candidate in asked] == [quality.tcp_pose for quality in qualities]
    assert {quality.header.frame_id for quality in qualities} == {OBJECT}

    wait_until(lambda: scene.stored() == BUDGET)
    best = max(qualities, key=lambda quality: quality.quality)
    assert best.quality > 0.0
    assert final.best_quality == best.quality
    reply = probe.call(GetBestGrasp, "get_best_grasp", GetBestGrasp.Request())
    assert reply.error_code == reply.NONE
    assert reply.grasps[0].header.stamp == best.header.stamp
    # Figures under noise are NaN here, which equals nothing: whole messages are compared as they are written.
    assert repr(reply.grasps[0]) == repr(best)


def test_late_subscribers_get_what_is_latched(scene: Scene, probe: Probe) -> None:
    scene.start()
    final = scene.wait_until_finished()
    wait_until(lambda: scene.stored() == BUDGET)
    status = probe.listen(ExplorationStatus, "exploration_status", qos.LATCHED).wait_for()
    assert (status.state, status.evaluations) == (ExplorationStatus.FINISHED, BUDGET)
    best = probe.listen(PoseStamped, "best_grasp", qos.LATCHED).wait_for()
    (best_quality,) = [q for q in scene.qualities.messages if q.quality == final.best_quality][:1]
    assert best.header == best_quality.header
    assert best.pose == best_quality.tcp_pose
    solutions = probe.listen(SolutionSetMsg, "solution_set", qos.LATCHED).wait_for(
        lambda message: message.stored == BUDGET
    )
    assert solutions.grasps[0].quality == final.best_quality
    description = probe.listen(String, "robot_description", qos.LATCHED).wait_for()
    assert "<robot" in description.data
    assert probe.listen(MarkerArray, "object_markers", qos.LATCHED).wait_for().markers
    assert probe.listen(MarkerArray, "hand_markers", qos.LATCHED).wait_for().markers
    assert probe.listen(MarkerArray, "solution_markers", qos.LATCHED).wait_for().markers
    joints = probe.listen(JointState, "joint_states", qos.LATCHED).wait_for()
    assert len(joints.name) == len(joints.position) > 0
    assert all(math.isfinite(position) for position in joints.position)


@pytest.mark.parametrize("victim", ["optimizer_node", "hand_node", "solution_set_node"])
def test_a_killed_node_costs_no_stored_trial(victim: str, launch, probe: Probe, tmp_path: Path) -> None:
    budget = 150
    scene = Scene(launch, probe, tmp_path, budget)
    scene.parameters["optimizer_node"]["max_attempts"] = 50  # until a hand is there again, on a busy machine too
    sets = probe.listen(SolutionSetMsg, "solution_set", qos.LATCHED)
    scene.start()
    scene.wait_for_evaluations(12)
    stored_before = sets.wait_for(lambda solutions: solutions.stored >= 1).stored
    scene.nodes[victim].kill()
    assert scene.status.messages[-1].evaluations < budget, "the exploration had ended before the kill"
    scene.start(victim)
    final = scene.wait_until_finished()
    assert (final.evaluations, final.failed) == (budget, 0)
    # A trial that was given twice is answered twice: what the probe saw must have come to the archive too.
    wait_until(lambda: scene.stored() >= len(set(stamps_of(scene.qualities.messages))))
    assert all(node.stop() == 0 for node in scene.nodes.values())
    # Every answer that any hand gave is in the database, whoever was dead at the time.
    with SolutionArchive(tmp_path / "trials.db", OBJECT) as archive:
        kept = {trial.stamp_ns for trial in archive.grasps}
    assert kept >= set(stamps_of(scene.qualities.messages))
    assert len(kept) >= stored_before


def test_a_resumed_run_goes_where_an_uninterrupted_one_goes(launch, probe: Probe, tmp_path: Path) -> None:
    budget = 120

    def poses(folder: str, interrupt: bool) -> list[tuple[float, float, float]]:
        (tmp_path / folder).mkdir()
        scene = Scene(launch, probe, tmp_path / folder, budget)
        scene.start("hand_node", "optimizer_node")
        if interrupt:
            scene.wait_for_evaluations(34)
            scene.nodes["optimizer_node"].kill()
            assert scene.status.messages[-1].evaluations < budget, "the exploration had ended before the kill"
            scene.start("optimizer_node")
        scene.wait_until_finished()
        # The optimizer may have its last answer before the probe has it: the hand must not go before.
        wait_until(lambda: len(distinct(scene)) >= budget)
        assert all(node.stop() == 0 for node in scene.nodes.values())
        return distinct(scene)

    def distinct(scene: Scene) -> list[tuple[float, float, float]]:
        positions = [quality.tcp_pose.position for quality in scene.qualities.messages]
        return list(dict.fromkeys((p.x, p.y, p.z) for p in positions))

    whole = poses("whole", interrupt=False)
    resumed = poses("resumed", interrupt=True)
    assert len(whole) == budget
    assert set(resumed) == set(whole)


@pytest.mark.parametrize("order", [signal.SIGINT, signal.SIGTERM])
def test_nodes_end_cleanly_when_told(scene: Scene, order: signal.Signals) -> None:
    scene.start()
    scene.wait_for_evaluations(3)
    assert {name: node.stop(order) for name, node in scene.nodes.items()} == dict.fromkeys(scene.nodes, 0)
    assert not any("Traceback" in node.log for node in scene.nodes.values())
