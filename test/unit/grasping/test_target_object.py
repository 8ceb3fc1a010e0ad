"""Target objects: stated sizes, files of several formats, and a corpus of meshes that must be refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from mebo_grasp.errors import InvalidObjectError
from mebo_grasp.grasping.target_object import BUILTIN_OBJECTS, LARGEST_SIZE, SMALLEST_SIZE, TargetObject, object_id_of

SIZES = {
    "bottle": (0.06566, 0.06566, 0.1995),
    "vase": (0.166, 0.166, 0.292),
    "drill": (0.180, 0.060, 0.190),
    "glass": (0.071, 0.071, 0.159),
    "mug": (0.082, 0.1224, 0.100),
}
FORMATS = (".stl", ".obj", ".ply", ".off", ".glb")
BOX = (0.04, 0.05, 0.12)


def box(scale: float = 1.0) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(np.array(BOX) * scale)
    # Off the origin, so that a loader that recentres or swaps axes is seen.
    mesh.apply_translation(np.array([0.01, -0.02, 0.03]) * scale)
    return mesh


def ascii_stl(vertices: list[list[str]]) -> str:
    """Return an ASCII STL of the triangles between consecutive threes of vertices, written as given."""
    lines = ["solid made"]
    for start in range(0, len(vertices), 3):
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += ["vertex " + " ".join(vertex) for vertex in vertices[start : start + 3]]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid made", ""])


def obj_text(mesh: trimesh.Trimesh, changed: str | None = None) -> str:
    """Return the mesh as OBJ, the x of its first vertex replaced by a word."""
    rows = [[f"{value:.9g}" for value in vertex] for vertex in mesh.vertices]
    if changed is not None:
        rows[0][0] = changed
    lines = ["v " + " ".join(row) for row in rows]
    return "\n".join([*lines, *("f " + " ".join(str(i + 1) for i in face) for face in mesh.faces), ""])


def refusal(path: Path, scale: float = 1.0) -> str:
    with pytest.raises(InvalidObjectError) as caught:
        TargetObject.load(path, scale)
    message = str(caught.value)
    assert path.name in message
    return message


@pytest.mark.parametrize("name", BUILTIN_OBJECTS)
def test_built_in_objects_have_the_stated_size_and_are_closed_and_centred(name: str) -> None:
    target = TargetObject.builtin(name)
    np.testing.assert_allclose(target.extents, SIZES[name], atol=1e-5)
    np.testing.assert_allclose(target.bounds.mean(axis=0), 0.0, atol=1e-9)
    assert target.mesh.is_watertight
    assert target.mesh.is_winding_consistent
    assert target.mesh.volume > 0.0
    assert target.longest_side == pytest.approx(max(SIZES[name]), abs=1e-5)


@pytest.mark.parametrize("name", BUILTIN_OBJECTS)
def test_the_convex_parts_fill_the_box_of_the_mesh(name: str) -> None:
    target = TargetObject.builtin(name)
    corners = np.vstack(target.convex_parts)
    np.testing.assert_allclose(corners.min(axis=0), target.bounds[0], atol=1e-4)
    np.testing.assert_allclose(corners.max(axis=0), target.bounds[1], atol=1e-4)


@pytest.mark.parametrize("name", BUILTIN_OBJECTS)
def test_the_convex_parts_are_the_solid_of_the_mesh(name: str) -> None:
    """Points at random in the box lie in a part exactly if they lie in the mesh, apart from the skin."""
    target = TargetObject.builtin(name)
    rng = np.random.default_rng(3)
    points = rng.uniform(target.bounds[0], target.bounds[1], (400, 3))
    inside_parts = np.zeros(len(points), dtype=bool)
    for part in target.convex_parts:
        hull = trimesh.PointCloud(part).convex_hull
        heights = np.einsum("nfk,fk->nf", points[:, None] - hull.triangles_center[None], hull.face_normals)
        inside_parts |= (heights <= 1e-9).all(axis=1)
    # By the winding number, which also counts right where bodies overlap.
    a, b, c = (target.mesh.triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    numerator = np.einsum("nfk,nfk->nf", a, np.cross(b, c))
    denominator = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    winding = 2.0 * np.arctan2(numerator, denominator).sum(axis=1) / (4.0 * np.pi)
    # The bottom of a cup is a prism of 48 sides, its mesh one of 24: a point in that skin of 0.3 mm may differ.
    assert np.sum(inside_parts != (winding > 0.5)) <= 1


def test_scale_multiplies_size_and_parts() -> None:
    target = TargetObject.builtin("bottle", 0.5)
    np.testing.assert_allclose(target.extents, np.array(SIZES["bottle"]) / 2, atol=1e-5)
    np.testing.assert_allclose(np.vstack(target.convex_parts).max(axis=0)[2], 0.1995 / 4, atol=1e-6)


def test_scaling_one_object_leaves_the_next_one_as_it_was() -> None:
    TargetObject.builtin("mug", 2.0)
    np.testing.assert_allclose(TargetObject.builtin("mug").extents, SIZES["mug"], atol=1e-5)


def test_centre_of_mass_of_a_box_is_its_middle() -> None:
    target = TargetObject.from_mesh(box(), "box")
    np.testing.assert_allclose(target.center_of_mass, [0.01, -0.02, 0.03], atol=1e-12)
    assert len(target.solid_parts) == 1


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_file_in_millimetres_loads_to_the_same_shape_in_every_format(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"carton{suffix}"
    box(1000.0).export(path)
    target = TargetObject.load(path, 0.001)
    assert target.object_id == "carton"
    np.testing.assert_allclose(target.bounds, box().bounds, atol=1e-7)
    assert target.mesh.is_watertight
    assert target.mesh.volume == pytest.approx(np.prod(BOX), rel=1e-5)
    assert len(target.mesh.vertices) == 8


def test_a_suffix_in_capitals_and_a_name_with_spaces_are_fine(tmp_path: Path) -> None:
    path = tmp_path / "my carton.STL"
    path.write_bytes(box().export(file_type="stl"))
    assert TargetObject.load(str(path)).object_id == "my carton"


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("bottle", "bottle"),
        ("meshes/cup.stl", "cup"),
        ("cup.v2.OBJ", "cup.v2"),
        ("cup.v2", "cup.v2"),
        ("", ""),
    ],
)
def test_only_the_suffix_of_a_mesh_file_is_left_out_of_a_name(given: str, name: str) -> None:
    assert object_id_of(given) == name
    assert object_id_of(name) == name


def test_a_file_of_two_bodies_is_one_object(tmp_path: Path) -> None:
    path = tmp_path / "pair.obj"
    other = box()
    other.apply_translation([0.1, 0.0, 0.0])
    trimesh.util.concatenate([box(), other]).export(path)
    assert TargetObject.load(path).extents[0] == pytest.approx(0.1 + BOX[0])


def test_a_surface_that_is_not_closed_loads(tmp_path: Path) -> None:
    path = tmp_path / "open.stl"
    mesh = box()
    mesh.update_faces(np.arange(len(mesh.faces)) > 1)
    mesh.export(path)
    target = TargetObject.load(path)
    assert not target.mesh.is_watertight
    assert np.isfinite(target.center_of_mass).all()


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(InvalidObjectError, match="teapot") as caught:
        TargetObject.load("teapot")
    for name in BUILTIN_OBJECTS:
        assert name in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert "no mesh file" in refusal(tmp_path / "absent.stl")


def test_a_folder_is_no_mesh(tmp_path: Path) -> None:
    folder = tmp_path / "folder.stl"
    folder.mkdir()
    refusal(folder)


def test_a_foreign_suffix_is_refused_with_those_known(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("no mesh at all")
    assert ".stl" in refusal(path)


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty", b""),
        ("text", b"Dear reader,\nthis is a letter and not a mesh.\n"),
        ("noise", bytes(np.random.default_rng(0).integers(0, 256, 700, dtype=np.uint8))),
    ],
)
def test_what_is_no_mesh_is_refused(suffix: str, name: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"{name}{suffix}"
    path.write_bytes(content)
    assert any(word in refusal(path) for word in ("cannot read", "no triangles", "not finite"))


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_file_cut_short_loads_smaller_or_is_refused(suffix: str, share: float, tmp_path: Path) -> None:
    path = tmp_path / f"cut{suffix}"
    whole = trimesh.creation.icosphere(2, 0.05)
    content = whole.export(file_type=suffix[1:])
    content = content.encode() if isinstance(content, str) else content
    path.write_bytes(content[: int(len(content) * share)])
    faces, message = 1, path.name
    try:
        faces = len(TargetObject.load(path).mesh.faces)
    except InvalidObjectError as error:
        message = str(error)
    assert 0 < faces < len(whole.faces)
    assert path.name in message


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("points.obj", "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\n"),
        ("solid.stl", "solid nothing\nendsolid nothing\n"),
        ("degenerate.obj", "v 0 0 0\nv 0.1 0 0\nv 0.2 0 0\nf 1 2 3\n"),
    ],
)
def test_a_mesh_without_faces_is_refused(name: str, content: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(content)
    assert any(word in refusal(path) for word in ("no triangles", "cannot read"))


def test_faces_that_name_absent_vertices_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "dangling.obj"
    path.write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0.1\nf 1 2 9\n")
    refusal(path)


@pytest.mark.parametrize("word", ["nan", "inf", "-inf"])
def test_vertices_that_are_not_finite_are_refused(word: str, tmp_path: Path) -> None:
    as_obj, as_stl = tmp_path / "bad.obj", tmp_path / "bad.stl"
    as_obj.write_text(obj_text(box(), word))
    corners = [[f"{v:.6g}" for v in corner] for corner in box().triangles.reshape(-1, 3)]
    corners[0][0] = word
    as_stl.write_text(ascii_stl(corners))
    for path in (as_obj, as_stl):
        assert "not finite" in refusal(path)


@pytest.mark.parametrize("tilted", [False, True])
def test_a_flat_mesh_is_refused(tilted: bool, tmp_path: Path) -> None:
    path = tmp_path / "sheet.obj"
    mesh = trimesh.creation.box((0.1, 0.1, 0.0))
    if tilted:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1.0, 1.0, 0.3]))
    path.write_text(obj_text(mesh))
    assert "flat" in refusal(path)


def test_a_needle_without_width_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "needle.obj"
    path.write_text(obj_text(trimesh.creation.box((0.1, 1e-6, 1e-6))))
    assert "flat" in refusal(path)


def test_millimetres_taken_for_metres_are_recognized(tmp_path: Path) -> None:
    path = tmp_path / "big.stl"
    trimesh.creation.box((60.0, 70.0, 200.0)).export(path)
    message = refusal(path)
    assert "60 x 70 x 200 m" in message
    assert "scale 0.001" in message
    np.testing.assert_allclose(TargetObject.load(path, 0.001).extents, [0.06, 0.07, 0.2], rtol=1e-5)


def test_a_microscopic_mesh_is_refused_with_a_scale_that_works(tmp_path: Path) -> None:
    path = tmp_path / "dust.stl"
    mesh = trimesh.creation.icosphere(1, 1.0)
    mesh.apply_scale(5e-5)
    mesh.export(path)
    message = refusal(path)
    assert "0.0001 x" in message
    assert "scale 1000" in message
    TargetObject.load(path, 1000.0)


@given(size=st.one_of(st.floats(1e-4, SMALLEST_SIZE * 0.99), st.floats(LARGEST_SIZE * 1.01, 1e6)))
def test_the_scale_proposed_is_one_that_is_taken(size: float) -> None:
    mesh = trimesh.creation.box((size, size / 2, size / 2))
    with pytest.raises(InvalidObjectError, match="use scale") as caught:
        TargetObject.from_mesh(mesh, "thing")
    mesh.apply_scale(float(str(caught.value).split("use scale ")[1].split()[0]))
    TargetObject.from_mesh(mesh, "thing")


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_that_is_no_positive_number_is_refused(scale: float, tmp_path: Path) -> None:
    path = tmp_path / "carton.stl"
    box().export(path)
    message = refusal(path, scale)
    assert "scale" in message
    assert "positive" in message
    with pytest.raises(InvalidObjectError, match=r"'bottle' must be a positive"):
        TargetObject.builtin("bottle", scale)
