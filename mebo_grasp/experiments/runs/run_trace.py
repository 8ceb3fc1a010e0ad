"""What a run did, read from its log in one pass."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mebo_grasp.experiments.objective import Recommendation, Trace
from mebo_grasp.experiments.runs.recommendation import recommendation_in
from mebo_grasp.optimization.optimizer import INITIAL_PHASE
from mebo_grasp.optimization.run_log import NOTE, RunLog


def read_trace(path: Path) -> Trace:
    """Read the trace of a run that may still be under way; the solutions, which no log holds, are left empty.

    Trials still open are left out.

    Args:
        path: a run log.

    Raises:
        RunLogError: the file is no run log.
    """
    header, *records = RunLog.load(path)
    points: dict[int, list[float]] = {}
    values: dict[int, float] = {}
    batches: dict[int, list[int]] = {}
    recommended: list[Recommendation | None] = []
    first_split = None
    for record in records:
        if record["kind"] == "ask":
            points |= {trial["id"]: trial["x"] for trial in record["trials"]}
            batch = [trial["id"] for trial in record["trials"] if trial["phase"] != INITIAL_PHASE]
            # By its first trial: a peer killed before it answered any of a batch notes the same one again.
            batches |= {batch[0]: batch} if batch else {}
            first_split = first_split or _size_when_split(record)
        elif record["kind"] == "tell":
            values[record["id"]] = record["value"]
        elif record["kind"] == "tell_failed":
            values[record["id"]] = float("nan")
        elif record["kind"] == NOTE:
            recommended.append(recommendation_in(record))
    ids = sorted(values)
    names, weights = _space(header)
    dim = max((len(x) for x in points.values()), default=len(names))
    return Trace(
        np.array([points[i] for i in ids], dtype=np.float64).reshape(len(ids), dim),
        np.array([values[i] for i in ids], dtype=np.float64),
        list(batches.values()),
        np.empty((0, dim)),
        tuple(item for item in recommended if item is not None),
        names,
        weights,
        first_split,
    )


def _size_when_split(ask: dict[str, Any]) -> int | None:
    """How many values a treed surrogate of more than one leaf was grown on; None for all others."""
    surrogate = ask.get("method", {}).get("surrogate", {})
    return int(surrogate["n_grown"]) if len(surrogate.get("leaves", ())) > 1 else None


def _space(header: dict[str, Any]) -> tuple[tuple[str, ...], np.ndarray | None]:
    """Names of the dimensions and their weights in distances; a log of an earlier version may lack them."""
    space = header.get("space", {})
    weights = space.get("distance_weights")
    return tuple(space.get("names", ())), None if weights is None else np.array(weights, dtype=np.float64)
