# SPDX-License-Identifier: Apache-2.0
"""What a run leaves: its numbers whatever becomes of its pictures, and pictures of robots with any meshes."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from mild_core.errors import BagError
from mild_core.resources import share_folder
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robots import ROBOTS
from mild_ros.assembly.robot import make_robot_to_draw
from mild_ros.assembly.settings import PipelineParameters
from mild_ros.command_line import results
from mild_ros.replay.demo import RunOptions
from mild_ros.viewing.page import UNPAINTED, _colour

YUMI = ROBOTS["yumi"]
HANDSHAKE = share_folder("bags") / "handshake"


def _fails(*_: Any) -> None:
    raise AttributeError("'TextureVisuals' object has no attribute 'main_color'")


def _draws(_staged: Any, _robot: Any, path: Path, _title: str) -> None:
    path.write_text("a picture")


def test_a_page_that_fails_costs_neither_the_numbers_nor_the_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / results.PAGE).write_text("of an earlier run")
    monkeypatch.setattr(results, "write_page", _fails)
    monkeypatch.setattr(results, "draw_filmstrip", _draws)
    shown = results.leave(HANDSHAKE, tmp_path, RunOptions(), "h\udcc3\udca4nd", Console())  # a name in another encoding
    left = {path.name for path in shown.files}
    assert left == {"handshake", "filmstrip.png", "plots.png", "report.json"}, "what is listed is there, and no page is"
    assert all(path.exists() for path in shown.files)
    assert not (tmp_path / results.PAGE).exists(), "a page of an earlier run would be taken for this one's"
    results.print_summary(shown, "handshake", Console())
    assert "no page.html: AttributeError: 'TextureVisuals'" in capsys.readouterr().out


def test_a_run_without_a_person_still_has_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def shows_no_person(*_: Any) -> None:
        raise BagError("recorded", "never shows a whole person", "there is nothing to show; plots need less")

    monkeypatch.setattr(results, "stage", shows_no_person)
    shown = results.leave(HANDSHAKE, tmp_path, RunOptions(), "handshake", Console())
    assert [path.name for path in shown.files] == ["handshake", "plots.png", "report.json"]
    assert len(shown.problems) == 1
    assert "never shows a whole person" in shown.problems[0]
    assert json.loads((tmp_path / results.NUMBERS).read_text())["duration_s"] > 10.0


@pytest.mark.parametrize("vendor", [True, False], ids=["a vendor's description", "a robot file"])
def test_pictures_show_the_meshes_that_the_description_names_by_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, vendor: bool
) -> None:
    mesh = tmp_path / "hat_description" / "meshes" / "hat.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_bytes(bytes(84))
    hat = '<link name="hat"><visual><geometry><mesh filename="package://hat_description/meshes/hat.stl"/></geometry>'
    hat += (
        '</visual></link><joint name="to_hat" type="fixed"><parent link="yumi_base_link"/><child link="hat"/></joint>'
    )
    urdf = mesh.parents[1] / "yumi.urdf"
    urdf.write_text(YUMI.urdf_path.read_text().replace("</robot>", f"{hat}</robot>"))
    file = urdf.with_suffix(".toml")
    file.write_text(
        f'name = "mine"\ndescription = "yumi.urdf"\nbase_link = "{YUMI.base_link}"\ntool_link = "{YUMI.tool_link}"\n'
        f"joint_names = {json.dumps(YUMI.joint_names)}\nhome_rad = {YUMI.home_rad.tolist()}\n"
        "acceleration_rad_s2 = 10.0\njerk_rad_s3 = 300.0\n"
    )
    drawn: list[RobotModel] = []
    monkeypatch.setattr(results, "draw_filmstrip", lambda staged, robot, *_: drawn.append(robot))
    monkeypatch.setattr(results, "write_page", lambda staged, robot, *_: drawn.append(robot))
    named = {"robot_description": str(urdf)} if vendor else {"robot": str(file)}
    results.leave(HANDSHAKE, tmp_path, RunOptions(PipelineParameters(**named)), "handshake", Console())
    assert [str(mesh) in robot.urdf_path.read_text() for robot in drawn] == [True, True]


def test_a_run_whose_description_came_by_topic_is_drawn_as_the_robot_of_its_name() -> None:
    assert make_robot_to_draw("yumi", "topic:robot_description").urdf_path == YUMI.urdf_path


def test_a_mesh_with_a_texture_has_its_middle_colour() -> None:
    trimesh = pytest.importorskip("trimesh")
    image = pytest.importorskip("PIL.Image").new("RGB", (4, 4), (200, 30, 40))
    box = trimesh.creation.box()
    material = trimesh.visual.material.SimpleMaterial(image=image)
    box.visual = trimesh.visual.TextureVisuals(uv=np.full((len(box.vertices), 2), 0.5), material=material)
    assert _colour(box) == (200, 30, 40)


def test_a_mesh_with_a_material_that_cannot_be_read_is_grey() -> None:
    assert _colour(SimpleNamespace(visual=SimpleNamespace(kind="vertex"))) == UNPAINTED
