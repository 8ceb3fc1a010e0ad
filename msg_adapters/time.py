"""Stamps and durations: ``builtin_interfaces`` messages and nanoseconds or seconds."""

from __future__ import annotations

from builtin_interfaces.msg import Duration, Time

from mebo_grasp.errors import InvalidMessageError
from msg_adapters.checks import require_finite

NS_PER_S = 1_000_000_000
LAST_SECOND = 2**31 - 1
"""Seconds are a signed 32-bit number in both messages."""


def to_time_msg(stamp_ns: int) -> Time:
    """Return the time message of a stamp.

    Args:
        stamp_ns: nanoseconds since the epoch, at least 0.

    Raises:
        InvalidMessageError: the stamp does not fit into the message.
    """
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    if not 0 <= seconds <= LAST_SECOND:
        raise InvalidMessageError(f"stamp {stamp_ns} ns is outside 0 to {LAST_SECOND} s")
    return Time(sec=seconds, nanosec=nanoseconds)


def from_time_msg(message: Time) -> int:
    """Return the stamp of a time message, nanoseconds.

    Raises:
        InvalidMessageError: the seconds are negative or the nanoseconds make up a second.
    """
    if message.sec < 0 or not 0 <= message.nanosec < NS_PER_S:
        raise InvalidMessageError(
            f"stamp sec={message.sec} nanosec={message.nanosec} is not a time: sec must be at least 0 "
            f"and nanosec below {NS_PER_S}"
        )
    return int(message.sec) * NS_PER_S + int(message.nanosec)


def to_duration_msg(seconds: float) -> Duration:
    """Return the duration message of a time span, rounded to nanoseconds.

    Raises:
        InvalidMessageError: the time span is not finite or does not fit into the message.
    """
    total = round(require_finite(seconds, "a duration") * NS_PER_S)
    whole, nanoseconds = divmod(total, NS_PER_S)
    if not -LAST_SECOND - 1 <= whole <= LAST_SECOND:
        raise InvalidMessageError(f"duration {seconds} s is beyond {LAST_SECOND} s")
    return Duration(sec=whole, nanosec=nanoseconds)


def from_duration_msg(message: Duration) -> float:
    """Return the time span of a duration message, seconds."""
    return float(message.sec) + float(message.nanosec) / NS_PER_S
