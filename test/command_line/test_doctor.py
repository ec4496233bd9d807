# SPDX-License-Identifier: Apache-2.0
"""The doctor finds a healthy machine healthy, and each planted illness by its name."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState

from mild_core import resources
from mild_core.resources import share_folder
from mild_ros.environment import doctor, local_dds
from mild_ros.node_kit import libraries
from mild_ros.node_kit.dds_variables import VARIABLES, heard_remedy
from test.ros.processes import Probe


def test_two_processes_hear_each_other_and_the_rest_is_well(ros_domain: int) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "mild_ros.command_line.main", "doctor", "--json"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    findings = {finding["subject"]: finding for finding in json.loads(run.stdout)}
    assert [name for name, finding in findings.items() if not finding["well"]] == [], run.stdout
    assert run.returncode == 0
    assert "hear each other" in findings["Discovery"]["seen"]


def test_a_domain_whose_ports_do_not_exist_is_unwell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "233")
    assert not doctor.domain().well
    for domain in ("7", "", "102"):
        monkeypatch.setenv("ROS_DOMAIN_ID", domain)
        assert doctor.domain().well
    assert "other programs may take its ports" in doctor.domain().seen


def test_another_distribution_or_two_at_once_are_unwell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "humble")
    assert not doctor.distribution().well
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(["/opt/ros/jazzy", sys.prefix]))
    assert "mixed" in doctor.distribution().seen


def test_a_log_folder_that_cannot_be_made_is_unwell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "file" / "log"))
    assert not doctor.log_folder().well


def test_a_model_that_was_changed_or_lost_is_unwell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    default = "yumi_buetepage_ahead"
    shutil.copytree(share_folder("models") / default, tmp_path / default)
    monkeypatch.setattr(resources, "share_folder", lambda kind: tmp_path)
    monkeypatch.setattr(doctor, "share_folder", lambda kind: tmp_path)
    assert doctor.models().well
    weights = tmp_path / default / "weights.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1] + b"?")
    assert "it was altered" in doctor.models().seen
    (tmp_path / default / "manifest.json").unlink()
    assert doctor.models().seen == f"{tmp_path / default}: holds no model"
    shutil.rmtree(tmp_path / default)  # nodes take it where no other is named
    assert not doctor.models().well


def test_a_library_that_is_broken_is_named_and_one_of_ours_is_no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = ImportError("cannot import name '_dispatcher'\nmore of it", name="numba._dispatcher")
    assert str(libraries.unusable(broken)).startswith("library numba: cannot be imported (cannot import name '_disp")
    assert "[learning]" in str(libraries.unusable(ModuleNotFoundError("No module named 'torch'", name="torch")))
    with pytest.raises(ImportError):
        libraries.unusable(ImportError("of ours", name="mild_core.shapes"))
    libraries.check_needed()
    monkeypatch.setattr(libraries, "NEEDED", (*libraries.NEEDED, "no_such_library"))
    with pytest.raises(ModuleNotFoundError, match="no_such_library"):
        libraries.check_needed()
    monkeypatch.setattr(doctor, "NEEDED", libraries.NEEDED)
    assert "missing: no_such_library" in doctor.libraries().seen


def test_running_nodes_are_reported_by_their_diagnostics(ros_domain: int) -> None:
    assert doctor.running_nodes().seen == f"none reports in domain {ros_domain}"
    rclpy.init()
    node = rclpy.create_node("operator")
    try:
        publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        rate = KeyValue(key="skeleton rate [Hz]", value="4.9")
        problem = "people are in 'odom', expected 'camera': set frame_id to that"
        wrong = DiagnosticStatus(level=DiagnosticStatus.WARN, name="perception", message=problem, values=[rate])
        report = DiagnosticArray(status=[DiagnosticStatus(name="simulation", message="ready"), wrong])
        timer = node.create_timer(0.1, lambda: publisher.publish(report))
        with ThreadPoolExecutor() as pool:
            asked = pool.submit(doctor.running_nodes)
            while not asked.done():
                rclpy.spin_once(node, timeout_sec=0.1)
        node.destroy_timer(timer)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    finding = asked.result()
    assert not finding.well
    assert finding.seen == f"perception: {problem} (skeleton 4.9 Hz)"


NO_SERVER = "127.0.0.1:4"  # a port that only root can have, and no discovery server has


def test_every_variable_of_dds_is_named_with_what_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_STATIC_PEERS", "10.0.0.7")
    finding = doctor.environment()
    assert finding.well
    assert f"ROS_STATIC_PEERS=10.0.0.7 ({VARIABLES['ROS_STATIC_PEERS'].does})" in finding.seen
    for name in VARIABLES:
        monkeypatch.setenv(name, "somewhere")
    seen = doctor.environment().seen
    assert all(f"{name}=somewhere (" in seen for name in VARIABLES)
    for name in VARIABLES:
        monkeypatch.delenv(name)
    assert doctor.environment() == doctor.Finding("DDS settings", True, "nothing is set that changes DDS")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("ROS_DISCOVERY_SERVER", NO_SERVER, f"no server runs at {NO_SERVER}"),
        ("ROS_DISCOVERY_SERVER", f"10.0.0.7:11811;{NO_SERVER}", f"no server runs at {NO_SERVER}"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF", "no node finds another"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCAL", "no range: set one of SUBNET, LOCALHOST"),
        ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp", "is not installed here"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/nowhere/profile.xml", "no such file"),
        ("FASTDDS_DEFAULT_PROFILES_FILE", "/nowhere/profile.xml", "no such file"),
        ("ROS_SECURITY_ENABLE", "true", "there is no keystore"),
        ("ROS_STATIC_PEERS", "127.0.0.1;" + 70 * "a", f"'{70 * 'a'}' is no IPv4 address and no name known here"),
        (
            "FASTDDS_BUILTIN_TRANSPORTS",
            "UPDv4",
            "Fast DDS knows no such transports and takes its own: set one of",
        ),
        ("FASTDDS_DEFAULT_PROFILES_FILE", __file__, "cannot be read (not well-formed"),
    ],
)
def test_a_value_that_keeps_nodes_apart_is_unwell(
    name: str, value: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    finding = doctor.environment()
    assert not finding.well
    assert f"{name}: {words}" in finding.remedy


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ROS_STATIC_PEERS", "10.0.0.7;127.0.0.1;"),
        ("FASTDDS_BUILTIN_TRANSPORTS", "LARGE_DATA?max_msg_size=1MB&sockets_size=1MB"),
        ("FASTDDS_DEFAULT_PROFILES_FILE", str(local_dds.profile())),
    ],
)
def test_what_dds_takes_is_well(name: str, value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, value)
    assert doctor.environment().well


def test_a_node_that_hears_no_other_asks_what_is_wrong_and_then_what_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    assert heard_remedy("start one") == "start one", "what everybody has is no cause"
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    assert heard_remedy("start one") == "start one; is it FASTDDS_BUILTIN_TRANSPORTS=UDPv4? ./mild doctor tries without"
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    assert heard_remedy("start one").startswith("ROS_AUTOMATIC_DISCOVERY_RANGE: no node finds another: unset it")
    assert heard_remedy("start one").endswith("; start one")


def test_a_range_counts_less_than_localhost_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    assert doctor.environment().well


def test_what_keeps_every_node_from_starting_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not as four findings with a remedy of their own each."""
    monkeypatch.setenv("ROS_DOMAIN_ID", "mine")
    monkeypatch.setattr(doctor, "_heard", lambda *questions, **given: ["ROS_DOMAIN_ID is no number"] * len(questions))
    findings = [doctor.domain(), doctor.discovery(), doctor.reception(), doctor.running_nodes()]
    assert not any(finding.well for finding in findings)
    assert {finding.remedy for finding in findings[1:]} == {f"first mend ROS_DOMAIN_ID: {findings[0].remedy}"}


def test_a_variable_that_makes_nodes_deaf_is_named_as_the_cause(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", NO_SERVER)
    monkeypatch.setenv("ROS_STATIC_PEERS", "127.0.0.1")
    monkeypatch.setattr(doctor, "DISCOVERY_PATIENCE_S", 3.0)
    monkeypatch.setattr(doctor, "AGAIN_PATIENCE_S", 6.0)
    finding = doctor.discovery()
    assert not finding.well
    assert finding.remedy.startswith(f"unset ROS_DISCOVERY_SERVER: with ROS_DISCOVERY_SERVER={NO_SERVER} nothing")


LOCAL_RANGE = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


@pytest.mark.parametrize(
    ("is_up", "environment", "remedy"),
    [
        (False, {}, "bring loopback up: ip link set lo up"),
        (True, {}, "set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, or let a firewall pass UDP"),
        (True, LOCAL_RANGE, "let a firewall pass UDP from port 7400 up on lo, and to 239.255.0.1"),
    ],
)
def test_the_remedy_of_a_deaf_process_is_what_is_missing(
    is_up: bool, environment: dict[str, str], remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert doctor._loopback_is_up(), "what talks in these tests needs it"
    monkeypatch.setattr(doctor, "_loopback_is_up", lambda: is_up)
    monkeypatch.setattr(doctor, "_deaf", lambda *given: "nothing heard")
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert doctor.discovery().remedy.startswith(remedy)


NOISY = """
import os, sys
import rclpy
real = rclpy.init
def init(**given):
    os.write(1, b"[RTPS_TRANSPORT_SHM Error] Failed init_port fastrtps_port7413: open_and_lock_file failed")
    real(**given)
rclpy.init = init
from mild_ros.environment.discovery_probe import main
main(sys.argv[3:])
"""


def test_whatever_is_printed_beside_an_answer_does_no_harm(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """As Fast DDS does, from below Python, to standard output, where the answer is expected."""
    monkeypatch.setattr(doctor, "PYTHON", (sys.executable, "-c", NOISY))
    assert doctor._heard(("reports", 0.1)) == [{}]


def test_a_node_that_is_seen_and_not_heard_is_found_by_name(ros_domain: int) -> None:
    """A node that has nothing to say answers when it is asked; one that does not is not heard."""
    with closing(Probe("/left")) as driver:
        driver.node.create_publisher(JointState, "joint_states", 10)
        with ThreadPoolExecutor() as pool:
            asked = pool.submit(doctor.reception)
            while not asked.done():
                driver.spin()
        heard, unheard = asked.result(), doctor.reception()
    assert heard.well, heard
    assert heard.seen.startswith("1 other node")
    assert not unheard.well
    assert "publishes /left/joint_states, and nothing of it arrives" in unheard.seen
    assert "FASTDDS_BUILTIN_TRANSPORTS=UDPv4" in unheard.remedy


def start_simulation(log: Path, *before: str) -> subprocess.Popen[bytes]:
    """A simulated robot that is ready, started by the words `before`."""
    command = [*before, sys.executable, "-P", "-m", "mild_ros.nodes.simulation_node"]
    with log.open("wb") as output:
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    deadline = time.monotonic() + 120
    while b"stands at home" not in log.read_bytes():
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.05)
    return process


@pytest.mark.heavy
@pytest.mark.parametrize("transports", ["", "UDPv4"])
def test_another_users_node_is_found_and_the_remedy_works(
    transports: str, ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two users of one machine and one /dev/shm: neither may open the other's shared memory."""
    if os.geteuid():
        pytest.skip("needs root, to be two users")
    tmp_path.chmod(0o777)
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    # Reads what we read, wherever Python is installed, but opens no other user's shared memory for writing.
    reads = ("--inh-caps", "+dac_read_search", "--ambient-caps", "+dac_read_search")
    user = ("setpriv", "--reuid", "54321", "--regid", "54321", "--clear-groups", *reads)
    process = start_simulation(tmp_path / "log", *user, "env", f"HOME={tmp_path}")
    if transports:  # as the remedy says, and of one side only
        monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", transports)
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    try:
        finding = doctor.reception()
    finally:
        process.terminate()
        process.wait(20)
    if transports:
        assert finding.well, finding
    else:
        assert not finding.well
        assert "/joint_states" in finding.seen
        assert "here runs a node of user 54321" in finding.seen
        assert "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET FASTDDS_BUILTIN_TRANSPORTS=UDPv4" in finding.remedy


def test_without_ros_it_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "find_spec", lambda name: None)
    with doctor.examinations() as asked:
        findings = [one() for one in asked]
    assert [(one.subject, one.seen) for one in findings if not one.well] == [("ROS 2", doctor.distribution().seen)]
    assert doctor.distribution().seen.startswith("not installed here")


def test_without_another_machine_it_says_what_to_do(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "MACHINES_PATIENCE_S", 0.5)
    monkeypatch.setattr(doctor, "LISTENING", ())
    with doctor.examinations(machines=True) as asked:
        finding = asked[-1]()
    assert (finding.subject, finding.well) == ("Other machines", False)
    assert "ROS_STATIC_PEERS" in finding.remedy
