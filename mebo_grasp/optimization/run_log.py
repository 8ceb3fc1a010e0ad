"""The record of a run as JSON lines, from which a killed run continues with the same trace.

Line 1 is the header (format, package version, method, settings, space, generator state before the initial
design). Each ask adds the new trials with the method's state and the generator's state after it; each tell,
failure, foreign observation and raise of the budget adds a line of its own. Every line is flushed before the
call returns, so a kill loses at most the last line, and a torn last line is dropped on reading.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError, MeboGraspError, RunLogError
from mebo_grasp.optimization.methods.base import DEFAULT_METHOD
from mebo_grasp.optimization.optimizer import Incumbent, Optimizer, OptimizerSettings, Trial
from mebo_grasp.optimization.search_space import SearchSpace

FORMAT_VERSION = 1
NOTE = "note"
BUDGET = "budget"


def _package_version() -> str:
    try:
        return version("mebo_grasp")
    except PackageNotFoundError:
        return "unknown"


def _plain(state: Any) -> Any:
    """Generator states hold numpy integers and arrays; JSON wants plain ones."""
    if isinstance(state, dict):
        return {key: _plain(value) for key, value in state.items()}
    if isinstance(state, np.ndarray):
        return {"uint_array": [int(value) for value in state], "dtype": str(state.dtype)}
    return int(state) if isinstance(state, np.integer) else state


def _generator(state: dict[str, Any]) -> np.random.Generator:
    """Build a generator that continues from a state written by ``_plain``."""

    def restored(value: Any) -> Any:
        if isinstance(value, dict) and "uint_array" in value:
            return np.array(value["uint_array"], dtype=value["dtype"])
        return {key: restored(item) for key, item in value.items()} if isinstance(value, dict) else value

    kind = getattr(np.random, str(state.get("bit_generator")), None)
    if not (isinstance(kind, type) and issubclass(kind, np.random.BitGenerator)):
        raise RunLogError(f"unknown random generator {state.get('bit_generator')!r} in the run's header")
    bit_generator = kind()
    bit_generator.state = restored(state)
    return np.random.Generator(bit_generator)


class RunLog:
    """An append-only file of JSON lines.

    Build it with ``RunLog.create`` (a new file) or ``RunLog.append`` (an existing one).
    """

    def __init__(self, path: Path, stream: TextIO) -> None:
        self.path = path
        self._stream = stream
        try:
            # The lock goes with the process, however it ends.
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            stream.close()
            raise RunLogError(
                f"the run log {path} is in use by another process: stop that one, or name another file"
            ) from error

    @classmethod
    def create(cls, path: str | os.PathLike[str], header: dict[str, Any]) -> RunLog:
        """Start a new log with its header.

        Raises:
            RunLogError: the file exists already or cannot be written.
        """
        target = Path(path)
        try:
            log = cls(target, target.open("x", encoding="utf-8"))
        except FileExistsError as error:
            raise RunLogError(f"{target} exists already; resume it or choose another file") from error
        except OSError as error:
            raise RunLogError(f"cannot create the run log {target}: {error}") from error
        log.write({"kind": "header", "format": FORMAT_VERSION, "version": _package_version(), **header})
        return log

    @classmethod
    def append(cls, path: str | os.PathLike[str]) -> RunLog:
        """Open an existing log to continue it; see ``reopen``."""
        return cls.reopen(path)[0]

    @classmethod
    def reopen(cls, path: str | os.PathLike[str]) -> tuple[RunLog, list[dict[str, Any]]]:
        """Open an existing log to continue it, and return its records; a torn last line is cut off.

        It is locked before it is read: a process that still writes might add what this one would not know.

        Raises:
            RunLogError: the file is absent, is not a run log (it is left as it is), or another process continues it.
        """
        target = Path(path)
        try:
            log = cls(target, target.open("r+", encoding="utf-8"))
        except OSError as error:
            raise RunLogError(f"cannot continue the run log {target}: {error}") from error
        try:
            lines = _complete_lines(_read(target))
            records = _records(lines, target)
            log._cut(sum(len(line) for line in lines))
        except BaseException:
            log.close()
            raise
        return log, records

    def _cut(self, size: int) -> None:
        try:
            self._stream.seek(size)
            self._stream.truncate()
        except OSError as error:
            raise RunLogError(f"cannot continue the run log {self.path}: {error}") from error

    @staticmethod
    def load(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
        """Read all complete records, the header first.

        Raises:
            RunLogError: the file is absent, has no header of a known format, or a line before the last is
                not a record.
        """
        target = Path(path)
        return _records(_complete_lines(_read(target)), target)

    @staticmethod
    def seed_of(path: str | os.PathLike[str]) -> int | None:
        """Read the seed of a run; None when it was begun with a generator.

        Raises:
            RunLogError: the file is absent, or its first line is no record.
        """
        target = Path(path)
        try:
            with target.open("rb") as stream:
                seed: int | None = _record(stream.readline(), 0, target).get("seed")
        except OSError as error:
            raise RunLogError(f"cannot read the run log {target}: {error}") from error
        return seed

    def write(self, record: dict[str, Any]) -> None:
        """Append one record and hand it to the operating system.

        Raises:
            RunLogError: it holds what JSON cannot, or the disk refuses it.
        """
        try:
            self._stream.write(json.dumps(record, allow_nan=False) + "\n")
            self._stream.flush()
        except (OSError, TypeError, ValueError) as error:
            raise RunLogError(f"cannot write to the run log {self.path}: {error}") from error

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise RunLogError(f"cannot read the run log {path}: {error}") from error


def _complete_lines(content: bytes) -> list[bytes]:
    """Lines that end in a newline; if the last of them is no JSON, it was torn as well and goes."""
    lines = [line for line in content.splitlines(keepends=True) if line.endswith(b"\n")]
    if lines:
        try:
            json.loads(lines[-1])
        except ValueError:
            lines.pop()
    return lines


def _records(lines: list[bytes], path: Path) -> list[dict[str, Any]]:
    records = [_record(line, i, path) for i, line in enumerate(lines)]
    if not records or records[0].get("kind") != "header":
        raise RunLogError(
            f"{path} is not a run log: its first line is no header; name another file, or delete this one"
        )
    if records[0].get("format") != FORMAT_VERSION:
        raise RunLogError(f"{path} has format {records[0].get('format')!r}; this version reads {FORMAT_VERSION}")
    return records


def _record(line: bytes, index: int, path: Path) -> dict[str, Any]:
    try:
        record = json.loads(line)
    except ValueError as error:
        raise RunLogError(f"line {index + 1} of {path} is not JSON: {error}") from error
    if not isinstance(record, dict):
        raise RunLogError(f"line {index + 1} of {path} is not a record: {record!r}")
    return record


class LoggedOptimizer:
    """An optimizer whose every step is in a run log; same asks and tells as ``Optimizer``.

    Args:
        optimizer: the state machine.
        log: where its steps go.
    """

    def __init__(self, optimizer: Optimizer, log: RunLog) -> None:
        self.optimizer = optimizer
        self.log = log

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        space: SearchSpace,
        method: str = DEFAULT_METHOD,
        settings: OptimizerSettings | None = None,
        rng: np.random.Generator | int = 0,
    ) -> LoggedOptimizer:
        """Start a run with a new log.

        Raises:
            RunLogError: the file exists already or cannot be written.
            InvalidSettingsError: the method is unknown.
        """
        generator = rng if isinstance(rng, np.random.Generator) else np.random.default_rng(rng)
        rng_state = _plain(generator.bit_generator.state)
        optimizer = Optimizer(space, method, settings, generator)
        header = {
            "method": method,
            "settings": asdict(optimizer.settings),
            "space": {
                "names": list(space.names),
                "units": list(space.units),
                "lower": space.lower.tolist(),
                "upper": space.upper.tolist(),
                "distance_weights": space.distance_weights.tolist(),
            },
            "seed": None if isinstance(rng, np.random.Generator) else int(rng),
            "rng": rng_state,
        }
        return cls(optimizer, RunLog.create(path, header))

    @classmethod
    def resume(cls, path: str | os.PathLike[str]) -> LoggedOptimizer:
        """Continue a run: its open trials are open again, and further lines go to the same file.

        Raises:
            RunLogError: the log cannot be read, contradicts itself, or another process continues it.
        """
        log, records = RunLog.reopen(path)
        try:
            return cls(_rebuilt(records, path), log)
        except BaseException:
            log.close()
            raise

    def ask(self, count: int | None = None) -> list[Trial]:
        """Open new trials; see ``Optimizer.ask``."""
        trials = self.optimizer.ask(count)
        pending = self.optimizer.observations.pending[-len(trials) :]
        self.log.write(
            {
                "kind": "ask",
                "phase": self.optimizer.phase,
                "trials": [
                    {"id": trial.id, "u": u.tolist(), "x": trial.x.tolist(), "phase": trial.phase}
                    for trial, u in zip(trials, pending, strict=True)
                ],
                "method": self.optimizer.method.state(),
                "rng": _plain(self.optimizer.rng.bit_generator.state),
            }
        )
        return trials

    def tell(self, trial_id: int, value: float) -> None:
        """Report a value; see ``Optimizer.tell``."""
        self.optimizer.tell(trial_id, value)
        self.log.write({"kind": "tell", "id": int(trial_id), "value": float(value)})

    def tell_failed(self, trial_id: int, reason: str = "") -> None:
        """Report a failure; see ``Optimizer.tell_failed``."""
        self.optimizer.tell_failed(trial_id, reason)
        self.log.write({"kind": "tell_failed", "id": int(trial_id), "reason": reason})

    def observe(self, x: npt.ArrayLike, value: float) -> None:
        """Learn a foreign result; see ``Optimizer.observe``."""
        self.optimizer.observe(x, value)
        self.log.write({"kind": "observe", "x": np.asarray(x).tolist(), "value": float(value)})

    def raise_budget(self, budget: int) -> None:
        """Allow more trials: the run goes on from where it stands.

        Methods that plan by shares of the budget count by the new one, so that the trace is not that of a run which
        had it from the beginning.

        Args:
            budget: trials in all.

        Raises:
            InvalidSettingsError: it is below the run's own.
        """
        known = self.optimizer.settings.budget
        if budget < known:
            raise InvalidSettingsError(f"the budget of a run can be raised only: it is {known}, got {budget}")
        if budget > known:
            self.log.write({"kind": BUDGET, "budget": int(budget)})
            self.optimizer = resume(self.log.path)

    def note(self, content: dict[str, Any]) -> None:
        """Write down something about the run, as JSON values, that does not bear on how it continues."""
        self.log.write({**content, "kind": NOTE})

    def solution_set(self, size: int | None = None, min_distance: float | None = None) -> list[Incumbent]:
        """Good and diverse points; see ``Optimizer.solution_set``."""
        return self.optimizer.solution_set(size, min_distance)

    @property
    def finished(self) -> bool:
        """Whether the budget is used up and no trial is open."""
        return self.optimizer.finished

    @property
    def pending(self) -> tuple[Trial, ...]:
        """Open trials in the order of asking."""
        return self.optimizer.pending

    def close(self) -> None:
        """Close the log."""
        self.log.close()


def resume(path: str | os.PathLike[str]) -> Optimizer:
    """Rebuild the optimizer of a run log; it continues with the trace of an uninterrupted run.

    Raises:
        RunLogError: the log cannot be read or contradicts itself.
    """
    return _rebuilt(RunLog.load(path), path)


def _rebuilt(records: list[dict[str, Any]], path: str | os.PathLike[str]) -> Optimizer:
    try:
        optimizer = _from_header(_with_last_budget(records))
        for record in records[1:]:
            _replay(optimizer, record)
    except RunLogError:
        raise
    except (MeboGraspError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise RunLogError(f"the run log {path} contradicts itself: {error!r}") from error
    return optimizer


def _with_last_budget(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the header of a run with the budget that it was raised to."""
    budgets = [record["budget"] for record in records if record.get("kind") == BUDGET]
    header = records[0]
    return header | {"settings": header["settings"] | {"budget": budgets[-1]}} if budgets else header


def _from_header(header: dict[str, Any]) -> Optimizer:
    names = {field.name for field in fields(OptimizerSettings)}
    unknown = set(header["settings"]) - names
    if unknown:
        raise RunLogError(f"the run log has settings that this version does not know: {sorted(unknown)}")
    space = SearchSpace(
        tuple(header["space"]["names"]),
        header["space"]["lower"],
        header["space"]["upper"],
        tuple(header["space"]["units"]),
        np.array(header["space"].get("distance_weights", ())),
    )
    return Optimizer(
        space, header["method"], OptimizerSettings.from_json(header["settings"]), _generator(header["rng"])
    )


def _replay(optimizer: Optimizer, record: dict[str, Any]) -> None:
    kind = record["kind"]
    if kind == "ask":
        trials = list(_logged_trials(record))
        optimizer.reopen(trials, record["method"], _generator(record["rng"]))
    elif kind == "tell":
        optimizer.tell(record["id"], record["value"])
    elif kind == "tell_failed":
        optimizer.tell_failed(record["id"], record["reason"])
    elif kind == "observe":
        optimizer.observe(record["x"], record["value"])
    elif kind not in (NOTE, BUDGET):
        raise RunLogError(f"unknown kind of record: {kind!r}")


def _logged_trials(record: dict[str, Any]) -> Iterator[tuple[int, list[float], str]]:
    for trial in record["trials"]:
        yield int(trial["id"]), trial["u"], str(trial["phase"])
