"""``docs/grasp_metrics.md`` defines every metric and names tests that exist."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from mebo_grasp.grasping.trial import QualityName

ROOT = Path(__file__).parents[4]
TEXT = (ROOT / "docs" / "grasp_metrics.md").read_text(encoding="utf-8")


def rows(heading: str, until: str) -> dict[str, list[str]]:
    """Return the further cells of each row of a table by the name in the first."""
    found = {}
    for line in TEXT.partition(heading)[2].partition(until)[0].splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        name = re.match(r"`(\w+)`", cells[0])
        if name:
            found[name[1]] = cells[1:]
    return found


@pytest.mark.parametrize("name", get_args(QualityName))
def test_a_metric_has_definition_range_source_and_tests(name: str) -> None:
    *told, section = rows("| Name | Value | Range | Source |", "\n\n")[name]
    assert len(told) == 3
    assert all(told)
    assert re.search(rf"^##+ {re.escape(section)}$", TEXT, re.MULTILINE), section
    (named,) = rows("| Metric | Tests |", "\n\n")[name]
    tests = re.findall(r"`([^`:]+)::(\w+)`", named)
    assert len(tests) >= 2
    for path, function in tests:
        assert re.search(rf"^def {function}\(", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE), function


def test_the_files_named_for_further_claims_exist() -> None:
    paths = re.findall(r"`(test/[\w/]+\.py)`", TEXT)
    assert len(paths) >= 5
    assert [path for path in paths if not (ROOT / path).is_file()] == []
