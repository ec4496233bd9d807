# SPDX-License-Identifier: Apache-2.0
"""Classes of messages by the names of their types: only those of packages that are installed can be had."""

from __future__ import annotations

import importlib
import re
from typing import Any


def message_class(type_name: str) -> Any | None:
    """The class of e.g. `sensor_msgs/msg/JointState`; None when it is not installed here."""
    if not re.fullmatch(r"[a-z]\w*/msg/[A-Z]\w*", type_name):  # it comes from a bag, or from the network
        return None
    package, _, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except ImportError:
        return None
