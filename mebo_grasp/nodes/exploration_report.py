"""What the optimizer node says of itself: status and diagnostics messages, and its pace."""

from __future__ import annotations

import math
from collections import deque

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from mebo_grasp_interfaces.msg import ExplorationStatus

from mebo_grasp.nodes.exploration_plan import ExplorationPlan
from mebo_grasp.nodes.optimizer_worker import Progress


class Pace:
    """Mean time between the last answers.

    Args:
        window: number of answers that count.
    """

    def __init__(self, window: int = 100) -> None:
        self._times: deque[float] = deque(maxlen=window)

    def count(self, now: float) -> None:
        """Note an answer at ``now``, seconds on a steady clock."""
        self._times.append(now)

    @property
    def seconds_per_trial(self) -> float:
        """Mean seconds between two answers; 0 before the second."""
        if len(self._times) < 2:
            return 0.0
        return (self._times[-1] - self._times[0]) / (len(self._times) - 1)


def status_msg(
    *,
    stamp: Time,
    state: int,
    plan: ExplorationPlan,
    progress: Progress,
    pending: int,
    seconds_per_trial: float,
    note: str,
) -> ExplorationStatus:
    """Build the message for ``exploration_status``."""
    message = ExplorationStatus()
    message.header.stamp = stamp
    message.header.frame_id = plan.object_id
    message.state = state
    message.method = plan.settings.method
    message.object_id = plan.object_id
    message.phase = progress.phase
    message.evaluations = progress.told
    message.failed = progress.failed
    message.budget = plan.settings.budget
    message.pending = pending
    message.best_quality = math.nan if progress.best_quality is None else progress.best_quality
    message.seconds_per_trial = seconds_per_trial
    message.message = note
    return message


def diagnostics_msg(node_name: str, status: ExplorationStatus) -> DiagnosticArray:
    """Build the message for ``/diagnostics``: WARN while a hand is missing or silent, else OK."""
    entry = DiagnosticStatus()
    entry.name = f"{node_name}: exploration"
    entry.hardware_id = status.object_id
    entry.level = DiagnosticStatus.WARN if status.message else DiagnosticStatus.OK
    entry.message = status.message or status.phase
    entry.values = [
        KeyValue(key="method", value=status.method),
        KeyValue(key="evaluations", value=f"{status.evaluations} of {status.budget}"),
        KeyValue(key="failed", value=str(status.failed)),
        KeyValue(key="pending", value=str(status.pending)),
        KeyValue(key="best quality", value=f"{status.best_quality:.4f}"),
        KeyValue(key="seconds per trial", value=f"{status.seconds_per_trial:.4f}"),
    ]
    message = DiagnosticArray()
    message.header.stamp = status.header.stamp
    message.status = [entry]
    return message
