# SPDX-License-Identifier: Apache-2.0
"""The doctor finds a healthy machine healthy, and each planted illness by its name."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from mild_ros import doctor


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
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert doctor.domain().well


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


def test_a_changed_model_is_unwell(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    healthy = doctor.model_folder(doctor.model_names()[0])
    for path in healthy.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    weights = bytearray((tmp_path / "weights.safetensors").read_bytes())
    weights[-1] ^= 1
    (tmp_path / "weights.safetensors").write_bytes(weights)
    monkeypatch.setattr(doctor, "model_folder", lambda name: tmp_path)
    assert not doctor.models().well


def test_running_nodes_are_told_of_in_their_own_words(ros_domain: int) -> None:
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


def test_without_another_machine_it_says_what_to_do(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "MACHINES_PATIENCE_S", 0.5)
    *_, last = (examination for examination in doctor.examinations(machines=True))
    finding = last()
    assert (finding.subject, finding.well) == ("Other machines", False)
    assert "ROS_STATIC_PEERS" in finding.remedy
