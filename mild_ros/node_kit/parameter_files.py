# SPDX-License-Identifier: Apache-2.0
"""A node's parameters as `ros2 run` and `ros2 launch` take them, for programs that start nodes or do without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml

from mild_core.budgets import SETTINGS_BYTES, read_file
from mild_core.errors import SetupError, unknown_name
from mild_core.parameters import parameters_of
from mild_core.resources import share_folder
from mild_core.yaml_budget import check_yaml
from mild_ros.node_kit.parameters import from_values

Parameters = TypeVar("Parameters")


def configuration(name: str) -> Path:
    """The parameter file of a name, as the launch files take it: of ours, or a path with or without `.yaml`.

    Raises:
        SetupError: There is none; the message lists ours.
    """
    here = Path(__file__).parents[1] / "config"  # of a checkout; what is installed lies with the models
    folder = here if here.is_dir() else share_folder("config")
    path = Path(name).expanduser()
    for found in (folder / f"{name}.yaml", path, path.with_name(f"{path.name}.yaml")):
        if found.exists() and not found.is_dir():
            return found
    raise unknown_name("config", name, sorted(file.stem for file in folder.glob("*.yaml")))


def read_parameters(
    kind: type[Parameters], node: str, config: str = "", given: Sequence[str] = (), **named: Any
) -> Parameters:
    """The parameters of a node: of a file, over them those of `NAME:=VALUE`, over them those that are named here.

    Args:
        kind: Their dataclass.
        node: Its name, by which a file knows it.
        config: A parameter file, as `configuration`; "" for none.
        given: Each `NAME:=VALUE`, the value as YAML.
        named: Those that are not None count.

    Raises:
        SetupError: A file, a name or a value is wrong.
    """
    values = _of_file(configuration(config), node) if config else {}
    for word in given:
        name, sign, value = word.partition(":=")
        if not sign:
            raise SetupError(f"-p {word}", "has no :=", "give NAME:=VALUE, e.g. -p side:=left")
        values[name] = _parsed(f"-p {word}", value)
    return from_values(kind, values | {name: value for name, value in named.items() if value is not None})


def changed(parameters: Any) -> dict[str, Any]:
    """The parameters that are not as by default, for the command line of a node."""
    pairs = [(entry, getattr(parameters, entry.name)) for entry in parameters_of(type(parameters))]
    return {entry.name: value for entry, value in pairs if value != entry.default}


def _of_file(path: Path, node: str) -> dict[str, Any]:
    """What a file says of a node, in whatever namespace; what it says of all nodes comes first."""
    content = _parsed(str(path), read_file(path, SETTINGS_BYTES).decode(errors="replace"))
    values: dict[str, Any] = {}
    for name, part in sorted(content.items()) if isinstance(content, Mapping) else ():
        if str(name).rsplit("/", 1)[-1] not in ("**", node):
            continue
        if not isinstance(part, Mapping) or not isinstance(part.get("ros__parameters"), Mapping):
            raise SetupError(str(path), f"{name} has no ros__parameters", "write it as in config/yumi.yaml")
        values |= part["ros__parameters"]
    if not values:
        raise SetupError(str(path), f"has no parameters of {node}", f"begin it with /**/{node}: as config/yumi.yaml")
    return values


def _parsed(thing: str, text: str) -> Any:
    try:
        check_yaml(text)
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError) as error:
        raise SetupError(thing, f"is no YAML ({str(error).splitlines()[0]})", "put texts into quotes") from None
