# SPDX-License-Identifier: Apache-2.0
"""A budget for YAML, in which a few lines can stand for more values than a computer has bytes."""

from __future__ import annotations

YAML_NODES, YAML_DEPTH = 500_000, 40
"""Most values, each use of an alias counted, and how deep they may be nested."""


def check_yaml(text: str) -> None:
    """Refuse YAML that is nested too deeply, or whose aliases stand for too much; what is no YAML passes.

    Raises:
        ValueError: It is.
    """
    import yaml  # only who reads such a file needs it

    total = 0
    opened: list[tuple[str | None, int]] = []
    sizes: dict[str | None, int] = {}
    try:
        for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            anchor: str | None = getattr(event, "anchor", None)
            if isinstance(event, yaml.AliasEvent):
                total += sizes.get(anchor, YAML_NODES + 1)  # one that is still open leads round in a circle
            elif isinstance(event, yaml.CollectionStartEvent):
                opened.append((anchor, total))
                total += 1
            elif isinstance(event, yaml.CollectionEndEvent):
                name, before = opened.pop()
                sizes[name] = total - before
            elif isinstance(event, yaml.ScalarEvent):
                sizes[anchor] = 1 + len(event.value) // 1000
                total += sizes[anchor]
            if len(opened) > YAML_DEPTH:
                raise ValueError(f"holds YAML that is nested deeper than {YAML_DEPTH}")
            if total > YAML_NODES:
                raise ValueError(f"holds YAML of more than {YAML_NODES} values, each use of an alias counted")
    except yaml.YAMLError:
        return
