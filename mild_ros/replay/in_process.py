# SPDX-License-Identifier: Apache-2.0
"""A bag through the pipeline in this process, without DDS: the same bag gives the same bytes, every time.

Replay is a fold over events in order of time: the bag's messages, and ticks of the control clock on a grid that
begins with the first message. `replay_node.py` sends the same events to nodes and gets the same commands. At equal
times the tick comes first, because over DDS a message at time t follows the `/clock` message that says t.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

from mild_core.errors import BagError, DataError, SetupError
from mild_core.perception.skeletons import SkeletonSource
from mild_core.pipeline import Pipeline, PipelineInput, PipelineOutput, PipelineState
from mild_core.retargeting.robot_model.robot import RobotModel
from mild_core.signals import JointMeasurement
from mild_ros.bag.budgets import OverBudgetError, TimeBudget
from mild_ros.bag.encoding import encode, restamped, type_name_of
from mild_ros.bag.people import skeleton_feeds
from mild_ros.bag.reader import BagReader, RawMessage, open_bag, topic_of_type
from mild_ros.bag.tracker_clock import Clock, tracker_clock
from mild_ros.bag.writer import BagWriter, create_bag
from mild_ros.commands.command_topics import JOINT_COMMAND, commands_a_robot, may_command_a_robot
from mild_ros.commands.controller_messages import ControllerMessages
from mild_ros.commands.joint_naming import JointNaming, joint_naming
from mild_ros.controllers import OUTPUTS
from mild_ros.messages.feeds import Feed
from mild_ros.messages.joint_state import joint_command_to_msg, joint_measurement_from_msg, joint_measurement_to_msg
from mild_ros.messages.motion import motion_state_to_msg, motion_to_msg
from mild_ros.messages.person import person_to_msg
from mild_ros.replay.events import JOINT_STATES, SKELETON, TAKEN, TRUE_MOTION, Event, with_ticks

LOOKED_AT = 20
"""Messages of which one names all joints of the robot, if it is there: drivers publish a gripper by itself."""


def foreign_joints(bag: BagReader, wanted: Sequence[str]) -> str:
    """Which joints the bag's joint_states name, for people, if those wanted are not among them; otherwise ""."""
    named: list[set[str]] = []
    for raw in islice(bag.messages(["/joint_states"]), LOOKED_AT):
        with suppress(DataError):
            named.append(set(map(str, bag.decode(raw).name)))
    if not named or any(names.issuperset(wanted) for names in named):
        return ""
    first, *others = sorted(set().union(*named)) or ["no names"]
    return f"{first} and {len(others)} others" if others else first


JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
STATIC_TRANSFORMS = "tf_static"
"""The topic on which several publishers latch what holds for ever: each of their messages counts."""

NEVER_WITH_ALL = ("clock", "handled", "recorded", JOINT_STATES)
"""`all` leaves out what a replay sends itself, and what may be a command. What is one is never sent."""


@dataclass(frozen=True)
class Inputs:
    """What of a bag goes into the pipeline.

    Attributes:
        source: Tracker convention of its skeletons.
        skeleton_topic: Their topic in the bag, of sources with a single one; "" finds it by its type.
        joint_states: `bag`, `home` (one message says that the robot stands at home), `none`, or `auto`: the bag's if
            they are of the robot's joints, otherwise home.
        robot: Whose joints these are.
        start_s: How much of the beginning to skip.
        also: Further topics to pass on under their own names; `all` stands for every one but commands, which are never
            passed on.
        joint_names: The bag's names of the robot's joints, in our order; empty if they are ours.
    """

    source: SkeletonSource
    robot: RobotModel
    skeleton_topic: str = ""
    joint_states: str = "auto"
    start_s: float = 0.0
    also: tuple[str, ...] = ()
    joint_names: tuple[str, ...] = ()

    def messages(self, bag: BagReader, clock: Clock | None = None) -> Iterator[Event]:
        """The bag's messages that the pipeline takes, in order of time.

        What was latched before the beginning comes first: late subscribers get it live too.

        Args:
            bag: The bag.
            clock: The tracker's; None judges it.

        Raises:
            BagError: The bag has no such topic, or is broken.
        """
        wanted, feeds = self.topics(bag), self.feeds(bag)
        clock = clock or self.clock(bag)
        at_home = self.joint_states == "home" or (self.joint_states == "auto" and JOINT_STATES not in wanted.values())
        start_ns = self._start_ns(bag)
        budget = TimeBudget()
        for raw in self._latched(bag, wanted, start_ns):
            topic = feeds[raw.topic].topic if raw.topic in feeds else ""
            yield Event(start_ns or raw.time_ns, wanted[raw.topic], raw, topic)
        for given in bag.messages(wanted, start_ns):
            raw = _on_the_recorders_clock(given, bag, clock) if given.topic in feeds else given
            try:
                budget.reach(raw.time_ns)
            except OverBudgetError as error:
                raise error.of(bag.path) from None
            if at_home:
                yield Event(raw.time_ns, JOINT_STATES, self._at_home(raw.time_ns))
                at_home = False
            topic = feeds[raw.topic].topic if raw.topic in feeds else ""
            yield Event(raw.time_ns, wanted[raw.topic], raw, topic)

    def laps(self, bag: BagReader, *, forever: bool) -> Iterator[Event]:
        """The bag's messages once, or over and over: time then starts again.

        Raises:
            BagError: As `messages`.
        """
        more, clock = True, self.clock(bag)
        while more:
            more = False  # a bag without messages is not read for ever
            for event in self.messages(bag, clock):
                more = forever
                yield event

    def topics(self, bag: BagReader) -> dict[str, str]:
        """The bag's topics that are sent, and as which input each.

        Raises:
            BagError: The bag does not have one of them.
            SetupError: One of `also` commands a robot.
        """
        skeletons = dict.fromkeys(self.feeds(bag), SKELETON)
        recorded = "/joint_states" in bag.topics and bag.topics["/joint_states"].count > 0
        wanted = {topic: topic for topic in self._others(bag)} | skeletons
        if self.joint_states == "bag" or (self.joint_states == "auto" and recorded and not self.note(bag)):
            wanted[topic_of_type(bag, JOINT_STATE_TYPE, "joint_states")] = JOINT_STATES
        if f"/{TRUE_MOTION}" in bag.topics:
            wanted[f"/{TRUE_MOTION}"] = TRUE_MOTION
        return wanted

    def note(self, bag: BagReader) -> str:
        """Why, of `auto`, the bag's joint_states are not taken, for people; "" if they are, or if there are none."""
        theirs = foreign_joints(bag, self.naming.theirs) if self.joint_states == "auto" else ""
        return theirs and f"its joint_states ({theirs}) are not of {self.robot.name}, which begins at home"

    @property
    def naming(self) -> JointNaming:
        """Our names of the robot's joints and the bag's.

        Raises:
            SetupError: There is not one name for each joint.
        """
        return joint_naming(self.robot.joint_names, self.joint_names)

    def feeds(self, bag: BagReader) -> Mapping[str, Feed]:
        """How the bag's skeletons are read, by topic; each call begins with an empty memory.

        Raises:
            SetupError: As `skeleton_feeds`, or a topic is given for a source that has several.
        """
        feeds = skeleton_feeds(bag, self.source, self.skeleton_topic)
        if self.skeleton_topic and SKELETON not in (feed.topic for feed in feeds.values()):
            raise SetupError("skeleton_topic", f"{self.source.name} has several", "leave it out; see joint_places")
        return feeds

    def clock(self, bag: BagReader) -> Clock:
        """How the tracker's stamps become times of the recorder's clock.

        Raises:
            BagError: The bag has no such topic, or breaks off.
        """
        return tracker_clock(bag, self.source, self.skeleton_topic)

    def _latched(self, bag: BagReader, wanted: Mapping[str, str], start_ns: int | None) -> Iterator[RawMessage]:
        """What was latched before the beginning: of each topic the last message, of static transforms all.

        Where the robot was counts as latched: a robot that stands still may say so once.
        """
        static = {topic for topic in wanted if topic.rsplit("/", 1)[-1] == STATIC_TRANSFORMS}
        latched = static | {
            topic for topic, given in wanted.items() if bag.topics[topic].latched or given == JOINT_STATES
        }
        newest: dict[str, RawMessage] = {}
        for raw in bag.messages(latched, stop_ns=start_ns) if start_ns is not None and latched else ():
            if raw.topic in static:
                yield raw
            else:
                newest[raw.topic] = raw
        yield from newest.values()

    def _others(self, bag: BagReader) -> list[str]:
        if self.also == ("all",):
            apart = {f"/{name}" for name in NEVER_WITH_ALL} | {
                topic for topic, summary in bag.topics.items() if may_command_a_robot(topic, summary.type_name)
            }
            return [topic for topic in bag.topics if topic not in apart]
        others = [topic_of_type(bag, "", topic) for topic in self.also]
        for topic in others:
            if commands_a_robot(topic, bag.topics[topic].type_name):
                raise SetupError("also", f"{topic} commands a robot and is never replayed", "leave it out")
        return others

    def _start_ns(self, bag: BagReader) -> int | None:
        if not self.start_s:
            return None
        if self.start_s >= bag.duration_s:
            raise BagError(str(bag.path), f"lasts {bag.duration_s:.1f} s", "start before its end")
        return bag.start_ns + round(self.start_s * 1e9)

    def _at_home(self, time_ns: int) -> RawMessage:
        message = joint_measurement_to_msg(JointMeasurement(time_ns, self.robot.joint_names, self.robot.home_rad))
        return RawMessage("/joint_states", JOINT_STATE_TYPE, time_ns, encode(message))


def _on_the_recorders_clock(raw: RawMessage, bag: BagReader, clock: Clock) -> RawMessage:
    """A tracker's message with the stamps that it would have if the tracker had the recorder's clock."""
    if clock.shift_ns == 0:
        return raw
    try:
        if clock.shift_ns is None:
            return replace(raw, data=encode(bag.decode(raw), types=bag.types, at_ns=raw.time_ns))
        shift_ns, decode = clock.shift_ns, partial(bag.decode, raw)
        return replace(raw, data=restamped(raw.data, raw.type_name, decode, shift_ns, bag.types))
    except DataError:
        return raw  # is counted where it is read


@dataclass(frozen=True, eq=False)
class Step:
    """One event, what came of it and the state after it.

    Attributes:
        event: What happened.
        output: What the pipeline made of it.
        state: Of the pipeline after it.
        unreadable: Why its message could not be read; "" when it could.
        detail: What was seen in one that could not.
    """

    event: Event
    output: PipelineOutput
    state: PipelineState
    unreadable: str = ""
    detail: str = ""


@dataclass(frozen=True)
class ReplaySummary:
    """What happened in a replay.

    Attributes:
        commands: How many were sent.
        motions: How many were inferred.
        duration_s: From the first message to the last.
        counts: Events by reason, of each stage; of `messages` those that could not be read.
        digest: SHA-256 of all commands' bytes: equal for equal replays.
        note: What of the bag was not taken, or could not be written, for people; "" for nothing.
    """

    commands: int
    motions: int
    duration_s: float
    counts: Mapping[str, Mapping[str, int]]
    digest: str
    note: str = ""


def fold(bag: BagReader, pipeline: Pipeline, inputs: Inputs, rate_hz: float = 100.0) -> Iterator[Step]:
    """Every event of a replay and its outcome.

    Raises:
        BagError: As `Inputs.messages`.
    """
    state, feeds = pipeline.init(), inputs.feeds(bag)
    for event in with_ticks(inputs.messages(bag), rate_hz):
        if event.input not in TAKEN:
            yield Step(event, PipelineOutput(), state)
            continue
        try:
            given, whole = _decoded(bag, event, feeds, inputs.naming)
        except DataError as error:
            yield Step(event, PipelineOutput(), state, unreadable=error.reason, detail=error.detail)
            continue
        output = PipelineOutput()
        if whole:
            state, output = pipeline.step(state, given, event.time_ns)
        yield Step(event, output, state)


def replay_in_process(
    bag_path: Path,
    pipeline: Pipeline,
    inputs: Inputs,
    output_path: Path | None = None,
    *,
    rate_hz: float = 100.0,
    salvage: bool = False,
    controllers: ControllerMessages | None = None,
    on_step: Callable[[Step], None] = lambda step: None,
) -> ReplaySummary:
    """Send a bag through the pipeline and write inputs, motions and commands to a new bag.

    Args:
        bag_path: The bag.
        pipeline: Perception, inference and retargeting.
        inputs: What of the bag goes into it.
        output_path: Folder of the new bag; None writes none.
        rate_hz: Of the control clock.
        salvage: Read what is readable of a broken bag.
        controllers: Makes the messages for controllers, which are written too; None makes none.
        on_step: Called with each step, for progress and for what a caller wants to keep.

    Raises:
        BagError: The bag cannot be read, or the new one not written.
    """
    digest, unreadable, commands, motions = hashlib.sha256(), Counter[str](), 0, 0
    first_ns = last_ns = 0
    state = pipeline.init()
    with ExitStack() as stack:
        bag = stack.enter_context(open_bag(bag_path, salvage=salvage))
        written = stack.enter_context(create_bag(output_path, types=bag.types)) if output_path else None
        unknown = _unknown_types(controllers, bag) if controllers else {}
        left_out = (f"{topic} is not written: the type {name} is not installed here" for topic, name in unknown.items())
        note = "; ".join(each for each in (inputs.note(bag), inputs.clock(bag).note, *left_out) if each)
        for step in fold(bag, pipeline, inputs, rate_hz):
            first_ns, last_ns, state = first_ns or step.event.time_ns, step.event.time_ns, step.state
            if step.unreadable:
                unreadable[step.unreadable] += 1
            encoded = [encode(joint_command_to_msg(command)) for command in step.output.commands]
            for data in encoded:
                digest.update(data)
            commands, motions = commands + len(encoded), motions + len(step.output.motions)
            if written:
                _write(written, step, encoded, pipeline.inference.model.manifest.interactions)
                for due in controllers.after(step.output.commands, step.state.retargeting) if controllers else ():
                    if due.topic not in unknown:
                        data = encode(due.message, types=bag.types)
                        written.write(f"/{due.topic}", type_name_of(due.message), step.event.time_ns, data)
            on_step(step)
    counts = {stage: getattr(state, stage).counts for stage in ("perception", "inference", "retargeting")}
    counts["messages"] = dict(unreadable)
    return ReplaySummary(commands, motions, (last_ns - first_ns) * 1e-9, counts, digest.hexdigest(), note)


def _unknown_types(controllers: ControllerMessages, bag: BagReader) -> Mapping[str, str]:
    """Types of messages for controllers that cannot be written here, by topic."""
    installed = {topic: OUTPUTS[topic].type_name for topic in controllers.kinds}
    without = {topic: name for topic, name in installed.items() if name not in bag.types.fielddefs}
    return {**controllers.absent, **without}


def _write(bag: BagWriter, step: Step, commands: list[bytes], interactions: tuple[str, ...]) -> None:
    time_ns, message = step.event.time_ns, step.event.message
    if message is not None:
        bag.write(f"/{step.event.name.lstrip('/')}", message.type_name, time_ns, message.data)
    person = step.output.person
    if person is not None:
        bag.write("/person", "sensor_msgs/msg/PointCloud2", time_ns, encode(person_to_msg(person)))
    for motion in step.output.motions:
        for topic, message in (
            ("/motion", motion_to_msg(motion)),
            ("/motion_state", motion_state_to_msg(motion, interactions)),
        ):
            bag.write(topic, type_name_of(message), time_ns, encode(message))
    for data in commands:
        bag.write(f"/{JOINT_COMMAND}", JOINT_STATE_TYPE, time_ns, data)


def _decoded(
    bag: BagReader, event: Event, feeds: Mapping[str, Feed], naming: JointNaming
) -> tuple[PipelineInput, bool]:
    """The event's message as the pipeline takes it, and whether it does: one joint alone shows no person yet.

    Raises:
        DataError: It cannot be read.
    """
    if event.message is None:
        return None, True
    message = bag.decode(event.message)
    if event.input == JOINT_STATES:
        return naming.understood(joint_measurement_from_msg(message)), True
    people = feeds[event.message.topic].read(message, event.time_ns)
    return people, people is not None
