# SPDX-License-Identifier: Apache-2.0
"""An ament_python package: `colcon build` in a ROS 2 workspace, or `pip install .` beside the ROS 2 wheels."""

import sys
from pathlib import Path

from setuptools import find_packages, setup  # first: it brings distutils where Python no longer has it

from distutils.command.install_data import install_data  # isort: skip

NODES = ("perception", "inference", "retargeting", "pipeline", "simulation", "camera", "markers", "replay", "record")
SHARE = "share/mild_ros"


def share_files() -> list[tuple[str, list[str]]]:
    """What is found through the ament index: the marker, the manifest, the models and the bags, folder by folder."""
    found = [("share/ament_index/resource_index/packages", ["resource/mild_ros"]), (SHARE, ["package.xml"])]
    for top in ("models", "bags", "mild_ros/launch", "mild_ros/config"):
        for folder in sorted(path for path in [Path(top), *Path(top).rglob("*")] if path.is_dir()):
            files = [str(path) for path in sorted(folder.iterdir()) if path.is_file() and path.suffix != ".pyc"]
            if files:
                found.append((f"{SHARE}/{folder.relative_to(Path(top).parent)}", files))
    return found


def console_scripts() -> list[str]:
    """`mild` for everybody, and for colcon the nodes.

    colcon calls this file and follows setup.cfg, so that scripts land in lib/mild_ros/, where `ros2 run` looks. pip
    puts them into bin/, which is in everybody's PATH: no place for a `record` and a `replay`.
    """
    nodes = NODES if {"install", "develop"} & set(sys.argv) else ()
    return ["mild = mild_ros.command_line.main:main", *(f"{name} = mild_ros.command_line.run:script" for name in nodes)]


class InstallDataAndLaunchers(install_data):
    """Leaves a launcher of each node where `ros2 run` looks, in lib/mild_ros/, as pip makes scripts in bin/ only."""

    def run(self) -> None:
        """Copy the data files, then write the launchers."""
        super().run()
        if self.get_finalized_command("install").install_scripts.endswith("lib/mild_ros"):
            return
        folder = Path(self.install_dir, "lib", "mild_ros")
        folder.mkdir(parents=True, exist_ok=True)
        for name, words in {"mild": "", **{node: f" run {node}" for node in NODES}}.items():
            launcher = folder / name
            launcher.write_text(f'#!/bin/sh\nexec "${{0%/*}}/../../bin/mild"{words} "$@"\n')
            launcher.chmod(0o755)
            self.outfiles.append(str(launcher))


setup(
    name="mild_ros",
    version="0.1.0",
    description="Human-to-robot motion generation on ROS 2: a person's arm in, a robot's arm out",
    license="Apache-2.0",
    maintainer="mild_ros maintainers",
    maintainer_email="maintainers@mild-ros.example",
    packages=find_packages(include=["mild_core", "mild_core.*", "mild_ros", "mild_ros.*"]),
    package_data={
        "mild_core.retargeting.robots": ["*.urdf"],
        "mild_core": ["py.typed"],
        "mild_core.learning": ["configurations/*.toml"],
    },
    data_files=share_files(),
    python_requires=">=3.11",
    # ROS 2 itself comes from apt or from the wheels of requirements/runtime.txt, which an apt install does not have.
    install_requires=[
        "daqp",
        "lz4",
        "matplotlib",
        "numba",
        "numpy",
        "pillow",
        "pin",
        "pybullet; python_version < '3.12'",
        "pybullet-arm64; python_version >= '3.12'",
        "pyyaml",
        "rich",
        "rosbags",
        "ruckig",
        "safetensors",
        "typer",
        "viser",
        "yourdfpy",
        "zstandard",
    ],
    extras_require={
        "learning": ["scipy", "torch"],
        "test": ["hypothesis", "mcap", "mypy", "pytest", "pytest-timeout", "pytest-xdist", "ruff", "torch"],
    },
    entry_points={"console_scripts": console_scripts()},
    cmdclass={"install_data": InstallDataAndLaunchers},
    zip_safe=False,
)
