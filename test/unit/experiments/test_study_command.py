"""Experiments by one command, from runs to the page in a browser; the quick form of the thesis's grasps."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from mebo_grasp.cli.main import main
from mebo_grasp.experiments.runs.results import RESULTS_FILE

REPOSITORY = Path(__file__).resolve().parents[3]
DOCS = (REPOSITORY / "docs" / "experiments.md").read_text(encoding="utf-8")
# The quick form, with fewer trials still: what is tested is the way from a name to a page.
QUICK = ["experiment", "quick", "--set", "budget=40", "seeds=2", "--workers", "2"]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
HEADLESS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--virtual-time-budget=20000", "--dump-dom",
)  # fmt: skip


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out: Path = tmp_path_factory.mktemp("quick")
    assert main([*QUICK, "--out", str(out)]) == 0
    return out


def _results(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / RESULTS_FILE).read_text().splitlines()]


def test_the_quick_form_runs_whole_and_keeps_every_trial(quick: Path) -> None:
    results = _results(quick)
    assert {(r["job"]["method"], r["job"]["seed"]) for r in results} == {
        (method, seed) for method in ("basin_search", "cl_mebo", "random") for seed in (0, 1)
    }
    for result in results:
        records = [json.loads(line) for line in (quick / "runs" / f"{result['key']}.jsonl").read_text().splitlines()]
        assert sum(record["kind"] == "tell" for record in records) == 40
        assert records[0]["seed"] == result["job"]["seed"]
        assert 0.0 < result["best_value"] < 1.0
        assert {"python", "numpy", "mebo_grasp"} <= set(result["versions"])


def test_methods_share_the_initial_design_of_a_seed(quick: Path) -> None:
    first: dict[int, set[str]] = {}
    for result in _results(quick):
        lines = (quick / "runs" / f"{result['key']}.jsonl").read_text().splitlines()
        ask = next(record for record in map(json.loads, lines) if record["kind"] == "ask")
        first.setdefault(result["job"]["seed"], set()).add(str(ask["trials"][0]["x"]))
    assert [len(points) for points in first.values()] == [1, 1]


def test_tables_plots_and_pictures_are_written(quick: Path) -> None:
    markdown = (quick / "tables.md").read_text(encoding="utf-8")
    assert "mebo-grasp experiment quick --set budget=40 seeds=2 --workers 2" in markdown
    for title in (
        "Best value",
        "Solution set",
        "Best grasp under an occlusion",
        "Occlusion retention",
        "Hypervolume",
    ):
        assert f"### {title}" in markdown
    assert "| *thesis ROBOT* | 0.829 ± 0.011 |" in markdown
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", markdown)
    assert len(pictures) == 1 + 2
    for name in pictures:
        assert (quick / name).read_bytes().startswith(b"\x89PNG")
    assert 'best,"simox_epsilon, TCP position",bottle/' in (quick / "tables.csv").read_text(encoding="utf-8")


def test_the_same_command_repeats_no_trial_and_more_seeds_extend_the_folder(
    quick: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "copy"
    shutil.copytree(quick, out)
    before = {path: path.read_bytes() for path in out.rglob("*.jsonl")}
    assert main([*QUICK, "--out", str(out), "--only", "method=random"]) == 0
    assert {path: path.read_bytes() for path in out.rglob("*.jsonl")} == before
    assert main(["experiment", "quick", "--set", "budget=40", "seeds=3", "--out", str(out), "--list"]) == 0
    assert "6 of 9 runs done" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "no experiment 'nowhere': it is none of paper-tgp"),
        (["quick", "--set", "budget"], "'budget' must be KEY=VALUE"),
        (["quick", "--set", "budget=[1"], "is not YAML"),
        (["quick", "--only", "object=cup"], "object is one of bottle"),
        (["quick", "--workers", "0"], "workers must be at least 1"),
    ],
)
def test_bad_options_are_told(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["experiment", *words, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.jsonl"))


def test_a_cluster_without_its_package_or_scheduler_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mebo_grasp.experiments.runs.cluster.CONNECT_SECONDS", 1)
    words = ["--only", "method=random", "--out", str(tmp_path), "--cluster", "tcp://127.0.0.1:1"]
    assert main([*QUICK, *words]) == 2
    expected = "no Dask scheduler answers" if find_spec("distributed") else "pip install 'mebo_grasp[cluster]'"
    assert expected in capsys.readouterr().err


def _browser() -> str:
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed")
    return found


def test_the_page_shows_tables_and_sets_in_a_browser_without_network(quick: Path, tmp_path: Path) -> None:
    command = [_browser(), *HEADLESS, f"--user-data-dir={tmp_path}", (quick / "report.html").as_uri()]
    page = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True).stdout
    body = re.search(r"<body[^>]*>", page)
    assert body is not None
    # The page's own script ran through, and so did the viewer's in the frame, WebGL included.
    assert 'data-ready="1"' in body[0]
    assert 'data-viewer="1"' in body[0]
    # Worst and best of three methods, and a viewer that holds the first of them.
    assert len(re.findall(r"<option ", page)) == 6
    assert "4 grasps, M_d" in page
    assert not re.search(r"(src|href)=\"(http|//)", page)


def test_the_example_of_the_docs_finds_diverse_hyperparameters(tmp_path: Path) -> None:
    code = next(block for block in re.findall(r"```python\n(.*?)```", DOCS, re.DOTALL) if "DigitsSvm" in block)
    definition = next(block for block in re.findall(r"```yaml\n(.*?)```", DOCS, re.DOTALL) if "DigitsSvm" in block)
    (tmp_path / "svm_objective.py").write_text(code)
    (tmp_path / "svm.yaml").write_text(definition)
    words = [
        "experiment",
        "svm.yaml",
        "--out",
        "out",
        "--workers",
        "1",
        "--set",
        "seeds=1",
        "samples=150",
        "budget=30",
    ]
    words += ["methods=default"]
    done = subprocess.run(
        [sys.executable, "-m", "mebo_grasp.cli.main", *words],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": f"{tmp_path}:{REPOSITORY}"}, capture_output=True, text=True,
        timeout=240, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = _results(tmp_path / "out")[0]
    solutions = result["solutions"]
    assert len(solutions) == 4
    assert all(
        sum((p - q) ** 2 for p, q in zip(a, b, strict=True)) ** 0.5 >= 0.8
        for i, a in enumerate(solutions)
        for b in solutions[:i]
    )
    assert result["best_value"] > 0.85
    assert "log10 gamma" in (tmp_path / "out" / "tables.md").read_text()
