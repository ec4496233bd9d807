# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1, of earlier versions of ROS 2, of packages renamed since, and of every kind of mcap that is valid."""

from __future__ import annotations

import dataclasses
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mild_core.errors import BagError, DataError
from mild_core.perception.skeletons import SOURCES
from mild_ros.bag.encoding import encode
from mild_ros.bag.people import people_in_bag
from mild_ros.bag.reader import open_bag
from mild_ros.bag.types import current_name, jazzy_types
from test.replay.made_bags import EXPECTED, JOINT_STATE, joint_state, positions, refused, write_foreign, write_with_mcap
from test.ros.foreign_messages import foreign_types

MARKERS, MARKER = "visualization_msgs/msg/MarkerArray", "visualization_msgs/msg/Marker"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
START_NS, FRAMES = 1_600_000_000 * 10**9, 12
SHOULDER, ELBOW = 12, 13
"""Numbers of an Azure Kinect."""


def body(store: Typestore, index: int) -> Any:
    """Two joints of a person as an Azure Kinect's driver of that age sends them."""
    markers = []
    for number in (SHOULDER, ELBOW):
        marker = zero(store, MARKER)
        marker.header.frame_id, marker.ns, marker.id = "camera", "body", number
        marker.header.stamp.sec = START_NS // 10**9 + index
        marker.pose.position.x = 0.1 * index + number
        markers.append(marker)
    return store.types[MARKERS](markers)


def zero(store: Typestore, name: str) -> Any:
    """A message of zeros."""

    def value(kind: Any) -> Any:
        node, detail = kind
        if node.name == "NAME":
            return zero(store, detail)
        if node.name == "BASE":
            return {"string": "", "bool": False}.get(detail[0], 0)
        element, count = detail
        if element[0].name == "BASE" and element[1][0] != "string":
            return np.zeros(count or 0, {"byte": "uint8", "char": "uint8"}.get(element[1][0], element[1][0]))
        return [value(element) for _ in range(count or 0)]

    return store.types[name](**{field: value(kind) for field, kind in store.fielddefs[name][1]})


def without_definitions(bag: Path, version: int) -> None:
    """Make a database what recorders before Iron wrote."""
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.executescript("drop table message_definitions; drop table schema; drop table metadata;")
        database.execute("alter table topics drop column type_description_hash")
        database.commit()
    metadata = (bag / "metadata.yaml").read_text().replace("  version: 8\n", f"  version: {version}\n")
    (bag / "metadata.yaml").write_text(metadata)


def write_old(bag: Path, version: Stores, metadata_version: int) -> Path:
    """What an early recorder of ROS 2 made of a tracker."""
    store = get_typestore(version)
    with Writer(bag, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/body_tracking_data", MARKERS, typestore=store)
        empty = store.types[MARKERS]([])
        writer.write(topic, START_NS, store.serialize_cdr(empty, MARKERS))
        for index in range(FRAMES):
            writer.write(topic, START_NS + index * 10**9, store.serialize_cdr(body(store, index), MARKERS))
        writer.write(topic, START_NS + FRAMES * 10**9, b"\x00\x01\x00\x00\xff\xff\xff\xff")
    without_definitions(bag, metadata_version)
    return bag


def shoulders(bag: Path, *, salvage: bool = False) -> list[float]:
    """Where a body's shoulder was in each message that shows it, read from bytes in the form of today."""
    found = []
    with open_bag(bag, salvage=salvage) as opened:
        for raw in opened.messages(["/body_tracking_data"]):
            try:
                message = jazzy_types().deserialize_cdr(raw.data, raw.type_name)
                assert [marker.id for marker in opened.decode(raw).markers] == [marker.id for marker in message.markers]
            except Exception:  # the message that is none
                continue
            found += [marker.pose.position.x - SHOULDER for marker in message.markers if marker.id == SHOULDER]
    return found


SHOWN = pytest.approx([0.1 * index for index in range(FRAMES)])


@pytest.mark.parametrize("salvage", [False, True], ids=["plain", "salvage"])
@pytest.mark.parametrize(
    ("version", "metadata_version"),
    [(Stores.ROS2_DASHING, 2), (Stores.ROS2_FOXY, 4), (Stores.ROS2_GALACTIC, 4), (Stores.ROS2_HUMBLE, 5)],
)
def test_messages_of_earlier_versions_are_read_by_what_their_bytes_fit(
    tmp_path: Path, version: Stores, metadata_version: int, salvage: bool
) -> None:
    bag = write_old(tmp_path / "bag", version, metadata_version)
    assert shoulders(bag, salvage=salvage) == SHOWN
    with open_bag(bag, salvage=salvage) as opened:
        wrong = 0
        for raw in opened.messages():
            try:
                opened.decode(raw)
            except DataError:
                wrong += 1
        assert wrong == 1, "a message that fits no version is still counted"


def test_the_definition_in_the_bag_decides(tmp_path: Path) -> None:
    """Fields are distinguished by their names, also where another version has the same types of fields."""
    own = get_typestore(Stores.EMPTY)
    text = "std_msgs/Header header\nstring[] name\nfloat64[] effort\nfloat64[] velocity\nfloat64[] position"
    parts = {name: jazzy_types().fielddefs[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")}
    own.register({**parts, **get_types_from_msg(text, JOINT_STATE)})
    for storage in StoragePlugin:
        with Writer(tmp_path / storage.name, version=9, storage_plugin=storage) as writer:
            topic = writer.add_connection("/joint_states", JOINT_STATE, typestore=own)
            for index in range(len(EXPECTED)):
                old = joint_state(index)
                header = own.types["std_msgs/msg/Header"](
                    own.types["builtin_interfaces/msg/Time"](old.header.stamp.sec, 0), "base"
                )
                message = own.types[JOINT_STATE](header, old.name, np.ones(2), np.zeros(0), old.position)
                writer.write(topic, START_NS + index, own.serialize_cdr(message, JOINT_STATE))
        assert positions(tmp_path / storage.name) == EXPECTED


@pytest.mark.parametrize(
    ("written", "today"),
    [
        ("tf/tfMessage", TRANSFORMS),
        ("tf/msg/tfMessage", TRANSFORMS),
        ("sensor_msgs/JointState", JOINT_STATE),
        ("sensor_msgs::msg::dds_::JointState_", JOINT_STATE),
        ("zed_interfaces/msg/ObjectsStamped", "zed_msgs/msg/ObjectsStamped"),
        ("yolov8_msgs/msg/DetectionArray", "yolo_msgs/msg/DetectionArray"),
        ("nao_msgs/JointAnglesWithSpeed", "naoqi_bridge_msgs/msg/JointAnglesWithSpeed"),
        (JOINT_STATE, JOINT_STATE),
    ],
)
def test_a_type_has_its_name_of_today(written: str, today: str) -> None:
    assert current_name(written) == today


def test_the_former_names_of_packages_are_read(tmp_path: Path) -> None:
    """A ZED camera's messages were called `zed_interfaces` up to Humble."""
    old = get_typestore(Stores.ROS2_HUMBLE)
    named = {
        name.replace("zed_msgs", "zed_interfaces"): kind
        for name, kind in foreign_types().fielddefs.items()
        if name.startswith("zed_msgs")
    }
    text = "\n".join(foreign_types().generate_msgdef("zed_msgs/msg/ObjectsStamped", ros_version=2)[:1])
    former = "zed_interfaces/msg/ObjectsStamped"
    old.register(get_types_from_msg(text.replace("zed_msgs", "zed_interfaces"), former))
    assert named
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/zed/body_trk/skeletons", former, typestore=old)
        message = zero(old, former)
        person = zero(old, "zed_interfaces/msg/Object")
        person.skeleton_available, person.body_format, person.label_id = True, 1, 7
        message.objects = [person]
        writer.write(topic, START_NS, old.serialize_cdr(message, former))
    with open_bag(tmp_path / "bag") as bag:
        ((_, (seen,)),) = people_in_bag(bag, SOURCES["zed"])
    assert seen.person_id == 7


def ros1_transforms(index: int, store: Typestore) -> Any:
    """A frame of openni_tracker's."""
    transform = zero(store, "geometry_msgs/msg/TransformStamped")
    transform.header.frame_id, transform.child_frame_id = "openni_depth_frame", "right_hand_1"
    transform.header.stamp.sec = index + 1
    transform.transform.translation.x, transform.transform.rotation.w = 0.1 * index, 1.0
    return store.types["tf/msg/tfMessage"]([transform])


def tf_of_ros1() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf/msg/tfMessage"))
    return store


def written_ros1_bag(path: Path) -> Path:
    store = tf_of_ros1()
    with Ros1Writer(path) as writer:
        moving = writer.add_connection("/tf", "tf/msg/tfMessage", typestore=store)
        shown = writer.add_connection("/body_tracking_data", MARKERS, typestore=store, latching=1)
        for index in range(FRAMES):
            data = store.serialize_ros1(ros1_transforms(index, store), "tf/msg/tfMessage")
            writer.write(moving, START_NS + index * 10**9, data)
            writer.write(shown, START_NS + index * 10**9, store.serialize_ros1(body(store, index), MARKERS))
    return path


def written_ros1_mcap(path: Path, **options: Any) -> Path:
    """What `mcap convert` makes of such a bag."""
    store = tf_of_ros1()
    with path.open("wb") as file:
        writer = McapWriter(file, **options)
        writer.start(profile="ros1", library="mcap go v1")
        channels = {}
        for topic, name in (("/tf", "tf/msg/tfMessage"), ("/body_tracking_data", MARKERS)):
            text = store.generate_msgdef(name)[0].encode()
            schema = writer.register_schema(name.replace("/msg/", "/"), "ros1msg", text)
            channels[topic] = writer.register_channel(topic, "ros1", schema)
        events = writer.register_schema("foxglove.Event", "jsonschema", b"{}")
        foreign = writer.register_channel("/events", "json", events)
        for index in range(FRAMES):
            time_ns = START_NS + index * 10**9
            data = store.serialize_ros1(ros1_transforms(index, store), "tf/msg/tfMessage")
            writer.add_message(channels["/tf"], time_ns, bytes(data), time_ns)
            data = store.serialize_ros1(body(store, index), MARKERS)
            writer.add_message(channels["/body_tracking_data"], time_ns, bytes(data), time_ns)
        writer.add_message(foreign, START_NS, b"{}", START_NS)
        writer.finish()
    return path


@pytest.mark.parametrize("salvage", [False, True], ids=["plain", "salvage"])
@pytest.mark.parametrize("write", [written_ros1_bag, written_ros1_mcap])
def test_bags_of_ros_1_are_read_in_both_formats(tmp_path: Path, write: Callable[[Path], Path], salvage: bool) -> None:
    is_mcap = write is written_ros1_mcap
    bag = write(tmp_path / ("a.mcap" if is_mcap else "a.bag"))
    assert shoulders(bag, salvage=salvage) == SHOWN
    with open_bag(bag, salvage=salvage) as opened:
        assert opened.topics["/tf"].type_name == TRANSFORMS
        hands = [jazzy_types().deserialize_cdr(raw.data, TRANSFORMS) for raw in opened.messages(["/tf"])]
        assert opened.lost == ("left out, as they are no messages of ROS: 1 in json" if is_mcap else "")
    assert [one.transforms[0].transform.translation.x for one in hands] == SHOWN
    assert hands[3].transforms[0].header.stamp.sec == 4


VARIANTS: dict[str, dict[str, Any]] = {
    "no repeated summary": {"repeat_channels": False, "repeat_schemas": False},
    "no repeated channels": {"repeat_channels": False},
    "no repeated schemas": {"repeat_schemas": False},
    "no statistics": {"use_statistics": False},
    "no statistics, nothing repeated": {"use_statistics": False, "repeat_channels": False, "repeat_schemas": False},
    "no statistics, no index of messages": {"use_statistics": False, "index_types": IndexType.CHUNK},
    "no index": {"index_types": IndexType.NONE},
    "no index of chunks": {"index_types": IndexType.MESSAGE},
    "no summary offsets": {"use_summary_offsets": False},
    "no summary at all": {
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
    },
    "in no chunks": {"use_chunking": False},
    "in no chunks, no summary": {
        "use_chunking": False,
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
    },
}


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("variant", VARIANTS)
def test_any_part_of_an_mcap_that_may_be_missing_may_be_missing(
    tmp_path: Path, variant: str, compression: CompressionType
) -> None:
    if compression is not CompressionType.NONE and "in no chunks" in variant:
        compression = CompressionType.NONE
    path = write_with_mcap(tmp_path / "a.mcap", compression=compression, chunk_size=1000, **VARIANTS[variant])
    assert positions(path) == EXPECTED, "all, and in order of time"
    with open_bag(path) as bag:
        assert (bag.start_ns, bag.topics["/joint_states"].count, bag.lost) == (10**9, len(EXPECTED), "")
        assert bag.duration_s == pytest.approx(0.01 * (len(EXPECTED) - 1), abs=1e-6)
    path.write_bytes(path.read_bytes()[:-40])
    assert refused(path, "add --salvage")


@pytest.mark.parametrize("variant", ["no repeated summary", "in no chunks, no summary"])
def test_such_a_file_may_be_part_of_a_folder(tmp_path: Path, variant: str) -> None:
    bag = write_foreign(tmp_path / "bag", StoragePlugin.MCAP, CompressionMode.NONE)
    write_with_mcap(next(bag.glob("*.mcap")), **VARIANTS[variant])
    assert positions(bag) == EXPECTED
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(f": {len(EXPECTED)}", ": 60"))
    assert refused(bag, "--salvage")


@pytest.mark.parametrize("profile", ["", "x-other"])
def test_a_profile_says_nothing_of_what_is_in_a_file(tmp_path: Path, profile: str) -> None:
    path = write_with_mcap(tmp_path / "a.mcap")
    data = path.read_bytes()
    assert data.count(b"\x04\x00\x00\x00ros2") == 1
    path.write_bytes(_with_profile(data, profile.encode()))
    assert positions(path) == EXPECTED


def _with_profile(data: bytes, profile: bytes) -> bytes:
    """The same file without the offsets of its summary, which would no longer be right."""
    begin = len(b"\x89MCAP0\r\n") + 1
    length = int.from_bytes(data[begin : begin + 8], "little")
    head = data[begin + 8 : begin + 8 + length].replace(
        b"\x04\x00\x00\x00ros2", len(profile).to_bytes(4, "little") + profile
    )
    moved = data[:begin] + len(head).to_bytes(8, "little") + head + data[begin + 8 + length :]
    return moved[:-28] + bytes(20) + moved[-8:]


@pytest.mark.parametrize("name", ["take #1", "what?", "100% done", "a%41b", "x?mode=rw&y", "ünï #?%"])
def test_paths_may_hold_any_sign(tmp_path: Path, name: str) -> None:
    for storage in StoragePlugin:
        bag = tmp_path / storage.name / name
        bag.parent.mkdir()
        write_foreign(tmp_path / "plain", storage, CompressionMode.NONE).rename(bag)
        assert positions(bag) == positions(bag, salvage=True) == EXPECTED
        (file,) = (file for file in bag.iterdir() if file.suffix != ".yaml")
        shutil.copy(file, tmp_path / f"{name}{file.suffix}")
        assert positions(tmp_path / f"{name}{file.suffix}") == EXPECTED


def test_an_undefined_type_is_named(tmp_path: Path) -> None:
    store = foreign_types()
    name = "zed_msgs/msg/ObjectsStamped"
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/skeletons", name, typestore=store)
        writer.write(topic, START_NS, store.serialize_cdr(zero(store, name), name))
    without_definitions(tmp_path / "bag", 5)
    with open_bag(tmp_path / "bag") as bag:
        assert encode(joint_state(0), types=bag.types)
        with pytest.raises(BagError, match=rf"does not define {name}, .*; .*"):
            list(people_in_bag(bag, SOURCES["zed"]))
    assert dataclasses.is_dataclass(store.types[name])
