"""What epsilon costs and how exact it is, beside scipy's Qhull on the same wrench sets."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mebo_grasp.benchmarks.figures import EDGES, Target, timed
from mebo_grasp.grasp import FloatArray, Grasp
from mebo_grasp.grasping import wrench_space
from mebo_grasp.grasping.quality import torque_length
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import TrialSettings

MOST_HULLS = 60
"""Wrench sets given to Qhull as well; it is slow."""
REPETITIONS = 40
QHULL_REPETITIONS = 4
LARGE_EVERY = 1000
"""One set in so many has 16 to 60 contacts: Qhull takes seconds for it."""


def qhull_epsilon(wrenches: FloatArray) -> float:
    """Return epsilon from the whole hull, as scipy computes it: the peer."""
    try:
        return max(0.0, float(-ConvexHull(wrenches).equations[:, -1].max()))
    except QhullError:
        return 0.0


def print_peer(label: str, sets: Sequence[FloatArray], again: int) -> None:
    """Print the time of the own search beside Qhull's on the same wrench sets."""
    wrench_space.epsilon(sets[0])
    own_values, own = timed(wrench_space.epsilon, list(sets) * again)
    peer_values, peer = timed(qhull_epsilon, sets)
    apart = float(np.abs(np.array(own_values[: len(sets)]) - peer_values).max())
    low, middle, high = 1e3 * np.quantile(own.cpu, [0.05, 0.5, 0.95])
    ratio = peer.cpu.mean() / own.cpu.mean()
    print(
        f"{label} ({len(sets)} sets): CPU ms median {middle:.3f}, 5-95 % {low:.3f} to {high:.3f}, mean "
        f"{1e3 * own.cpu.mean():.3f} (wall {1e3 * own.wall.mean():.3f}); Qhull mean "
        f"{1e3 * peer.cpu.mean():.3f} (wall {1e3 * peer.wall.mean():.3f}); ratio of means {ratio:.1f}; "
        f"largest difference of epsilon {apart:.1e}"
    )


def wrenches_of(grasp: Grasp, target: TargetObject) -> FloatArray:
    """Return the wrench set of a grasp under the default settings."""
    settings = TrialSettings(cone_edges=EDGES)
    positions = np.array([contact.position for contact in grasp.contacts])
    normals = np.array([contact.normal for contact in grasp.contacts])
    return wrench_space.contact_wrenches(
        positions,
        normals,
        settings.friction,
        settings.cone_edges,
        target.center_of_mass,
        torque_length(target, settings),
    )


def drawn_wrenches(target: TargetObject, contacts: int, rng: np.random.Generator) -> FloatArray:
    """Return wrenches in force closure of contacts drawn over the object's surface."""
    areas = np.asarray(target.mesh.area_faces)
    length = torque_length(target, TrialSettings())
    while True:
        faces = rng.choice(len(areas), contacts, p=areas / areas.sum())
        points, inward = target.mesh.triangles_center[faces], -target.mesh.face_normals[faces]
        wrenches = wrench_space.contact_wrenches(
            points, inward, TrialSettings().friction, EDGES, target.center_of_mass, length
        )
        if wrench_space.force_closure(wrench_space.epsilon(wrenches)):
            return wrenches


def bench_epsilon(target: TargetObject, grasps: Sequence[Grasp], seed: int) -> None:
    """Print what epsilon costs, on the wrenches of the trials and on drawn contacts."""
    rng = np.random.default_rng(seed)
    print(f"epsilon, {EDGES} edges a contact, own search beside scipy's Qhull:")
    closed = [wrenches_of(grasp, target) for grasp in grasps if grasp.force_closure]
    rest = [wrenches_of(grasp, target) for grasp in grasps if grasp.contacts and not grasp.force_closure]
    for label, sets in (("trials in force closure", closed), ("other trials with contacts", rest)):
        if sets:
            print_peer(f"  {label}", sets[:MOST_HULLS], 3)
    for contacts in (6, 15):
        sets = [drawn_wrenches(target, contacts, rng) for _ in range(QHULL_REPETITIONS)]
        print_peer(f"  {contacts} contacts in force closure", sets, REPETITIONS // QHULL_REPETITIONS)
        _, spent = timed(wrench_space.epsilon, sets * (REPETITIONS // QHULL_REPETITIONS))
        asked = Target("mean CPU ms", 0.3 if contacts == 6 else 1.0, at_least=False)
        print(f"    {asked.verdict(1e3 * float(spent.cpu.mean()))}")


Contacts = tuple[FloatArray, FloatArray]
"""Points and unit normals, each (n, 3)."""


def spread(n: int, rng: np.random.Generator) -> Contacts:
    """Draw contacts at random points with random normals."""
    normals = rng.normal(size=(n, 3))
    return rng.uniform(-0.08, 0.08, (n, 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def in_a_plane(n: int, rng: np.random.Generator) -> Contacts:
    """Draw contacts whose points and normals lie in one plane through the centre."""
    points, normals = spread(n, rng)
    points[:, 2] = normals[:, 2] = 0.0
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def on_a_line(n: int, rng: np.random.Generator) -> Contacts:
    """Draw contacts on one line through the centre."""
    points, normals = spread(n, rng)
    points[:, 1:] = 0.0
    return points, normals


def alike(n: int, rng: np.random.Generator) -> Contacts:
    """Draw contacts of which about half are the same as others."""
    points, normals = spread(n, rng)
    which = rng.integers(0, (n + 1) // 2, n)
    return points[which], normals[which]


def facing(n: int, rng: np.random.Generator) -> Contacts:
    """Draw contacts in pairs that face each other, as of two jaws on a box."""
    points, _ = spread(n, rng)
    normals = np.zeros((n, 3))
    side = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    points[:, 0], normals[:, 0] = -0.04 * side, side
    return points, normals


KINDS: tuple[Callable[[int, np.random.Generator], Contacts], ...] = (spread, in_a_plane, on_a_line, alike, facing)


def random_wrenches(index: int, rng: np.random.Generator) -> tuple[str, FloatArray]:
    """Draw set number ``index``: every second one spread, the others degenerate by turns; return its kind too."""
    kind = KINDS[0] if index % 2 == 0 else KINDS[1 + (index // 2) % (len(KINDS) - 1)]
    large = index % LARGE_EVERY == LARGE_EVERY // 2
    contacts = int(rng.integers(16, 61)) if large else int(rng.integers(1, 16))
    edges = int(rng.integers(3, 5)) if large else int(rng.integers(3, 11))
    wrenches = wrench_space.contact_wrenches(
        *kind(contacts, rng), float(rng.uniform(0.1, 1.2)), edges, np.zeros(3), 0.08
    )
    return kind.__name__, wrenches


def bench_exactness(sets: int, seed: int) -> None:
    """Print the largest difference of epsilon from Qhull's over random contact sets, by kind."""
    rng = np.random.default_rng(seed)
    worst = dict.fromkeys((kind.__name__ for kind in KINDS), 0.0)
    count, closed, most = dict.fromkeys(worst, 0), 0, 0
    for index in range(sets):
        kind, wrenches = random_wrenches(index, rng)
        own, peer = wrench_space.epsilon(wrenches), qhull_epsilon(wrenches)
        worst[kind] = max(worst[kind], abs(own - peer))
        count[kind] += 1
        closed, most = closed + (peer > wrench_space.FORCE_CLOSURE_EPSILON), max(most, len(wrenches))
    print(f"epsilon of {sets} random contact sets ({closed} in force closure, up to {most} wrenches), seed {seed}:")
    for kind, value in worst.items():
        print(f"  {kind.replace('_', ' ')} ({count[kind]} sets): largest difference from Qhull {value:.1e}")
    print(f"  {Target('largest difference from Qhull', 1e-9, False).verdict(max(worst.values()))}")
