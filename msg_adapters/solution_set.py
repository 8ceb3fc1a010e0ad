"""Sets of diverse grasps: ``SolutionSet``."""

from __future__ import annotations

from mebo_grasp_interfaces.msg import SolutionSet as SolutionSetMsg

from mebo_grasp.errors import InvalidMessageError
from mebo_grasp.solutions.solution_set import SolutionSet
from msg_adapters.checks import require_finite, require_frame
from msg_adapters.grasp import from_grasp_quality_msg, to_grasp_quality_msg
from msg_adapters.time import to_time_msg


def to_solution_set_msg(solutions: SolutionSet, stamp_ns: int) -> SolutionSetMsg:
    """Return the message of a set; its frame is the object's.

    Args:
        solutions: best first.
        stamp_ns: when the set was made, nanoseconds since the epoch.

    Raises:
        InvalidMessageError: a stamp does not fit into a message.
    """
    frame_id = solutions.object_id
    message = SolutionSetMsg(
        object_id=solutions.object_id,
        grasps=[to_grasp_quality_msg(stamped, frame_id) for stamped in solutions.grasps],
        diverse=solutions.diverse,
        mean_min_distance=float(solutions.mean_min_distance),
        mean_quality=float(solutions.mean_quality),
        qd=float(solutions.qd),
    )
    message.header.stamp = to_time_msg(stamp_ns)
    message.header.frame_id = frame_id
    return message


def from_solution_set_msg(message: SolutionSetMsg) -> SolutionSet:
    """Return the set of a message.

    Raises:
        WrongFrameError: the set or a grasp of it is given in another frame than its object's.
        InvalidPoseError: a pose or contact is not usable.
        InvalidMessageError: a number is not finite, or there are more diverse grasps than grasps.
    """
    require_frame(message.header.frame_id, message.object_id, "a solution set")
    grasps = tuple(from_grasp_quality_msg(grasp, message.object_id) for grasp in message.grasps)
    if message.diverse > len(grasps):
        raise InvalidMessageError(f"a set of {len(grasps)} grasps cannot have {message.diverse} diverse ones")
    return SolutionSet(
        message.object_id,
        grasps,
        int(message.diverse),
        require_finite(message.mean_min_distance, "mean_min_distance"),
        require_finite(message.mean_quality, "mean_quality"),
        require_finite(message.qd, "qd"),
    )
