# SPDX-License-Identifier: Apache-2.0
"""A folder of trials: `trials.toml` says what they are, for people to read and edit; `trials.npz` holds numbers only.

Array `trial_<number>` has a row for each frame: the observed arm's joints, x y z [m], from the shoulder outwards, then
what the controlled agent did: joint angles [rad], or its arm's joints [m]. It loads without pickle.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mild_core.budgets import parse_toml, read_file
from mild_core.errors import DatasetError
from mild_core.fields import Fields
from mild_core.inference.manifest import ControlledAgent, HumanPlacement, ObservedAgent
from mild_core.inference.manifest_reading import read_controlled, read_observed, read_placement
from mild_core.learning.data.demonstration import Demonstration
from mild_core.learning.data.recording import SPLITS, Demonstrations, Recording
from mild_core.learning.data.safe_npz import numbers, read_safe_npz
from mild_core.learning.data.windows import protocols

SPDX: tuple[str, ...] = (
    *("Apache-2.0", "MIT", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0"),
    *("GPL-3.0-only", "GPL-3.0-or-later", "AGPL-3.0-only", "AGPL-3.0-or-later", "LGPL-3.0-only"),
)
"""Licences of a folder of trials that are taken at their word; others are shown to people as they are written."""

MANIFEST, ARRAYS = "trials.toml", "trials.npz"
FORMAT_VERSION = 1
LARGEST_FILE = 10_000_000
"""Bytes of a manifest: some hundred thousand trials."""

MOST_TRIALS = 100_000
REMEDY = "mend it, or write the folder again with mild demonstrations"
NEXT_HZ = 8.0
"""About the rate at which protocol "next" sees frames."""

HEAD = """\
# Trials cut out of recorded bags by `mild demonstrations`; the numbers are in trials.npz.
# Edit freely: the interaction of a trial, its split ("test": never learned from), or take a whole [[trial]] out.
"""


@dataclass(frozen=True)
class TrialEntry:
    """One trial.

    Attributes:
        number: Of its array.
        interaction: What the two were doing.
        split: "train", or "test" to put it aside.
        bag: Where it comes from.
        from_s: Its begin in the bag, since the bag's first message.
        onset_s: When the person's hand leaves its rest.
        back_s: When both rest again.
        to_s: Its end.
    """

    number: int
    interaction: str
    split: str
    bag: str
    from_s: float
    onset_s: float
    back_s: float
    to_s: float


@dataclass(frozen=True)
class Trials:
    """All of `trials.toml`.

    Attributes:
        name: Of the recording.
        source: Who recorded what, for model cards.
        licence: Under which terms.
        rate_hz: Frames per second.
        interactions: Their names, in the order of a model's labels.
        observed: The person; every trial has these bone lengths.
        controlled: A robot's joints or a partner's arm.
        robot_from_human: Where the person stood; None when unknown.
        trial: The trials.
    """

    name: str
    source: str
    licence: str
    rate_hz: float
    interactions: tuple[str, ...]
    observed: ObservedAgent
    controlled: ControlledAgent
    robot_from_human: HumanPlacement | None
    trial: tuple[TrialEntry, ...]


def write_trials(folder: Path, trials: Trials, demonstrations: Sequence[Demonstration]) -> None:
    """Write a folder of trials; demonstrations are in the order of `trials.trial`."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {
        f"trial_{entry.number}": np.hstack([d.observed_m.reshape(d.frames, -1), d.controlled.reshape(d.frames, -1)])
        for entry, d in zip(trials.trial, demonstrations, strict=True)
    }
    np.savez_compressed(folder / ARRAYS, **arrays)  # type: ignore[arg-type]  # the stubs take these for its options
    values = {"format_version": FORMAT_VERSION, **asdict(trials)}
    (folder / MANIFEST).write_text(HEAD + "\n".join(_toml(values)) + "\n", encoding="utf-8")


def _toml(values: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """Lines of TOML; what is None or empty is left out."""
    later = []
    for key, value in values.items():
        if isinstance(value, Mapping):
            later.append((f"\n[{path}{key}]", f"{path}{key}.", value))
        elif isinstance(value, tuple) and value and isinstance(value[0], Mapping):
            later += [(f"\n[[{path}{key}]]", f"{path}{key}.", row) for row in value]
        elif value is not None:
            yield f"{key} = {json.dumps(value, ensure_ascii=False)}"
    for head, below, table in later:
        if table:
            yield head
            yield from _toml(table, below)


def read_trials(folder: Path) -> Trials:
    """Read and check `trials.toml`.

    Raises:
        DatasetError: There is none, or a key is missing, unknown or out of its bounds; the key is named.
    """
    path = folder / MANIFEST
    thing = str(path)
    if not path.exists():
        raise DatasetError(str(folder), f"has no {MANIFEST}", "give a folder that mild demonstrations wrote")
    content = read_file(path, LARGEST_FILE, REMEDY, DatasetError)
    try:
        values = parse_toml(content)
    except ValueError as error:
        raise DatasetError(thing, f"is no TOML ({error})", REMEDY) from None
    fields = Fields(thing, "", values, REMEDY, DatasetError)
    fields.only({"format_version", *Trials.__dataclass_fields__})
    if fields.integer("format_version", 0, 10**6) != FORMAT_VERSION:
        raise fields.wrong("format_version", "is another one", f"this program reads version {FORMAT_VERSION}")
    interactions = fields.names("interactions", 64)
    placed = "robot_from_human" in values
    entries = tuple(_entry(row, interactions) for row in fields.objects("trial", MOST_TRIALS))
    if len({entry.number for entry in entries}) != len(entries):
        raise fields.wrong("trial", "holds a number twice")
    return Trials(
        name=fields.text("name"),
        source=fields.text("source"),
        licence=fields.text("licence"),
        rate_hz=fields.number("rate_hz", 1.0, 1000.0),
        interactions=interactions,
        observed=read_observed(fields.object("observed")),
        controlled=read_controlled(fields.object("controlled")),
        robot_from_human=read_placement(fields.object("robot_from_human"), interactions) if placed else None,
        trial=entries,
    )


def _entry(fields: Fields, interactions: tuple[str, ...]) -> TrialEntry:
    fields.only(TrialEntry.__dataclass_fields__)
    times = ("from_s", "onset_s", "back_s", "to_s")
    return TrialEntry(
        fields.integer("number", 0, 10**9),
        fields.text("interaction", interactions),
        fields.text("split", SPLITS),
        fields.text("bag"),
        *(fields.number(name, -1e9, 1e9) for name in times),
    )


def recording_of(folder: Path) -> Recording:
    """A folder of trials as a recording like any other.

    Raises:
        DatasetError: As `read_trials`.
    """
    trials = read_trials(folder)
    return Recording(
        name=trials.name,
        title=f"{trials.name}: a person and {_whom(trials.controlled)}",
        file=str(folder.resolve()),
        rate_hz=trials.rate_hz,
        interactions=trials.interactions,
        touching=(),
        observed_names=trials.observed.joint_names,
        observed_side=trials.observed.side,
        robot="" if trials.controlled.kind == "human_arm" else trials.controlled.robot,
        controlled_names=trials.controlled.joint_names,
        licence=trials.licence,
        source=trials.source,
        read=_read,
        protocols=protocols(window=round(trials.rate_hz), keep_every=max(1, round(trials.rate_hz / NEXT_HZ))),
        placement=trials.robot_from_human,
        spdx=trials.licence if trials.licence in SPDX else "NOASSERTION",
    )


def _whom(controlled: ControlledAgent) -> str:
    return "another person" if controlled.kind == "human_arm" else f"the robot {controlled.robot}"


def _read(folder: Path) -> Demonstrations:
    """The trials of a folder (see `Recording.read`)."""
    trials = read_trials(folder)
    arrays = read_safe_npz(folder / ARRAYS, [f"trial_{entry.number}" for entry in trials.trial])
    of = partial(_demonstration, folder, trials, arrays)
    return Demonstrations(*(tuple(of(entry) for entry in trials.trial if entry.split == split) for split in SPLITS))


def _demonstration(folder: Path, trials: Trials, arrays: Mapping[str, Any], entry: TrialEntry) -> Demonstration:
    """One trial, checked."""
    observed, controlled = trials.observed.joint_names, trials.controlled.joint_names
    partner = trials.controlled.kind == "human_arm"
    width = 3 * len(observed)
    columns = width + len(controlled) * (3 if partner else 1)
    thing = f"trial {entry.number} of '{folder / ARRAYS}'"
    rows = numbers(thing, "motion", arrays[f"trial_{entry.number}"], columns)
    times_s = entry.from_s + np.arange(len(rows)) / trials.rate_hz
    return Demonstration(
        trial=entry.number,
        interaction=entry.interaction,
        rate_hz=trials.rate_hz,
        observed_names=observed,
        observed_m=rows[:, :width].reshape(len(rows), -1, 3),
        controlled_names=controlled,
        controlled=rows[:, width:].reshape(len(rows), -1, 3) if partner else rows[:, width:],
        active=((times_s >= entry.onset_s) & (times_s < entry.back_s)).astype(np.float64),
    )
