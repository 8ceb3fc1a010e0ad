"""Definitions: what is read, what is refused, and which runs come of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from mebo_grasp.errors import InvalidFileError, InvalidSettingsError
from mebo_grasp.experiments.definition import builtin_names, load_definition, make_definition
from mebo_grasp.experiments.scores.study_scores import METRICS

SMALL: dict[str, Any] = {
    "objective": {"name": "cec2013", "problem": ["himmelblau", "equal_maxima"]},
    "methods": ["random", "sobol"],
    "seeds": 2,
}


def test_the_thesiss_experiment_has_all_its_runs() -> None:
    definition = load_definition("thesis-grasp")
    # Three objects, two spaces, two qualities, six methods, ten seeds.
    assert len(definition.jobs) == 3 * 2 * 2 * 6 * 10
    protocols = {(job.as_dict()["space"], job.budget, job.n_initial, job.batch_size) for job in definition.jobs}
    assert protocols == {("position", 250, 25, 3), ("pose", 500, 25, 3)}
    assert [job.seed for job in definition.jobs] == sorted(job.seed for job in definition.jobs)
    assert {job.objective.wanted_set(0).size for job in definition.jobs if "drill" in job.key} == {3}


@pytest.mark.parametrize("name", builtin_names())
def test_every_builtin_experiment_is_sound(name: str) -> None:
    definition = load_definition(name)
    assert definition.title != name
    assert len({job.key for job in definition.jobs}) == len(definition.jobs) > 0


def test_defaults_are_the_thesiss_protocol() -> None:
    job = make_definition("n", {**SMALL, "seeds": 1}).jobs[0]
    assert (job.budget, job.n_initial, job.batch_size) == (250, 25, 3)
    definition = make_definition("n", {k: v for k, v in SMALL.items() if k != "seeds"})
    assert len(definition.jobs) == 2 * 2 * 10
    assert definition.metrics == tuple(METRICS)


def test_parts_set_keys_anew_and_share_the_rest() -> None:
    content = {
        **SMALL,
        "budget": 40,
        "parts": [
            {"methods": ["mebo"]},
            {"budget": 60, "objective": {"problem": "vincent_2d", "transformed": True}},
        ],
    }
    keys = [job.cell for job in make_definition("n", content).jobs if job.seed == 0]
    assert keys == [
        "himmelblau/mebo/b40-i25-q3",
        "equal_maxima/mebo/b40-i25-q3",
        "vincent_2d~t/random/b60-i25-q3",
        "vincent_2d~t/sobol/b60-i25-q3",
    ]


def test_runs_that_parts_have_in_common_are_run_once() -> None:
    content = {**SMALL, "parts": [{"methods": ["random"]}, {"methods": ["random", "mebo"]}]}
    assert len(make_definition("n", content).jobs) == 2 * 2 * 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"budgets": 3}, "no key 'budgets'; the keys are title"),
        ({"budget": 2.5}, "budget must be a whole number of at least 1, got 2.5"),
        ({"budget": True}, "budget must be"),
        ({"initial": 300}, "initial must not be above the budget 250, got 300"),
        ({"batch": 0}, "batch must be a whole number of at least 1"),
        ({"seeds": 0}, "seeds must be a whole number of at least 1"),
        ({"seeds": [1, 1]}, "a list of different ones"),
        ({"methods": ["simulated_annealing"]}, "method must be one of all, peers"),
        ({"methods": []}, "needs methods"),
        ({"metrics": ["beauty"]}, "metric must be one of best"),
        ({"metrics": 3}, "metrics must be a list of names, got 3"),
        ({"objective": "grasp"}, "objective must hold a name and settings"),
        ({"objective": {"problem": "himmelblau"}}, "needs a name, got None"),
        ({"objective": {"name": "cec2013"}}, "the objective cec2013 needs problem"),
        ({"objective": {"name": "cec2013", "problem": "nowhere"}}, "problem must be one of"),
        ({"objective": {"name": "cec2013", "problem": "himmelblau", "colour": 1}}, "no setting 'colour'; it has"),
        ({"objective": {"name": "grasp", "object": "bottle", "scale": "big"}}, "scale of the objective grasp must"),
        ({"objective": {"name": "grasp", "object": "bottle"}, "space": "joint"}, "space must be one of position, pose"),
        ({"objective": {"name": "grasp", "object": "mug", "bounds": "thesis"}}, "boxes for bottle, vase, drill"),
        ({"objective": {"name": "grasp", "object": "bottle", "min_distance": -1}}, "min_distance above 0"),
        ({"parts": {"budget": 3}}, "parts must be a list"),
        ({"parts": [{"metrics": "best"}]}, "a part has no key 'metrics'"),
        ({"parts": [{"seeds": 0}]}, "seeds must be a whole number of at least 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_by_name(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        make_definition("n", {**SMALL, **change})


def test_overrides_reach_all_parts() -> None:
    definition = load_definition("thesis-grasp", {"budget": 30, "object": "vase", "seeds": [7], "methods": "random"})
    assert {job.budget for job in definition.jobs} == {30}
    assert {job.seed for job in definition.jobs} == {7}
    assert len(definition.jobs) == 2 * 2
    assert {job.as_dict()["object"] for job in definition.jobs} == {"vase"}


def test_conditions_leave_runs_out() -> None:
    definition = load_definition("thesis-grasp")
    left = definition.only({"space": ["pose"], "object": ["bottle", "drill"], "seed": ["0", "3"]})
    assert len(left.jobs) == 2 * 2 * 6 * 2
    assert {job.budget for job in left.jobs} == {500}
    with pytest.raises(InvalidSettingsError, match="object is one of bottle, drill, vase"):
        definition.only({"object": ["cup"]})
    with pytest.raises(InvalidSettingsError, match="no run has a setting 'colour'"):
        definition.only({"colour": ["red"]})


def test_files_are_read_and_what_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(SMALL))
    assert load_definition(str(path)).name == "mine"
    path.write_text("a: [1")
    with pytest.raises(InvalidFileError, match="is not YAML"):
        load_definition(str(path))
    path.write_text("- 1")
    with pytest.raises(InvalidSettingsError, match="must hold keys and values"):
        load_definition(str(path))
    with pytest.raises(InvalidFileError, match="none of paper-tgp, paper-ubo, quick"):
        load_definition("nothing-of-this-name")


def test_settings_that_a_label_does_not_show_tell_folders_apart() -> None:
    def key(**settings: Any) -> str:
        content = {**SMALL, "objective": {"name": "grasp", "object": "bottle", **settings}}
        return make_definition("n", content).jobs[0].key

    assert key().startswith("bottle/position-object/epsilon/random/")
    keys = [
        key(),
        key(friction=0.3),
        key(friction=0.4),
        key(hand="icub_right"),
        key(scale=2),
        key(quality="volume"),
    ]
    keys += [
        key(object="a/bottle.stl"),
        key(object="b/bottle.stl"),
        key(object="a/bottle.stl", scene="bottle"),
    ]
    assert len(set(keys)) == len(keys)
    assert key(friction=0.5) == key()
    assert key(object="my mug.v2.stl").startswith("my_mug_v2/position-object/epsilon-")
