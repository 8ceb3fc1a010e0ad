"""The thread in which the optimizer computes, so that callbacks are never kept waiting.

The optimizer belongs to the thread alone. The node puts commands in and takes events out; nothing else is
shared.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer
from mebo_grasp.optimization.optimizer import Optimizer, Trial


@dataclass(frozen=True)
class Progress:
    """Where the optimization stands after a command.

    Args:
        told: trials told, failed ones included.
        failed: of these, failed.
        finished: whether the budget is used up and nothing is open.
        exhausted: whether nothing is left to ask for.
        best_quality: None before the first value.
        phase: what the method is doing.
    """

    told: int
    failed: int
    finished: bool
    exhausted: bool
    best_quality: float | None
    phase: str


class Order(Enum):
    """What the thread is told to do."""

    ASK = "ask"
    TELL = "tell"
    OBSERVE = "observe"


@dataclass(frozen=True)
class Event:
    """What one command came to: trials of an ask, or the error that stopped it."""

    progress: Progress
    order: Order
    trials: tuple[Trial, ...] = ()
    error: Exception | None = None


AskTell = Optimizer | LoggedOptimizer
Command = Callable[[AskTell], tuple[Trial, ...] | None]


def state_of(optimizer: AskTell) -> Optimizer:
    """Return the state machine itself, logged or not."""
    return optimizer.optimizer if isinstance(optimizer, LoggedOptimizer) else optimizer


class OptimizerWorker:
    """Runs one optimizer in a thread of its own.

    Args:
        optimizer: what computes; not to be touched by anybody else from now on.
        on_event: called from the thread after each command, to wake whoever takes the events.
    """

    def __init__(self, optimizer: AskTell, on_event: Callable[[], None]) -> None:
        self._optimizer = optimizer
        self._on_event = on_event
        self.progress = self._progress()
        """Where the optimization stood before the thread began."""
        self.untold = 0
        """Tells whose events were not taken yet: ``progress`` does not count them."""
        self._commands: queue.SimpleQueue[tuple[Order, Command] | None] = queue.SimpleQueue()
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="optimizer", daemon=True)
        self._thread.start()

    def ask(self, count: int | None = None) -> None:
        """Order the next batch; it comes as an event."""
        self._commands.put((Order.ASK, lambda optimizer: tuple(optimizer.ask(count))))

    def tell(self, trial_id: int, value: float) -> None:
        """Pass on the value of a trial."""
        self._give_tell(lambda optimizer: optimizer.tell(trial_id, value))

    def tell_failed(self, trial_id: int, reason: str) -> None:
        """Pass on that a trial gave no value."""
        self._give_tell(lambda optimizer: optimizer.tell_failed(trial_id, reason))

    def observe(self, x: FloatArray, value: float) -> None:
        """Pass on a result that somebody else asked for."""
        self._commands.put((Order.OBSERVE, lambda optimizer: optimizer.observe(x, value)))

    def _give_tell(self, command: Command) -> None:
        self.untold += 1
        self._commands.put((Order.TELL, command))

    def events(self) -> list[Event]:
        """Take every event that has come since the last call."""
        taken: list[Event] = []
        with contextlib.suppress(queue.Empty):
            while True:
                taken.append(self._events.get_nowait())
        self.untold -= sum(event.order is Order.TELL for event in taken)
        return taken

    def stop(self, timeout: float = 10.0) -> None:
        """Finish the commands given so far and end the thread."""
        self._commands.put(None)
        self._thread.join(timeout)

    def _run(self) -> None:
        while (item := self._commands.get()) is not None:
            self._events.put(self._execute(*item))
            self._on_event()
        if isinstance(self._optimizer, LoggedOptimizer):
            # What a full disk did not take was told as the error of its command.
            with contextlib.suppress(OSError):
                self._optimizer.close()

    def _execute(self, order: Order, command: Command) -> Event:
        trials: tuple[Trial, ...] = ()
        error: Exception | None = None
        try:
            trials = command(self._optimizer) or ()
        except Exception as raised:
            # The thread must outlive a bad tell; the node logs the error.
            error = raised
        return Event(self._progress(), order, trials, error)

    def _progress(self) -> Progress:
        optimizer = state_of(self._optimizer)
        incumbent = optimizer.incumbent
        return Progress(
            told=optimizer.n_told + optimizer.n_failed,
            failed=optimizer.n_failed,
            finished=optimizer.finished,
            exhausted=optimizer.n_asked >= optimizer.settings.budget,
            best_quality=None if incumbent is None else float(incumbent.value),
            phase=optimizer.phase,
        )
