"""The book of open trials: hand-outs, time-outs, silent hands, late and repeated answers."""

from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.nodes.dispatcher import Dispatcher, DispatchSettings


def make(hands=("left",), per_hand=2, timeout=1.0, attempts=3) -> Dispatcher[str]:
    stamps = count(1)
    return Dispatcher(DispatchSettings(tuple(hands), per_hand, timeout, attempts), lambda: next(stamps))


def test_gives_out_no_more_than_a_hand_may_hold() -> None:
    dispatcher = make(per_hand=2)
    dispatcher.add(["a", "b", "c"])
    assert [a.trial for a in dispatcher.assign(0.0, ["left"])] == ["a", "b"]
    assert (dispatcher.in_flight_count, dispatcher.open_count) == (2, 3)
    assert dispatcher.assign(0.0, ["left"]) == []
    assert dispatcher.answer(1) == "a"
    assert [a.trial for a in dispatcher.assign(0.0, ["left"])] == ["c"]


def test_spreads_trials_over_the_ready_hands() -> None:
    dispatcher = make(hands=("left", "right", "away"), per_hand=2)
    dispatcher.add(["a", "b", "c"])
    given_to = [a.hand for a in dispatcher.assign(0.0, ["left", "right"])]
    assert sorted(given_to) == ["left", "left", "right"]


def test_an_answer_counts_once_and_unknown_stamps_not_at_all() -> None:
    dispatcher = make()
    dispatcher.add(["a"])
    dispatcher.assign(0.0, ["left"])
    assert dispatcher.answer(99) is None
    assert dispatcher.answer(1) == "a"
    assert dispatcher.answer(1) is None
    assert dispatcher.open_count == 0


def test_an_overdue_trial_goes_to_another_hand_and_the_late_answer_still_settles_it() -> None:
    dispatcher = make(hands=("left", "right"), per_hand=1)
    dispatcher.add(["a"])
    (first,) = dispatcher.assign(0.0, ["left", "right"])
    assert dispatcher.expire(0.5) == []
    assert dispatcher.assign(0.5, ["left", "right"]) == []
    assert dispatcher.expire(1.0) == []
    (second,) = dispatcher.assign(1.0, ["left", "right"])
    assert second.hand != first.hand
    assert second.stamp_ns > first.stamp_ns
    assert dispatcher.answer(first.stamp_ns) == "a"
    assert dispatcher.answer(second.stamp_ns) is None
    assert dispatcher.open_count == 0


def test_a_trial_is_given_up_after_the_last_attempt() -> None:
    dispatcher = make(attempts=2)
    dispatcher.add(["a"])
    dispatcher.assign(0.0, ["left"])
    assert dispatcher.expire(1.0) == []
    dispatcher.assign(1.0, ["left"])
    assert dispatcher.expire(2.0) == ["a"]
    assert dispatcher.open_count == 0


def test_a_silent_hand_gets_one_trial_as_a_probe_until_it_answers() -> None:
    dispatcher = make(per_hand=3)
    dispatcher.add(["a", "b", "c"])
    assert len(dispatcher.assign(0.0, ["left"])) == 3
    dispatcher.expire(1.0)
    assert list(dispatcher.silent_hands) == ["left"]
    (probe,) = dispatcher.assign(1.0, ["left"])
    assert dispatcher.answer(probe.stamp_ns) == probe.trial
    assert not dispatcher.silent_hands
    assert len(dispatcher.assign(1.1, ["left"])) == 2


def test_losing_a_hand_costs_its_trials_no_attempt() -> None:
    dispatcher = make(attempts=1, per_hand=2)
    dispatcher.add(["a", "b"])
    dispatcher.assign(0.0, ["left"])
    dispatcher.hand_lost("left")
    assert [a.trial for a in dispatcher.assign(0.1, ["left"])] == ["a", "b"]
    assert sorted(dispatcher.expire(5.0)) == ["a", "b"]


def test_settles_by_a_property_of_the_trial() -> None:
    dispatcher = make(per_hand=1)
    dispatcher.add(["a", "b"])
    dispatcher.assign(0.0, ["left"])
    assert dispatcher.settle(lambda trial: trial == "b") == "b"
    assert dispatcher.settle(lambda trial: trial == "b") is None
    assert dispatcher.settle(lambda trial: trial == "a") == "a"
    assert dispatcher.open_count == 0


def test_cleared_trials_are_unknown() -> None:
    dispatcher = make()
    dispatcher.add(["a"])
    dispatcher.assign(0.0, ["left"])
    dispatcher.clear()
    assert dispatcher.answer(1) is None
    assert dispatcher.open_trials() == ()


@pytest.mark.parametrize("changes", [{"hands": ()}, {"per_hand": 0}, {"timeout": 0.0}, {"attempts": 0}])
def test_refuses_settings_that_cannot_work(changes) -> None:
    with pytest.raises(InvalidSettingsError):
        make(**changes)


EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just("assign"), st.sampled_from([("left",), ("right",), ("left", "right"), ()])),
        st.tuples(st.just("answer"), st.integers(0, 30)),
        st.tuples(st.just("wait"), st.floats(0.0, 2.0)),
        st.tuples(st.just("lost"), st.sampled_from(["left", "right"])),
    ),
    max_size=60,
)


@given(EVENTS)
def test_every_trial_is_open_or_settled_exactly_once(events) -> None:
    dispatcher = make(hands=("left", "right"), attempts=3)
    trials = [f"trial {i}" for i in range(6)]
    dispatcher.add(trials)
    settled: list[str] = []
    now = 0.0
    for kind, value in events:
        if kind == "assign":
            dispatcher.assign(now, value)
        elif kind == "answer":
            answered = dispatcher.answer(value)
            settled += [answered] if answered is not None else []
        elif kind == "wait":
            now += value
            settled += dispatcher.expire(now)
        else:
            dispatcher.hand_lost(value)
        assert sorted([*settled, *dispatcher.open_trials()]) == trials
        assert dispatcher.open_count == len(trials) - len(settled)
