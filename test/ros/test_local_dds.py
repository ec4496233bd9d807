# SPDX-License-Identifier: Apache-2.0
"""LOCALHOST is a promise: with the profile no other machine hears or is heard, and processes of this one still are."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from mild_ros.command_line import main as command_line
from mild_ros.environment.local_dds import PROFILE_VARIABLES, keep_to_this_machine, local_environment, profile
from mild_ros.environment.processes import PYTHON, Nodes
from mild_ros.node_kit.dds_variables import GIVEN_RMW, VARIABLES
from test.ros.two_machines import ADDRESSES, cannot_be_made, on_both

HELLO = [*PYTHON, "-m", "mild_ros.environment.discovery_probe", "hello"]
LISTENER = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
PEER = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_STATIC_PEERS": ADDRESSES[0]}
LOCALHOST = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
NO_SHARED_MEMORY = ("unshare", "--mount", "--", "sh", "-c", 'mount -t tmpfs -o ro tmpfs /dev/shm; exec "$@"', "sh")


def words(name: str, seconds: int, environment: dict[str, str]) -> list[str]:
    """A command that says hello in an environment of its own."""
    return ["env", *(f"{key}={value}" for key, value in environment.items()), *HELLO, name, str(seconds)]


def profiled() -> dict[str, str]:
    """What own processes have, and a terminal that does what docs/deployment.md says."""
    return {key: value for key, value in local_environment({}).items() if key != "RMW_IMPLEMENTATION"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ours", "peer", "heard"),
    [
        (LOCALHOST, LISTENER, False),
        (LOCALHOST, PEER, True),
        (profiled(), LISTENER, False),
        (profiled(), PEER, False),
        (profiled() | {"ROS_STATIC_PEERS": ADDRESSES[1]}, PEER, False),
    ],
    ids=[
        *("the range keeps out who only listens", "and no one who names this machine"),
        *("the profile keeps out the one", "and the other", "even where our own side names it too"),
    ],
)
def test_another_machine(ours: dict[str, str], peer: dict[str, str], heard: bool, ros_domain: int) -> None:
    if reason := cannot_be_made():
        pytest.skip(f"no two machines: {reason}")
    seconds = 60 if heard else 6  # silence has to be waited for
    said = on_both((words("first", seconds, ours), words("second", seconds, peer)), multicast=True)
    assert [json.loads(line) for line in said] == ([["second"], ["first"]] if heard else [[], []])


@pytest.mark.parametrize(
    ("other", "prefix"),
    [
        (profiled(), ()),
        (LOCALHOST, ()),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, ()),
        (profiled(), NO_SHARED_MEMORY),
    ],
    ids=["with the profile", "with the range alone", "with neither", "without shared memory"],
)
def test_processes_of_this_machine_hear_each_other(
    other: dict[str, str], prefix: tuple[str, ...], ros_domain: int
) -> None:
    if prefix and subprocess.run([*prefix, "true"], capture_output=True, check=False).returncode:
        pytest.skip("shared memory can only be taken away by root")
    commands = (words("first", 60, profiled()), [*prefix, *words("second", 60, other)])
    running = [subprocess.Popen(each, stdout=subprocess.PIPE, text=True) for each in commands]
    said = [process.communicate(timeout=120)[0].strip().splitlines()[-1] for process in running]
    assert [json.loads(line) for line in said] == [["second"], ["first"]]


def test_the_users_environment_does_not_leak_in() -> None:
    others = ("ROS_DOMAIN_ID", "RCUTILS_CONSOLE_OUTPUT_FORMAT", "RMW_OF_TOMORROW", "FASTDDS_OF_TOMORROW")
    users = dict.fromkeys({*VARIABLES, *others} - {GIVEN_RMW}, "elsewhere")
    ours = local_environment(users | {"HOME": "/home"}, 7)
    assert "elsewhere" not in ours.values()
    assert (ours["HOME"], ours["ROS_DOMAIN_ID"]) == ("/home", "7")
    assert Path(ours[PROFILE_VARIABLES[0]]).read_text().count("<address>") == 1


@pytest.mark.parametrize("variable", ["ROS_DISCOVERY_SERVER", "RMW_IMPLEMENTATION", "CURRENT_FOLDER"])
def test_own_nodes_start_in_a_clean_environment(
    variable: str, tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a node sees it: what it has in its environment, and that it talks."""
    monkeypatch.setenv(variable, "10.255.255.1")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text("<dds>")  # Fast DDS would complain of it
    with Nodes(ros_domain, tmp_path / "log") as nodes:
        nodes.start("markers", {"nosuch": 1})
        process = nodes._running["markers"]
        seen = Path(f"/proc/{process.pid}/environ").read_bytes().decode().split("\0")
        process.wait(120)
    assert f"FASTRTPS_DEFAULT_PROFILES_FILE={profile()}" in seen
    assert variable == "CURRENT_FOLDER" or f"{variable}=10.255.255.1" not in seen
    assert "XMLPARSER" not in (tmp_path / "log" / "markers.log").read_text()


@pytest.mark.parametrize(("given", "local"), [(["replay"], True), (["models"], False), (["models", "--local"], True)])
def test_commands_keep_to_this_machine(given: list[str], local: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in PROFILE_VARIABLES:
        monkeypatch.setenv(name, "")
    kept = dict(os.environ)
    monkeypatch.setattr(command_line, "assemble", lambda wanted: lambda **given: None)
    try:
        with pytest.raises(SystemExit) as ended:
            command_line.main(given)
        assert ended.value.code == 0
        assert (os.environ[PROFILE_VARIABLES[0]] == str(profile())) is local
    finally:
        os.environ.clear()
        os.environ.update(kept)


def test_this_process_too(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = dict(os.environ)
    try:
        os.environ["ROS_STATIC_PEERS"] = "10.0.0.1"
        keep_to_this_machine()
        assert "ROS_STATIC_PEERS" not in os.environ
        assert os.environ["ROS_DOMAIN_ID"] == kept["ROS_DOMAIN_ID"]
        assert Path(os.environ[PROFILE_VARIABLES[1]]).is_file()
    finally:
        os.environ.clear()
        os.environ.update(kept)
