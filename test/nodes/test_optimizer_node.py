"""The optimizer node beside hands that are late, repeat themselves, stay silent or talk nonsense."""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import ExplorationStatus, GraspQuality
from std_srvs.srv import Trigger

from mebo_grasp.nodes import qos
from msg_adapters.time import from_time_msg

from .harness import Inbox, Probe
from .scenes import OBJECT, PlayedHand, answer

pytestmark = pytest.mark.nodes


@pytest.fixture
def status(probe: Probe) -> Inbox[ExplorationStatus]:
    return probe.listen(ExplorationStatus, "exploration_status", qos.LATCHED)


def finished(status: ExplorationStatus) -> bool:
    return bool(status.state == ExplorationStatus.FINISHED)


def test_an_answer_that_comes_late_or_twice_counts_once(launch, probe: Probe, status) -> None:
    hand = PlayedHand(probe)
    kept_back: list[PoseStamped] = []

    def respond(candidate: PoseStamped) -> list[GraspQuality]:
        if not kept_back:
            kept_back.append(candidate)
            return []
        late = [answer(kept_back[0])] if len(hand.candidates.messages) == 8 else []
        return [answer(candidate), answer(candidate), *late]

    hand.respond = respond
    launch("optimizer_node", budget=12, initial_points=12, trial_timeout=0.5, object=OBJECT)
    final = status.wait_for(finished)
    assert (final.evaluations, final.failed) == (12, 0)
    assert math.isclose(final.best_quality, max(answer(c).quality for c in hand.candidates.messages), rel_tol=1e-12)


def test_the_robot_of_the_documents_is_a_hand(launch, probe: Probe, status, tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "hands.md").read_text(encoding="utf-8")
    script = tmp_path / "my_robot.py"
    script.write_text(text.split("## A robot in place of")[1].split("```python\n")[1].split("```")[0])
    qualities = probe.listen(GraspQuality, "grasp_quality", qos.QUALITIES)
    node = launch("optimizer_node", budget=4, initial_points=4, object=OBJECT)
    environment = dict(os.environ, ROS_DOMAIN_ID=str(probe.domain_id), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    with subprocess.Popen([sys.executable, str(script)], env=environment) as robot:
        try:
            final = status.wait_for(finished)
        finally:
            robot.kill()
    assert (final.evaluations, final.failed) == (4, 0)
    assert final.best_quality == max(quality.quality for quality in qualities.messages)
    assert node.alive


def test_a_hand_whose_answers_cannot_be_heard_is_told_why(launch, probe: Probe, status) -> None:
    probe.node.create_publisher(GraspQuality, "grasp_quality", 10)
    probe.listen(PoseStamped, "candidate_pose", qos.CANDIDATES)
    launch("optimizer_node", object=OBJECT)
    status.wait_for(lambda s: "nobody publishes grasp_quality with the QoS reliable and transient local" in s.message)


def test_a_hand_that_never_answers_costs_the_trial_not_the_run(launch, probe: Probe, status) -> None:
    hand = PlayedHand(probe)
    hand.respond = lambda _: []
    diagnostics = probe.listen(DiagnosticArray, "/diagnostics")
    launch("optimizer_node", budget=3, initial_points=3, trial_timeout=0.2, max_attempts=2, object=OBJECT)
    status.wait_for(lambda s: "no answer from hand on /candidate_pose" in s.message)
    diagnostics.wait_for(lambda d: d.status[0].level == DiagnosticStatus.WARN)
    final = status.wait_for(finished)
    assert (final.evaluations, final.failed) == (3, 3)
    assert math.isnan(final.best_quality)
    stamps = [from_time_msg(c.header.stamp) for c in hand.candidates.messages]
    assert len(stamps) == 6
    assert stamps == sorted(set(stamps))


def test_a_silent_hands_trials_go_to_another_hand(launch, probe: Probe, status) -> None:
    deaf, well = PlayedHand(probe, "deaf"), PlayedHand(probe, "well")
    deaf.respond = lambda _: []
    launch(
        "optimizer_node",
        budget=9,
        initial_points=9,
        trial_timeout=0.3,
        max_attempts=20,
        hands=["deaf", "well"],
        object=OBJECT,
    )
    final = status.wait_for(finished)
    assert (final.evaluations, final.failed) == (9, 0)
    assert len(deaf.candidates.messages) >= 1
    given = {(c.pose.position.x, c.pose.position.y) for c in deaf.candidates.messages}
    assert given <= {(c.pose.position.x, c.pose.position.y) for c in well.candidates.messages}


def test_waits_for_a_hand_and_says_so(launch, probe: Probe, status) -> None:
    launch("optimizer_node", budget=3, initial_points=3, object=OBJECT)
    assert "waiting for a hand" in status.wait_for(lambda s: bool(s.message)).message
    PlayedHand(probe)
    assert status.wait_for(finished).evaluations == 3


def test_who_only_listens_to_candidates_is_no_hand(launch, probe: Probe, status) -> None:
    echo = probe.listen(PoseStamped, "candidate_pose", qos.CANDIDATES)
    launch("optimizer_node", budget=3, initial_points=3, object=OBJECT, trial_timeout=0.1)
    status.wait_for(lambda s: "waiting for a hand" in s.message)
    probe.listen(DiagnosticArray, "/diagnostics").wait_for_count(3)
    assert echo.messages == []
    PlayedHand(probe)
    final = status.wait_for(finished)
    assert (final.evaluations, final.failed) == (3, 0)


def test_nonsense_fails_the_trial_and_unknown_stamps_are_ignored(launch, probe: Probe, status) -> None:
    hand = PlayedHand(probe)

    def respond(candidate: PoseStamped) -> list[GraspQuality]:
        number = len(hand.candidates.messages)
        message = answer(candidate)
        if number == 1:
            message.quality = math.nan
        elif number == 2:
            message.tcp_pose.orientation.w = 0.0
            message.tcp_pose.orientation.x = message.tcp_pose.orientation.y = 0.0
            message.tcp_pose.orientation.z = 0.0
        elif number == 3:
            message.header.frame_id = "elsewhere"
        elif number == 4:
            message.outcome = 77
        elif number == 5:
            stranger = answer(candidate, quality=1000.0)
            stranger.header.stamp.sec += 1000
            stranger.tcp_pose.position.x += 100.0
            return [stranger, message]
        return [message]

    hand.respond = respond
    node = launch("optimizer_node", budget=9, initial_points=9, object=OBJECT, trials_per_hand=1)
    final = status.wait_for(finished)
    assert (final.evaluations, final.failed) == (9, 4)
    assert final.best_quality <= 1.0
    assert "elsewhere" in node.log


def test_learns_from_trials_that_another_asked_for(launch, probe: Probe, status) -> None:
    hand = PlayedHand(probe)
    launch("optimizer_node", budget=30, initial_points=9, object=OBJECT, trials_per_hand=1)
    sent: list[GraspQuality] = []

    def respond(candidate: PoseStamped) -> list[GraspQuality]:
        stranger = answer(candidate, quality=500.0)
        stranger.header.stamp.nanosec = (stranger.header.stamp.nanosec + 7) % 1_000_000_000
        stranger.tcp_pose.position.x += 1e-4
        sent.append(stranger)
        return [stranger, answer(candidate)] if len(sent) == 3 else [answer(candidate)]

    hand.respond = respond
    final = status.wait_for(finished)
    assert final.evaluations == 30
    assert final.best_quality == 500.0


def test_start_pause_resume_reset(launch, probe: Probe, status) -> None:
    hand = PlayedHand(probe)
    launch("optimizer_node", budget=500, initial_points=500, autostart=False, object=OBJECT)
    status.wait_for(lambda s: s.state == ExplorationStatus.IDLE)

    def order(name: str) -> Trigger.Response:
        return probe.call(Trigger, f"/optimizer_node/{name}", Trigger.Request())

    refused = order("pause")
    assert not refused.success
    assert "cannot pause while idle" in refused.message
    assert hand.candidates.messages == []
    assert order("start").success
    hand.candidates.wait_for_count(10)
    assert order("pause").success
    paused = status.wait_for(lambda s: s.state == ExplorationStatus.PAUSED)
    assert not order("start").success
    assert order("resume").success
    status.wait_for(lambda s: s.evaluations >= paused.evaluations + 5)
    seen = len(status.messages)
    assert order("reset").success
    fresh = status.wait_for(lambda s: s.state == ExplorationStatus.IDLE, after=seen)
    assert fresh.evaluations == 0
    assert order("start").success
    status.wait_for(lambda s: s.evaluations >= 5, after=seen)


def test_reset_sets_the_log_aside(launch, probe: Probe, status, tmp_path: Path) -> None:
    PlayedHand(probe)
    log = tmp_path / "run.jsonl"
    launch("optimizer_node", budget=6, initial_points=6, object=OBJECT, run_log=str(log))
    status.wait_for(finished)
    before = log.read_text()
    probe.call(Trigger, "/optimizer_node/reset", Trigger.Request())
    (aside,) = [path for path in tmp_path.iterdir() if path.name.startswith("run.jsonl.")]
    assert aside.read_text() == before


def test_a_run_that_was_finished_is_finished_when_it_is_resumed(launch, probe: Probe, status, tmp_path: Path) -> None:
    PlayedHand(probe)
    parameters = {"budget": 6, "initial_points": 6, "object": OBJECT, "run_log": str(tmp_path / "run.jsonl")}
    node = launch("optimizer_node", **parameters)
    status.wait_for(finished)
    node.stop()
    seen = len(status.messages)
    launch("optimizer_node", **parameters)
    assert status.wait_for(finished, after=seen).evaluations == 6


def test_a_reset_that_a_full_disk_refuses_is_made_up_for_by_the_next_start(
    launch, probe: Probe, status, tmp_path: Path
) -> None:
    PlayedHand(probe)
    log = tmp_path / "run.jsonl"
    node = launch("optimizer_node", budget=6, initial_points=6, object=OBJECT, run_log=str(log))
    status.wait_for(finished)
    resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    for order in ("reset", "start"):
        refused = probe.call(Trigger, f"/optimizer_node/{order}", Trigger.Request())
        assert not refused.success
        assert "cannot write to the run log" in refused.message
    resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    seen = len(status.messages)
    assert probe.call(Trigger, "/optimizer_node/start", Trigger.Request()).success
    status.wait_for(lambda s: s.state == ExplorationStatus.EXPLORING, after=seen)
    status.wait_for(finished, after=seen)
    assert log.read_text().count('"tell"') == 6


def test_explores_while_simulated_time_stands_still(launch, probe: Probe, status) -> None:
    PlayedHand(probe)
    node = launch("optimizer_node", budget=4, initial_points=4, object=OBJECT, use_sim_time=True, budgett=9)
    assert status.wait_for(finished).evaluations == 4
    assert "unknown parameters are ignored: budgett" in node.log


def test_a_full_disk_pauses_the_run_and_resume_goes_on_where_the_log_ends(
    launch, probe: Probe, status, tmp_path: Path
) -> None:
    PlayedHand(probe)
    log = tmp_path / "run.jsonl"
    node = launch("optimizer_node", budget=9, initial_points=9, object=OBJECT, run_log=str(log), autostart=False)
    status.wait_for(lambda s: s.state == ExplorationStatus.IDLE)
    resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, (log.stat().st_size, resource.RLIM_INFINITY))
    probe.call(Trigger, "/optimizer_node/start", Trigger.Request())
    halted = status.wait_for(lambda s: s.state == ExplorationStatus.PAUSED)
    assert "cannot write to the run log" in halted.message
    resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert probe.call(Trigger, "/optimizer_node/resume", Trigger.Request()).success
    final = status.wait_for(finished)
    assert (final.evaluations, final.message) == (9, "")
    node.stop()
    assert log.read_text().count('"tell"') == 9


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"method": "guessing"}, "guessing"),
        ({"space": "sideways"}, "sideways"),
        ({"object": "unicorn"}, "unicorn"),
        ({"budget": 3, "initial_points": 9}, "initial_points"),
        ({"budget": 0}, "budget"),
        ({"hands": ["left hand"]}, "left hand/candidate_pose"),
        ({"run_log": "/dev/null/run.jsonl"}, "/dev/null"),
        ({"ucb_beta": -1.0}, "ucb_beta"),
        ({"kernel": "cubic"}, "additive_matern52"),
        ({"lower_bounds": [0.0, 0.0, 0.0]}, "upper_bounds"),
        ({"lower_bounds": [1.0, 1.0, 1.0], "upper_bounds": [0.0, 0.0, 0.0]}, "bound"),
    ],
)
def test_bad_parameters_end_the_node_with_one_clear_line(launch, parameters, expected) -> None:
    node = launch("optimizer_node", **parameters)
    assert node.process.wait(30.0) == 2
    assert expected in node.log
    assert len([line for line in node.log.splitlines() if "pybullet build" not in line]) == 1
