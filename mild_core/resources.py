# SPDX-License-Identifier: Apache-2.0
"""The models and bags that came with the package, however it was installed: by name, loaded, and what they observe."""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mild_core.errors import SetupError, unknown_name
from mild_core.printable import printable

if TYPE_CHECKING:
    from mild_core.inference.manifest import Manifest
    from mild_core.inference.motion_model import MildModel
    from mild_core.perception.settings import PerceptionSettings


@cache
def share_folder(kind: str) -> Path:
    """The folder of `kind` (models, bags): of the ament index, of the Python environment, or of the checkout.

    Raises:
        SetupError: There is none.
    """
    places = [Path(sys.prefix, "share", "mild_ros"), Path(__file__).resolve().parent.parent]
    try:
        from ament_index_python.packages import get_package_share_directory

        places.insert(0, Path(get_package_share_directory("mild_ros")))
    except (ImportError, LookupError, ValueError, OSError):  # PackageNotFoundError is a LookupError
        pass  # bags are read and models evaluated where ROS is not installed
    for place in places:
        if (place / kind).is_dir():
            return place / kind
    raise SetupError(kind, f"no folder of that name in {places[0]}", "install the package again")


def model_folder(name: str) -> Path:
    """The folder of a model that is given by its name or by a path.

    A bare name means the shipped model, whatever lies in the current folder; only a name that no shipped model has may
    be a folder there, and that is said on stderr.

    Raises:
        SetupError: There is no such folder; the message lists those there are.
    """
    path, bare = Path(name).expanduser(), os.sep not in name
    if bare and name in model_names():
        if path.is_dir():
            _print_once(f"model {name}: the shipped one is taken; the folder of that name here is .{os.sep}{name}")
        return share_folder("models") / name
    if path.is_dir():
        if bare and path.name:
            _print_once(f"model {printable(name)}: the folder of that name here is taken")
        return path
    if len(path.parts) != 1:
        names = " or ".join(model_names()) or "a path"
        raise SetupError(f"model {name}", "no such folder", f"give a folder or {names}")
    raise unknown_name("model", name, model_names())


@cache
def _print_once(words: str) -> None:
    """Say something once."""
    sys.stderr.write(f"mild: {words}\n")


def model_names() -> tuple[str, ...]:
    """Names of the models that came with the package."""
    return tuple(sorted(path.parent.name for path in share_folder("models").glob("*/manifest.json")))


def load_model(name: str | Path) -> MildModel:
    """A model by its name or the path of its folder, all of it checked.

    Args:
        name: As for `model_folder`.

    Raises:
        SetupError: There is no such folder.
        ModelError: It is broken, altered, or predicts otherwise than where it was trained.
    """
    from mild_core.inference import model  # what only looks for a bag does without numba

    return model.load_model(model_folder(str(name)))


def perception_settings(manifest: Manifest, **settings: Any) -> PerceptionSettings:
    """Settings of perception for what a model observes: its joints, bone lengths, rate, window and features.

    Args:
        manifest: Of the model.
        settings: Further fields of `PerceptionSettings`, such as `source_axes` or `robot_from_source`.

    Raises:
        SetupError: One of them cannot work.
    """
    from mild_core.perception.settings import PerceptionSettings

    return PerceptionSettings(
        joint_names=manifest.observed.joint_names,
        bone_lengths_m=manifest.observed.bone_lengths_m,
        rate_hz=manifest.rate_hz,
        window=manifest.window,
        features=manifest.features,  # type: ignore[arg-type] # one of its choices
        **settings,
    )
