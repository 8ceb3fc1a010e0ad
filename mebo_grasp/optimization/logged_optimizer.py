"""An optimizer whose every step is in a run log, from which a killed run continues with the same trace.

Line 1 is the header (format, package version, method, settings, space, generator state before the initial
design). Each ask adds the new trials with the method's state and the generator's state after it; each tell,
failure, foreign observation and raise of the budget adds a line of its own.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError, MeboGraspError, RunLogError
from mebo_grasp.optimization.methods.base import DEFAULT_METHOD
from mebo_grasp.optimization.optimizer import Incumbent, Optimizer, OptimizerSettings, Trial
from mebo_grasp.optimization.run_log import NOTE, RunLog
from mebo_grasp.optimization.search_space import SearchSpace

BUDGET = "budget"


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


class LoggedOptimizer:
    """An optimizer whose every step is in a run log; same asks and tells as ``Optimizer``.

    Args:
        optimizer: the state machine.
        log: where its steps go.
        header: what the run was begun with, as the log's first line says it.
    """

    def __init__(self, optimizer: Optimizer, log: RunLog, header: Mapping[str, Any]) -> None:
        self.optimizer = optimizer
        self.log = log
        self._header = header

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        space: SearchSpace,
        method: str = DEFAULT_METHOD,
        settings: OptimizerSettings | None = None,
        rng: np.random.Generator | int = 0,
        about: Mapping[str, Any] | None = None,
    ) -> LoggedOptimizer:
        """Start a run with a new log, whose header also says what is given as ``about``, JSON.

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
        if about is not None:
            header["about"] = dict(about)
        return cls(optimizer, RunLog.create(path, header), header)

    @classmethod
    def resume(cls, path: str | os.PathLike[str]) -> LoggedOptimizer:
        """Continue a run: its open trials are open again, and further lines go to the same file.

        Raises:
            RunLogError: the log cannot be read, contradicts itself, or another process continues it.
        """
        log, records = RunLog.reopen(path)
        try:
            return cls(_rebuilt(records, path), log, records[0])
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
            raise InvalidSettingsError(
                f"a budget can only be raised: it is {known}, got {budget}; give at least that, or another log"
            )
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

    @property
    def seed(self) -> int | None:
        """The seed that the run was begun with; None when it was a generator."""
        seed: int | None = self._header.get("seed")
        return seed

    @property
    def about(self) -> dict[str, Any] | None:
        """What the run was said to be about when it was begun."""
        about: dict[str, Any] | None = self._header.get("about")
        return about

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
    if not isinstance(header.get("about", {}), dict):
        raise RunLogError(f"what the run log is about must be named values, got {header['about']!r}")
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
