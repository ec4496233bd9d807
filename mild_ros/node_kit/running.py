# SPDX-License-Identifier: Apache-2.0
"""How every executable of ours starts, runs and ends.

A wrong set-up is one line and exit code 2. SIGINT, SIGTERM and SIGHUP (a closed terminal) end the node with exit code
0, also while it is still loading. `EventsExecutor.spin` of Jazzy calls nothing; its `spin_once` does, with half the
processor time and a third of the tail latency of the `SingleThreadedExecutor`.
"""

from __future__ import annotations

import gc
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from mild_core.errors import SetupError
from mild_core.parameters import parameters_of
from mild_core.printable import printable_lines
from mild_ros.node_kit.dds_variables import domain_id, problems, refuse_what_cannot_start, why_alone
from mild_ros.node_kit.parameters import help_text
from mild_ros.node_kit.ros_errors import USAGE, refused_in_one_line
from mild_ros.node_kit.terminal import show_any_text
from mild_ros.node_kit.threads import StageNode

_ENDED_BY = "ended_by"
"""Attribute of a node that gave up."""

_NOTICE_S = 0.1
"""A node that has nothing to do notices a signal within this time."""

_ALONE_S = 5.0
"""A node that sees no other for so long after its start says what in the environment may be why."""

VALUE_FLAGS = ("-p", "--param", "-r", "--remap", "--log-level", "-e", "--enclave", "--params-file")
"""Flags of `--ros-args` that take the next word."""

SETUP_ERROR = 2
"""Exit code of a wrong set-up, as of a wrong command line."""


def run(name: str, make_node: Callable[[], Node], parameters: type[Any]) -> int:
    """Run a node until a signal ends it, and the process with it.

    Args:
        name: Of the executable, for messages.
        make_node: Makes the node, ready to work.
        parameters: The dataclass of its parameters, for `--help`.

    Returns:
        The exit code of `--help`; in all other cases the process ends here.
    """
    show_any_text()
    if {"--help", "-h"} & set(sys.argv[1:]):
        print(f"ros2 run mild_ros {name} [--ros-args -p NAME:=VALUE ... -r TOPIC:=TOPIC ...]\n\nParameters:")
        print(help_text(parameters))
        return 0
    with _Interruption() as interruption:
        code = _run(name, make_node, interruption, tuple(entry.name for entry in parameters_of(parameters)))
    sys.stdout.flush()
    sys.stderr.flush()
    # Everything is closed. To take the interpreter and its compiled libraries down would need another 0.6 s.
    os._exit(code)


def _run(
    name: str, make_node: Callable[[], Node], interruption: _Interruption, parameter_names: Collection[str]
) -> int:
    """The exit code, once all is over."""
    try:
        check_words(sys.argv[1:], parameter_names)
        _start_ros(name)
        with refused_in_one_line():
            node = make_node()
        interruption.end_of_loading()
        _spin(node, interruption)
    except SetupError as error:
        print(f"mild_ros {name}: {error}", file=sys.stderr)
        return SETUP_ERROR
    except KeyboardInterrupt:
        pass
    except Exception:
        if not interruption.cut_short:  # otherwise compiled code has made something else of the interruption
            raise
    finally:
        interruption.loading = False
        rclpy.try_shutdown()
    return 0


def give_up(node: Node, error: SetupError) -> None:
    """End the program from within a callback, with one line and exit code 2.

    What a callback raises, the executor reports as a traceback before it passes it on.
    """
    setattr(node, _ENDED_BY, error)
    rclpy.try_shutdown()


def has_given_up(node: Node) -> bool:
    """Whether `give_up` is ending the program."""
    return getattr(node, _ENDED_BY, None) is not None


@contextmanager
def giving_up(node: Node) -> Iterator[None]:
    """Around what a callback does: a `SetupError` in it ends the program as `give_up` does."""
    try:
        yield
    except SetupError as error:
        give_up(node, error)


def check_words(words: Sequence[str], parameter_names: Collection[str]) -> None:
    """Refuse `NAME:=VALUE` without a flag: ROS takes it for another name of a topic and runs with the defaults.

    Raises:
        SetupError: Names the word and how to write it.
    """
    for before, word in zip(("", *words), words, strict=False):
        name, sign, value = word.partition(":=")
        if sign and not value and before in VALUE_FLAGS:
            raise SetupError(
                f"{before} {word}", "has no value", f"give one, or leave it out; an empty text is {name}:='\"\"'"
            )
        if not sign or before in VALUE_FLAGS:
            continue
        flag = "-p" if name in parameter_names else "-r"
        raise SetupError(word, "has no flag before it", f"write --ros-args {flag} {word}")


def _start_ros(name: str) -> None:
    """Start rclpy; before it, and before whatever DDS prints, say what is wrong in the environment.

    Raises:
        SetupError: The environment or the command line is wrong.
    """
    domain_id()
    refuse_what_cannot_start()
    for variable, problem in problems().items():
        print(printable_lines(f"mild_ros {name}: {variable}: {problem}"), file=sys.stderr, flush=True)
    with refused_in_one_line():
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        words = remove_ros_args(sys.argv)[1:]
    if words:
        raise SetupError(words[0], "is no argument of a node", USAGE)


def _spin(node: Node, interruption: _Interruption) -> None:
    executor = EventsExecutor()
    executor.add_node(node)
    gc.collect()
    gc.freeze()  # models and messages types stay: collections that walk them would show in the latency
    beside = node if isinstance(node, StageNode) else None
    look_s = time.monotonic() + _ALONE_S
    try:
        if beside is not None:
            beside.start_threads()
        with suppress(ExternalShutdownException):
            while rclpy.ok() and not interruption.wanted and not (beside and beside.failure):
                executor.spin_once(timeout_sec=_NOTICE_S)
                if time.monotonic() > look_s:
                    look_s = math.inf
                    _look_around(node)
        if beside is not None and beside.failure is not None:
            raise beside.failure
        if (error := getattr(node, _ENDED_BY, None)) is not None:
            raise error
    finally:
        if beside is not None:
            beside.stop_threads()
        executor.remove_node(node)
        node.destroy_node()
        executor.shutdown()
    if (error := getattr(node, _ENDED_BY, None)) is not None:  # its end has failed
        raise error


def _look_around(node: Node) -> None:
    """Say what in the environment may be why no other node is seen, if there is such a thing."""
    if len(node.get_node_names()) < 2 and (why := why_alone()):
        node.get_logger().error(printable_lines(f"no other node is seen in ROS domain {domain_id()}: {why}"))


class _Interruption:
    """What SIGINT, SIGTERM and SIGHUP do.

    rclpy's own handlers are not used: they end the context in the middle of a callback.

    While the node loads they raise KeyboardInterrupt, again and again, because callbacks of compiled libraries
    swallow exceptions. Afterwards they only say that the node is to end, and it does between two callbacks.

    Attributes:
        loading: Whether the node is.
        wanted: Whether a signal has come.
        cut_short: Whether it came during the load.
    """

    _AGAIN_S = 0.1

    def __init__(self) -> None:
        self.loading = True
        self.wanted = self.cut_short = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> _Interruption:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM):
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # of nohup
                self._before[number] = signal.signal(number, self._interrupt)
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def end_of_loading(self) -> None:
        """The node is ready; raises KeyboardInterrupt if it is no longer wanted."""
        self.loading = False
        if self.wanted:
            raise KeyboardInterrupt

    def _interrupt(self, _number: int, _frame: FrameType | None) -> None:
        self.wanted = True
        if self.loading:
            self.cut_short = True
            sys.unraisablehook = lambda _: None  # what a library swallows is no news
            signal.setitimer(signal.ITIMER_REAL, self._AGAIN_S)
            raise KeyboardInterrupt
