"""Compiled code that calls across modules goes when any module changes."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from mebo_grasp.compiled_code import STAMP, discard_stale_code

INNER = "from numba import njit\n\n\n@njit(cache=True)\ndef value():\n    return {}\n"
OUTER = """
from pathlib import Path
from {guard} import discard_stale_code
discard_stale_code(Path(__file__).parent)
from numba import njit
from inner import value


@njit(cache=True)
def twice():
    return 2 * value()


print(twice())
"""


def _run(folder: Path) -> str:
    return subprocess.run(
        [sys.executable, "-c", "import outer"], cwd=folder, capture_output=True, text=True, check=True, timeout=120
    ).stdout.strip()


def test_a_change_in_a_called_module_is_seen(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(OUTER.format(guard="mebo_grasp.compiled_code"))
    (tmp_path / "inner.py").write_text(INNER.format(1))
    assert _run(tmp_path) == "2"
    assert list((tmp_path / "__pycache__").glob("*.nbi"))
    (tmp_path / "inner.py").write_text(INNER.format(7))
    assert _run(tmp_path) == "14"


def test_the_cache_stays_while_nothing_changes(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text("x = 1\n")
    assert discard_stale_code(tmp_path)
    kept = tmp_path / "__pycache__" / "module.f-1.py311.nbi"
    kept.write_bytes(b"index")
    assert not discard_stale_code(tmp_path)
    assert kept.exists()
    (tmp_path / "__pycache__" / STAMP).unlink()
    assert discard_stale_code(tmp_path)
    assert not kept.exists()


def test_every_folder_with_compiled_code_has_the_guard() -> None:
    package = Path(__file__).parents[2] / "mebo_grasp"
    kept = re.compile(r"@njit\(.*cache=True|^@(compiled|borrowing)", re.MULTILINE)
    compiled = {path.parent for path in package.rglob("*.py") if kept.search(path.read_text(encoding="utf-8"))}
    assert len(compiled) >= 3
    unguarded = [
        folder.name
        for folder in compiled
        if "discard_stale_code(Path(__file__).parent)" not in (folder / "__init__.py").read_text(encoding="utf-8")
    ]
    assert not unguarded
