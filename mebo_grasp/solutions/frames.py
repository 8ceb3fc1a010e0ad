"""Named frames that stand still to one another: where is something that is given in another frame?"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from mebo_grasp.errors import InvalidFrameError
from mebo_grasp.grasp import Pose


@dataclass(frozen=True, eq=False)
class FrameTransform:
    """Where one frame is in another, for good.

    Args:
        parent: name of the frame that the pose is given in.
        child: name of the other frame.
        T_parent_child: pose of the child frame in the parent.

    Raises:
        InvalidFrameError: a name is empty, or both are the same.
    """

    parent: str
    child: str
    T_parent_child: Pose

    def __post_init__(self) -> None:
        # ROS 1 wrote frames with a leading slash.
        for name in ("parent", "child"):
            object.__setattr__(self, name, getattr(self, name).lstrip("/"))
        if not self.parent or not self.child or self.parent == self.child:
            raise InvalidFrameError(f"a transform needs two different frames, got '{self.parent}' and '{self.child}'")


class FrameTree:
    """Static transforms, as tf2 keeps them: a frame has one parent, of two the later one counts.

    Args:
        transforms: in any order, later ones replace earlier ones of the same child.
        further: links beside them, which replace nothing and are followed first.
    """

    def __init__(self, transforms: Iterable[FrameTransform] = (), further: Iterable[FrameTransform] = ()) -> None:
        by_child = {transform.child: transform for transform in transforms}
        self._transforms, self._further = tuple(by_child.values()), tuple(further)

    def updated(self, transforms: Iterable[FrameTransform]) -> FrameTree:
        """Return a tree in which these transforms replace those of the same children."""
        return FrameTree((*self._transforms, *transforms), self._further)

    def with_links(self, links: Iterable[FrameTransform]) -> FrameTree:
        """Return a tree that has these links as well; a frame may have another parent by them."""
        return FrameTree(self._transforms, (*links, *self._further))

    def lookup(self, target: str, source: str) -> Pose | None:
        """Return ``T_target_source``, the pose of one frame in another, or None where no way leads.

        Args:
            target: frame to express things in.
            source: frame that things are given in.
        """
        found = {target: Pose.identity()}
        waiting = deque([target])
        while waiting and source not in found:
            frame = waiting.popleft()
            for neighbour, T_frame_neighbour in self._neighbours(frame):
                if neighbour not in found:
                    found[neighbour] = found[frame] @ T_frame_neighbour
                    waiting.append(neighbour)
        return found.get(source)

    def _neighbours(self, frame: str) -> Iterable[tuple[str, Pose]]:
        for transform in (*self._further, *self._transforms):
            if transform.parent == frame:
                yield transform.child, transform.T_parent_child
            elif transform.child == frame:
                yield transform.parent, transform.T_parent_child.inverse()
