"""``solution_set_node``: stores every trial, keeps the diverse grasps and answers what is best now."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray, PoseStamped
from mebo_grasp_interfaces.msg import GraspQuality, OcclusionArray
from mebo_grasp_interfaces.msg import Occlusion as OcclusionMsg
from mebo_grasp_interfaces.msg import SolutionSet as SolutionSetMsg
from mebo_grasp_interfaces.srv import GetBestGrasp, GetSolutionSet, ResetArchive
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from mebo_grasp.errors import InvalidMessageError, InvalidQueryError, MeboGraspError, WrongFrameError
from mebo_grasp.grasp import Grasp, StampedGrasp
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.target_object import object_id_of
from mebo_grasp.hand_volumes import HandVolumes
from mebo_grasp.nodes import markers, qos
from mebo_grasp.nodes.known_frames import KnownFrames
from mebo_grasp.nodes.parameters import declare
from mebo_grasp.nodes.runtime import STEADY_CLOCK, guarded, guarded_service, run_node
from mebo_grasp.nodes.settings import LARGEST_ANSWER, SolutionSetNodeSettings
from mebo_grasp.solutions.archive import AddStatus, SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspAnswer, BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.diversity import PoseMetric
from mebo_grasp.solutions.occlusion import Occlusion
from mebo_grasp.solutions.ranking import DEFAULT_QUANTILE, Ranking
from mebo_grasp.solutions.solution_set import SolutionSet
from msg_adapters.grasp import from_grasp_quality_msg, to_grasp_quality_msg
from msg_adapters.occlusion import from_occlusion_msgs
from msg_adapters.pose import to_pose_array_msg, to_pose_stamped_msg
from msg_adapters.solution_set import to_solution_set_msg
from msg_adapters.time import to_time_msg

MESSAGES = 2048
"""Messages of returned grasps that are kept: the best ones are asked for again and again."""

SAME_POSE = 1e-9
"""Largest difference between the matrices of two poses of one trial that came twice."""

_RANKINGS = {
    GetBestGrasp.Request.RANK_OBSERVED: Ranking.OBSERVED,
    GetBestGrasp.Request.RANK_EXPECTED: Ranking.EXPECTED,
    GetBestGrasp.Request.RANK_WORST: Ranking.WORST,
    GetBestGrasp.Request.RANK_QUANTILE: Ranking.QUANTILE,
}


def default_database(object_id: str) -> Path:
    """Return the file in which the trials of an object are stored when none is named."""
    home = os.environ.get("ROS_HOME") or str(Path.home() / ".ros")
    return Path(home) / "mebo_grasp" / f"{object_id}.db"


class SolutionSetNode(Node):
    """Subscribes to ``grasp_quality`` and ``occlusions``; publishes the set and serves the best grasp.

    Raises:
        MeboGraspError: a parameter is not usable, or the database cannot be opened.
    """

    def __init__(self) -> None:
        super().__init__("solution_set_node")
        self._settings = declare(self, SolutionSetNodeSettings)
        self._object_id = object_id_of(self._settings.object)
        self._rule = BlockingRule(self._settings.occlusion_rule)
        self._occlusions: tuple[Occlusion, ...] = ()
        self._heard = OcclusionArray()
        self._frames = KnownFrames(self, self._settings.static_transforms, self._reread_occlusions)
        self._set_changed = self._markers_changed = True
        self._published_best: int | None = None
        self._quality_to_beat = 0.0
        self._shown: list[Grasp] = []
        self._message_of = lru_cache(MESSAGES)(self._make_message)
        self._open_archive()
        self._advertise()
        self._publish_best()
        self._publish_set()

    def _open_archive(self) -> None:
        path = Path(self._settings.database or default_database(self._object_id))
        path.parent.mkdir(parents=True, exist_ok=True)
        axis = self._settings.symmetry_axis
        metric = PoseMetric(self._settings.rotation_weight, (axis[0], axis[1], axis[2]) if axis else None)
        self._hand = HandModel.load(self._settings.hand)
        start, own_start = time.perf_counter(), time.process_time()
        self._archive = SolutionArchive(
            path,
            self._object_id,
            metric,
            hand_volume=HandVolumes([self._hand], self._tell_unknown_hand),
            approach_axis=self._settings.approach_axis or self._hand.approach_axis,
            sync_each_trial=self._settings.sync_each_trial,
        )
        self.get_logger().info(
            f"{len(self._archive)} trials of '{self._object_id}' in {path} "
            f"(opened in {time.perf_counter() - start:.2f} s; {time.process_time() - own_start:.2f} s of "
            "processor time)"
        )

    def _tell_unknown_hand(self, name: str) -> None:
        self.get_logger().warning(
            f"a trial was made by hand '{name}', whose volume is not known: that of '{self._settings.hand}' "
            "is taken; give the description of the hand by the parameter 'hand'"
        )

    def _advertise(self) -> None:
        self._best_publisher = self.create_publisher(PoseStamped, "best_grasp", qos.LATCHED)
        self._set_publisher = self.create_publisher(SolutionSetMsg, "solution_set", qos.LATCHED)
        self._poses_publisher = self.create_publisher(PoseArray, "solution_poses", qos.LATCHED)
        self._marker_publisher = self.create_publisher(MarkerArray, "solution_markers", qos.LATCHED)
        self.create_service(GetBestGrasp, "get_best_grasp", self._on_get_best_grasp)
        self.create_service(GetSolutionSet, "get_solution_set", self._on_get_solution_set)
        self.create_service(ResetArchive, "~/reset", self._on_reset)
        self.create_subscription(OcclusionArray, "occlusions", self._on_occlusions, qos.LATCHED)
        self.create_subscription(GraspQuality, "grasp_quality", self._on_quality, qos.QUALITIES)
        self.create_timer(1.0 / self._settings.publish_rate, self._on_publish_timer, clock=STEADY_CLOCK)
        self.create_timer(1.0 / self._settings.marker_rate, self._on_marker_timer, clock=STEADY_CLOCK)

    @guarded
    def _on_quality(self, message: GraspQuality) -> None:
        if message.object_id and message.object_id != self._object_id:
            return  # another exploration on the same topic
        trial = from_grasp_quality_msg(message, expected_frame=self._object_id)
        if trial.stamp_ns == 0:
            raise InvalidMessageError("a stamp of 0 names no trial: send the header of the candidate back")
        status = self._archive.add(trial)
        if status is AddStatus.DUPLICATE:
            self._compare_with_stored(trial)
            return
        self._set_changed = True
        # What is no better than the best free grasp cannot take its place.
        if trial.grasp.quality > self._quality_to_beat:
            self._publish_best()

    def _compare_with_stored(self, trial: StampedGrasp) -> None:
        # Hands send their old answers again to late subscribers; only another trial is worth a word.
        known = self._archive.read(trial.stamp_ns).grasp.T_object_tcp
        if not np.allclose(known.matrix, trial.grasp.T_object_tcp.matrix, rtol=0.0, atol=SAME_POSE):
            self.get_logger().warning(
                f"not stored: another trial has the stamp {trial.stamp_ns} ns already; give each candidate its own"
            )

    @guarded
    def _on_occlusions(self, message: OcclusionArray) -> None:
        self._heard = message
        self._reread_occlusions()

    def _reread_occlusions(self) -> None:
        """Take the occlusions of the newest array as the frames lie that are known now."""
        self._occlusions = self._to_occlusions(self._heard.occlusions)
        self._publish_best()
        self._publish_set()

    def _to_occlusions(self, messages: Iterable[OcclusionMsg]) -> tuple[Occlusion, ...]:
        margin = self._settings.occlusion_margin
        occlusions = from_occlusion_msgs(messages, self._object_id, self._frames.tree)
        if margin == 0.0:
            return occlusions
        return tuple(replace(occlusion, margin=occlusion.margin + margin) for occlusion in occlusions)

    @guarded_service(GetBestGrasp.Response.INTERNAL_ERROR)
    def _on_get_best_grasp(
        self, request: GetBestGrasp.Request, response: GetBestGrasp.Response
    ) -> GetBestGrasp.Response:
        try:
            query = self._to_query(request)
        except WrongFrameError as error:
            return _refuse(response, response.WRONG_FRAME, error)
        except MeboGraspError as error:
            return _refuse(response, response.INVALID_REQUEST, error)
        answer = self._archive.best(query)
        response.considered, response.occluded = answer.considered, answer.occluded
        response.blocked_by = [name for name, _ in answer.blocked_by]
        response.blocked = [count for _, count in answer.blocked_by]
        response.grasps = [self._message_of(grasp) for grasp in answer.grasps]
        if not answer.grasps:
            blocked = answer.considered > 0
            response.error_code = response.ALL_OCCLUDED if blocked else response.NO_GRASP_STORED
        response.passed_over = answer.passed_over
        response.message = answer.explanation or answer.remark
        return response

    def _make_message(self, stamped: StampedGrasp) -> GraspQuality:
        return to_grasp_quality_msg(stamped, self._object_id)

    def _to_query(self, request: GetBestGrasp.Request) -> BestGraspQuery:
        rules = {
            request.RULE_OF_NODE: self._rule,
            request.RULE_TCP: BlockingRule.TCP,
            request.RULE_HAND: BlockingRule.HAND,
        }
        if request.rule not in rules:
            raise InvalidMessageError(
                f"rule {request.rule} is unknown; use RULE_OF_NODE={request.RULE_OF_NODE}, "
                f"RULE_TCP={request.RULE_TCP} or RULE_HAND={request.RULE_HAND}"
            )
        if request.ranking not in _RANKINGS:
            known_rankings = ", ".join(f"RANK_{name.name}={value}" for value, name in _RANKINGS.items())
            raise InvalidMessageError(f"ranking {request.ranking} is unknown; known are {known_rankings}")
        _require_answerable("max_grasps", request.max_grasps)
        known = () if request.ignore_known else self._occlusions
        return BestGraspQuery(
            occlusions=(*known, *self._to_occlusions(request.occlusions)),
            max_grasps=request.max_grasps or 1,
            min_quality=request.min_quality,
            min_diversity=request.min_diversity,
            rule=rules[request.rule],
            approach_length=self._settings.approach_length,
            ranking=_RANKINGS[request.ranking],
            quantile=request.quantile or DEFAULT_QUANTILE,
        )

    @guarded_service(GetSolutionSet.Response.INTERNAL_ERROR)
    def _on_get_solution_set(
        self, request: GetSolutionSet.Request, response: GetSolutionSet.Response
    ) -> GetSolutionSet.Response:
        distance = request.min_diversity or self._settings.min_distance
        try:
            _require_answerable("size", request.size)
            solutions = self._archive.solution_set(request.size or self._settings.size, distance)
        except (InvalidMessageError, InvalidQueryError) as error:
            return _refuse(response, response.INVALID_REQUEST, error)
        response.solution_set = self._to_message(solutions)
        if not solutions.grasps:
            response.error_code = response.NO_GRASP_STORED
            response.message = f"no grasp of '{self._object_id}' with a quality above 0 is stored yet"
        return response

    @guarded_service(ResetArchive.Response.INTERNAL_ERROR)
    def _on_reset(self, request: ResetArchive.Request, response: ResetArchive.Response) -> ResetArchive.Response:
        if request.object_id != self._object_id:
            error = f"object_id is '{request.object_id}', but this node keeps '{self._object_id}'"
            return _refuse(response, response.WRONG_OBJECT, error)
        response.deleted = self._archive.reset(self._object_id)
        self.get_logger().warning(f"{response.deleted} trials of '{self._object_id}' were deleted on request")
        self._publish_best()
        self._publish_set()
        return response

    @guarded
    def _on_publish_timer(self) -> None:
        if self._set_changed:
            self._publish_set()

    @guarded
    def _on_marker_timer(self) -> None:
        # Markers are large and for the eye: they come less often than the set itself.
        if self._markers_changed:
            self._markers_changed = False
            array = markers.solution_markers(self._shown, self._occlusions, self._object_id, self._hand)
            self._marker_publisher.publish(array)

    def _publish_best(self) -> None:
        answer = self._archive.best(
            BestGraspQuery(self._occlusions, rule=self._rule, approach_length=self._settings.approach_length)
        )
        best = answer.grasps[0] if answer.grasps else None
        self._quality_to_beat = 0.0 if best is None else best.grasp.quality
        stamp_ns = None if best is None else best.stamp_ns
        if stamp_ns == self._published_best:
            return
        self._published_best = stamp_ns
        if best is None:
            self._tell_that_none_is_left(answer)
        else:
            self._best_publisher.publish(to_pose_stamped_msg(best.stamp_ns, self._object_id, best.grasp.T_object_tcp))

    def _tell_that_none_is_left(self, answer: BestGraspAnswer) -> None:
        self.get_logger().warning(f"best_grasp: {answer.explanation}")
        # The topic is latched: without this a late subscriber would use the grasp that is now blocked.
        self._best_publisher.publish(no_grasp_msg(self._now_ns(), self._object_id))

    def _publish_set(self) -> None:
        self._set_changed = False
        solutions = self._archive.solution_set(
            self._settings.size,
            self._settings.min_distance,
            self._occlusions,
            self._rule,
            self._settings.approach_length,
        )
        self._set_publisher.publish(self._to_message(solutions))
        self._shown = [stamped.grasp for stamped in solutions.grasps]
        poses = [grasp.T_object_tcp for grasp in self._shown]
        self._poses_publisher.publish(to_pose_array_msg(self._now_ns(), self._object_id, poses))
        self._markers_changed = True

    def _to_message(self, solutions: SolutionSet) -> SolutionSetMsg:
        message = to_solution_set_msg(solutions, self._now_ns())
        message.stored = len(self._archive)
        return message

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def destroy_node(self) -> None:
        """Close the database, then the node."""
        self._archive.close()
        super().destroy_node()


def no_grasp_msg(stamp_ns: int, frame_id: str) -> PoseStamped:
    """Return the message that says on ``best_grasp`` that no grasp is left: a position of NaN."""
    message = PoseStamped()
    message.header.stamp = to_time_msg(stamp_ns)
    message.header.frame_id = frame_id
    message.pose.position.x = message.pose.position.y = message.pose.position.z = math.nan
    return message


def _require_answerable(what: str, number: int) -> None:
    if number > LARGEST_ANSWER:
        raise InvalidMessageError(
            f"{what} is {number}, but at most {LARGEST_ANSWER} grasps are sent at once; ask for fewer, or read all "
            "from the database by `mebo-grasp export`"
        )


def _refuse(response: Any, error_code: int, reason: object) -> Any:
    response.error_code = error_code
    response.message = str(reason)
    return response


def main() -> None:
    """Run the node until it is stopped."""
    run_node(SolutionSetNode)


if __name__ == "__main__":
    main()
