"""Prints tables I to III of the UBO paper, measured: ``python -m mebo_grasp.experiments.bench_safe paper-tgp``.

Every run is appended to a file as a line of JSON; runs that the file already holds are not repeated, so a stopped
study goes on where it was. The tables show the mean over the seeds at the last iteration, its standard error in
parentheses, and the paper's figure below.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.noisy_targets import TARGET_NAMES, get_target
from mebo_grasp.experiments.published_safe import BEST_VALUES, SAFE_OUTCOMES, TREED_COLUMNS
from mebo_grasp.experiments.safe_studies import ARMS, NOISE_STUDY, STUDIES, TREED_STUDY, run

Record = dict[str, object]
_KEY = ("study", "target", "arm", "seed")


def read_records(path: Path) -> list[Record]:
    """Runs of a file; a last line that was cut off by a kill is left out."""
    records = []
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return records


def make_runs(
    study: str, targets: Sequence[str], arms: Sequence[str], seeds: Sequence[int], path: Path
) -> Iterator[Record]:
    """Make the runs that the file lacks and append each; targets outermost within a seed, so that all grow alike."""
    done = {tuple(record[key] for key in _KEY) for record in read_records(path)}
    built = {}
    for seed in seeds:
        for name in targets:
            for arm in arms:
                if (study, name, arm, seed) in done:
                    continue
                if name not in built:
                    built[name] = get_target(name, study == TREED_STUDY)
                trace = run(study, arm, built[name], seed)
                record = {"study": study, "target": name, "arm": arm, "seed": seed, **asdict(trace)}
                with path.open("a") as file:
                    file.write(json.dumps(record) + "\n")
                yield record


def summary(values: Sequence[float]) -> str:
    """Mean over the runs with its standard error."""
    error = np.std(values, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else float("nan")
    return f"{np.mean(values):.4f} ({error:.4f})"


def last(records: Sequence[Record], measure: str) -> Callable[[str, str], list[float]]:
    """Return what gives a measure at the last iteration of all runs of a target and an arm."""

    def of(target: str, arm: str) -> list[float]:
        own = [r for r in records if (r["target"], r["arm"]) == (target, arm)]
        return [trace[-1] for r in own if (trace := r[measure])]  # type: ignore[index]

    return of


def _row(name: str, cells: Sequence[str]) -> str:
    return f"| {name} | " + " | ".join(cells) + " |"


def _in_paper(arm: str) -> str:
    """The paper's arm that one of ours stands beside, which learns its hyperparameters in another way."""
    return arm.removesuffix("_map")


def treed_table(records: Sequence[Record]) -> str:
    """Tables I and II: best value at the last iteration, in Markdown."""
    of = last(records, "best")
    arms = [arm for arm in ARMS[TREED_STUDY] if any(r["arm"] == arm for r in records)]
    lines = [_row("best value", arms), "|---|" + "---|" * len(arms)]
    for target in dict.fromkeys(str(r["target"]) for r in records):
        found = [of(target, arm) for arm in arms]
        lines.append(
            _row(f"{target}, {max(map(len, found))} runs", [summary(v) if v else "-" for v in found])
        )
        paper = dict(zip(TREED_COLUMNS, BEST_VALUES[target], strict=True))
        printed = [paper.get(_in_paper(arm)) for arm in arms]
        lines.append(_row("*paper*", [f"{p[0]:.4f} ({p[1]:.4f})" if p else "" for p in printed]))
    return "\n".join(lines)


def noise_table(records: Sequence[Record]) -> str:
    """Table III: outcomes of the recommended point under input noise at the last iteration, in Markdown."""
    arms = [arm for arm in ARMS[NOISE_STUDY] if any(r["arm"] == arm for r in records)]
    lines = [_row("target | measure", arms), "|---|---|" + "---|" * len(arms)]
    for target in dict.fromkeys(str(r["target"]) for r in records):
        for place, measure in enumerate(("mean", "sd", "worst")):
            found = [last(records, measure)(target, arm) for arm in arms]
            label = f"{target}, {max(map(len, found))} runs | {measure}"
            lines.append(_row(label, [summary(v) if v else "-" for v in found]))
            paper = SAFE_OUTCOMES.get(target, {})
            printed = [paper.get(_in_paper(arm)) for arm in arms]
            lines.append(_row("*paper* | ", [f"{p[place]:.3f}" if p else "" for p in printed]))
    return "\n".join(lines)


def _chosen(text: str, known: Sequence[str], what: str) -> list[str]:
    names = list(known) if text == "all" else text.split(",")
    for name in names:
        if name not in known:
            raise InvalidSettingsError(f"{what} must be of {', '.join(known)}, got {name!r}")
    return names


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(description="Tables I to III of the UBO paper, measured")
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--targets", default="all", help=f"of {', '.join(TARGET_NAMES)}; default all")
    parser.add_argument("--arms", default="all", help="columns of the table; default all")
    parser.add_argument("--seeds", type=int, default=30, help="runs of each (default: 30)")
    parser.add_argument("--first-seed", type=int, default=0, help="the first seed (default: 0)")
    parser.add_argument("--out", type=Path, help="file of the runs (default: out/<study>.jsonl)")
    parser.add_argument("--table", action="store_true", help="only print what the file holds")
    options = parser.parse_args(arguments)
    path: Path = options.out or Path("out") / f"{options.study}.jsonl"
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        targets = _chosen(options.targets, TARGET_NAMES, "targets")
        arms = _chosen(options.arms, tuple(ARMS[options.study]), "arms")
        if options.seeds < 1:
            raise InvalidSettingsError(f"--seeds must be at least 1, got {options.seeds}")
        if options.targets == "all" and options.study == NOISE_STUDY:
            targets.remove("gramacy")  # The paper studies no input noise on it.
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        if not options.table:
            for record in make_runs(options.study, targets, arms, seeds, path):
                what = f"{record['target']} {record['arm']} seed {record['seed']}"
                print(f"{what}: {record['cpu_seconds']:.1f} s", file=sys.stderr)
    except InvalidSettingsError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"\nstopped; {path} holds what was done, the same command goes on", file=sys.stderr)
    records = [r for r in read_records(path) if r["study"] == options.study]
    if records:
        print((treed_table if options.study == TREED_STUDY else noise_table)(records))
    return 0


if __name__ == "__main__":
    sys.exit(main())
