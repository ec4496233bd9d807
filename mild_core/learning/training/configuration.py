# SPDX-License-Identifier: Apache-2.0
"""One file per model says all that its training depends on: recording, protocol, settings, seed, where it starts."""

from __future__ import annotations

import json
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from mild_core.budgets import SETTINGS_BYTES, parse_toml, read_file
from mild_core.errors import SetupError, unknown_name
from mild_core.learning.data.windows import protocol_named
from mild_core.learning.datasets import DATASETS, recording_named
from mild_core.learning.training.presets import preset_named
from mild_core.learning.training.settings import TrainingSettings

FOLDER = Path(__file__).parents[1] / "configurations"

STEP_S = {"same": 0.4, "ahead": 0.4, "next": 0.125}
"""How far belief and memory step in the shipped models, by protocol."""

Settings = TypeVar("Settings")


@dataclass(frozen=True)
class Configuration:
    """How one model is trained.

    Attributes:
        name: Of the model: the file's name without its ending.
        dataset: Name in `DATASETS`, or the path of a folder of trials.
        protocol: One of that recording's.
        seed: Of all draws.
        preset: Name in `PRESETS` of the settings that the file does not name.
        start_from: Model (a name or folder) whose hidden layers of equal size the training starts from; "" for none.
        settings: All else.
        text: The file as it was read; model cards repeat it.
    """

    name: str
    dataset: str
    protocol: str
    seed: int
    preset: str
    start_from: str
    settings: TrainingSettings
    text: str


KEYS = ("dataset", "protocol", "preset", "seed", "start_from", "settings")


def configuration_names() -> tuple[str, ...]:
    """The configurations that came with the package."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def read_configuration(name: str) -> Configuration:
    """Read a configuration.

    Args:
        name: One of `configuration_names`, or the path of a TOML file.

    Raises:
        SetupError: There is none, it is no TOML, or a key or value of it is unknown; names the key.
    """
    path = Path(name)
    if path.suffix != ".toml":
        if name not in configuration_names():
            raise unknown_name("configuration", name, configuration_names())
        path = FOLDER / f"{name}.toml"
    try:
        text = read_file(path, SETTINGS_BYTES, "give the path of a configuration").decode()
        table = parse_toml(text)
    except ValueError as error:
        raise SetupError(str(path), f"is no TOML ({error})", "see the configurations of the shipped models") from None
    return _configuration(path, table, text)


def configuration_from(name: str, table: Mapping[str, Any], text: str) -> Configuration:
    """The configuration that a manifest repeats (see `Manifest.training`), under the model's name."""
    return _configuration(Path(f"{name}.toml"), table, text)


def _configuration(path: Path, table: Mapping[str, Any], text: str) -> Configuration:
    """A configuration from what the file says."""
    for key in table:
        if key not in KEYS:
            raise unknown_name(f"{path}, key", key, KEYS)
    given = {key: table.get(key, default) for key, default in (("seed", 0), ("start_from", ""), ("preset", ""))}
    for key in ("dataset", "protocol"):
        if key not in table:
            raise SetupError(str(path), f"key '{key}' is missing", "name it")
        given[key] = table[key]
    for key, value in given.items():
        _require(f"{path}, key '{key}'", value, int if key == "seed" else str)
    beside = path.parent / Path(given["dataset"]).expanduser()
    if given["dataset"] not in DATASETS and beside.is_dir():
        given["dataset"] = str(beside)
    protocol = protocol_named(given["protocol"], recording_named(given["dataset"]).protocols).name
    given["preset"] = given["preset"] or protocol
    settings = overridden(preset_named(given["preset"]), table.get("settings", {}), f"{path}, settings")
    return Configuration(path.stem, settings=settings, text=text, **given)


def overridden(settings: Settings, table: Any, where: str) -> Settings:
    """Settings with some of their values replaced by what a table of the same structure says.

    Args:
        settings: A frozen dataclass; may hold further ones, which sub-tables override in turn.
        table: New values by name. An optional part is left out by `false`, and taken with its defaults by `true`.
        where: How to name the place in an error.

    Raises:
        SetupError: A name is unknown, a value has another type, or the values do not go together.
    """
    _require(where, table, dict)
    hints, changes = get_type_hints(type(settings)), {}
    names = [field.name for field in fields(settings)]  # type: ignore[arg-type]  # any dataclass
    for name, value in table.items():
        if name not in names:
            raise unknown_name(f"{where}, key", name, names)
        changes[name] = _value(getattr(settings, name), hints[name], value, f"{where}.{name}")
    try:
        return replace(settings, **changes)  # type: ignore[type-var]
    except ValueError as error:
        raise SetupError(where, str(error), "change one of them") from None


def _value(before: Any, kind: Any, value: Any, where: str) -> Any:
    """`value` of a file as the field of type `kind` takes it."""
    if get_origin(kind) is types.UnionType:
        kind = next(option for option in get_args(kind) if option is not type(None))
        if value is False:
            return None
        before, value = before or kind(), {} if value is True else value
    if is_dataclass(kind):
        return overridden(before, value, where)
    if get_origin(kind) is tuple:
        _require(where, value, list)
        for one in value:
            _require(where, one, get_args(kind)[0])
        return tuple(value)
    _require(where, value, kind)
    return kind(value)


def _require(where: str, value: Any, kind: type) -> None:
    """Refuse a value of another type; a whole number will do for a fraction, and truth for neither."""
    if isinstance(value, kind) and (kind is bool or not isinstance(value, bool)):
        return
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return
    raise SetupError(where, f"is {value!r}", f"give {NAMES[kind]}")


NAMES = {
    int: "a whole number",
    float: "a number",
    str: "a text",
    bool: "true or false",
    list: "a list",
    dict: "a table of values",
}


def configuration_for(dataset: str, protocol: str) -> Configuration | None:
    """The configuration of the model that is shipped for a recording and protocol; None where none is.

    Of a folder of trials the protocol's preset, its steps being as long as in the shipped models.

    Raises:
        SetupError: A folder of trials cannot be read, or there is no such protocol.
    """
    for name in configuration_names():
        found = read_configuration(name)
        if (found.dataset, found.protocol) == (dataset, protocol) and found.preset != "paper":
            return found
    if dataset in DATASETS:
        return None
    recording = recording_named(dataset)
    rate_hz = recording.rate_hz / protocol_named(protocol, recording.protocols).keep_every
    stride = max(1, round(STEP_S[protocol] * rate_hz))
    text = f'dataset = {json.dumps(dataset)}\nprotocol = "{protocol}"\n[settings]\n'
    text += f"stride = {stride}  # belief and memory step every {stride / rate_hz:.2g} s\ngradient_stride = {stride}\n"
    return _configuration(Path(f"{recording.name}_{protocol}.toml"), parse_toml(text), text)
