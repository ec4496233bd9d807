# SPDX-License-Identifier: Apache-2.0
"""What may be said of bags that are cut into trials: one TOML file, checked as a node's parameters are.

interactions = ["handshake", "hand_wave"]   # others are left out; all that are found, if this is
touching = ["handshake"]                    # hands meet in these, which shows where the person stood
label = "topic:/label"                      # std_msgs/String; or one interaction for all trials
source = "recorded by ... in ..."           # for the model card
licence = "CC-BY-4.0"
[person]                                    # who is watched: parameters of the perception node, and `topic`
source = "nuitrack"
[robot]
robot = "yumi"
[cut]
rate_hz = 30.0
[labels]                                    # by bag; wins over `label`
take_1 = "handshake"                        # all of its trials
take_2 = ["handshake", "", "hand_wave"]     # one for each trial in its picture; "" leaves it out
take_3 = [{from_s = 3.0, to_s = 40.0, interaction = "hand_wave"}]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from mild_core.budgets import SETTINGS_BYTES, parse_toml, read_file
from mild_core.errors import SetupError, unknown_name
from mild_core.parameters import parameter
from mild_ros.assembly.settings import PerceptionParameters
from mild_ros.demonstrations.labels import BagLabels, bag_labels
from mild_ros.node_kit.parameters import from_values

REMEDY = "see mild demonstrations --help"
SAME = "same"
"""As the partner's topic: both people are in the person's messages."""


@dataclass(frozen=True)
class PersonParameters(PerceptionParameters):
    """Of a person in a bag: those of the perception node, and where its tracker's messages are."""

    topic: str = parameter("", "Topic of the skeletons; empty finds it by its type.")


@dataclass(frozen=True)
class RobotParameters:
    """Of a robot in a bag."""

    robot: str = parameter("", "A robot of this package, or the path of a robot file (.toml).")
    topic: str = parameter("joint_states", "Topic of its `sensor_msgs/JointState`.")
    robot_joint_names: tuple[str, ...] = parameter((), "The bag's names of its joints, in our order; empty if ours.")


@dataclass(frozen=True)
class CutParameters:
    """How a bag is cut. Speeds and spans are described in `mild_core.learning.data.segmentation.RestToRest`."""

    rate_hz: float = parameter(30.0, "Frames of a trial per second.", unit="Hz", minimum=5.0, maximum=200.0)
    clock: str = parameter(
        "auto", "Take the time from stamps, from receipt, or judge.", choices=("auto", "header", "bag")
    )
    slow_m_s: float = parameter(0.15, "A hand below this is slow.", unit="m/s", minimum=0.01, maximum=2.0)
    near_m: float = parameter(
        0.15, "It rests when this near to its place of rest too.", unit="m", minimum=0.01, maximum=1.0
    )
    rest_s: float = parameter(
        0.5, "Rests shorter than this do not split a recording.", unit="s", minimum=0.1, maximum=60.0
    )
    margin_s: float = parameter(
        1.0, "Rest around a movement that belongs to the trial.", unit="s", minimum=0.0, maximum=60.0
    )
    least_s: float = parameter(1.0, "Shortest movement.", unit="s", minimum=0.1, maximum=60.0)
    still_rad_s: float = parameter(0.1, "A robot slower than this stands.", unit="rad/s", minimum=0.001, maximum=10.0)


@dataclass(frozen=True)
class DemonstrationSettings:
    """All of a file.

    Attributes:
        person: Who is watched.
        partner: A second person who answers; None for a robot.
        robot: The robot that answers; None for a partner.
        cut: How trials are cut out.
        swap: The second person is watched, and the first one answers.
        interactions: The only ones wanted, in the order of labels; empty for all that are found.
        touching: Those in which hands meet.
        label: One for all trials, or "topic:NAME"; "" for none.
        labels: By bag.
        source: Who recorded what, for model cards.
        licence: Under which terms.
    """

    person: PersonParameters = PersonParameters()
    partner: PersonParameters | None = None
    robot: RobotParameters | None = None
    cut: CutParameters = CutParameters()
    swap: bool = False
    interactions: tuple[str, ...] = ()
    touching: tuple[str, ...] = ()
    label: str = ""
    labels: Mapping[str, BagLabels] = field(default_factory=dict)
    source: str = "our own bags"
    licence: str = "not stated"


TABLES: dict[str, type[Any]] = {
    "person": PersonParameters,
    "partner": PersonParameters,
    "robot": RobotParameters,
    "cut": CutParameters,
}
KINDS: dict[str, tuple[type[Any], str]] = {
    "swap": (bool, "true or false"),
    "interactions": (list, "a list of texts"),
    "touching": (list, "a list of texts"),
}


def read_settings(path: Path | None) -> DemonstrationSettings:
    """The settings of a TOML file; those by default without one.

    Raises:
        SetupError: It cannot be read, or a key or a value is wrong; names the key.
    """
    if path is None:
        return DemonstrationSettings()
    try:
        values = parse_toml(read_file(path, SETTINGS_BYTES, REMEDY))
    except ValueError as error:
        raise SetupError(str(path), f"is no TOML ({error})", REMEDY) from None
    known = [entry.name for entry in fields(DemonstrationSettings)]
    for key in values:
        if key not in known:
            raise unknown_name(f"{path}, key", key, known)
    return DemonstrationSettings(**{key: _value(path, key, value) for key, value in values.items()})


def _value(path: Path, key: str, value: Any) -> Any:
    """What the file says under a key, checked."""
    thing = f"{path}, key '{key}'"
    if key in (*TABLES, "labels"):
        if not isinstance(value, dict):
            raise SetupError(thing, f"is {value!r}", f"write it as [{key}]")
        if key == "labels":
            return {name: bag_labels(f"{thing}, '{name}'", said) for name, said in value.items()}
        try:
            return from_values(TABLES[key], value)
        except SetupError as error:
            raise SetupError(f"{thing}, {error.thing}", error.problem, error.remedy) from None
    kind, name = KINDS.get(key, (str, "a text"))
    if not isinstance(value, kind) or (kind is list and not all(isinstance(one, str) for one in value)):
        raise SetupError(thing, f"is {value!r}", f"give {name}")
    return tuple(value) if kind is list else value
