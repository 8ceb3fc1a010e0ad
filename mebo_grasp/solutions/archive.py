"""The archive of trials: nothing that a robot paid for in trials is lost, and every question is quick."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from enum import IntEnum
from functools import lru_cache
from itertools import islice
from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import ArchiveError, InvalidHandError
from mebo_grasp.grasp import FloatArray, StampedGrasp
from mebo_grasp.solutions.best_grasp import BestGraspAnswer, BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.diversity import PoseMetric
from mebo_grasp.solutions.grasp_index import GraspIndex
from mebo_grasp.solutions.hand_volume import HandVolumeOf, PackedVolume
from mebo_grasp.solutions.occlusion import Occlusion
from mebo_grasp.solutions.solution_set import SolutionSet
from mebo_grasp.solutions.trial_store import Session, TrialStore

ADDED_AT_ONCE = 10_000
"""Trials of one transaction when many are added."""
READ_AT_ONCE = 1000
"""Trials that are in memory at a time when all are read."""
REMEMBERED = 2048
"""Returned grasps that are kept whole in memory."""
COMPLETED_AT_ONCE = 1000
"""Trials whose hand volume is added in one transaction."""


class AddStatus(IntEnum):
    """What became of an added trial; true when it was stored."""

    DUPLICATE = 0
    """A trial of this stamp is stored already; the first one stays."""
    STORED = 1
    """Stored."""
    IMPROVED = 2
    """Stored, and better than every grasp before."""


class SolutionArchive:
    """All trials of one object, on the disk and ready for questions.

    A trial is committed before ``add`` returns: it survives the death of the process at any instant.
    All methods may be called from several threads.

    Args:
        path: database file, created when absent, or ``":memory:"`` for an archive that is not kept.
        object_id: name of the object; one file may hold several objects.
        metric: distance between grasps.
        hand_volume: tells the room that the hand takes up in a grasp, for the rule ``HAND``; grasps that
            were stored without it are completed when the archive is opened.
        approach_axis: direction in which the TCP arrives, in its own frame, shape (3,).
        sync_each_trial: wait for the disk at each trial (some milliseconds), so that a loss of power
            loses no acknowledged trial either.

    Raises:
        ArchiveError: the file cannot be opened or written, is damaged, belongs to another program or is
            in use; it is left as it was.
    """

    def __init__(
        self,
        path: str | Path,
        object_id: str,
        metric: PoseMetric | None = None,
        *,
        hand_volume: HandVolumeOf | None = None,
        approach_axis: npt.ArrayLike = (0.0, 0.0, 1.0),
        sync_each_trial: bool = False,
    ) -> None:
        if not object_id:
            raise ArchiveError("an archive needs the name of its object, got an empty one")
        self.metric = PoseMetric() if metric is None else metric
        self._hand_volume = hand_volume
        self._approach_axis = _unit(approach_axis)
        self._guard = threading.RLock()
        self._store = TrialStore(path, object_id, sync_each_trial)
        # The best grasps are returned again and again.
        self._read = lru_cache(maxsize=REMEMBERED)(self._store.read)
        try:
            self._load()
        except BaseException:
            self._store.close()
            raise
        self._is_open = True

    def require_own(self, trial: StampedGrasp) -> StampedGrasp:
        """Return the trial, or refuse it when it is of another object.

        Raises:
            ArchiveError: it names another object.
        """
        object_id = trial.grasp.object_id
        if object_id and object_id != self.object_id:
            raise ArchiveError(f"a trial of '{object_id}' does not belong to the archive of '{self.object_id}'")
        return trial

    def _packed_volume(self, trial: StampedGrasp) -> PackedVolume | None:
        if self._hand_volume is None or not trial.grasp.quality > 0.0:
            return None
        return self._hand_volume(trial.grasp).packed()

    def _reload(self) -> None:
        self._index.close()
        del self._index  # so that two of them need not fit into memory
        self._read.cache_clear()
        self._load()

    def _load(self) -> None:
        by_hand = self._hand_volume is not None
        stored = self._store.load(by_hand)
        if by_hand and (missing := stored.without_volume()):
            self._complete_volumes(missing)
            del stored  # so that two of them need not fit into memory
            stored = self._store.load(by_hand)
        self._trials = stored.trials
        self._index = GraspIndex(stored)

    def _complete_volumes(self, stamps: list[int]) -> None:
        assert self._hand_volume is not None
        for begin in range(0, len(stamps), COMPLETED_AT_ONCE):
            self._store.store_volumes(
                (stamp, self._hand_volume(self._store.read(stamp).grasp).packed())
                for stamp in stamps[begin : begin + COMPLETED_AT_ONCE]
            )
        self._store.pack()

    @property
    def object_id(self) -> str:
        """Name of the object."""
        return self._store.object_id

    @property
    def path(self) -> str:
        """Database file, or ``":memory:"``."""
        return self._store.path

    def __len__(self) -> int:
        """Return how many trials are stored, failed ones included."""
        return self._trials

    def __enter__(self) -> SolutionArchive:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def grasps(self) -> Iterator[StampedGrasp]:
        """All stored trials, failed ones included, in the order of their stamps.

        Raises:
            ArchiveError: the archive is closed or damaged.
        """
        last = -1
        while True:
            with self._guard:
                self._require_open()
                group = self._store.read_after(last, READ_AT_ONCE)
            if not group:
                return
            yield from group
            last = group[-1].stamp_ns

    @property
    def sessions(self) -> tuple[Session, ...]:
        """The sessions in which trials of the object were stored, in the order of time.

        Raises:
            ArchiveError: the archive is closed or damaged.
        """
        with self._guard:
            self._require_open()
            return self._store.sessions()

    def add(self, trial: StampedGrasp) -> AddStatus:
        """Store a trial; when this returns, it is committed.

        Args:
            trial: of this archive's object; a trial without an object's name is taken for one.

        Raises:
            ArchiveError: the trial is of another object, or cannot be written; it is not stored then.
        """
        grasp = self.require_own(trial).grasp
        volume = self._packed_volume(trial)
        with self._guard:
            self._require_open()
            if not self._store.insert(trial, volume):
                return AddStatus.DUPLICATE
            self._trials += 1
            if not grasp.quality > 0.0:
                return AddStatus.STORED
            improved = grasp.quality > self._index.best_quality
            self._index.add(trial, volume)
            return AddStatus.IMPROVED if improved else AddStatus.STORED

    def read(self, stamp_ns: int) -> StampedGrasp:
        """Return one stored trial whole.

        Raises:
            ArchiveError: no trial of this stamp is stored, or the archive is closed or damaged.
        """
        with self._guard:
            self._require_open()
            return self._store.read(stamp_ns)

    def add_many(self, trials: Iterable[StampedGrasp]) -> int:
        """Store many trials at once, as an import does; return how many were new.

        They are committed in groups of ``ADDED_AT_ONCE``; a group is stored whole or not at all.

        Args:
            trials: of this archive's object.

        Raises:
            ArchiveError: a trial is of another object or cannot be written; the groups before stay.
        """
        added = 0
        remaining = iter(trials)
        with self._guard:
            self._require_open()
            while group := list(islice(remaining, ADDED_AT_ONCE)):
                added += self._store.insert_many(
                    [(trial, self._packed_volume(self.require_own(trial))) for trial in group]
                )
            self._store.pack()
            self._reload()
        return added

    def best(self, query: BestGraspQuery | None = None) -> BestGraspAnswer:
        """Return the best grasps that nothing blocks, of all that are stored.

        Args:
            query: what is wanted; by default the one best grasp.

        Raises:
            ArchiveError: the archive is closed or damaged.
        """
        query = BestGraspQuery() if query is None else query
        with self._guard:
            self._require_open()
            found = self._index.search(query, self.metric, self._approach_axis)
            grasps = tuple(self._read(stamp) for stamp in found.stamps_ns)
        counts: dict[str, int] = {}
        for occlusion, count in zip(query.occlusions, found.blocked, strict=True):
            if count:
                counts[occlusion.id] = counts.get(occlusion.id, 0) + int(count)
        return BestGraspAnswer(
            grasps,
            found.considered,
            int(found.blocked.sum()),
            tuple(counts.items()),
            query.ranking,
            found.passed_over,
        )

    def solution_set(
        self,
        size: int,
        min_distance: float,
        occlusions: tuple[Occlusion, ...] = (),
        rule: BlockingRule = BlockingRule.TCP,
        approach_length: float = 0.0,
    ) -> SolutionSet:
        """Return the best grasps that are mutually diverse, chosen greedily from all that are stored.

        Args:
            size: how many at most.
            min_distance: least mutual distance, metres.
            occlusions: regions in which no grasp may be used.
            rule: when a grasp counts as blocked.
            approach_length: under the rule ``HAND``, length of the approach path, metres.

        Raises:
            InvalidQueryError: a number is out of range, or the hand's volume is not known.
            ArchiveError: the archive is closed or damaged.
        """
        query = BestGraspQuery(occlusions, size, min_diversity=min_distance, rule=rule, approach_length=approach_length)
        answer = self.best(query)
        return SolutionSet.of(self.object_id, answer.grasps, min_distance, self.metric)

    def reset(self, object_id: str) -> int:
        """Delete every trial of the object; return how many there were.

        Args:
            object_id: the object's name again, as a guard against a slip.

        Raises:
            ArchiveError: the name is not this archive's object, or the trials cannot be deleted.
        """
        if object_id != self.object_id:
            raise ArchiveError(f"this archive keeps '{self.object_id}', not '{object_id}': nothing was deleted")
        with self._guard:
            self._require_open()
            deleted = self._store.delete_object()
            self._reload()
        return deleted

    def object_counts(self) -> dict[str, int]:
        """Return the number of trials of each object in the file.

        Raises:
            ArchiveError: the archive is closed or damaged.
        """
        with self._guard:
            self._require_open()
            return self._store.object_counts()

    def close(self) -> None:
        """Close the database; harmless when called again."""
        with self._guard:
            if self._is_open:
                self._is_open = False
                self._index.close()
                self._store.close()

    def _require_open(self) -> None:
        if not self._is_open:
            raise ArchiveError(f"the archive {self.path} is closed")


def _unit(direction: npt.ArrayLike) -> FloatArray:
    vector = np.array(direction, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise InvalidHandError(f"an approach axis needs three finite numbers, not all 0; got {vector.tolist()}")
    return vector / length
