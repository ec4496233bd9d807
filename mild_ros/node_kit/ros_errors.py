# SPDX-License-Identifier: Apache-2.0
"""What ROS 2 refuses when it starts or makes a node, as one line."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.impl.implementation_singleton import rclpy_implementation

from mild_core.errors import SetupError
from mild_ros.node_kit.dds_variables import heard_remedy

USAGE = "write --ros-args -p NAME:=VALUE -r TOPIC:=TOPIC"

_OF_THE_COMMAND_LINE = (rclpy_implementation.UnknownROSArgsError, rclpy_implementation.RCLInvalidROSArgsError)
_UNTOLD = "error not set"
"""What it says where it has printed the reason before, or knows none."""


@contextmanager
def refused_in_one_line() -> Iterator[None]:
    """Around the first contact with ROS: what comes of a wrong environment or command line is a `SetupError`."""
    warnings.filterwarnings("ignore", "Failed to fini", RuntimeWarning)  # of what is left of a node that is none
    try:
        yield
    except _OF_THE_COMMAND_LINE as error:
        raise SetupError("--ros-args", _first_line(error), USAGE) from None
    except rclpy_implementation.RCLError as error:
        problem = _first_line(error)
        if "logging" in problem:
            raise SetupError("ROS log", problem, "set ROS_LOG_DIR to a folder that can be written") from None
        if "argument" in problem or "parse" in problem:
            raise SetupError("--ros-args", problem, USAGE) from None
        remedy = heard_remedy("./mild doctor names what of the environment keeps it from that")
        raise SetupError("ROS 2", problem, remedy) from None


def _first_line(error: Exception) -> str:
    """Without the place in the sources of ROS."""
    line = re.sub(r",? at /\S+", "", str(error).strip().splitlines()[0])
    return line.replace(_UNTOLD, "the environment or the command line is refused")
