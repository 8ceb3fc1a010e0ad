"""What an experiment is: a small YAML file that says what is maximized, by which methods, and what is read of it.

Keys of the file, all but ``objective`` and ``methods`` with a default:

- ``title``, ``about``: for the report.
- ``objective``: its ``name`` and its settings; a list of values stands for all of them.
- ``space``: short for the objective's setting of that name.
- ``methods``: names as ``mebo-grasp experiment cec2013 --methods`` takes them.
- ``budget``, ``initial``, ``batch``: evaluations a run, of them the initial design, and points a batch.
- ``seeds``: how many, counted from 0, or a list.
- ``metrics``: what the tables show (``scores.METRICS``).
- ``parts``: a list; each has any of the keys above but title, about and metrics, and stands for itself.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from mebo_grasp.errors import InvalidFileError, InvalidSettingsError
from mebo_grasp.experiments.objective import Objective
from mebo_grasp.experiments.objectives.registry import make_objective, setting_names
from mebo_grasp.experiments.runs.job import BATCH_SIZE, BUDGET, N_INITIAL, SEEDS, Job
from mebo_grasp.experiments.runs.peers import installed_peers
from mebo_grasp.experiments.runs.protocol import select_methods
from mebo_grasp.experiments.scores.study_scores import METRICS, check_metrics

PART_KEYS = ("objective", "space", "methods", "budget", "initial", "batch", "seeds")
KEYS = ("title", "about", *PART_KEYS, "metrics", "parts")
_FOLDER = "definitions"


@dataclass(frozen=True)
class Definition:
    """An experiment.

    Args:
        name: how it is called, also its default folder.
        title: one line.
        about: a paragraph, or empty.
        metrics: names of ``scores.METRICS``.
        jobs: its runs, seeds outermost, so that an unfinished experiment is balanced over the cells.
    """

    name: str
    title: str
    about: str
    metrics: tuple[str, ...]
    jobs: tuple[Job, ...]

    def only(self, conditions: Mapping[str, Sequence[Any]]) -> Definition:
        """Leave the runs whose settings have one of the values given.

        Raises:
            InvalidSettingsError: no run has a setting of that name, or none is left.
        """
        kept = self.jobs
        for key, values in conditions.items():
            wanted = {str(value) for value in values}
            found = sorted({str(job.as_dict()[key]) for job in kept if key in job.as_dict()})
            kept = tuple(job for job in kept if str(job.as_dict().get(key)) in wanted)
            if not kept:
                known = f"{key} is one of {', '.join(found)}" if found else f"no run has a setting {key!r}"
                raise InvalidSettingsError(f"no run has {key} {', '.join(sorted(wanted))}; {known}")
        return replace(self, jobs=kept)


def builtin_names() -> tuple[str, ...]:
    """Names of the experiments that come with the package."""
    folder = files("mebo_grasp.experiments").joinpath(_FOLDER)
    return tuple(sorted(item.name.removesuffix(".yaml") for item in folder.iterdir() if item.name.endswith(".yaml")))


def load_definition(name_or_path: str, overrides: Mapping[str, Any] | None = None) -> Definition:
    """Read a built-in experiment or a file.

    Args:
        name_or_path: name of a built-in one, else a file.
        overrides: keys of the file or settings of the objective, set for all parts.

    Raises:
        InvalidFileError: there is no such experiment, or the file cannot be read.
        InvalidSettingsError: a key or value is unknown, missing or out of range.
    """
    name, text = _read(name_or_path)
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InvalidFileError(f"{name_or_path} is not YAML: {error}") from error
    if not isinstance(content, dict):
        raise InvalidSettingsError(f"{name_or_path} must hold keys and values; the keys are {', '.join(KEYS)}")
    return make_definition(name, _overridden(content, overrides or {}))


def _read(name_or_path: str) -> tuple[str, str]:
    if name_or_path in builtin_names():
        resource = files("mebo_grasp.experiments").joinpath(_FOLDER, f"{name_or_path}.yaml")
        return name_or_path, resource.read_text(encoding="utf-8")
    path = Path(name_or_path)
    try:
        return path.stem, path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidFileError(
            f"no experiment {name_or_path!r}: it is none of {', '.join(builtin_names())}, and as a file it cannot be "
            f"read: {error}"
        ) from error


def _overridden(content: dict[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """The content with keys or settings of the objective replaced, in all parts."""
    content = {**content, "parts": [dict(part) for part in _parts(content)]}
    for key, value in overrides.items():
        for part in content["parts"]:
            part.pop(key, None)
            if isinstance(part.get("objective"), dict):
                part["objective"] = {k: v for k, v in part["objective"].items() if k != key}
        if key in KEYS:
            content[key] = value
        elif "objective" in content:
            _check_mapping("objective", content["objective"])
            content["objective"] = {**content["objective"], key: value}
        else:
            _set_in_parts(content["parts"], key, value)
    return content


def _set_in_parts(parts: Sequence[dict[str, Any]], key: str, value: Any) -> None:
    """Set a setting in the parts whose objective has it."""
    fitting = [part for part in parts if key in setting_names(str(_mapping(part, "objective").get("name")))]
    if not fitting:
        raise InvalidSettingsError(f"no part's objective has a setting {key!r}")
    for part in fitting:
        part["objective"] = {**part["objective"], key: value}


def make_definition(name: str, content: Mapping[str, Any]) -> Definition:
    """Check an experiment's keys and values and make its runs.

    Raises:
        InvalidSettingsError: a key or value is unknown, missing or out of range.
    """
    _check_keys("the experiment", content, KEYS)
    shared = {key: content[key] for key in PART_KEYS if key in content}
    jobs: dict[str, Job] = {}
    places: dict[str, int] = {}
    for part in _parts(content) or [{}]:
        _check_keys("a part", part, PART_KEYS)
        for place, job in _jobs_of(_merged(shared, part)):
            places.setdefault(job.key, place)
            if jobs.setdefault(job.key, job).objective != job.objective:
                raise InvalidSettingsError(
                    f"two objectives with other settings have one label, {job.objective.label!r}: let the label show "
                    "what differs"
                )
    metrics = content.get("metrics", list(METRICS))
    names = tuple(_names("metrics", metrics))
    check_metrics(names)
    ordered = sorted(jobs.values(), key=lambda job: places[job.key])
    title, about = str(content.get("title", name)), str(content.get("about", "")).strip()
    return Definition(name, title, about, names, tuple(ordered))


def _parts(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    parts = content.get("parts", [])
    if not isinstance(parts, list) or not all(isinstance(part, dict) for part in parts):
        raise InvalidSettingsError(f"parts must be a list of keys and values, got {parts!r}")
    return parts


def _check_keys(what: str, content: Mapping[str, Any], known: Sequence[str]) -> None:
    for key in content:
        if key not in known:
            raise InvalidSettingsError(f"{what} has no key {key!r}; the keys are {', '.join(known)}")


def _merged(shared: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    """A part with what it does not say itself; settings of the objective are merged one by one."""
    merged = {**shared, **part}
    objective = {**_mapping(shared, "objective"), **_mapping(part, "objective")}
    if "space" in merged:
        objective["space"] = merged.pop("space")
    return {**merged, "objective": objective}


def _mapping(content: dict[str, Any], key: str) -> dict[str, Any]:
    _check_mapping(key, content.get(key, {}))
    return dict(content.get(key, {}))


def _check_mapping(key: str, value: Any) -> None:
    if not isinstance(value, dict):
        raise InvalidSettingsError(f"{key} must hold a name and settings, got {value!r}")


def _jobs_of(part: dict[str, Any]) -> Iterable[tuple[int, Job]]:
    """A part's runs, each with its seed's place among the part's seeds."""
    for key in ("objective", "methods"):
        if not part.get(key):
            raise InvalidSettingsError(f"an experiment needs {key}")
    methods = select_methods(_names("methods", part["methods"]), installed_peers())
    budget = _count("budget", part.get("budget", BUDGET), 1)
    initial = _count("initial", part.get("initial", N_INITIAL), 0)
    batch = _count("batch", part.get("batch", BATCH_SIZE), 1)
    if initial > budget:
        raise InvalidSettingsError(f"initial must not be above the budget {budget}, got {initial}")
    seeds = _seeds(part.get("seeds", SEEDS))
    for objective in _objectives(part["objective"]):
        for method, (place, seed) in itertools.product(methods, enumerate(seeds)):
            yield place, Job(method, objective, seed, budget, initial, batch)


def _objectives(settings: dict[str, Any]) -> list[Objective]:
    """One objective for each combination of the settings that are lists."""
    settings = dict(settings)
    name = settings.pop("name", None)
    if not isinstance(name, str):
        raise InvalidSettingsError(f"the objective needs a name, got {name!r}")
    choices = [value if isinstance(value, list) else [value] for value in settings.values()]
    return [make_objective(name, dict(zip(settings, chosen, strict=True))) for chosen in itertools.product(*choices)]


def _names(key: str, value: Any) -> list[str]:
    values = [value] if isinstance(value, str) else value
    if not isinstance(values, list) or not values or not all(isinstance(item, str) for item in values):
        raise InvalidSettingsError(f"{key} must be a list of names, got {value!r}")
    return values


def _count(key: str, value: Any, least: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise InvalidSettingsError(f"{key} must be a whole number of at least {least}, got {value!r}")
    return value


def _seeds(value: Any) -> list[int]:
    if isinstance(value, list):
        seeds = [_count("a seed", seed, 0) for seed in value]
        if not seeds or len(set(seeds)) < len(seeds):
            raise InvalidSettingsError(f"seeds must be a number or a list of different ones, got {value!r}")
        return seeds
    return list(range(_count("seeds", value, 1)))
