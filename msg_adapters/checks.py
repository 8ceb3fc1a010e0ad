"""What every converter asks of a message before it becomes a value."""

from __future__ import annotations

import math

from mebo_grasp.errors import InvalidMessageError, WrongFrameError


def require_frame(frame_id: str, expected_frame: str, what: str) -> None:
    """Refuse a message that is given in another frame.

    Args:
        frame_id: frame named by the message; a leading slash, as ROS 1 wrote it, is ignored.
        expected_frame: frame that the receiver works in.
        what: name of the message, for the error.

    Raises:
        WrongFrameError: the frames differ.
    """
    if frame_id.lstrip("/") != expected_frame:
        raise WrongFrameError(
            f"{what} is given in frame '{frame_id}', expected is the object's frame '{expected_frame}'; "
            "transform it before sending"
        )


def require_finite(value: float, what: str) -> float:
    """Return the number, or refuse it when it is infinite or NaN.

    Raises:
        InvalidMessageError: the number is not finite.
    """
    number = float(value)
    if not math.isfinite(number):
        raise InvalidMessageError(f"{what} must be finite, got {number}")
    return number
