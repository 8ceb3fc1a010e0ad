"""``show``, ``best``, ``export`` and ``import`` say what the archive says, under every filter of the service."""

from __future__ import annotations

import json
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mebo_grasp.cli.filters import parse_occlusion
from mebo_grasp.cli.main import main
from mebo_grasp.errors import InvalidOcclusionError
from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, Pose, QualityUnderNoise, StampedGrasp
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.hand_volumes import HandVolumes
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.exchange import from_record
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Sphere, TriangleMesh
from mebo_grasp.solutions.ranking import Ranking
from test.property.solution_strategies import same_grasp

HAND = HandModel.load("icub_left")
UPPER_HALF = "box:1,1,1@0,0,0.5"


def trials(count: int = 60) -> list[StampedGrasp]:
    """Grasps around a bottle; every tenth trial failed, and of two in three the quality under noise is known."""
    rng, noise = np.random.default_rng(4), np.random.default_rng(5)
    contact = GraspContact("l_index_3_link", np.array([0.03, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    found = []
    for stamp in range(count):
        pose = Pose.from_rpy(rng.uniform(-0.1, 0.1, 3), rng.uniform(-3, 3, 3))
        if stamp % 10 == 9:
            grasp = Grasp.failed(pose, "no answer", "bottle", HAND.name)
        else:
            quality = float(rng.uniform(0.1, 1.0))
            known = None if stamp % 3 == 0 else QualityUnderNoise.of(quality + noise.normal(0.0, 0.3, 3))
            grasp = Grasp(
                pose, GraspOutcome.GRASPED, quality, quality, contacts=(contact,),
                hand_posture=HAND.posture(), object_id="bottle", hand=HAND.name, under_noise=known,
            )  # fmt: skip
        found.append(StampedGrasp(stamp, grasp))
    return found


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    with SolutionArchive(folder / "trials.db", "bottle") as archive:
        archive.add_many(trials())
    return folder


def answer_of(folder: Path, query: BestGraspQuery) -> list[StampedGrasp]:
    with SolutionArchive(
        folder / "trials.db", "bottle",
        hand_volume=HandVolumes([HAND]), approach_axis=HAND.approach_axis,
    ) as archive:  # fmt: skip
        return list(archive.best(query).grasps)


def stamps(grasps: list[StampedGrasp]) -> list[int]:
    return [grasp.stamp_ns for grasp in grasps]


SMALL = "sphere:0.05@0,0.05,0"
TCP, HAND_RULE = {"rule": BlockingRule.TCP}, {"rule": BlockingRule.HAND, "approach_length": 0.1}
FILTERS = [
    (["--rule", "tcp"], TCP),
    ([], HAND_RULE),
    (["--approach-length", "0"], {"rule": BlockingRule.HAND}),
    (["--approach-length", "0.5"], {"rule": BlockingRule.HAND, "approach_length": 0.5}),
    (["--min-quality", "0.93"], HAND_RULE | {"min_quality": 0.93}),
    (["--min-diversity", "0.25"], HAND_RULE | {"min_diversity": 0.25}),
    (["--rank-by", "expected"], HAND_RULE | {"ranking": Ranking.EXPECTED}),
    (["--rank-by", "worst"], HAND_RULE | {"ranking": Ranking.WORST}),
    (["--rank-by", "quantile"], HAND_RULE | {"ranking": Ranking.QUANTILE}),
    (["--rank-by", "quantile", "--quantile", "0.2"], HAND_RULE | {"ranking": Ranking.QUANTILE, "quantile": 0.2}),
]


def asked(folder: Path, *options: str) -> list[int]:
    """Return the stamps that ``export`` writes."""
    file = folder / "some.jsonl"
    assert main(["export", str(folder), str(file), "--max-grasps", "30", *options]) == 0
    return stamps([from_record(json.loads(line)) for line in file.read_text().splitlines()])


@pytest.mark.parametrize(("options", "query"), FILTERS)
def test_best_and_export_answer_as_the_archive_does(
    run_folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], query: dict[str, object]
) -> None:
    occlusions = (parse_occlusion(SMALL),)
    expected = answer_of(run_folder, BestGraspQuery(occlusions, max_grasps=30, **query))  # type: ignore[arg-type]
    chosen = ["--max-grasps", "30", "--occlusion", SMALL, *options]
    capsys.readouterr()
    assert main(["best", str(run_folder), "--json", *chosen]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert stamps([from_record(json.loads(line)) for line in lines]) == stamps(expected)
    assert asked(run_folder, "--occlusion", SMALL, *options) == stamps(expected)


def test_every_filter_changes_the_answer(run_folder: Path) -> None:
    answers = {tuple(asked(run_folder, "--occlusion", SMALL, *options)) for options, _ in FILTERS}
    answers.add(tuple(asked(run_folder)))
    answers.add(tuple(asked(run_folder, "--occlusion", SMALL, "--margin", "0.03")))
    assert len(answers) == len(FILTERS) + 2, answers
    nearest = ["--min-diversity", "0.25", "--occlusion", SMALL, "--rotation-weight"]
    assert asked(run_folder, *nearest, "0") != asked(run_folder, *nearest, "1")
    turned = ["--min-diversity", "0.1", "--rotation-weight", "0"]
    assert asked(run_folder, *turned) != asked(run_folder, *turned, "--symmetry-axis", "0", "0", "1")


def test_best_says_what_blocked_and_by_its_exit_code_that_nothing_is_left(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    many = ["--max-grasps", "20", "--rule", "tcp"]
    assert main(["best", str(run_folder), "--occlusion", UPPER_HALF, *many]) == 0
    assert f"by '{UPPER_HALF}'" in capsys.readouterr().out
    everything = "box:2,2,2@0,0,0"
    assert main(["best", str(run_folder), "--occlusion", everything]) == 3
    out = capsys.readouterr().out
    assert "all 54 grasps" in out
    assert everything in out
    assert main(["best", str(run_folder), "--occlusion", everything, "--json"]) == 3
    said = capsys.readouterr()
    assert (said.out, "all 54 grasps" in said.err) == ("", True)


def test_best_by_a_figure_shows_it_and_says_how_many_lack_it(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["best", str(run_folder), "--rank-by", "expected"]) == 0
    (best,) = answer_of(run_folder, BestGraspQuery(ranking=Ranking.EXPECTED))
    assert best.grasp.under_noise is not None
    header, row, line = capsys.readouterr().out.splitlines()
    assert header.split()[-3:] == ["expected", "sd", "worst"]
    known = best.grasp.under_noise
    assert row.split()[-3:] == [f"{value:.4f}" for value in (known.expected, known.sd, known.worst)]
    assert "18 grasps were passed over, as their expected quality is not known" in line


def test_a_margin_blocks_what_is_beside(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    beside = ["best", str(run_folder), "--occlusion", "sphere:0.01@0,0,1", "--rule", "tcp"]
    assert main(beside) == 0
    assert main([*beside, "--margin", "1.5"]) == 3
    capsys.readouterr()


@pytest.mark.parametrize("suffix", ["csv", "jsonl", "mcap"])
def test_everything_comes_back_from_a_file(run_folder: Path, tmp_path: Path, suffix: str) -> None:
    file, copy = tmp_path / f"all.{suffix}", tmp_path / "copy" / "trials.db"
    assert main(["export", str(run_folder), str(file)]) == 0
    assert main(["import", str(file), str(copy)]) == 0
    with SolutionArchive(copy, "bottle") as archive:
        found = list(archive.grasps)
    assert stamps(found) == stamps(trials())
    assert all(same_grasp(a.grasp, b.grasp) for a, b in zip(found, trials(), strict=True))


def test_import_twice_adds_nothing_and_a_broken_file_changes_nothing(
    run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "all.csv"
    assert main(["export", str(run_folder), str(file)]) == 0
    assert main(["import", str(file), str(run_folder)]) == 0
    assert "0 new trials of 'bottle'" in capsys.readouterr().out
    text = file.read_text().splitlines()
    file.write_text("\n".join([*text[:30], text[30].replace("GRASPED", "GUESSED").replace("FAILED", "X")]))
    other = tmp_path / "other"
    assert main(["import", str(file), str(other)]) == 2
    assert "line 31" in capsys.readouterr().err
    with SolutionArchive(other / "trials.db", "bottle") as archive:
        assert len(archive) == 0


def test_a_name_with_a_dot_is_found_by_every_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of `cup.v2.stl`, the object `cup.v2`."""
    folder, name = tmp_path / "run", "cup.v2"
    folder.mkdir()
    with SolutionArchive(folder / "trials.db", name) as archive:
        archive.add(StampedGrasp(1, replace(trials(1)[0].grasp, object_id=name)))
    for chosen in ([], ["--object", name], ["--object", "meshes/cup.v2.stl"]):
        assert main(["best", str(folder), *chosen]) == 0
    for suffix in ("csv", "mcap"):
        file = tmp_path / f"all.{suffix}"
        assert main(["export", str(folder), str(file)]) == 0
        assert main(["import", str(file), str(tmp_path / suffix), "--object", name]) == 0
        assert "1 new trials of 'cup.v2'" in capsys.readouterr().out


def test_a_full_disk_is_told_in_one_line(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    full = run_folder / "full.png"
    full.symlink_to("/dev/full")
    assert main(["show", str(run_folder), "--rule", "tcp", "--picture", str(full)]) == 1
    assert capsys.readouterr().err == "mebo-grasp show: No space left on device\n"


def test_show_writes_picture_and_page_of_what_the_filters_leave(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["show", str(run_folder), "--occlusion", UPPER_HALF, "--rule", "tcp", "--size", "2"]) == 0
    out = capsys.readouterr().out
    assert "2 grasps, 2 diverse" in out
    assert UPPER_HALF in out
    assert (run_folder / "grasps.png").read_bytes().startswith(b"\x89PNG")
    page = (run_folder / "grasps.html").read_text(encoding="utf-8")
    data = json.loads(page.split('application/json">', 1)[1].split("</script>", 1)[0])
    assert (len(data["grasps"]), len(data["occlusions"])) == (2, 1)


def test_a_database_of_several_objects_needs_the_name(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = [StampedGrasp(1, Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.7, object_id="mug"))]
    with SolutionArchive(run_folder / "trials.db", "mug") as archive:
        archive.add_many(other)
    assert main(["best", str(run_folder)]) == 1
    assert "bottle, mug" in capsys.readouterr().err
    assert main(["best", str(run_folder), "--object", "mug", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["quality"] == 0.7


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["best", "RUN", "--occlusion", "box:1,2@0,0,0"], "3 sizes, got 2"),
        (["best", "RUN", "--occlusion", "blob:1@0,0,0"], "blob"),
        (["best", "RUN", "--occlusion", "sphere:-1@0,0,0"], "radius"),
        (["best", "RUN", "--occlusion", "sphere:1"], "3 or 6 numbers"),
        (["best", "RUN", "--occlusion", "mesh:nowhere.stl@0,0,0"], "nowhere.stl"),
        (["best", "RUN", "--max-grasps", "0"], "max_grasps"),
        (["best", "RUN", "--min-quality", "nan"], "min_quality"),
        (["best", "RUN", "--symmetry-axis", "0", "0", "0"], "symmetry_axis"),
        (["export", "RUN", "all.xlsx"], "xlsx"),
        (["import", "no_such.csv", "RUN"], "no_such.csv"),
        (["best", "nowhere"], "nowhere"),
    ],
)
def test_mistakes_are_named(
    run_folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert main([str(run_folder) if word == "RUN" else word for word in arguments]) in (1, 2)
    assert expected in capsys.readouterr().err


def test_without_the_mcap_libraries_the_other_files_work_and_the_way_out_is_named(
    run_folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "msg_adapters.mcap", raising=False)
    monkeypatch.delattr("msg_adapters.mcap", raising=False)
    for name in ("mcap", "mcap.reader", "mcap_ros2", "mcap_ros2.decoder", "mcap_ros2.writer"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main(["export", str(run_folder), str(run_folder / "a.mcap")]) == 2
    assert "pip install mcap mcap-ros2-support" in capsys.readouterr().err
    assert main(["export", str(run_folder), str(run_folder / "a.csv")]) == 0


def test_an_archive_in_use_is_left_alone(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with SolutionArchive(run_folder / "trials.db", "bottle"):
        assert main(["best", str(run_folder)]) == 1
    assert "in use by process" in capsys.readouterr().err


def test_every_shape_can_be_written(tmp_path: Path) -> None:
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    file = tmp_path / "cube.stl"
    cube.export(file)
    texts = {
        "box:1,2,3@0,0,0": Box,
        "sphere:1@0,0,0": Sphere,
        "cylinder:1,2@1,2,3,0,0,1.5": Cylinder,
        "cone:1,2@0,0,0": Cone,
        f"mesh:{file}@0,0,0": TriangleMesh,
    }
    for text, kind in texts.items():
        occlusion = parse_occlusion(text, 0.01)
        assert isinstance(occlusion.shape, kind)
        assert (occlusion.id, occlusion.margin) == (text, 0.01)
    turned = parse_occlusion("cylinder:1,2@1,2,3,0,0,1.5").T_object_shape
    np.testing.assert_allclose([*turned.position, *turned.rpy], [1, 2, 3, 0, 0, 1.5], atol=1e-12)
    with pytest.raises(InvalidOcclusionError, match="sphere:x@0,0,0"):
        parse_occlusion("sphere:x@0,0,0")


def test_the_run_folder_tells_what_was_explored(run_folder: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone.db"
    shutil.copy(run_folder / "trials.db", alone)
    assert main(["best", str(alone)]) == 0  # the only object of the file


def test_output_that_nobody_reads_ends_the_command_quietly(run_folder: Path, monkeypatch, capfd) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as nobody:
        monkeypatch.setattr(sys, "stdout", nobody)
        assert main(["best", str(run_folder), "--rule", "tcp"]) == 141
    assert "BrokenPipe" not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "expected"),
    [
        (["show", "RUN", "--picture", "RUN/trials.db/a.png"], 1, "trials.db"),
        (["show", "RUN", "--picture", "a.txt"], 2, "--picture a.txt must end in .png"),
        (["show", "RUN", "--scale", "0"], 2, "scale 0.0"),
        (["best", "RUN", "--object", "mug"], 1, "holds no trials of 'mug', but of bottle"),
        (["import", "RUN/all.jsonl", "RUN/trials.db/deeper"], 1, "trials.db"),
        (["trial", "--repeat", "-1"], 2, "--repeat is -1"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    run_folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, expected: str
) -> None:
    assert main(["export", str(run_folder), str(run_folder / "all.jsonl")]) == 0
    assert main([argument.replace("RUN", str(run_folder)) for argument in arguments]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
