"""The page is complete in itself, and a browser without a network shows it."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from mebo_grasp.errors import InvalidFileError
from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, Pose, StampedGrasp
from mebo_grasp.solutions.diversity import PoseMetric
from mebo_grasp.solutions.hand_volume import HandVolume
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Sphere, TriangleMesh
from mebo_grasp.solutions.page import Mesh, hand_mesh, shape_mesh, write_page
from mebo_grasp.solutions.solution_set import SolutionSet

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

HAND = HandVolume(
    np.array([[-0.03, -0.03, -0.04], [-0.03, 0.03, -0.04], [0.03, -0.03, -0.03], [0.03, 0.03, -0.03]]),
    np.array([[0.03, -0.03, -0.04], [0.03, 0.03, -0.04], [0.05, -0.03, 0.03], [0.05, 0.03, 0.03]]),
    np.array([0.02, 0.02, 0.008, 0.008]),
)


def solutions(object_id: str = "bottle") -> SolutionSet:
    contact = GraspContact("index_3", np.array([0.03, 0.0, 0.05]), np.array([-1.0, 0.0, 0.0]))
    grasps = tuple(
        StampedGrasp(
            k,
            Grasp(
                Pose.from_rpy([0.05, 0.0, 0.06 * k - 0.06], [0.0, -np.pi / 2, 1.5 * k]),
                GraspOutcome.GRASPED,
                0.5 - 0.1 * k,
                contacts=(contact,),
                object_id=object_id,
            ),
        )
        for k in range(3)
    )
    return SolutionSet.of(object_id, grasps, 0.04, PoseMetric())


def write(path: Path, found: SolutionSet) -> None:
    bottle = trimesh.creation.cylinder(radius=0.03, height=0.2)
    hands = [hand_mesh(HAND, s.grasp.T_object_tcp) for s in found.grasps]
    occlusion = Occlusion("top", Box((0.15, 0.15, 0.06)), Pose(np.array([0.0, 0.0, 0.09])))
    write_page(path, found, Mesh(np.array(bottle.vertices), np.array(bottle.faces)), hands, (occlusion,))


def test_the_page_needs_nothing_from_outside(tmp_path: Path) -> None:
    path = tmp_path / "grasps.html"
    write(path, solutions())
    text = path.read_text(encoding="utf-8")
    for reference in ("http:", "https:", "src=", "<link", "@import", "import("):
        assert reference not in text
    assert [file.name for file in tmp_path.iterdir()] == ["grasps.html"]


def test_names_cannot_break_the_page(tmp_path: Path) -> None:
    path = tmp_path / "grasps.html"
    write(path, solutions("</script><b>&"))
    text = path.read_text(encoding="utf-8")
    assert "&lt;/script&gt;&lt;b&gt;&amp;" in text
    assert text.count("</script>") == 2


def test_a_hand_is_shown_where_it_is() -> None:
    pose = Pose.from_rpy([0.1, 0.2, 0.3], [0.3, 0.2, 0.1])
    mesh = hand_mesh(HAND, pose)
    local = pose.inverse().transform_points(mesh.vertices)
    low = np.minimum(HAND.starts, HAND.ends).T - HAND.radii
    high = np.maximum(HAND.starts, HAND.ends).T + HAND.radii
    np.testing.assert_allclose(local.min(axis=0), low.min(axis=1), atol=3e-3)
    np.testing.assert_allclose(local.max(axis=0), high.max(axis=1), atol=3e-3)


@pytest.mark.parametrize(
    "shape",
    [
        Box((0.1, 0.2, 0.3)),
        Sphere(0.1),
        Cylinder(0.2, 0.1),
        Cone(0.2, 0.1),
        TriangleMesh(np.eye(3), np.array([[0, 1, 2]])),
    ],
)
def test_an_occlusion_is_drawn_on_its_border(shape: object) -> None:
    occlusion = Occlusion("o", shape, Pose.from_rpy([0.1, 0.0, 0.2], [0.5, 0.4, 0.3]))  # type: ignore[arg-type]
    assert np.abs(occlusion.signed_distance(shape_mesh(occlusion).vertices)).max() < 1e-9


def test_a_page_needs_a_hand_for_each_grasp(tmp_path: Path) -> None:
    with pytest.raises(InvalidFileError, match="3 grasps, 0 hands"):
        write_page(tmp_path / "p.html", solutions(), Mesh(np.eye(3), np.array([[0, 1, 2]])), [])


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_a_browser_shows_the_grasps(tmp_path: Path) -> None:
    path, picture = tmp_path / "grasps.html", tmp_path / "grasps.png"
    write(path, solutions())
    command = [
        str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle",
        "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1200,700",
        f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=5000",
    ]  # fmt: skip
    page = subprocess.run(
        [*command, "--dump-dom", path.as_uri()], capture_output=True, text=True, timeout=120, check=True
    ).stdout
    assert 'data-ready="1"' in page
    assert 'data-shown="3"' in page
    assert "0.5000" in page
    subprocess.run(
        [*command, f"--screenshot={picture}", path.as_uri()], capture_output=True, timeout=120, check=True
    )
    pixels = np.asarray(Image.open(picture).convert("RGB"), dtype=int)[:, :700]
    # The blue of the first hand, in any light.
    blue = (pixels[..., 2] > 1.3 * pixels[..., 1]) & (pixels[..., 1] > 2 * pixels[..., 0])
    assert blue.sum() > 500
