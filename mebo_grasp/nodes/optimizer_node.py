"""``optimizer_node``: publishes candidate TCP poses and learns from the grasp qualities that come back.

In space ``pose_posture`` the posture in which the hand arrives goes out under the same stamp.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from mebo_grasp_interfaces.msg import ExplorationStatus, GraspQuality
from rclpy.node import Node
from std_srvs.srv import Trigger

from mebo_grasp.errors import MeboGraspError, RunLogError
from mebo_grasp.grasp import FloatArray, GraspOutcome, StampedGrasp
from mebo_grasp.nodes import qos
from mebo_grasp.nodes.clock import StampSource, random_offset
from mebo_grasp.nodes.dispatcher import Assignment, Dispatcher, DispatchSettings
from mebo_grasp.nodes.exploration_plan import make_plan
from mebo_grasp.nodes.exploration_report import Pace, diagnostics_msg, status_msg
from mebo_grasp.nodes.hand_links import HandLinks
from mebo_grasp.nodes.optimizer_worker import Event, OptimizerWorker, Order, state_of
from mebo_grasp.nodes.parameters import declare
from mebo_grasp.nodes.runtime import STEADY_CLOCK, guarded, guarded_trigger, run_node
from mebo_grasp.nodes.settings import OptimizerNodeSettings
from mebo_grasp.optimization.optimizer import Trial
from msg_adapters.grasp import from_grasp_quality_msg
from msg_adapters.time import from_time_msg

CHECK_PERIOD = 0.05
"""Seconds between two looks for overdue trials and hands that came or went."""

STATUS_PERIOD = 0.1
"""Least seconds between two messages on ``exploration_status``."""

DIAGNOSTICS_PERIOD = 1.0
"""Seconds between two messages on ``/diagnostics``."""

SWITCH_INTERVAL = 0.001
"""Seconds until the optimizer's thread yields the interpreter to a callback (Python's default: 5 ms)."""

SAME_POINT = 1e-9
"""Largest difference in the unit cube at which two points are the same trial, seen through a message."""


class OptimizerNode(Node):
    """Publishes ``<hand>/candidate_pose`` and learns from ``grasp_quality``.

    Raises:
        MeboGraspError: a parameter, the object or the log of the run is not usable.
    """

    def __init__(self) -> None:
        super().__init__("optimizer_node")
        self._settings = declare(self, OptimizerNodeSettings)
        self._plan = make_plan(self._settings)
        dispatch = DispatchSettings(
            hands=self._settings.hands,
            trials_per_hand=self._settings.trials_per_hand,
            timeout=self._settings.trial_timeout,
            max_attempts=self._settings.max_attempts,
        )
        self._next_stamp = StampSource(lambda: self.get_clock().now().nanoseconds, offset_ns=random_offset())
        self._dispatcher: Dispatcher[Trial] = Dispatcher(dispatch, self._next_stamp)
        self._note_said = ""
        self._state = ExplorationStatus.EXPLORING if self._settings.autostart else ExplorationStatus.IDLE
        self._wake = self.create_guard_condition(self._on_worker_event)
        self._begin_run()
        self._advertise()

    def _begin_run(self) -> None:
        self._has_run = False
        optimizer = self._plan.open_optimizer()
        state = state_of(optimizer)
        self._known_points = state.observations.taken
        self._dispatcher.add(optimizer.pending)
        self._worker = OptimizerWorker(optimizer, self._wake.trigger)
        self._progress = self._worker.progress
        self._run_began = self._next_stamp()
        self._asking = False
        self._trouble: Exception | None = None
        self._pace = Pace()
        self._status_due = 0.0
        self._has_run = True
        if self._progress.told:
            self.get_logger().info(f"resumed {self._settings.run_log}: {self._progress.told} trials are told")

    def _end_run(self) -> None:
        self._worker.stop()
        self._dispatcher.clear()
        self._has_run = False

    def _advertise(self) -> None:
        self._hands = HandLinks(self, self._settings.hands, self._plan.object_id, self._plan.with_posture)
        self._status = self.create_publisher(ExplorationStatus, "exploration_status", qos.LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._qualities = self.create_subscription(GraspQuality, "grasp_quality", self._on_quality, qos.QUALITIES)
        self.create_service(Trigger, "~/start", self._on_start)
        self.create_service(Trigger, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/resume", self._on_resume)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_timer(CHECK_PERIOD, self._on_check, clock=STEADY_CLOCK)
        self.create_timer(DIAGNOSTICS_PERIOD, self._on_diagnostics, clock=STEADY_CLOCK)
        space = self._plan.search_space
        self.get_logger().info(
            f"exploring '{self._plan.object_id}' with {self._settings.method} in {space.dim} dimensions, "
            f"{self._settings.budget} trials"
        )

    # Results ------------------------------------------------------------------------------------------

    @guarded
    def _on_quality(self, message: GraspQuality) -> None:
        if message.object_id and message.object_id != self._plan.object_id:
            return  # another exploration on the same topic
        trial = self._dispatcher.answer(from_time_msg(message.header.stamp))
        if trial is None:
            self._learn_from_others(message)
        else:
            self._tell(trial, message)
        self._advance()

    def _tell(self, trial: Trial, message: GraspQuality) -> None:
        self._pace.count(time.monotonic())
        try:
            grasp = from_grasp_quality_msg(message, expected_frame=self._plan.object_id).grasp
        except MeboGraspError as error:
            self.get_logger().warning(f"trial {trial.id} has an unusable answer: {error}")
            self._worker.tell_failed(trial.id, str(error))
            return
        if grasp.outcome is GraspOutcome.FAILED:
            self.get_logger().warning(f"trial {trial.id} failed: {grasp.message}")
            self._worker.tell_failed(trial.id, grasp.message)
        else:
            self._worker.tell(trial.id, grasp.quality)

    def _learn_from_others(self, message: GraspQuality) -> None:
        stamped: StampedGrasp = from_grasp_quality_msg(message, expected_frame=self._plan.object_id)
        if stamped.grasp.outcome is GraspOutcome.FAILED:
            return
        pose = stamped.grasp.T_object_tcp
        x = self._plan.point_of(pose)
        if x is None and not self._plan.with_posture:
            return
        # After a restart the answers to this optimizer's own candidates come under stamps it forgot.
        open_trial = self._dispatcher.settle(
            lambda trial: self._plan.has_pose(trial.x, pose) if x is None else self._same_point(trial.x, x)
        )
        if open_trial is not None:
            self._tell(open_trial, message)
        elif x is not None and self._is_news(stamped.stamp_ns, x):
            self._remember([x])
            self._worker.observe(x, stamped.grasp.quality)

    def _is_news(self, stamp_ns: int, x: FloatArray) -> bool:
        # Hands send their old answers to late subscribers: a new run must not begin with those.
        if not self._settings.listen_to_others or stamp_ns < self._run_began:
            return False
        distances = np.abs(self._known_points - self._plan.search_space.to_unit(x))
        return not bool(np.any(np.max(distances, axis=1) < SAME_POINT))

    def _remember(self, points: Sequence[FloatArray]) -> None:
        units = [self._plan.search_space.to_unit(x) for x in points]
        self._known_points = np.vstack([self._known_points, *units])

    def _same_point(self, a: FloatArray, b: FloatArray) -> bool:
        space = self._plan.search_space
        return bool(np.max(np.abs(space.to_unit(a) - space.to_unit(b))) < SAME_POINT)

    # The next trials ----------------------------------------------------------------------------------

    def _advance(self) -> None:
        """Send what waits, order more when too little is open, and say where things stand."""
        exploring = self._state == ExplorationStatus.EXPLORING
        if exploring and self._progress.finished:  # also at the start: the log may tell of a whole run
            self._finish()
        elif exploring:
            for assignment in self._dispatcher.assign(time.monotonic(), self._hands.ready):
                self._send(assignment)
            self._ask_if_needed()
        self._publish_status()

    def _send(self, assignment: Assignment[Trial]) -> None:
        x = assignment.trial.x
        pose, posture = self._plan.pose_space.to_pose(x), self._plan.posture_of(x)
        self._hands.send(assignment.hand, assignment.stamp_ns, pose, posture)

    def _ask_if_needed(self) -> None:
        if self._asking or self._progress.exhausted or not self._hands.ready:
            return
        # One hand waits for its whole batch, as in the thesis; more hands than open trials never idle.
        if self._dispatcher.open_count == 0 or self._dispatcher.open_count < len(self._hands.ready):
            self._asking = True
            self._worker.ask()

    @guarded
    def _on_worker_event(self) -> None:
        for event in self._worker.events():
            self._take_event(event)
        self._advance()

    def _take_event(self, event: Event) -> None:
        self._progress = event.progress
        if event.error is not None:
            self.get_logger().error(f"optimizer: {type(event.error).__name__}: {event.error}")
            # Asking on would spend the budget on trials that are never sent, or that no log tells of.
            if event.order is Order.ASK or isinstance(event.error, RunLogError):
                self._halt(event.error)
        if event.order is Order.ASK:
            self._asking = False
            self._remember([trial.x for trial in event.trials])
            self._dispatcher.add(event.trials)

    def _halt(self, error: Exception) -> None:
        self._trouble = error
        if self._state == ExplorationStatus.EXPLORING:
            self._state = ExplorationStatus.PAUSED
            self._status_due = 0.0

    def _finish(self) -> None:
        self._state = ExplorationStatus.FINISHED
        best = self._progress.best_quality
        self.get_logger().info(
            f"finished: {self._progress.told} trials, {self._progress.failed} of them failed, "
            f"best quality {'none' if best is None else f'{best:.4f}'}"
        )
        self._status_due = 0.0

    @guarded
    def _on_check(self) -> None:
        for hand in self._hands.look(self._qualities.get_publisher_count() > 0):
            self.get_logger().warning(f"{self._hands.describe([hand])} is gone; its trials wait for another")
            self._dispatcher.hand_lost(hand)
        for trial in self._dispatcher.expire(time.monotonic()):
            reason = f"no answer after {self._settings.max_attempts} attempts"
            self.get_logger().warning(f"trial {trial.id} failed: {reason}")
            self._worker.tell_failed(trial.id, reason)
        self._advance()

    # Orders -------------------------------------------------------------------------------------------

    @guarded_trigger
    def _on_start(self) -> str:
        self._change_state("start", ExplorationStatus.IDLE, ExplorationStatus.EXPLORING)
        return "exploring"

    @guarded_trigger
    def _on_pause(self) -> str:
        self._change_state("pause", ExplorationStatus.EXPLORING, ExplorationStatus.PAUSED)
        return f"paused; {self._dispatcher.in_flight_count} candidates are out"

    @guarded_trigger
    def _on_resume(self) -> str:
        if self._state == ExplorationStatus.PAUSED and isinstance(self._trouble, RunLogError):
            # The log knows less than the optimizer: go on from what it knows.
            self._end_run()
            self._begin_run()
        self._trouble = None
        self._change_state("resume", ExplorationStatus.PAUSED, ExplorationStatus.EXPLORING)
        return "exploring"

    @guarded_trigger
    def _on_reset(self) -> str:
        # First what may be refused, by a folder that is read-only: then nothing has changed.
        aside = self._plan.set_log_aside()
        self._end_run()
        self._state = ExplorationStatus.IDLE
        self._begin_run()
        self._advance()
        return "idle; call start to explore anew" + (f"; the old log is {aside}" if aside else "")

    def _change_state(self, order: str, expected: int, target: int) -> None:
        if self._state != expected:
            raise MeboGraspError(
                f"cannot {order} while {STATE_NAMES[self._state]}; {order} works while {STATE_NAMES[expected]}"
            )
        if not self._has_run:  # a full disk did not take its log when it was to begin
            self._begin_run()
        self._state = target
        self._status_due = 0.0
        self._advance()

    # Reports ------------------------------------------------------------------------------------------

    def _publish_status(self) -> None:
        now = time.monotonic()
        if now >= self._status_due:
            self._status_due = now + STATUS_PERIOD
            status = self._status_now()
            self._status.publish(status)
            if status.message not in ("", self._note_said):
                self.get_logger().warning(status.message)
            self._note_said = status.message

    def _status_now(self) -> ExplorationStatus:
        return status_msg(
            stamp=self.get_clock().now().to_msg(),
            state=self._state,
            plan=self._plan,
            progress=self._progress,
            pending=self._dispatcher.in_flight_count + self._worker.untold,
            seconds_per_trial=self._pace.seconds_per_trial,
            note=self._note(),
        )

    def _note(self) -> str:
        if self._trouble is not None:
            return f"stopped: {self._trouble}; mend that, then resume"
        if self._state != ExplorationStatus.EXPLORING:
            return ""
        if not self._hands.ready:
            return self._hands.what_is_missing()
        silent = self._dispatcher.silent_hands
        return f"no answer from {self._hands.describe(silent)}" if silent else ""

    @guarded
    def _on_diagnostics(self) -> None:
        self._diagnostics.publish(diagnostics_msg(self.get_fully_qualified_name(), self._status_now()))

    def destroy_node(self) -> None:
        """Finish what the optimizer was told, close its log, then the node."""
        self._worker.stop()
        super().destroy_node()


STATE_NAMES = {
    ExplorationStatus.IDLE: "idle",
    ExplorationStatus.EXPLORING: "exploring",
    ExplorationStatus.PAUSED: "paused",
    ExplorationStatus.FINISHED: "finished",
}


def main() -> None:
    """Run the node until it is stopped."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    run_node(OptimizerNode)


if __name__ == "__main__":
    main()
