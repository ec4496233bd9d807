# SPDX-License-Identifier: Apache-2.0
"""How every executable of ours starts, runs and ends.

A wrong set-up is one line and exit code 2. SIGINT and SIGTERM end the node with exit code 0, also while it is still
loading. `EventsExecutor.spin` of Jazzy calls nothing and ignores SIGTERM; its `spin_once` does both, with half the
processor time and a third of the tail latency of the `SingleThreadedExecutor`.
"""

from __future__ import annotations

import gc
import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from mild_core.errors import SetupError
from mild_ros.parameters import help_text

_ENDED_BY = "ended_by"
"""Attribute of a node that gave up."""

SETUP_ERROR = 2
"""Exit code of a wrong set-up, as of a wrong command line."""


def run(name: str, make_node: Callable[[], Node], parameters: type[Any]) -> int:
    """Run a node until a signal ends it.

    Args:
        name: Of the executable, for messages.
        make_node: Makes the node, ready to work.
        parameters: The dataclass of its parameters, for `--help`.

    Returns:
        The exit code.
    """
    if {"--help", "-h"} & set(sys.argv[1:]):
        print(f"ros2 run mild_ros {name} [--ros-args -p NAME:=VALUE ... -r TOPIC:=TOPIC ...]\n\nParameters:")
        print(help_text(parameters))
        return 0
    with _signals_interrupt() as settle:
        try:
            _start_ros()
            node = make_node()
            settle()
            _spin(node)
        except SetupError as error:
            print(f"mild_ros {name}: {error}", file=sys.stderr)
            return SETUP_ERROR
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        finally:
            settle()
            rclpy.try_shutdown()
    return 0


def give_up(node: Node, error: SetupError) -> None:
    """End the program from within a callback, with one line and exit code 2.

    What a callback raises, the executor reports as a traceback before it passes it on.
    """
    setattr(node, _ENDED_BY, error)
    rclpy.try_shutdown()


def _start_ros() -> None:
    try:
        rclpy.init()
        words = remove_ros_args(sys.argv)[1:]
    except Exception as error:  # rclpy has no common root for what it raises on bad arguments
        problem = re.sub(r",? at /\S+", "", str(error).splitlines()[0])
        raise SetupError("--ros-args", problem, "write --ros-args -p NAME:=VALUE -r TOPIC:=TOPIC") from None
    if words:
        raise SetupError(words[0], "is no argument of a node", "write --ros-args -p NAME:=VALUE -r TOPIC:=TOPIC")


def _spin(node: Node) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    gc.collect()
    gc.freeze()  # models and messages types stay: collections that walk them would show in the latency
    try:
        with suppress(ExternalShutdownException):
            while rclpy.ok():
                executor.spin_once(timeout_sec=1.0)
        if (error := getattr(node, _ENDED_BY, None)) is not None:
            raise error
    finally:
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()
        gc.unfreeze()  # compiled libraries complain of what is still there when they are unloaded


@contextmanager
def _signals_interrupt() -> Iterator[Callable[[], None]]:
    """Let SIGINT and SIGTERM raise KeyboardInterrupt until the yielded function is called; then rclpy's own way holds.

    rclpy's handler only marks the context as shut down, which nobody looks at during a long load, and calls the one
    that was there before.
    """
    loading = True

    def settle() -> None:
        nonlocal loading
        loading = False

    def interrupt(_signal: int, _frame: FrameType | None) -> None:
        if loading:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield settle
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
