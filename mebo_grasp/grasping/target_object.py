"""The object to be grasped: its surface, its solid as convex parts, and checks of its size and soundness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import trimesh

from mebo_grasp.errors import InvalidObjectError
from mebo_grasp.grasping.builtin_objects import BUILDERS, Shape
from mebo_grasp.grasping.decomposition import convex_parts

FloatArray = npt.NDArray[np.float64]

ConcaveShape = Literal["surface", "parts"]
CONCAVE_SHAPES: tuple[str, ...] = ("surface", "parts")
"""What stands for a concave mesh in trials: its own surface, or convex parts that fill it."""

BUILTIN_OBJECTS: tuple[str, ...] = tuple(BUILDERS)

SMALLEST_SIZE = 0.01
LARGEST_SIZE = 1.0
"""Range of the longest side of the bounding box, metres: what a hand of human size can meet."""
SMALLEST_THICKNESS = 0.0005
MOST_FACES = 1_000_000
CONVEX_SHARE = 0.985
"""A closed mesh that fills this share of its convex hull is taken for convex."""
MOST_PART_VERTICES = 100_000
"""A finer hull is known by its surface: PyBullet takes no convex shape of more than 131,072 vertices."""
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".3mf", ".dae")


@dataclass(frozen=True, eq=False)
class TargetObject:
    """A rigid object in its own frame.

    Args:
        object_id: name of the object.
        mesh: surface for display and for the sampling of faces, metres.
        solid_parts: convex parts whose union is the solid, each (n, 3) vertices in metres; empty when the
            object is known by its surface only.
        symmetry_axis: unit axis of rotational symmetry through the centre of the box, or None.

    Raises:
        InvalidObjectError: the mesh is empty, flat, not finite, or of implausible size.
    """

    object_id: str
    mesh: trimesh.Trimesh
    solid_parts: tuple[FloatArray, ...] = ()
    symmetry_axis: FloatArray | None = None

    def __post_init__(self) -> None:
        check_mesh(self.mesh, self.object_id)

    @classmethod
    def builtin(cls, name: str, scale: float = 1.0) -> TargetObject:
        """Return one of the ``BUILTIN_OBJECTS``, scaled about the centre of its box.

        Raises:
            InvalidObjectError: the name is unknown, or the scale is not a positive finite number.
        """
        if name not in BUILDERS:
            raise InvalidObjectError(
                f"unknown object '{name}'; the built-in ones are {', '.join(BUILTIN_OBJECTS)}, "
                f"or give a mesh file ({', '.join(MESH_SUFFIXES)})"
            )
        check_scale(scale, name)
        shape: Shape = BUILDERS[name]()
        mesh = shape.mesh.copy()
        mesh.apply_scale(scale)
        axis = None if shape.symmetry_axis is None else np.array(shape.symmetry_axis)
        return cls(name, mesh, tuple(part * scale for part in shape.convex_parts), axis)

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        scale: float = 1.0,
        object_id: str | None = None,
        concave: ConcaveShape = "surface",
    ) -> TargetObject:
        """Load a mesh file; its coordinates times ``scale`` are metres; ``concave`` as in ``from_mesh``.

        Raises:
            InvalidObjectError: the file is missing or unreadable, or the mesh is unsound.
        """
        name = object_id or object_id_of(path)
        check_scale(scale, str(path))
        mesh = load_mesh(Path(path))
        try:
            check_finite(mesh, name)
            mesh.merge_vertices()
            mesh.update_faces(mesh.nondegenerate_faces())
            mesh.remove_unreferenced_vertices()
            mesh.apply_scale(scale)
            return cls.from_mesh(mesh, name, concave)
        except InvalidObjectError as error:
            raise InvalidObjectError(f"mesh file '{path}': {error}") from error

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh, object_id: str, concave: ConcaveShape = "surface") -> TargetObject:
        """Wrap a mesh in metres; a closed mesh that is nearly convex becomes one solid part.

        Args:
            mesh: the surface.
            object_id: name of the object.
            concave: "surface": any other mesh is known by its surface, which is exact; "parts": it is replaced by
                convex parts (``decomposition``), where these can be found.

        Raises:
            InvalidObjectError: the mesh is unsound, or ``concave`` unknown.
        """
        check_mesh(mesh, object_id)
        check_concave(concave)
        if mesh.is_watertight:
            hull = mesh.convex_hull
            nearly_convex = abs(mesh.volume) >= CONVEX_SHARE * hull.volume
            if nearly_convex and len(hull.vertices) <= MOST_PART_VERTICES:
                return cls(object_id, mesh, (np.array(hull.vertices),))
        parts = convex_parts(mesh, object_id) if concave == "parts" else ()
        if parts:
            hulls = [trimesh.PointCloud(part).convex_hull for part in parts]
            return cls(object_id, trimesh.util.concatenate(hulls), parts)
        return cls(object_id, mesh)

    @classmethod
    def load(cls, name_or_path: str | Path, scale: float = 1.0, concave: ConcaveShape = "surface") -> TargetObject:
        """Return a built-in object by name, or else load the file of that path; ``concave`` as in ``from_mesh``.

        Raises:
            InvalidObjectError: neither a built-in name nor a readable, sound mesh file, or ``concave`` unknown.
        """
        check_concave(concave)
        name = str(name_or_path)
        if name in BUILDERS or not Path(name).suffix:
            return cls.builtin(name, scale)
        return cls.from_file(name_or_path, scale, concave=concave)

    @cached_property
    def bounds(self) -> FloatArray:
        """Corners of the axis-aligned box in the object frame, shape (2, 3), metres."""
        return np.array(self.mesh.bounds, dtype=np.float64)

    @property
    def extents(self) -> FloatArray:
        """Sides of the axis-aligned box, shape (3,), metres."""
        bounds = self.bounds
        return bounds[1] - bounds[0]

    @cached_property
    def longest_side(self) -> float:
        """Longest side of the axis-aligned box, metres."""
        return float(self.extents.max())

    @cached_property
    def convex_parts(self) -> list[FloatArray]:
        """Convex parts that stand for the solid, each (n, 3) vertices; the hull if nothing finer is known."""
        return list(self.solid_parts) or [np.array(self.mesh.convex_hull.vertices)]

    @cached_property
    def parts_surface(self) -> trimesh.Trimesh:
        """The surfaces of all convex parts together, those inside other parts included; the mesh without parts."""
        if not self.solid_parts:
            return self.mesh
        return trimesh.util.concatenate([trimesh.PointCloud(part).convex_hull for part in self.solid_parts])

    @cached_property
    def center_of_mass(self) -> FloatArray:
        """Centre of mass at uniform density, shape (3,); the centre of the surface if that is not closed."""
        if self.mesh.is_watertight and self.mesh.volume > 0.0:
            return np.array(self.mesh.center_mass, dtype=np.float64)
        if self.solid_parts:
            hulls = [trimesh.PointCloud(part).convex_hull for part in self.solid_parts]
            volumes = np.array([hull.volume for hull in hulls])
            centres = np.array([hull.center_mass for hull in hulls])
            weighted: FloatArray = volumes @ centres / volumes.sum()
            return weighted
        return np.array(self.mesh.centroid, dtype=np.float64)

    @cached_property
    def corner_mean(self) -> FloatArray:
        """Mean of all triangle corners, shape (3,): what Simox takes for the centre of mass."""
        return np.array(self.mesh.triangles.reshape(-1, 3).mean(axis=0), dtype=np.float64)


def object_id_of(name_or_path: str | Path) -> str:
    """Return the name under which an object is known: that of a mesh file without its suffix, any other as it is."""
    path = Path(name_or_path)
    return path.stem if path.suffix.lower() in MESH_SUFFIXES else path.name


def check_concave(concave: str) -> None:
    """Refuse an unknown way to stand for a concave mesh."""
    if concave not in CONCAVE_SHAPES:
        raise InvalidObjectError(f"concave is '{concave}', it must be one of {', '.join(CONCAVE_SHAPES)}")


def check_scale(scale: float, name: str) -> None:
    """Refuse a scale that is not a positive finite number."""
    if not (np.isfinite(scale) and scale > 0.0):
        raise InvalidObjectError(
            f"scale {scale} of '{name}' must be a positive finite number (1 for metres, 0.001 for mm)"
        )


def load_mesh(path: Path) -> trimesh.Trimesh:
    """Read a mesh file into one mesh, unprocessed; every failure becomes an ``InvalidObjectError``."""
    if not path.is_file():
        raise InvalidObjectError(
            f"no mesh file '{path}'; give an existing file ({', '.join(MESH_SUFFIXES)}) "
            f"or a built-in object ({', '.join(BUILTIN_OBJECTS)})"
        )
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise InvalidObjectError(f"'{path.name}' is of no known mesh type; use one of {', '.join(MESH_SUFFIXES)}")
    try:
        scene = trimesh.load_scene(str(path), process=False)
        mesh = scene.to_mesh()
    except Exception as error:
        # The readers behind trimesh raise anything from KeyError to struct.error on broken files.
        raise InvalidObjectError(f"cannot read '{path}' as a mesh: {error}") from error
    return mesh


def check_finite(mesh: trimesh.Trimesh, name: str) -> None:
    """Refuse a mesh without faces, with too many, or with coordinates that are not finite."""
    if len(mesh.faces) == 0 or len(mesh.vertices) == 0:
        raise InvalidObjectError(f"object '{name}' is empty: its mesh has no triangles")
    if len(mesh.faces) > MOST_FACES:
        raise InvalidObjectError(
            f"object '{name}' has {len(mesh.faces)} triangles, at most {MOST_FACES} are taken; simplify the mesh"
        )
    if not np.all(np.isfinite(mesh.vertices)):
        bad = int((~np.isfinite(mesh.vertices)).any(axis=1).sum())
        raise InvalidObjectError(f"object '{name}' has {bad} vertices that are not finite; repair the mesh")


def check_mesh(mesh: trimesh.Trimesh, name: str) -> None:
    """Refuse a mesh that no hand can grasp, saying its size, the size expected and the way out."""
    check_finite(mesh, name)
    extents = np.asarray(mesh.bounds[1] - mesh.bounds[0])
    longest = float(extents.max())
    size = " x ".join(f"{side:.4g}" for side in extents)
    if longest > LARGEST_SIZE or longest < SMALLEST_SIZE:
        raise InvalidObjectError(
            f"object '{name}' measures {size} m, its longest side must lie between {SMALLEST_SIZE} and "
            f"{LARGEST_SIZE} m; {_way_out(longest)}"
        )
    thickness = min(float(extents.min()), float(np.min(mesh.bounding_box_oriented.primitive.extents)))
    if thickness < SMALLEST_THICKNESS:
        raise InvalidObjectError(
            f"object '{name}' is flat: it measures {size} m and its smallest thickness is {thickness:.3g} m, "
            f"at least {SMALLEST_THICKNESS} m is needed; give it a volume"
        )


def _way_out(longest: float) -> str:
    for unit, factor in (("millimetres", 0.001), ("centimetres", 0.01), ("inches", 0.0254)):
        if longest > LARGEST_SIZE and 0.03 <= longest * factor <= 0.5:
            return f"it looks like {unit}, use scale {factor}"
    if longest < SMALLEST_SIZE and 0.03 <= longest * 1000.0 <= 0.5:
        return "it looks as if scaled to metres twice, use scale 1000"
    return f"use scale {0.15 / longest:.3g} for a longest side of 150 mm"
