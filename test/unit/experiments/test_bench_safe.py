import json
from dataclasses import replace

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments import bench_safe, noisy_targets, safe_studies
from mebo_grasp.experiments.published_safe import BEST_VALUES, SAFE_OUTCOMES


def small(name, treed=False):
    return replace(noisy_targets._function(name, treed), n_initial=6, n_iterations=3)


def test_a_point_is_judged_by_its_noisy_executions():
    target = small("rkhs")
    found = target.outcome(np.array([0.892362]), np.random.default_rng(0))
    noise = 0.01 * np.random.default_rng(0).standard_normal(100)
    values = [target.evaluate(np.array([0.892362 + e])) for e in noise]
    assert [found.mean, found.sd, found.worst] == pytest.approx(
        [np.mean(values), np.std(values, ddof=1), np.min(values)]
    )


def test_a_run_has_one_number_an_iteration_and_repeats_itself():
    first, second = (safe_studies.run("paper-ubo", "ubo_map", small("rkhs"), 3) for _ in range(2))
    assert [len(part) for part in (first.best, first.mean, first.sd, first.worst)] == [3, 3, 3, 3]
    assert replace(first, cpu_seconds=0.0) == replace(second, cpu_seconds=0.0)
    assert first.best == sorted(first.best)
    assert all(w <= m for w, m in zip(first.worst, first.mean, strict=True))
    treed = safe_studies.run("paper-tgp", "tgp_winf_map", small("rkhs", True), 3)
    assert len(treed.best) == 3
    assert treed.mean == []


def test_unknown_names_are_refused():
    with pytest.raises(InvalidSettingsError, match="paper-tgp: gp"):
        safe_studies.run("paper-ubo", "gp", small("rkhs"), 0)
    with pytest.raises(InvalidSettingsError, match="rkhs"):
        noisy_targets.get_target("teapot")
    assert bench_safe.main(["paper-ubo", "--targets", "teapot"]) == 2


def test_a_stopped_study_goes_on_and_prints_its_table(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(bench_safe, "get_target", small)
    path = tmp_path / "runs.jsonl"
    command = ["paper-ubo", "--targets", "rkhs", "--arms", "bo_map", "--out", str(path), "--seeds"]
    assert bench_safe.main([*command, "1"]) == 0
    before = path.read_text()
    path.write_text(before + '{"cut off')
    assert bench_safe.main([*command, "1"]) == 0
    assert path.read_text() == before + '{"cut off'
    path.write_text(before)
    assert bench_safe.main([*command, "2"]) == 0
    assert path.read_text().startswith(before)
    records = [json.loads(line) for line in path.read_text().splitlines()]
    assert [record["seed"] for record in records] == [0, 1]
    mean = np.mean([record["mean"][-1] for record in records])
    assert f"| rkhs, 2 runs | mean | {mean:.4f} (" in capsys.readouterr().out


@pytest.mark.parametrize("study", safe_studies.STUDIES)
def test_tables_show_the_paper_beside_the_runs(study):
    arm = "gp" if study == "paper-tgp" else "ubo"
    records = [
        {
            "study": study,
            "target": "rkhs",
            "arm": arm,
            "seed": s,
            "best": [v],
            "mean": [v],
            "sd": [0.1],
            "worst": [1.0],
        }
        for s, v in enumerate((4.0, 5.0))
    ]
    table = bench_safe.treed_table(records) if study == "paper-tgp" else bench_safe.noise_table(records)
    assert "4.5000 (0.5000)" in table
    assert ("5.3279" if study == "paper-tgp" else "4.934") in table


def test_printed_tables_have_every_target():
    assert set(BEST_VALUES) == set(noisy_targets.TARGET_NAMES)
    assert set(SAFE_OUTCOMES) <= set(noisy_targets.TARGET_NAMES)
