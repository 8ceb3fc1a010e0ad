"""Installation of the mebo_grasp package, by pip or by colcon (ament_python)."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = "mebo_grasp"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=["mebo_grasp*", "msg_adapters*"], exclude=["mebo_grasp_interfaces*"]),
    package_data={
        "mebo_grasp": [
            "py.typed",
            "grasping/hands/*",
            "experiments/problems/data/*",
            "solutions/*.html",
            "experiments/reports/*.html",
            "experiments/definitions/*.yaml",
        ],
        "msg_adapters": ["py.typed"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/params", glob("params/*.yaml")),
        (f"share/{PACKAGE}/params/thesis", glob("params/thesis/*.yaml")),
    ],
    python_requires=">=3.11",
    extras_require={
        # `mebo-grasp experiment NAME --cluster ADDRESS`.
        "cluster": ["distributed==2026.8.0"],
        # The meshes of `mebo-grasp experiment rgb-objects`.
        "objects": ["dm-robotics-manipulation==0.10.0"],
        # Optimizers of others, measured beside ours by `mebo-grasp experiment cec2013 --methods peers`.
        "peers": ["botorch==0.18.1", "cma==4.5.0", "optuna==5.0.0", "scikit-optimize==0.10.2"],
    },
    zip_safe=False,
    description="Diverse grasps of unknown objects by multisolution Bayesian optimization",
    license="Apache-2.0",
    maintainer="mebo_grasp maintainers",
    maintainer_email="maintainers@mebo-grasp.example.org",
    entry_points={
        "console_scripts": [
            "optimizer_node = mebo_grasp.nodes.executables:optimizer_node",
            "hand_node = mebo_grasp.nodes.executables:hand_node",
            "solution_set_node = mebo_grasp.nodes.executables:solution_set_node",
            "mebo-grasp = mebo_grasp.cli.main:main",
        ],
    },
)
