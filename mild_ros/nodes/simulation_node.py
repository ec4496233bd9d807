# SPDX-License-Identifier: Apache-2.0
"""`simulation`: joint_command in, joint_states of a robot in PyBullet out."""

from __future__ import annotations

from typing import Any

import numpy as np
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Float64, String

from mild_core.errors import DataError
from mild_core.signals import JointCommand
from mild_ros.assembly.robot import make_robot
from mild_ros.assembly.settings import SimulationParameters
from mild_ros.messages.image import image_to_msg
from mild_ros.messages.joint_state import joint_command_from_msg, joint_measurement_to_msg
from mild_ros.node_kit.clock import NodeClock, steady_clock
from mild_ros.node_kit.diagnostics import Diagnostics
from mild_ros.node_kit.guarded import GuardedNode
from mild_ros.node_kit.parameters import declare
from mild_ros.node_kit.quality_of_service import COMMAND, LATCHED, STATE
from mild_ros.node_kit.running import run
from mild_ros.simulation.backend import RenderCamera, scene_of
from mild_ros.simulation.bullet import BulletRobot

LONGEST_STEP_NS = 100_000_000
"""After a longer pause the simulation goes on from where it was, as computing all of it would take as long again."""

LARGEST = 1000.0
"""No joint has a position [rad or m] or a speed beyond this; the physics would blow up."""

UNTIL_CLOCK_S = 0.1
"""Before a replay starts its clock, retargeting must hear where the robot is."""


class SimulationNode(GuardedNode):
    """A simulated robot, in real time or, with `use_sim_time`, at the pace of `/clock`."""

    def __init__(self) -> None:
        super().__init__("simulation")
        parameters = declare(self, SimulationParameters)
        robot = make_robot(parameters.robot, parameters.robot_description)
        self._robot = BulletRobot(robot, gui=parameters.gui, scene=scene_of(robot))
        self._command: JointCommand | None = None
        self._stepped_ns: int | None = None
        self._diagnostics = Diagnostics(self, expected=("joint_command",), hardware_id=f"simulated {robot.name}")
        self._states = self.create_publisher(JointState, "joint_states", STATE)
        if not parameters.robot_description.startswith("topic:"):
            self._description = self.create_publisher(String, "robot_description", LATCHED)
            text = robot.urdf_path.read_text().replace('filename="/', 'filename="file:///')  # as viewers want it
            self._description.publish(String(data=text))
        self._time = NodeClock(self, self._diagnostics, self._on_tick, parameters.rate_hz)
        self._publish(self._time.now_ns())
        if parameters.camera_rate_hz:
            self._images = self.create_publisher(Image, "camera/image_raw", STATE)
            self.create_timer(1.0 / parameters.camera_rate_hz, self._photograph)
        if self._time.simulated:
            self._waiting = self.create_timer(UNTIL_CLOCK_S, self._before_clock, clock=steady_clock())
        self.create_subscription(JointState, "joint_command", self._on_command, COMMAND)
        self.create_subscription(Float64, "stiffness", self._on_stiffness, LATCHED)
        self.get_logger().info(f"{robot.name} stands at home")

    def _on_command(self, message: Any) -> None:
        self._diagnostics.flowed("joint_command")
        try:
            command = joint_command_from_msg(message)
            if np.abs([command.positions_rad, command.velocities_rad_s]).max() > LARGEST:
                raise DataError("out_of_range", "a joint is sent round and round")
            unknown = sorted(set(command.joint_names) - set(self._robot.robot.joint_names))
            if unknown:
                raise DataError("wrong_joints", f"no joint {', '.join(unknown)}")
        except DataError as error:
            self._diagnostics.unreadable("joint_command", error.reason, error.detail)
            return
        self._command = command

    def _on_stiffness(self, message: Any) -> None:
        self._robot.stiffen(float(message.data))

    def _on_tick(self, now_ns: int) -> None:
        elapsed_ns = 0 if self._stepped_ns is None else now_ns - self._stepped_ns
        self._stepped_ns = now_ns
        self._robot.step(self._command, min(max(elapsed_ns, 0), LONGEST_STEP_NS) * 1e-9)
        self._command = None
        self._publish(now_ns)

    def _publish(self, now_ns: int) -> None:
        self._states.publish(joint_measurement_to_msg(self._robot.measure(now_ns)))
        self._diagnostics.flowed("joint_states")

    def _photograph(self) -> None:
        if self._images.get_subscription_count():
            pixels = self._robot.render(RenderCamera(smoothing=1))
            self._images.publish(image_to_msg(pixels, self._time.now_ns(), "camera"))

    def _before_clock(self) -> None:
        if self._stepped_ns is None:
            self._publish(self._time.now_ns())
        else:
            self.destroy_timer(self._waiting)

    def destroy_node(self) -> None:
        """Close the simulation too."""
        self._robot.close()
        super().destroy_node()  # type: ignore[no-untyped-call]


def main() -> int:
    """The executable."""
    return run("simulation", SimulationNode, SimulationParameters)


if __name__ == "__main__":
    raise SystemExit(main())
