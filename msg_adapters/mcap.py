"""Trials as MCAP files of ``GraspQuality`` messages, as rosbag2 and Foxglove read them.

The schema of the messages is part of the file: a reader needs neither this package nor ROS.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer

from mebo_grasp.errors import InvalidFileError, MeboGraspError
from mebo_grasp.grasp import StampedGrasp
from msg_adapters.grasp import from_grasp_quality_msg, to_grasp_quality_msg

TOPIC = "/grasp_quality"
TYPE = "mebo_grasp_interfaces/msg/GraspQuality"
SEPARATOR = "=" * 80


def message_definition(message_type: str = TYPE) -> str:
    """Return the definition of a message type and of all types in it, in the ``ros2msg`` format.

    Args:
        message_type: such as ``std_msgs/msg/Header``.
    """
    texts = {message_type: _text_of(message_type)}
    waiting = [message_type]
    while waiting:
        name = waiting.pop()
        for part in _types_in(name, texts[name]):
            if part not in texts:
                texts[part] = _text_of(part)
                waiting.append(part)
    first, *others = texts.items()
    blocks = [first[1]]
    for name, text in others:
        package, _, short = name.split("/")
        blocks.append(f"{SEPARATOR}\nMSG: {package}/{short}\n{text}")
    return "\n".join(blocks)


def _text_of(message_type: str) -> str:
    package, kind, name = message_type.split("/")
    file = Path(get_package_share_directory(package)) / kind / f"{name}.msg"
    return file.read_text(encoding="utf-8")


def _types_in(message_type: str, text: str) -> Iterator[str]:
    package = message_type.split("/")[0]
    for line in text.splitlines():
        field = line.split("#")[0].split()
        if len(field) < 2:
            continue
        name = field[0].split("[")[0].split("<")[0]
        if "/" in name:
            yield f"{name.split('/')[0]}/msg/{name.split('/')[-1]}"
        elif name[0].isupper():
            yield f"{package}/msg/{name}"


def write_mcap(trials: Iterable[StampedGrasp], path: str | Path, frame_id: str) -> int:
    """Write trials as messages on the topic ``/grasp_quality``, logged at their stamps; return how many.

    Args:
        trials: in the order of their stamps.
        path: file; it is there only when it is complete.
        frame_id: the object's frame.

    Raises:
        InvalidFileError: the file cannot be written.
    """
    path, count = Path(path), 0
    unfinished = path.with_name(path.name + ".part")
    try:
        with unfinished.open("wb") as file:
            writer = Writer(file)
            schema = writer.register_msgdef(TYPE, message_definition())
            for count, stamped in enumerate(trials, start=1):  # noqa: B007
                writer.write_message(TOPIC, schema, to_grasp_quality_msg(stamped, frame_id), stamped.stamp_ns)
            writer.finish()  # type: ignore[no-untyped-call]
        os.replace(unfinished, path)
    except OSError as error:
        raise InvalidFileError(f"cannot write {path}: {error.strerror}") from error
    finally:
        unfinished.unlink(missing_ok=True)
    return count


def read_mcap(path: str | Path, expected_frame: str | None, topic: str = TOPIC) -> Iterator[StampedGrasp]:
    """Read the trials of one topic.

    Args:
        path: file, as written here or recorded by rosbag2.
        expected_frame: the object's frame; None takes that of the messages.
        topic: to be read, all others are left out.

    Raises:
        InvalidFileError: the file cannot be read or holds a message that is no trial.
    """
    try:
        with Path(path).open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            messages = reader.iter_decoded_messages(topics=[topic])
            for number, (_, _, _, message) in enumerate(messages, start=1):
                yield _trial(message, f"{path}, message {number} of {topic}", expected_frame)
    except InvalidFileError:
        raise
    except Exception as error:
        # A broken file makes the reader fail in many ways: its own errors, those of struct and zstandard.
        raise InvalidFileError(f"cannot read {path}: {type(error).__name__} {error}") from error


def _trial(message: Any, where: str, expected_frame: str | None) -> StampedGrasp:
    try:
        return from_grasp_quality_msg(message, expected_frame or message.header.frame_id)
    except (MeboGraspError, AttributeError) as error:
        raise InvalidFileError(f"{where}: {error}") from error
