# SPDX-License-Identifier: Apache-2.0
"""A vendor's description as it can be used here: its meshes found, and from ours what it lacks.

Vendors name meshes by package (`package://yumi_description/meshes/body.stl`), and the packages are often not there, or
may not be given away. A part whose mesh is missing is drawn as in our own description of the robot; for the check
against collisions of the robot with itself, which wants primitive shapes, our own stand in for every mesh.
"""

from __future__ import annotations

import codecs
import copy
import hashlib
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from mild_core.errors import SetupError
from mild_core.retargeting.robot_model.kinematics import read_tree
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.retargeting.robot_model.urdf import read_description
from mild_ros.assembly.private import private_folder

MESHES_LIMIT = 500_000_000
"""Bytes of all meshes of a description, as often as it names them; a large humanoid's have 100 MB."""

SCHEMES = ("package://", "model://")
"""Before the name of a package and a path in it."""


@dataclass(frozen=True)
class Prepared:
    """A description as it can be used.

    Attributes:
        path: Where it is.
        note: What is missing, for people; "" for nothing.
    """

    path: Path
    note: str = ""


@dataclass
class _Meshes:
    """What became of the meshes of a description."""

    near: Path
    changed: bool = False
    bytes_read: int = 0
    missing: list[str] = field(default_factory=list)

    def add(self, file: Path) -> None:
        """Count a mesh that will be loaded.

        Raises:
            SetupError: Together they are larger than any robot's.
        """
        self.bytes_read += file.stat().st_size
        if self.bytes_read > MESHES_LIMIT:
            problem = f"and the meshes before it have more than {MESHES_LIMIT // 1_000_000} MB"
            raise SetupError(str(file), problem, "give coarser meshes, or a description without")


def prepared(path: Path, robot: RobotModel, source: str) -> Prepared:
    """The description at `path`, which `read_tree` has read before, for a robot with its own description.

    What has to be changed is changed in a copy. Messages name it as `source`.
    """
    root, own = read_description(path), read_description(robot.urdf_path)
    ours = {} if path == robot.urdf_path else {link.get("name", ""): link for link in own.findall("link")}
    meshes = _Meshes(path.parent.resolve())
    for link in root.findall("link"):
        _settle(link, ours.get(link.get("name", "")), meshes)
    added = list(_lacking(path, robot, own)) if ours else []
    if meshes.changed and ours:
        colours = {one.get("name") for one in root.findall("material")}
        added += [one for one in own.findall("material") if one.get("name") not in colours]
    root.extend(added)
    note = ""
    if meshes.missing:
        packaged = [name for name in meshes.missing if name.startswith(SCHEMES)]
        packages = sorted({name.split("://")[1].split("/")[0] for name in packaged})
        names = packages or [f"files such as {sorted(meshes.missing)[0]}"]
        drawn = f"as our own {robot.name} is" if ours else "not at all"
        what = f"{len(meshes.missing)} meshes of {', '.join(names)} are not here"
        remedy = "source the workspace that has them" if packages else "put them there, or name them by package://"
        note = f"{source}: {what}: those parts are drawn {drawn}; {remedy}"
    if not (meshes.changed or added) and _is_plain(path):
        return Prepared(path, note)
    return Prepared(temporary(ElementTree.tostring(root, encoding="unicode")), note)


def _is_plain(path: Path) -> bool:
    """Whether a file is written in UTF-8 and does not begin with a mark, as programs expect it."""
    content = path.read_bytes()
    try:
        content.decode()
    except UnicodeDecodeError:
        return False
    return not content.startswith(codecs.BOM_UTF8)


def temporary(text: str) -> Path:
    """A file with a description, in a folder that only this user can write to; the same for the same text.

    Raises:
        SetupError: The folder belongs to another user.
    """
    folder = private_folder()
    path = folder / f"{hashlib.sha256(text.encode(errors='replace')).hexdigest()[:16]}.urdf"
    written = path.with_suffix(f".{os.getpid()}")
    written.write_text(text, encoding="utf-8", errors="replace")
    return written.replace(path)


def _settle(link: ElementTree.Element, ours: ElementTree.Element | None, meshes: _Meshes) -> None:
    """Say where a link's meshes are, and put our own shapes in the place of those that are not there."""
    for tag in ("visual", "collision"):
        replaced = False
        for part in link.findall(tag):
            mesh = part.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            file = _found(name, meshes.near)
            if file is not None and (tag == "visual" or ours is None):
                meshes.add(file)
                mesh.set("filename", str(file))
                meshes.changed |= str(file) != name
                continue
            meshes.missing += [name] * (file is None and tag == "visual")
            link.remove(part)
            meshes.changed = replaced = True
        if replaced and ours is not None:
            link.extend(copy.deepcopy(part) for part in ours.findall(tag))


def _found(name: str, near: Path) -> Path | None:
    """Where a mesh is: in its installed package, or in a folder of that name around the description; None: nowhere."""
    scheme = next((scheme for scheme in SCHEMES if name.startswith(scheme)), "")
    if not scheme:
        file = near / name.removeprefix("file://")
        return file if file.is_file() else None
    package, _, rest = name.removeprefix(scheme).partition("/")
    if ".." in (package, *Path(rest).parts):  # untrusted description: its meshes must lie in their packages
        return None
    return next((folder / rest for folder in _folders(package, near) if (folder / rest).is_file()), None)


def _folders(package: str, near: Path) -> Iterator[Path]:
    """Where a package may be, installed or in the source tree around the description."""
    # Not there, nothing is installed, or no name at all; PackageNotFoundError is a LookupError.
    with suppress(ImportError, LookupError, OSError, ValueError):
        from ament_index_python.packages import get_package_share_directory

        yield Path(get_package_share_directory(package))
    for folder in (near, *near.parents):
        yield from (folder, folder.parent / package) if folder.name == package else (folder / package,)


def _lacking(path: Path, robot: RobotModel, own: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Our links, with the fixed joints before them, that the robot's model names and the description does not have."""
    theirs, ours = read_tree(path), read_tree(robot.urdf_path)
    known, wanted = {theirs.root, *theirs.by_child}, set[str]()
    for link in (robot.tool_link, *(robot.arm_links or ())):
        chain = ours.chain(link)
        after = max((place for place, joint in enumerate(chain) if joint.parent in known), default=len(chain))
        if link not in known and all(joint.kind == "fixed" for joint in chain[after:]):
            wanted |= {joint.child for joint in chain[after:]}
    for element in own:
        child = element.find("child")
        name = element.get("name") if element.tag == "link" else "" if child is None else child.get("link")
        if name in wanted:
            yield element
