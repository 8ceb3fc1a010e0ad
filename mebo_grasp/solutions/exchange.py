"""Trials in files that other programs read: CSV and JSON lines.

Both hold every field of a trial. Numbers are written so that they come back to the last bit; NaN is null
in JSON and an empty cell in CSV. Lengths are in metres, angles in radians, quaternions xyzw. A file is
written beside its place and moved there when it is complete.
"""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from mebo_grasp.errors import InvalidFileError, MeboGraspError
from mebo_grasp.grasp import (
    Grasp,
    GraspContact,
    GraspOutcome,
    HandPosture,
    Pose,
    QualityUnderNoise,
    StampedGrasp,
)
from mebo_grasp.solutions.archive import SolutionArchive

NUMBERS = ("quality", "epsilon", "volume", "isotropy", "computation_time")
NOISE_NUMBERS = ("expected_quality", "quality_sd", "worst_quality", "noise_samples")
"""Empty where nothing is known of a grasp under noise; older files lack them."""
LATEST_STAMP = 2**31 * 10**9 - 1
"""Nanoseconds, in 2038: the last that a ROS time tells; a grasp of a later stamp could never be sent."""
MOST_SAMPLES = 2**32 - 1
"""Of a quality under noise, as its message counts them."""
CSV_COLUMNS = (
    "stamp_ns", "object_id", "outcome", "quality", "epsilon", "volume", "isotropy", "force_closure",
    "px", "py", "pz", "qx", "qy", "qz", "qw", "hand", "computation_time", "message",
    "joint_names", "joint_positions", "contacts", *NOISE_NUMBERS,
)  # fmt: skip
"""Columns of a CSV file; joints and contacts are JSON in their cells."""

Record = dict[str, Any]


def to_record(stamped: StampedGrasp) -> Record:
    """Return a trial as plain values, as a line of JSON holds them."""
    grasp = stamped.grasp
    return {
        "stamp_ns": stamped.stamp_ns,
        "object_id": grasp.object_id,
        "outcome": grasp.outcome.name,
        **{name: _null_if_nan(getattr(grasp, name)) for name in NUMBERS},
        "force_closure": bool(grasp.force_closure),
        "position": grasp.T_object_tcp.position.tolist(),
        "quaternion_xyzw": grasp.T_object_tcp.quaternion_xyzw.tolist(),
        "hand": grasp.hand,
        "message": grasp.message,
        "joint_names": list(grasp.hand_posture.names),
        "joint_positions": list(grasp.hand_posture.positions),
        "contacts": [
            {
                "link": contact.link,
                "position": contact.position.tolist(),
                "normal": contact.normal.tolist(),
            }
            for contact in grasp.contacts
        ],
        **dict(zip(NOISE_NUMBERS, _noise_values(grasp.under_noise), strict=True)),
    }


def from_record(record: Record) -> StampedGrasp:
    """Return the trial that plain values describe.

    Raises:
        InvalidFileError: a field is missing or of the wrong kind, or the values contradict each other.
    """
    try:
        grasp = Grasp(
            T_object_tcp=Pose(record["position"], record["quaternion_xyzw"]),
            outcome=GraspOutcome[record["outcome"]],
            **{name: _number(record[name], name) for name in NUMBERS},
            force_closure=_boolean(record["force_closure"]),
            contacts=tuple(
                GraspContact(_text(contact["link"]), contact["position"], contact["normal"])
                for contact in record["contacts"]
            ),
            hand_posture=HandPosture(
                tuple(_text(name) for name in record["joint_names"]),
                tuple(float(position) for position in record["joint_positions"]),
            ),
            object_id=_text(record["object_id"]),
            hand=_text(record["hand"]),
            message=_text(record["message"]),
            under_noise=_under_noise(record),
        )
        return StampedGrasp(_whole(record["stamp_ns"], "stamp_ns", LATEST_STAMP), grasp)
    except KeyError as error:
        raise InvalidFileError(f"field or value {error} is missing or unknown") from error
    except (TypeError, ValueError, MeboGraspError) as error:
        raise InvalidFileError(str(error)) from error


def _noise_values(known: QualityUnderNoise | None) -> tuple[float | int | None, ...]:
    return (None,) * 4 if known is None else (known.expected, known.sd, known.worst, known.samples)


def _under_noise(record: Record) -> QualityUnderNoise | None:
    given = [record[name] for name in NOISE_NUMBERS if record.get(name) is not None]
    if not given:
        return None
    if len(given) < len(NOISE_NUMBERS):
        raise ValueError(f"of {', '.join(NOISE_NUMBERS)} either all or none must be given")
    *figures, samples = given
    expected, sd, worst = map(float, figures)
    return QualityUnderNoise(expected, sd, worst, _whole(samples, "noise_samples", MOST_SAMPLES))


def _null_if_nan(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def _number(value: float | None, name: str) -> float:
    """Return a number, NaN for null; infinite ones could not be written as JSON again."""
    number = math.nan if value is None else float(value)
    if math.isinf(number):
        raise ValueError(f"{name} must be finite or empty, got {number}")
    return number


def _text(value: object) -> str:
    """Return a text; UnicodeEncodeError (a ValueError) for half a character, which no database takes."""
    text = str(value)
    text.encode()
    return text


def _boolean(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"force_closure must be true or false, got {value!r}")
    return value


def _whole(value: object, name: str, most: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
        raise ValueError(f"{name} must be a whole number from 0 to {most}, got {value!r:.40}")
    return value


@contextmanager
def _complete_or_not_at_all(path: Path) -> Iterator[IO[str]]:
    unfinished = path.with_name(path.name + ".part")
    try:
        with unfinished.open("w", encoding="utf-8", newline="") as file:
            yield file
        os.replace(unfinished, path)
    except OSError as error:
        raise InvalidFileError(f"cannot write {path}: {error.strerror}") from error
    finally:
        unfinished.unlink(missing_ok=True)


def write_jsonl(trials: Iterable[StampedGrasp], path: str | Path) -> int:
    """Write trials as JSON lines; return how many.

    Raises:
        InvalidFileError: the file cannot be written.
    """
    count = 0
    with _complete_or_not_at_all(Path(path)) as file:
        for stamped in trials:
            json.dump(to_record(stamped), file, allow_nan=False, ensure_ascii=False)
            file.write("\n")
            count += 1
    return count


def write_csv(trials: Iterable[StampedGrasp], path: str | Path) -> int:
    """Write trials as CSV with a header; return how many.

    Raises:
        InvalidFileError: the file cannot be written.
    """
    count = 0
    with _complete_or_not_at_all(Path(path)) as file:
        writer = csv.DictWriter(file, CSV_COLUMNS)
        writer.writeheader()
        for stamped in trials:
            writer.writerow(_to_row(to_record(stamped)))
            count += 1
    return count


def _to_row(record: Record) -> Record:
    row = dict(record)
    row.update(zip(("px", "py", "pz"), row.pop("position"), strict=True))
    row.update(zip(("qx", "qy", "qz", "qw"), row.pop("quaternion_xyzw"), strict=True))
    for name in ("joint_names", "joint_positions", "contacts"):
        row[name] = json.dumps(row[name], ensure_ascii=False)
    row["force_closure"] = str(row["force_closure"]).lower()
    return row


def _from_row(row: Record) -> Record:
    record = dict(row)
    record["position"] = [float(row[name]) for name in ("px", "py", "pz")]
    record["quaternion_xyzw"] = [float(row[name]) for name in ("qx", "qy", "qz", "qw")]
    for name in ("joint_names", "joint_positions", "contacts", "force_closure"):
        record[name] = json.loads(row[name])
    for name in NUMBERS:
        record[name] = float(row[name]) if row[name] else None
    for name in NOISE_NUMBERS:
        convert = int if name == "noise_samples" else float
        record[name] = convert(row[name]) if row.get(name) else None
    record["stamp_ns"] = int(row["stamp_ns"])
    return record


def read_jsonl(path: str | Path) -> Iterator[StampedGrasp]:
    """Read trials from JSON lines; empty lines are left out.

    Raises:
        InvalidFileError: the file cannot be read; the message names the line that is wrong.
    """
    with _open(path) as file:
        for number, line in enumerate(file, start=1):
            if line.strip():
                yield _read(path, number, line, lambda text: from_record(_object(json.loads(text))))


def read_csv(path: str | Path) -> Iterator[StampedGrasp]:
    """Read trials from CSV; the columns may stand in any order.

    Raises:
        InvalidFileError: the file cannot be read; the message names the line that is wrong.
    """
    with _open(path) as file:
        reader = csv.DictReader(file)
        missing = set(CSV_COLUMNS) - set(NOISE_NUMBERS) - set(reader.fieldnames or ())
        if missing:
            raise InvalidFileError(f"{path}: these columns are missing: {', '.join(sorted(missing))}")
        for row in reader:
            yield _read(path, reader.line_num, row, lambda cells: from_record(_from_row(cells)))


def import_trials(archive: SolutionArchive, read: Callable[[], Iterable[StampedGrasp]]) -> int:
    """Store the trials of a file; return how many were new. A file with an error changes nothing.

    Args:
        archive: of the object that the trials are of.
        read: reads the file from its beginning, such as ``lambda: read_csv(path)``; it is called twice.

    Raises:
        InvalidFileError: the file cannot be read.
        ArchiveError: a trial is of another object or cannot be stored.
    """
    for stamped in read():
        archive.require_own(stamped)
    return archive.add_many(read())


def _object(value: object) -> Record:
    if not isinstance(value, dict):
        raise ValueError("a line must hold an object in braces")
    return value


@contextmanager
def _open(path: str | Path) -> Iterator[IO[str]]:
    try:
        with Path(path).open(encoding="utf-8", newline="") as file:
            yield file
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidFileError(f"cannot read {path}: {error}") from error


def _read(path: str | Path, line: int, content: Any, convert: Callable[[Any], StampedGrasp]) -> StampedGrasp:
    try:
        return convert(content)
    except (ValueError, TypeError, KeyError, RecursionError, InvalidFileError) as error:
        raise InvalidFileError(f"{path}, line {line}: {error}") from error
