"""``/tf_static`` leads occlusions of other frames to the object, whichever of the two comes first.

The ROS wheels have no ``tf2_msgs``: where it is missing, its one message that matters is built here.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from mebo_grasp_interfaces.msg import GraspQuality, OcclusionArray

from mebo_grasp.grasp import Pose
from mebo_grasp.nodes import qos
from msg_adapters.pose import to_pose_stamped_msg

from .harness import WAIT, Inbox, Probe
from .scenes import OBJECT, answer, box_occlusion

BUILD_LIMIT = 280.0
COLCON = Path(sys.prefix) / "bin" / "colcon"
HAS_TF2 = importlib.util.find_spec("tf2_msgs") is not None

pytestmark = [
    pytest.mark.nodes,
    pytest.mark.slow,
    pytest.mark.skipif(not HAS_TF2 and not COLCON.exists(), reason="needs tf2_msgs or colcon (`make setup`)"),
]

PACKAGE = """<package format="3"><name>tf2_msgs</name><version>0.0.0</version><description>stands in</description>
<maintainer email="nobody@example.org">nobody</maintainer><license>none</license>
<buildtool_depend>ament_cmake</buildtool_depend>
<buildtool_depend>rosidl_default_generators</buildtool_depend><depend>geometry_msgs</depend>
<member_of_group>rosidl_interface_packages</member_of_group>
<export><build_type>ament_cmake</build_type></export></package>"""
CMAKE = """cmake_minimum_required(VERSION 3.16)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(tf2_msgs "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_package()
"""

BROADCASTER = """
import rclpy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage
from mebo_grasp.nodes import qos
rclpy.init()
node = rclpy.create_node("static_broadcaster")
publisher = node.create_publisher(TFMessage, "/tf_static", qos.TF_STATIC)
transform = TransformStamped(child_frame_id="camera")
transform.header.frame_id = "bottle"
transform.transform.translation.z = 0.5
broken = TransformStamped(child_frame_id="nowhere")
broken.header.frame_id = "bottle"
broken.transform.rotation.w = 0.0
publisher.publish(TFMessage(transforms=[broken, transform]))
rclpy.spin(node)
"""


@pytest.fixture(scope="module")
def tf2_environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables with which a process finds ``tf2_msgs``."""
    if HAS_TF2:
        return {}
    root = tmp_path_factory.mktemp("tf2")
    source, install = root / "tf2_msgs", root / "install"
    (source / "msg").mkdir(parents=True)
    (source / "package.xml").write_text(PACKAGE)
    (source / "CMakeLists.txt").write_text(CMAKE)
    (source / "msg" / "TFMessage.msg").write_text("geometry_msgs/TransformStamped[] transforms\n")
    prefix = sys.prefix
    kept = {name: os.environ[name] for name in ("HOME", "LANG", "TMPDIR") if name in os.environ}
    done = subprocess.run(
        [COLCON, "build", "--merge-install", "--install-base", install, "--base-paths", source,
         "--cmake-args", f"-DPython3_EXECUTABLE={sys.executable}", "-DBUILD_TESTING=OFF"],
        cwd=root,
        env=kept | {
            "PATH": f"{prefix}/bin{os.pathsep}{os.environ['PATH']}", "AMENT_PREFIX_PATH": prefix,
            "CMAKE_PREFIX_PATH": prefix, "COLCON_HOME": str(root / "home"),
        },
        capture_output=True, text=True, timeout=BUILD_LIMIT, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    added = {
        "PYTHONPATH": install / "lib" / "python{}.{}".format(*sys.version_info) / "site-packages",
        "LD_LIBRARY_PATH": install / "lib",
        "AMENT_PREFIX_PATH": install,
    }
    return {name: os.pathsep.join(filter(None, (str(folder), os.environ.get(name)))) for name, folder in added.items()}


def test_occlusions_wait_for_their_frame(
    tf2_environment: dict[str, str],
    launch,
    probe: Probe,
    domain_id: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, value in tf2_environment.items():
        monkeypatch.setenv(name, value)
    node = launch("solution_set_node", object=OBJECT, database=str(tmp_path / "trials.db"), occlusion_rule="tcp")
    best: Inbox[PoseStamped] = probe.listen(PoseStamped, "best_grasp", qos.LATCHED)
    qualities = probe.publisher(GraspQuality, "grasp_quality", qos.QUALITIES)
    for stamp, (height, quality) in enumerate(((0.0, 0.5), (0.08, 0.4)), start=1):
        pose = Pose(np.array([0.0, 0.1, height]))
        qualities.publish(answer(to_pose_stamped_msg(stamp, OBJECT, pose), quality))
    best.wait_for(lambda m: m.pose.position.z == 0.0)
    occlusions = probe.publisher(OcclusionArray, "occlusions", qos.LATCHED)
    seen = box_occlusion((0.0, 0.1, -0.5), (0.05, 0.05, 0.05), frame="camera")
    occlusions.publish(OcclusionArray(occlusions=[seen]))
    node.wait_for_log("'camera'")
    broadcaster = subprocess.Popen(
        [sys.executable, "-c", BROADCASTER],
        env=os.environ | {"ROS_DOMAIN_ID": str(domain_id), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
    )
    try:
        best.wait_for(lambda m: m.pose.position.z == 0.08)
        assert "transform from 'bottle' to 'nowhere'" in node.log
    finally:
        broadcaster.kill()
        broadcaster.wait(WAIT)
