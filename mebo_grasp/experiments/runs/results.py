"""The finished runs of an experiment's folder, ``results.jsonl``: one line each."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

from mebo_grasp.errors import RunLogError
from mebo_grasp.experiments.runs.job import Job
from mebo_grasp.experiments.runs.run_job import RESULT_FORMAT

RESULTS_FILE = "results.jsonl"

Result = dict[str, Any]


def load_results(out: Path) -> dict[str, Result]:
    """Finished runs of an experiment's folder by the job's key.

    A torn last line and results of another format are left out.

    Raises:
        RunLogError: a line before the last is not a result.
    """
    path = out / RESULTS_FILE
    if not path.exists():
        return {}
    lines = path.read_bytes().split(b"\n")
    results: dict[str, Result] = {}
    for number, line in enumerate(lines[:-1], start=1):
        try:
            record = json.loads(line)
            if record["format"] == RESULT_FORMAT:
                results[str(record["key"])] = record
        except (ValueError, KeyError, TypeError) as error:
            raise RunLogError(f"line {number} of {path} is not a result: {error!r}") from error
    return results


def check_same_jobs(jobs: Sequence[Job], known: dict[str, Result], out: Path) -> None:
    """Refuse a folder whose results are of other settings under the same name.

    Raises:
        RunLogError: naming the run, the setting and both values.
    """
    for job in jobs:
        recorded = known.get(job.key, {}).get("job", {})
        wanted = json.loads(json.dumps(job.as_dict()))
        for name in recorded.keys() & wanted.keys():
            if recorded[name] != wanted[name]:
                raise RunLogError(
                    f"{job.key} was run in {out} with {name} {recorded[name]!r}, not {wanted[name]!r}; choose another "
                    "--out"
                )


def open_results(out: Path) -> TextIO:
    """Open for appending; what a kill left of a last line is cut off."""
    path = out / RESULTS_FILE
    if path.exists():
        content = path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            with path.open("r+b") as stream:
                stream.truncate(whole)
    return path.open("a", encoding="utf-8")
