"""The page is complete in itself, and a browser without a network shows it."""

import json
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from mebo_grasp.errors import InvalidFileError
from mebo_grasp.grasp import Grasp, GraspContact, GraspOutcome, Pose, QualityUnderNoise, StampedGrasp
from mebo_grasp.solutions.diversity import PoseMetric
from mebo_grasp.solutions.hand_volume import HandVolume
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Sphere, TriangleMesh
from mebo_grasp.solutions.page import Mesh, grasp_numbers, hand_mesh, page_template, shape_mesh, write_page
from mebo_grasp.solutions.solution_set import SolutionSet

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
needs_browser = pytest.mark.skipif(
    BROWSER is None, reason=f"none of {', '.join(BROWSERS)} is on the path; apt-get install chromium"
)

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


def browse(page: Path, *options: str) -> str:
    """Show a page in a browser without a screen; return what it writes to its standard output."""
    command = [
        str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--use-gl=angle",
        "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1200,700",
        f"--user-data-dir={page.parent / 'profile'}", "--virtual-time-budget=5000", *options, page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout


def colored(page: Path) -> dict[str, int]:
    """Count the pixels of the scene in the colours of the first two hands, in any light, and of an occlusion."""
    picture = page.with_suffix(".png")
    browse(page, f"--screenshot={picture}")
    r, g, b = np.moveaxis(np.asarray(Image.open(picture).convert("RGB"), dtype=float)[:, :640], 2, 0)
    return {
        "blue": int(((b > 1.3 * g) & (g > 2 * r)).sum()),
        "green": int(((g > 2 * r) & (g > 2 * b)).sum()),
        "red": int(((r > 1.15 * g) & (r > 1.15 * b) & (r > 150)).sum()),
    }


@needs_browser
def test_a_browser_shows_the_grasps(tmp_path: Path) -> None:
    path = tmp_path / "grasps.html"
    write(path, solutions())
    page = browse(path, "--dump-dom")
    assert 'data-ready="1"' in page
    assert 'data-shown="3"' in page
    for number in ("0.5000", "0.4000", "50.0, 0.0, -60.0"):
        assert f"<td>{number}</td>" in page
    seen = colored(path)
    assert min(seen.values()) > 100, seen


@needs_browser
def test_the_slider_and_the_list_choose_what_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "grasps.html"
    write(path, solutions())
    moves = """<script>
    const slider = element("quality");
    slider.value = 1000;
    slider.dispatchEvent(new Event("input"));
    element("occlusions").click();
    </script></body>"""
    path.write_text(path.read_text(encoding="utf-8").replace("</body>", moves), encoding="utf-8")
    page = browse(path, "--dump-dom")
    assert 'data-shown="1"' in page
    assert page.count('class="off') == 2
    seen = colored(path)
    assert seen["blue"] > 500
    assert max(seen["green"], seen["red"]) < 40, seen


def test_the_table_has_a_column_for_each_number_of_a_grasp() -> None:
    grasp = Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.5, under_noise=QualityUnderNoise(0.4, 0.1, 0.2, 5))
    assert grasp_numbers(grasp)[-1] == "0.4000 ± 0.1000, 0.2000"
    assert page_template().count("<th>") == len(grasp_numbers(grasp)) + 2  # colour and number


def test_a_number_that_is_not_known_does_not_break_the_page(tmp_path: Path) -> None:
    path = tmp_path / "grasps.html"
    grasp = Grasp(Pose.identity(), GraspOutcome.GRASPED, 0.5, epsilon=math.nan)
    write(path, SolutionSet.of("bottle", (StampedGrasp(1, grasp),), 0.04, PoseMetric()))
    data = path.read_text(encoding="utf-8").split('type="application/json">')[1].split("</script>")[0]
    json.loads(data, parse_constant=pytest.fail)  # a browser knows no NaN
