"""Functions that borrow count no references, and cannot make arrays."""

from __future__ import annotations

import numpy as np
import pytest
from numba.core.errors import TypingError

from mebo_grasp.compiling import borrowing, compiled
from mebo_grasp.grasp import FloatArray

Pair = tuple[FloatArray, FloatArray]


def last_of_turns(pair: Pair, turns: int) -> float:
    """Change two arrays about, for which a plain function counts references."""
    row, other = pair
    for _ in range(turns):
        row, other = other, row[1:]
    return float(row[-1])


def counts_references(function: object) -> bool:
    """Tell whether the machine code of a compiled function counts references."""
    return any("NRT_incref" in code for code in function.inspect_asm().values())  # type: ignore[attr-defined]


def test_what_borrows_counts_no_references_and_answers_the_same() -> None:
    pair = np.zeros(3), np.array([1.0, 2.0, 3.0])
    plain, lean = compiled(last_of_turns), borrowing(last_of_turns)
    assert plain(pair, 3) == lean(pair, 3) == last_of_turns(pair, 3) == 3.0
    plain.recompile(), lean.recompile()  # the machine code of what comes from the cache cannot be seen
    assert counts_references(plain)
    assert not counts_references(lean)


def test_what_borrows_cannot_make_an_array() -> None:
    @borrowing
    def makes_an_array(n: int) -> float:
        return float(np.zeros(n).sum())

    with pytest.raises(TypingError):
        makes_an_array(3)


def test_a_borrower_may_call_what_makes_arrays() -> None:
    @compiled
    def sum_of_zeros(n: int) -> float:
        return float(np.zeros(n).sum())

    @borrowing
    def caller(n: int) -> float:
        return float(sum_of_zeros(n))

    assert caller(3) == 0.0
