"""What every node does before it spins."""

import gc
from collections.abc import Iterator

import pytest

from mebo_grasp.nodes.runtime import forget_garbage


@pytest.fixture
def thawed() -> Iterator[None]:
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("thawed")
def test_later_collections_leave_out_what_is_there_now() -> None:
    kept = [[k] for k in range(1000)]
    forget_garbage()
    assert gc.get_freeze_count() > len(kept)
    assert not any(item is kept for item in gc.get_objects())
    later: list[object] = []
    assert any(item is later for item in gc.get_objects())
