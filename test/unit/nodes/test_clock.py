"""Stamps increase strictly, whatever the clock does."""

from hypothesis import given
from hypothesis import strategies as st

from mebo_grasp.nodes.clock import StampSource, random_offset


@given(st.lists(st.integers(0, 50), min_size=1), st.integers(0, 30))
def test_stamps_increase_strictly_on_any_clock(times: list[int], after: int) -> None:
    clock = iter(times)
    source = StampSource(lambda: next(clock), after_ns=after)
    stamps = [source() for _ in times]
    assert all(later > earlier for earlier, later in zip([after, *stamps], stamps, strict=False))
    assert all(stamp >= time for stamp, time in zip(stamps, times, strict=True))


def test_stamps_follow_a_clock_that_runs() -> None:
    clock = iter([100, 200, 300])
    source = StampSource(lambda: next(clock))
    assert [source(), source(), source()] == [100, 200, 300]


def test_two_sources_give_different_stamps_while_the_clock_stands_still() -> None:
    first, second = (StampSource(lambda: 0, offset_ns=offset) for offset in (7, 900))
    assert not {first() for _ in range(100)} & {second() for _ in range(100)}
    assert len({random_offset() for _ in range(20)}) > 1
