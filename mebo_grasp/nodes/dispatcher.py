"""Who tries what: gives open trials to hands, takes them back from silent ones. Knows no ROS and no clock.

A trial may be sent several times, each time under a new stamp; the first answer to any of its stamps
settles it and every later one is recognized as repeated.

A hand that has answered nothing since it was last sent a trial may be dead. It is then *silent*: it gets one
trial at a time, as a probe, so that a dead hand costs few trials and its return is noticed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from mebo_grasp.errors import InvalidSettingsError

TrialType = TypeVar("TrialType")


@dataclass(frozen=True)
class DispatchSettings:
    """How trials are given to hands.

    Args:
        hands: namespaces of the hands, all different.
        trials_per_hand: candidates in flight for one hand.
        timeout: seconds until an unanswered trial is given again.
        max_attempts: times that a trial is given before it is given up.

    Raises:
        InvalidSettingsError: a number is not positive, or no hand is named.
    """

    hands: tuple[str, ...]
    trials_per_hand: int = 2
    timeout: float = 5.0
    max_attempts: int = 5

    def __post_init__(self) -> None:
        if not self.hands:
            raise InvalidSettingsError("at least one hand must be named")
        for name in ("trials_per_hand", "timeout", "max_attempts"):
            if not getattr(self, name) > 0:
                raise InvalidSettingsError(f"{name} must be positive, got {getattr(self, name)}")


@dataclass(eq=False)
class _OpenTrial(Generic[TrialType]):
    trial: TrialType
    attempts: int = 0
    last_hand: str | None = None


@dataclass
class _Hand:
    in_flight: set[int] = field(default_factory=set)
    silent: bool = False


@dataclass(frozen=True)
class _Sent(Generic[TrialType]):
    open_trial: _OpenTrial[TrialType]
    hand: str
    deadline: float


@dataclass(frozen=True)
class Assignment(Generic[TrialType]):
    """A trial to be published now to a hand under a stamp."""

    stamp_ns: int
    hand: str
    trial: TrialType


class Dispatcher(Generic[TrialType]):
    """The book of open trials.

    Args:
        settings: hands, limits and time-outs.
        make_stamp: returns a new stamp in nanoseconds, strictly greater than every one before.
    """

    def __init__(self, settings: DispatchSettings, make_stamp: Callable[[], int]) -> None:
        self._settings = settings
        self._make_stamp = make_stamp
        self._waiting: deque[_OpenTrial[TrialType]] = deque()
        self._sent: dict[int, _Sent[TrialType]] = {}
        self._stamps: dict[int, _OpenTrial[TrialType]] = {}
        self._hands = {name: _Hand() for name in settings.hands}

    @property
    def open_count(self) -> int:
        """Trials without an answer, sent or waiting."""
        return len(self._waiting) + len(self._sent)

    @property
    def in_flight_count(self) -> int:
        """Trials sent to a hand that has not answered."""
        return len(self._sent)

    @property
    def silent_hands(self) -> tuple[str, ...]:
        """Hands that left their last trial unanswered."""
        return tuple(name for name, hand in self._hands.items() if hand.silent)

    def open_trials(self) -> tuple[TrialType, ...]:
        """Return every trial without an answer."""
        sent = (sent.open_trial.trial for sent in self._sent.values())
        return (*sent, *(open_trial.trial for open_trial in self._waiting))

    def add(self, trials: Iterable[TrialType]) -> None:
        """Take new trials; they wait until a hand is free."""
        self._waiting.extend(_OpenTrial(trial) for trial in trials)

    def clear(self) -> None:
        """Forget every open trial; answers to them count as unknown from now on."""
        self._waiting.clear()
        self._sent.clear()
        self._stamps.clear()
        self._hands = {name: _Hand() for name in self._settings.hands}

    def assign(self, now: float, ready_hands: Sequence[str]) -> list[Assignment[TrialType]]:
        """Give waiting trials to hands that are ready and have room.

        Args:
            now: the present time, seconds on any steady clock.
            ready_hands: hands that can be reached now.
        """
        assignments: list[Assignment[TrialType]] = []
        while self._waiting:
            hand = self._choose_hand(self._waiting[0], ready_hands)
            if hand is None:
                break
            open_trial = self._waiting.popleft()
            stamp = self._make_stamp()
            open_trial.attempts += 1
            open_trial.last_hand = hand
            self._sent[stamp] = _Sent(open_trial, hand, now + self._settings.timeout)
            self._stamps[stamp] = open_trial
            self._hands[hand].in_flight.add(stamp)
            assignments.append(Assignment(stamp, hand, open_trial.trial))
        return assignments

    def answer(self, stamp_ns: int) -> TrialType | None:
        """Settle the trial of a stamp; None when the stamp is unknown or its trial is already settled."""
        open_trial = self._stamps.get(stamp_ns)
        if open_trial is None:
            return None
        sent = self._sent.get(stamp_ns)
        if sent is not None:
            self._hands[sent.hand].silent = False
        self._settle(open_trial)
        return open_trial.trial

    def settle(self, matches: Callable[[TrialType], bool]) -> TrialType | None:
        """Settle the first open trial that ``matches``; for answers known by their pose, not their stamp."""
        candidates = [sent.open_trial for sent in self._sent.values()] + list(self._waiting)
        for open_trial in candidates:
            if matches(open_trial.trial):
                self._settle(open_trial)
                return open_trial.trial
        return None

    def expire(self, now: float) -> list[TrialType]:
        """Take back overdue trials; return those given up after ``max_attempts``."""
        given_up: list[TrialType] = []
        overdue = [stamp for stamp, sent in self._sent.items() if sent.deadline <= now]
        for stamp in overdue:
            sent = self._sent[stamp]
            self._hands[sent.hand].silent = True
            if sent.open_trial.attempts >= self._settings.max_attempts:
                given_up.append(sent.open_trial.trial)
                self._settle(sent.open_trial)
            else:
                self._take_back(stamp)
        return given_up

    def hand_lost(self, hand: str) -> None:
        """Take back every trial of a hand that is known to be gone; the loss is not the trials' fault."""
        for stamp in sorted(self._hands[hand].in_flight, reverse=True):
            self._sent[stamp].open_trial.attempts -= 1
            self._take_back(stamp)

    def _choose_hand(self, open_trial: _OpenTrial[TrialType], ready_hands: Sequence[str]) -> str | None:
        free = [name for name in ready_hands if self._has_room(self._hands[name])]
        if not free:
            return None
        # A trial that one hand left unanswered goes to another one if there is any; otherwise the
        # hand with the fewest candidates in flight.
        return min(free, key=lambda name: (name == open_trial.last_hand, len(self._hands[name].in_flight)))

    def _has_room(self, hand: _Hand) -> bool:
        limit = 1 if hand.silent else self._settings.trials_per_hand
        return len(hand.in_flight) < limit

    def _take_back(self, stamp: int) -> None:
        sent = self._sent.pop(stamp)
        self._hands[sent.hand].in_flight.discard(stamp)
        self._waiting.appendleft(sent.open_trial)

    def _settle(self, open_trial: _OpenTrial[TrialType]) -> None:
        stamps = [stamp for stamp, known in self._stamps.items() if known is open_trial]
        for stamp in stamps:
            del self._stamps[stamp]
            sent = self._sent.pop(stamp, None)
            if sent is not None:
                self._hands[sent.hand].in_flight.discard(stamp)
        if open_trial in self._waiting:
            self._waiting.remove(open_trial)
