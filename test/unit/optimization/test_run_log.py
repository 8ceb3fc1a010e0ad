import json

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.optimization.logged_optimizer import LoggedOptimizer, resume
from mebo_grasp.optimization.optimizer import OptimizerSettings
from mebo_grasp.optimization.run_log import RunLog
from mebo_grasp.optimization.search_space import SearchSpace

SPACE = SearchSpace(("x", "y"), np.full(2, -6.0), np.full(2, 6.0), ("m", "m"))


def objective(x):
    return float(200 - (x[0] ** 2 + x[1] - 11) ** 2 - (x[0] + x[1] ** 2 - 7) ** 2)


def evaluate(run, trial):
    """Every fifth trial fails, so that failures are part of the trace."""
    if trial.id % 5 == 4:
        run.tell_failed(trial.id, "collision check timed out")
    else:
        run.tell(trial.id, objective(trial.x))


def finish(run):
    while not run.finished:
        for trial in run.pending or run.ask():
            evaluate(run, trial)


def full_run(path, method="mebo", budget=26):
    settings = OptimizerSettings(budget=budget, n_initial=8, burn_in=20, relearn_period=2)
    run = LoggedOptimizer.create(path, SPACE, method, settings, 3)
    finish(run)
    run.close()
    return path.read_bytes()


def test_killed_at_every_line_it_resumes_to_the_same_trace(tmp_path):
    content = full_run(tmp_path / "full.jsonl")
    lines = content.splitlines(keepends=True)
    assert len(lines) > 30
    for kept in range(1, len(lines) + 1):
        torn = lines[kept][: len(lines[kept]) // 2] if kept < len(lines) else b""
        path = tmp_path / f"{kept}.jsonl"
        path.write_bytes(b"".join(lines[:kept]) + torn)
        run = LoggedOptimizer.resume(path)
        finish(run)
        run.close()
        assert path.read_bytes() == content, f"killed after line {kept}"


@pytest.mark.parametrize("method", ["mebo", "cl_mebo", "robot", "basin_search"])
def test_a_finished_run_goes_on_with_a_higher_budget_and_resumes_to_the_same_trace(tmp_path, method):
    begun = full_run(tmp_path / "run.jsonl", method, budget=14)
    run = LoggedOptimizer.resume(tmp_path / "run.jsonl")
    run.raise_budget(14)
    assert run.finished
    run.raise_budget(23)
    assert run.optimizer.settings.budget == 23
    finish(run)
    run.close()
    content = (tmp_path / "run.jsonl").read_bytes()
    assert content.startswith(begun)
    assert run.optimizer.n_asked == 23

    raised = begun.count(b"\n") + 1
    lines = content.splitlines(keepends=True)
    for kept in range(raised, len(lines), 3):
        path = tmp_path / f"{kept}.jsonl"
        path.write_bytes(b"".join(lines[:kept]))
        again = LoggedOptimizer.resume(path)
        finish(again)
        again.close()
        assert path.read_bytes() == content, f"killed after line {kept}"


def test_a_budget_is_not_lowered(tmp_path):
    run = LoggedOptimizer.create(tmp_path / "run.jsonl", SPACE, "mebo", OptimizerSettings(budget=8, n_initial=8), 3)
    content = (tmp_path / "run.jsonl").read_bytes()
    with pytest.raises(InvalidSettingsError, match="it is 8, got 7"):
        run.raise_budget(7)
    assert (tmp_path / "run.jsonl").read_bytes() == content


def test_a_log_that_is_being_written_is_not_continued_by_another(tmp_path):
    path = tmp_path / "run.jsonl"
    run = LoggedOptimizer.create(path, SPACE, "mebo", OptimizerSettings(budget=8, n_initial=8), 3)
    content = path.read_bytes()
    with pytest.raises(RunLogError, match="in use by another process"):
        LoggedOptimizer.resume(path)
    assert path.read_bytes() == content
    run.close()
    LoggedOptimizer.resume(path).close()


def test_a_log_is_held_before_it_is_read(tmp_path):
    path = tmp_path / "run.jsonl"
    run = LoggedOptimizer.create(path, SPACE, "mebo", OptimizerSettings(budget=8, n_initial=8), 3)
    with path.open("ab") as stream:
        stream.write(b"{half a line, as another process would see it\n{}\n")
    with pytest.raises(RunLogError, match="in use by another process"):
        LoggedOptimizer.resume(path)
    run.close()
    for _ in range(2):  # What is refused is not held any longer.
        with pytest.raises(RunLogError, match="line 2"):
            LoggedOptimizer.resume(path)


@pytest.mark.parametrize("content", ["precious\nthings", '{"kind": "tell"}\n{"torn', ""])
def test_a_file_that_is_no_run_log_is_left_as_it_is(tmp_path, content):
    path = tmp_path / "notes.txt"
    path.write_text(content)
    for action in (RunLog.append, LoggedOptimizer.resume):
        with pytest.raises(RunLogError, match="name another file"):
            action(path)
    assert path.read_text() == content


def test_two_runs_of_one_seed_write_the_same_bytes(tmp_path):
    assert full_run(tmp_path / "a.jsonl") == full_run(tmp_path / "b.jsonl")


def test_distance_weights_are_kept_and_logs_without_them_still_resume(tmp_path):
    space = SearchSpace(("x", "roll"), np.zeros(2), np.ones(2), ("m", "rad"), np.array([1.0, 0.05]))
    path = tmp_path / "run.jsonl"
    LoggedOptimizer.create(path, space, "random", OptimizerSettings(budget=4, n_initial=2), 0).close()
    assert resume(path).space.distance_weights.tolist() == [1.0, 0.05]
    header = json.loads(path.read_text())
    del header["space"]["distance_weights"]
    path.write_text(json.dumps(header) + "\n")
    assert resume(path).space.distance_weights.tolist() == [1.0, 1.0]


def test_foreign_observations_are_part_of_the_trace(tmp_path):
    path = tmp_path / "run.jsonl"
    settings = OptimizerSettings(budget=12, n_initial=3, burn_in=20)
    run = LoggedOptimizer.create(path, SPACE, "mebo", settings, 3)
    run.ask()
    run.observe([3.0, 2.0], 200.0)
    expected = run.optimizer.ask(3)
    again = resume(path).ask(3)
    assert [t.x.tolist() for t in again] == [t.x.tolist() for t in expected]


def test_open_trials_are_open_again(tmp_path):
    path = tmp_path / "run.jsonl"
    run = LoggedOptimizer.create(path, SPACE, "random", OptimizerSettings(budget=9, n_initial=3), 3)
    run.ask()
    run.tell(1, 5.0)
    again = resume(path)
    assert [(t.id, t.x.tolist()) for t in again.pending] == [(t.id, t.x.tolist()) for t in run.pending]
    assert again.incumbent is not None
    assert again.incumbent.value == 5.0


def test_failure_reasons_are_kept(tmp_path):
    path = tmp_path / "run.jsonl"
    run = LoggedOptimizer.create(path, SPACE, "random", OptimizerSettings(budget=9, n_initial=3), 3)
    run.ask()
    run.tell_failed(0, "hand lost")
    assert RunLog.load(path)[-1] == {"kind": "tell_failed", "id": 0, "reason": "hand lost"}


@pytest.mark.parametrize(("rng", "seed"), [(7, 7), (np.int64(7), 7), (np.random.default_rng(7), None)])
def test_the_seed_is_kept_where_there_is_one(tmp_path, rng, seed):
    path = tmp_path / "run.jsonl"
    begun = LoggedOptimizer.create(path, SPACE, "random", OptimizerSettings(budget=9, n_initial=3), rng)
    begun.close()
    resumed = LoggedOptimizer.resume(path)
    assert begun.seed == resumed.seed == seed
    assert begun.about is resumed.about is None


def test_what_a_run_is_about_is_kept(tmp_path):
    path, about = tmp_path / "run.jsonl", {"object": "bottle", "facet": "+y"}
    settings = OptimizerSettings(budget=9, n_initial=3)
    begun = LoggedOptimizer.create(path, SPACE, "random", settings, 3, about)
    begun.close()
    resumed = LoggedOptimizer.resume(path)
    resumed.close()
    assert begun.about == resumed.about == about
    path.write_text(path.read_text().replace('{"object": "bottle", "facet": "+y"}', '["bottle"]'))
    with pytest.raises(RunLogError, match="what the run log is about must be named values, got \\['bottle'\\]"):
        LoggedOptimizer.resume(path)


@pytest.mark.parametrize("value", [np.nan, object()])
def test_a_note_that_is_no_json_is_refused_and_leaves_nothing(tmp_path, value):
    path = tmp_path / "run.jsonl"
    run = LoggedOptimizer.create(path, SPACE, "random", OptimizerSettings(budget=9, n_initial=3), 3)
    before = path.read_bytes()
    with pytest.raises(RunLogError, match="cannot write"):
        run.note({"what": value})
    run.close()
    assert path.read_bytes() == before


def test_an_existing_file_is_never_overwritten(tmp_path):
    path = tmp_path / "run.jsonl"
    path.write_text("precious")
    with pytest.raises(RunLogError, match="exists already"):
        LoggedOptimizer.create(path, SPACE)
    assert path.read_text() == "precious"


def test_refused_steps_are_not_logged(tmp_path):
    path = tmp_path / "run.jsonl"
    run = LoggedOptimizer.create(path, SPACE, "random", OptimizerSettings(budget=9, n_initial=3), 3)
    run.ask()
    before = path.read_bytes()
    for action in (lambda: run.tell(99, 1.0), lambda: run.tell(0, np.nan), lambda: run.observe([99, 0], 1.0)):
        with pytest.raises(Exception, match=r"unknown|finite|outside"):
            action()
    assert path.read_bytes() == before


def edited(tmp_path, edit):
    """A log of one ask and three tells, with its list of records changed by ``edit``."""
    path = tmp_path / "run.jsonl"
    run = LoggedOptimizer.create(path, SPACE, "mebo", OptimizerSettings(budget=9, n_initial=3), 3)
    for trial in run.ask():
        run.tell(trial.id, 1.0)
    run.close()
    records = [json.loads(line) for line in path.read_text().splitlines()]
    edit(records)
    path.write_text("".join(json.dumps(record) + "\n" for record in records))
    return path


BROKEN = {
    "no header": lambda r: r.pop(0),
    "other format": lambda r: r[0].update(format=99),
    "unknown method": lambda r: r[0].update(method="none such"),
    "unknown setting": lambda r: r[0]["settings"].update(colour="red"),
    "bad setting": lambda r: r[0]["settings"].update(budget=-1),
    "bad space": lambda r: r[0]["space"].update(lower=[9.0, 9.0]),
    "bad generator": lambda r: r[0]["rng"].update(bit_generator="Dice"),
    "unknown kind": lambda r: r[1].update(kind="guess"),
    "told twice": lambda r: r.append(r[-1]),
    "id gap": lambda r: r[1]["trials"][0].update(id=5),
    "point outside": lambda r: r[1]["trials"][0].update(u=[2.0, 0.0]),
    "method state": lambda r: r[1]["method"].pop("proposed"),
    "surrogate state": lambda r: r[1]["method"].update(surrogate=None),
    "value is text": lambda r: r[2].update(value="much"),
    "no id": lambda r: r[2].pop("id"),
    "a list": lambda r: r.insert(1, [1, 2]),
}


@pytest.mark.parametrize("edit", BROKEN.values(), ids=BROKEN.keys())
def test_contradicting_logs_get_a_clear_error(tmp_path, edit):
    path = edited(tmp_path, edit)
    with pytest.raises(RunLogError):
        resume(path)


@pytest.mark.parametrize("torn", [b'{"kind": "tell", "id": 1', b'{"kind": "te\x00\x00\n', b"\n"])
def test_a_torn_last_line_is_dropped_even_if_it_ends(tmp_path, torn):
    path = edited(tmp_path, lambda _: None)
    whole = path.read_bytes()
    path.write_bytes(whole + torn)
    assert resume(path).n_told == 3
    run = LoggedOptimizer.resume(path)
    run.close()
    assert path.read_bytes() == whole


def test_a_broken_line_in_the_middle_is_an_error_and_an_absent_file_too(tmp_path):
    path = edited(tmp_path, lambda _: None)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text(lines[0] + "{torn\n" + "".join(lines[1:]))
    with pytest.raises(RunLogError, match="line 2"):
        resume(path)
    with pytest.raises(RunLogError, match="cannot read"):
        resume(tmp_path / "absent.jsonl")
    (tmp_path / "empty.jsonl").write_bytes(b"")
    with pytest.raises(RunLogError, match="no header"):
        resume(tmp_path / "empty.jsonl")
