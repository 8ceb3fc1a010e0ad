"""Two halves of a candidate, in any order, late, lost, repeated."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mebo_grasp.nodes.candidate_pairs import MOST_WAITING, CandidatePairs


def make(timeout: float = 1.0) -> CandidatePairs[str, int]:
    return CandidatePairs(timeout)


def test_a_pair_is_whole_whichever_half_comes_first() -> None:
    pairs = make()
    assert pairs.add_pose(1, "a", 0.0) is None
    assert pairs.add_posture(2, 20, 0.0) is None
    assert pairs.add_posture(1, 10, 0.1) == ("a", 10)
    assert pairs.add_pose(2, "b", 0.1) == ("b", 20)
    assert pairs.give_up(100.0) == {}


def test_a_half_whose_other_has_another_stamp_is_given_up_once_and_what_comes_late_is_dropped() -> None:
    pairs = make(timeout=1.0)
    pairs.add_pose(1, "a", 0.0)
    pairs.add_posture(2, 20, 0.5)
    assert pairs.give_up(0.99) == {}
    (half,) = pairs.give_up(1.0).values()
    assert (half.pose, half.posture) == ("a", None)
    assert list(pairs.give_up(1.5)) == [2]
    assert pairs.add_posture(1, 10, 1.6) is None
    assert pairs.add_pose(2, "b", 1.6) is None
    assert pairs.give_up(100.0) == {}


def test_a_repeated_half_counts_as_the_newer_one() -> None:
    pairs = make()
    pairs.add_pose(1, "old", 0.0)
    pairs.add_pose(1, "new", 0.9)
    assert pairs.give_up(1.0) == {}
    assert pairs.add_posture(1, 10, 1.1) == ("new", 10)


def test_of_candidates_without_a_stamp_a_lost_half_is_not_held_against_the_next() -> None:
    pairs = make(timeout=1.0)
    pairs.add_pose(0, "typed", 0.0)
    assert list(pairs.give_up(1.0)) == [0]
    assert pairs.add_pose(0, "typed again", 2.0) is None
    assert pairs.add_posture(0, 10, 2.1) == ("typed again", 10)


def test_a_flood_of_halves_gives_up_the_oldest() -> None:
    pairs = make()
    for stamp in range(MOST_WAITING + 3):
        pairs.add_pose(stamp, str(stamp), 0.0)
    assert list(pairs.give_up(0.0)) == [0, 1, 2]


@given(st.permutations([(half, stamp) for stamp in range(4) for half in ("pose", "posture")]), st.integers(0, 7))
def test_every_stamp_is_settled_exactly_once(order: list[tuple[str, int]], lost: int) -> None:
    """Whatever the order and whichever message is lost: a pair, or one half that is given up."""
    pairs, whole = make(), []
    for half, stamp in order[:lost] + order[lost + 1 :]:
        found = pairs.add_pose(stamp, str(stamp), 0.0) if half == "pose" else pairs.add_posture(stamp, stamp, 0.0)
        if found is not None:
            assert found == (str(stamp), stamp)
            whole.append(stamp)
    assert sorted(whole + list(pairs.give_up(1.0))) == list(range(4))
