# SPDX-License-Identifier: Apache-2.0
"""A run as one HTML file: robot and person in 3-D with a play bar, in any browser, without a network."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import viser
import yourdfpy

from mild_core.retargeting.robot_model.capsules import TABLE_AT_M, TABLE_M, table_of
from mild_core.retargeting.robot_model.kinematics import forward_kinematics
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.shapes import FloatArray
from mild_ros.simulation.quiet import quiet_terminal
from mild_ros.simulation.trial_load import survivable
from mild_ros.viewing.body import BodyPart, body_parts
from mild_ros.viewing.filmstrip import caption
from mild_ros.viewing.renderer import quaternion
from mild_ros.viewing.staging import Staged

FRAMES_PER_SECOND = 20.0
TABLE_TOP, TABLE_FOOT, FLOOR, UNPAINTED = (92, 99, 112), (148, 156, 168), (225, 229, 234), (180, 184, 190)


def write_page(staged: Staged, robot: RobotModel, path: Path, title: str) -> None:
    """Write the page of a run."""
    times = np.arange(staged.times_s[0], staged.times_s[-1], 1.0 / FRAMES_PER_SECOND)
    joints = [staged.joints_at(time_s) for time_s in times.tolist()]
    positions = np.array([[each[name] for name in robot.joint_names] for each in joints])
    with _server() as server:
        recording = server.get_scene_serializer()
        _light_and_camera(server, staged.floor_m)
        _furniture(server, staged.floor_m, robot)
        links = _robot(server, robot, positions)
        parts = _person(server, body_parts(staged.bodies))
        label = server.scene.add_label("/belief", "", position=(-0.2, 0.0, 0.95), anchor="bottom-center")
        for index, time_s in enumerate(times.tolist()):
            for handle, poses in links:
                _move(handle, poses[index, :3, :3], poses[index, :3, 3])
            body = staged.bodies[staged.frame_at(time_s)]
            for part, mesh in parts:
                _move(mesh, *part.pose(body))
            said = f"{time_s:.1f} s   {caption(staged, time_s)}".strip()
            if label.text != said:
                label.text = said
            recording.insert_sleep(1.0 / FRAMES_PER_SECOND)
        page = recording.as_html()
    path.write_text(page.replace("<title>Viser</title>", f"<title>{html.escape(title)}</title>", 1), encoding="utf-8")


@contextmanager
def _server() -> Iterator[viser.ViserServer]:
    """viser draws through a server of its own, though no client connects to it."""
    with quiet_terminal():  # its greeting is of no use here
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        yield server
    finally:
        with quiet_terminal():
            server.stop()


def _move(handle: viser.SceneNodeHandle, rotation: FloatArray, position_m: FloatArray) -> None:
    """Put a node into a pose, unless it is there already: every change makes the page larger."""
    x, y, z, w = quaternion(rotation)
    wxyz = np.array([w, x, y, z])
    if not np.allclose(handle.position, position_m, atol=1e-4):
        handle.position = position_m
    if not np.allclose(handle.wxyz, wxyz, atol=1e-4):
        handle.wxyz = wxyz


def _robot(
    server: viser.ViserServer, robot: RobotModel, positions_rad: FloatArray
) -> list[tuple[viser.FrameHandle, FloatArray]]:
    """The robot's links, each with its poses (T, 4, 4) at T joint positions."""
    urdf = yourdfpy.URDF.load(str(survivable(robot)), build_scene_graph=True, load_meshes=True)
    graph, geometry = urdf.scene.graph, urdf.scene.geometry
    links: dict[str, viser.FrameHandle] = {}
    for node in graph.nodes_geometry:
        link = graph.transforms.parents[node]
        if link not in links:
            links[link] = server.scene.add_frame(f"/robot/{link}", show_axes=False)
        pose, name = graph.get(node, frame_from=link)[0], graph[node][1]
        mesh = geometry[name]
        vertices = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        server.scene.add_mesh_simple(
            f"/robot/{link}/{name}",
            vertices.astype(np.float32),
            np.asarray(mesh.faces, dtype=np.uint32),
            color=_colour(mesh),
            flat_shading=True,
        )
    shape = (len(positions_rad), 4, 4)
    poses = {link: np.broadcast_to(forward_kinematics(robot, positions_rad, link), shape) for link in links}
    return [(handle, poses[link]) for link, handle in links.items()]


def _colour(mesh: Any) -> tuple[int, int, int]:
    """Of a mesh, or the middle colour of its texture; grey where it has neither."""
    visual = mesh.visual
    try:
        if visual.kind == "texture":
            visual = visual.to_color()
        red, green, blue = (int(value) for value in visual.main_color[:3])
    except (AttributeError, TypeError, ValueError, IndexError, OSError):  # a material that trimesh cannot read
        return UNPAINTED
    return red, green, blue


def _light_and_camera(server: viser.ViserServer, floor_m: float) -> None:
    """Soft light from all sides and some from above; the camera stands at the robot's left.

    The usual environment map is left out: it would be fetched from the network.
    """
    scene = server.scene
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(205, 210, 220), intensity=2.0)
    scene.add_light_directional("/light/sun", intensity=1.6, position=(1.5, 4.0, 5.0))
    scene.add_light_directional("/light/other_side", intensity=0.7, position=(-2.0, -4.0, 3.0))
    scene.world_axes.visible = False
    server.initial_camera.position = (0.2, 4.3, 0.75)
    server.initial_camera.look_at = (0.38, 0.0, 0.5 * (floor_m + 1.0) - 0.1)
    server.initial_camera.fov = float(np.radians(30.0))


def _furniture(server: viser.ViserServer, floor_m: float, robot: RobotModel) -> None:
    if robot.on_table:
        (x, y), (long, wide), top_m = TABLE_AT_M, TABLE_M, table_of(robot).top_m
        height = max(top_m - 0.04 - floor_m, 0.02)
        server.scene.add_box("/table/top", TABLE_TOP, (long, wide, 0.04), position=(x, y, top_m - 0.02))
        foot = (x - 0.02, y, floor_m + height / 2)
        server.scene.add_box("/table/foot", TABLE_FOOT, (long - 0.2, wide - 0.2, height), position=foot)
    where = (0.4, 0.0, floor_m - 0.01)
    server.scene.add_cylinder("/floor", 1.3, 0.02, color=FLOOR, radial_segments=96, position=where)


def _person(server: viser.ViserServer, parts: Sequence[BodyPart]) -> list[tuple[BodyPart, viser.MeshHandle]]:
    handles = []
    for part in parts:
        red, green, blue = (round(255 * value) for value in part.colour)
        vertices = part.surface.vertices_m.astype(np.float32)
        mesh = server.scene.add_mesh_simple(
            f"/person/{part.name}", vertices, part.surface.faces, color=(red, green, blue)
        )
        handles.append((part, mesh))
    return handles
