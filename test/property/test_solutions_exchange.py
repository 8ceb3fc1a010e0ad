"""Trials survive the way through CSV, JSON lines and MCAP; broken files give typed errors."""

import contextlib
import csv
import json
import math
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from mebo_grasp.errors import ArchiveError, InvalidFileError
from mebo_grasp.grasp import Grasp, GraspOutcome, Pose, QualityUnderNoise, StampedGrasp
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.exchange import (
    NOISE_NUMBERS,
    import_trials,
    read_csv,
    read_jsonl,
    to_record,
    write_csv,
    write_jsonl,
)
from msg_adapters.mcap import message_definition, read_mcap, write_mcap
from test.property.solution_strategies import OBJECT, same_grasp, trials

Write = Callable[[Iterable[StampedGrasp], Path], int]
Read = Callable[[Path], Iterator[StampedGrasp]]

FORMATS: dict[str, tuple[Write, Read]] = {
    "csv": (write_csv, read_csv),
    "jsonl": (write_jsonl, read_jsonl),
    "mcap": (lambda found, path: write_mcap(found, path, OBJECT), lambda path: read_mcap(path, OBJECT)),
}


@pytest.mark.parametrize("suffix", FORMATS)
@settings(deadline=None, max_examples=30)
@given(stored=trials(max_size=6))
def test_what_is_written_is_read(suffix: str, stored: list[StampedGrasp]) -> None:
    write, read = FORMATS[suffix]
    stored = sorted(stored, key=lambda stamped: stamped.stamp_ns)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"grasps.{suffix}"
        assert write(stored, path) == len(stored)
        found = list(read(path))
        assert [file.name for file in path.parent.iterdir()] == [path.name]
    assert [stamped.stamp_ns for stamped in found] == [stamped.stamp_ns for stamped in stored]
    for one, other in zip(stored, found, strict=True):
        assert same_grasp(one.grasp, other.grasp)


@settings(deadline=None, max_examples=15)
@given(stored=trials(max_size=6))
def test_an_archive_survives_export_and_import(stored: list[StampedGrasp]) -> None:
    with tempfile.TemporaryDirectory() as folder, SolutionArchive(":memory:", OBJECT) as archive:
        path = Path(folder) / "grasps.jsonl"
        archive.add_many(stored)
        assert write_jsonl(archive.grasps, path) == len(stored)
        with SolutionArchive(":memory:", OBJECT) as other:
            assert import_trials(other, lambda: read_jsonl(path)) == len(stored)
            assert import_trials(other, lambda: read_jsonl(path)) == 0
            assert [s.stamp_ns for s in other.grasps] == [s.stamp_ns for s in archive.grasps]
            assert [s.stamp_ns for s in other.best().grasps] == [s.stamp_ns for s in archive.best().grasps]


@settings(deadline=None)
@given(content=st.one_of(st.text(max_size=200), st.just('{"stamp_ns": 1}\n'), st.just("[1]\n")))
def test_any_text_is_trials_or_a_typed_error(content: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grasps"
        path.write_text(content, encoding="utf-8", errors="surrogatepass")
        for read in (read_csv, read_jsonl):
            with contextlib.suppress(InvalidFileError):
                list(read(path))
        with pytest.raises(InvalidFileError):
            list(read_mcap(path, OBJECT))


def test_the_line_that_is_wrong_is_named_and_nothing_is_stored(tmp_path: Path) -> None:
    path = tmp_path / "grasps.jsonl"
    good = '{"stamp_ns": %d, "object_id": "bottle", "outcome": "GRASPED", "quality": %s, "epsilon": 0.0, '
    good += '"volume": 0.0, "isotropy": 0.0, "force_closure": true, "position": [0, 0, 0], '
    good += '"quaternion_xyzw": [0, 0, 0, 1], "hand": "", "computation_time": 0.1, "message": "", '
    good += '"joint_names": [], "joint_positions": [], "contacts": []}\n'
    path.write_text(good % (1, 0.5) + good % (2, "null"), encoding="utf-8")
    with SolutionArchive(":memory:", OBJECT) as archive:
        with pytest.raises(InvalidFileError, match=r"grasps.jsonl, line 2: outcome GRASPED"):
            import_trials(archive, lambda: read_jsonl(path))
        assert len(archive) == 0
        path.write_text(good % (1, 0.5) + good.replace("bottle", "mug") % (2, 0.5), encoding="utf-8")
        with pytest.raises(ArchiveError, match="'mug'"):
            import_trials(archive, lambda: read_jsonl(path))
        assert len(archive) == 0
        partly = good.replace('"hand": ""', '"hand": "", "expected_quality": 0.4')
        path.write_text(partly % (1, 0.5), encoding="utf-8")
        with pytest.raises(InvalidFileError, match="noise_samples either all or none"):
            import_trials(archive, lambda: read_jsonl(path))
        path.write_text(good % (1, 0.5), encoding="utf-8")
        assert import_trials(archive, lambda: read_jsonl(path)) == 1


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("stamp_ns", -1),
        ("stamp_ns", 2**31 * 10**9),
        ("noise_samples", 2**32),
        ("noise_samples", 10**400),
        ("epsilon", math.inf),
        ("message", "\ud800"),
        ("hand", "\ud800"),
    ],
)
def test_what_no_archive_or_message_can_hold_is_refused_before_anything_is_stored(
    field: str, value: object, tmp_path: Path
) -> None:
    path = tmp_path / "grasps.jsonl"
    known = QualityUnderNoise(0.4, 0.1, 0.2, 5)
    record = to_record(StampedGrasp(2, Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.5, under_noise=known)))
    path.write_text("\n".join(json.dumps(line) for line in (record, record | {"stamp_ns": 3, field: value})))
    with SolutionArchive(":memory:", OBJECT) as archive:
        with pytest.raises(InvalidFileError, match="line 2"):
            import_trials(archive, lambda: read_jsonl(path))
        assert len(archive) == 0


def test_files_of_before_quality_under_noise_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = QualityUnderNoise(0.4, 0.1, 0.2, 5)
    trial = StampedGrasp(1, Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.5, under_noise=known))
    table, recording = tmp_path / "grasps.csv", tmp_path / "grasps.mcap"
    write_csv([trial], table)
    with table.open(newline="") as file:
        rows = [row[: -len(NOISE_NUMBERS)] for row in csv.reader(file)]
    with table.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    definition = message_definition()
    lines = definition.split("\n")
    older = "\n".join(line for line in lines if line.split()[1:2] not in [[name] for name in NOISE_NUMBERS])
    assert len(older.split("\n")) == len(lines) - len(NOISE_NUMBERS)
    monkeypatch.setattr("msg_adapters.mcap.message_definition", lambda: older)
    write_mcap([trial], recording, OBJECT)
    for found in (*read_csv(table), *read_mcap(recording, OBJECT)):
        assert same_grasp(found.grasp, replace(trial.grasp, under_noise=None))


def test_missing_columns_and_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "grasps.csv"
    with pytest.raises(InvalidFileError, match="cannot read"):
        list(read_csv(path))
    with pytest.raises(InvalidFileError, match="cannot write"):
        write_csv([], tmp_path / "missing" / "grasps.csv")
    path.write_text("stamp_ns,quality\n1,0.5\n", encoding="utf-8")
    with pytest.raises(InvalidFileError, match=r"columns are missing: computation_time, contacts, .*qw"):
        list(read_csv(path))


@settings(deadline=None, max_examples=1)
@given(stored=trials(max_size=3).filter(bool))
def test_an_mcap_file_is_read_by_a_program_that_knows_nothing_of_this_package(
    stored: list[StampedGrasp],
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grasps.mcap"
        write_mcap(sorted(stored, key=lambda s: s.stamp_ns), path, OBJECT)
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            messages = list(reader.iter_decoded_messages())
    assert {channel.topic for _, channel, _, _ in messages} == {"/grasp_quality"}
    assert {schema.name for schema, _, _, _ in messages if schema} == {"mebo_grasp_interfaces/msg/GraspQuality"}
    assert sorted(message.log_time for _, _, message, _ in messages) == sorted(s.stamp_ns for s in stored)
