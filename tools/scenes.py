# SPDX-License-Identifier: Apache-2.0
"""The scenes in `bags/`, made from a page of numbers: a kinematic person moves an arm along minimum-jerk paths.

No person was recorded and no recording was copied: the poses below are ours, rounded to look like the four interactions
that the models know. `python -m tools.scenes FOLDER` writes them again, to the same messages.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mild_core.errors import SetupError
from mild_core.perception.skeletons import SOURCES
from mild_core.retargeting.robots import ROBOTS
from mild_core.shapes import FloatArray
from mild_core.signals import JointMeasurement
from mild_ros.bag.camera import FILE, camera_text, facing_camera, write_camera
from mild_ros.simulation.person import Camera, bodies, kneeling, skeleton_frames, with_fist

RATE_HZ = 30.0
"""The Azure Kinect's."""

START_NS = 1_700_000_000_000_000_000
"""Start time of every scene: a date that cannot be mistaken for a recording's."""

TOPIC = "/body_tracking_data"
"""As the Azure Kinect's ROS driver calls it."""

Direction = tuple[float, float, float]

REST: tuple[Direction, Direction] = ((-0.08, -0.08, -1.0), (0.02, -0.06, -1.0))
"""Upper arm and forearm hang down."""


MODELS = {"yumi": "yumi_buetepage_ahead", "pepper": "pepper_nuisi_next"}
"""Whose recordings say where people stand before each robot."""


@dataclass(frozen=True)
class ArmPose:
    """Where the arm comes to a short stop.

    Attributes:
        after_s: Since the pose before.
        upper: Direction of the upper arm: x forward, y left, z up of the person; of any length.
        fore: Direction of the forearm.
        lean_m: How far the shoulder has gone forward.
    """

    after_s: float
    upper: Direction
    fore: Direction
    lean_m: float = 0.0


@dataclass(frozen=True)
class Scene:
    """One interaction.

    Attributes:
        name: Of its folder and, but for who kneels, of the interaction.
        what: In a sentence.
        poses: What the arm does after a time of rest.
        robot: At whose home the robot stands.
        kneels: Whether the person is on one knee, as before a child, and holds out a fist.
    """

    name: str
    what: str
    poses: tuple[ArmPose, ...]
    robot: str = "yumi"
    kneels: bool = False

    @property
    def interaction(self) -> str:
        """Its name."""
        return self.name.removesuffix("_kneeling")


def _still(seconds: float) -> ArmPose:
    return ArmPose(seconds, *REST)


def _swung(first: ArmPose, second: ArmPose, times: int) -> tuple[ArmPose, ...]:
    return (first, second) * times


BEGIN, END = _still(2.6), _still(1.0)
"""A second to calibrate and a second and a half to fill the first window; then to show that the robot goes home."""

SCENES = (
    Scene(
        "hand_wave",
        "The forearm goes up and swings from side to side four times.",
        (
            ArmPose(0.9, (0.68, -0.36, -0.64), (0.33, 0.82, 0.47)),
            *_swung(
                ArmPose(0.72, (0.2, -0.5, -0.85), (0.42, -0.83, 0.38)),
                ArmPose(0.72, (0.72, -0.42, -0.55), (0.25, 0.88, 0.4)),
                4,
            ),
            ArmPose(0.55, (0.2, -0.3, -0.93), (0.55, 0.55, -0.63)),
            ArmPose(0.8, *REST),
        ),
    ),
    Scene(
        "handshake",
        "The hand is offered, shaken up and down four times, and taken back.",
        (
            ArmPose(1.0, (0.38, 0.12, -0.92), (0.24, 0.77, -0.6), 0.04),
            *_swung(
                ArmPose(0.74, (0.66, -0.36, -0.66), (0.12, 0.93, -0.34), 0.035),
                ArmPose(0.74, (0.29, 0.0, -0.96), (0.3, 0.76, -0.58), 0.045),
                4,
            ),
            ArmPose(1.0, *REST),
        ),
    ),
    Scene(
        "rocket",
        "A fist is drawn back, meets the robot's, rises with it and bursts.",
        (
            ArmPose(0.8, (-0.43, -0.15, -0.89), (0.28, 0.22, -0.93)),
            ArmPose(0.8, (0.1, -0.18, -0.98), (0.3, 0.91, -0.3)),
            ArmPose(3.4, (0.89, -0.4, -0.24), (0.5, 0.86, 0.0), 0.0),
            ArmPose(0.6, (0.45, -0.41, -0.79), (0.72, 0.32, 0.62), -0.02),
            ArmPose(0.7, *REST),
        ),
    ),
    Scene(
        "parachute",
        "A fist is drawn back, meets the robot's high up, and sways down like a parachute.",
        (
            ArmPose(0.7, (-0.45, -0.16, -0.88), (0.58, 0.3, -0.76)),
            ArmPose(1.5, (0.95, 0.08, -0.3), (0.48, 0.83, 0.28), 0.03),
            ArmPose(0.75, (0.92, -0.28, -0.27), (0.8, 0.57, 0.2), 0.02),
            ArmPose(0.75, (0.83, 0.1, -0.55), (0.23, 0.96, 0.15), 0.04),
            ArmPose(0.75, (0.69, -0.2, -0.69), (0.8, 0.58, 0.17), 0.01),
            ArmPose(0.75, (0.51, 0.15, -0.85), (0.16, 0.96, -0.24), 0.04),
            ArmPose(0.75, (0.41, -0.1, -0.9), (0.82, 0.48, -0.32), 0.02),
            ArmPose(0.75, (0.38, 0.14, -0.92), (0.4, 0.77, -0.5), 0.05),
            ArmPose(1.0, *REST),
        ),
    ),
)

ROCKET_KNEELING = Scene(
    "rocket_kneeling",
    "On one knee before a small robot: a fist is drawn back, meets the robot's, rises with it and goes.",
    (
        ArmPose(0.8, (-0.35, -0.2, -0.9), (0.35, 0.2, -0.9)),
        *(ArmPose(after, (0.72, 0.39, -0.57), (0.7, 0.64, 0.3), 0.05) for after in (1.1, 0.6)),
        *(ArmPose(after, (0.86, 0.45, -0.24), (0.58, 0.53, 0.61), 0.03) for after in (1.1, 1.0)),
        ArmPose(0.8, (0.3, -0.2, -0.93), (0.6, 0.3, -0.73)),
        ArmPose(0.6, *REST),
    ),
    robot="pepper",
    kneels=True,
)
"""Pepper's shoulders are at half an adult's height, and its hand comes 0.36 m from them: people go down to it, as the
two people from whom its model learned were of one height."""


def minimum_jerk(share: FloatArray) -> FloatArray:
    """How far along a straight path a hand is, for the share of its time that has passed.

    Source: Flash and Hogan, "The coordination of arm movements", J. Neuroscience 1985, eq. 4.
    """
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def arm_track(scene: Scene, rate_hz: float = RATE_HZ) -> FloatArray:
    """(T, 3, 3) shoulder, elbow and hand [m] in the arm frame, as `simulation.person.bodies` takes them."""
    stops = [ArmPose(0.0, *REST), BEGIN, *scene.poses, END]
    times_s = np.cumsum([stop.after_s for stop in stops])
    corners = np.array([[stop.upper, stop.fore, (stop.lean_m, 0.0, 0.0)] for stop in stops])
    times = np.arange(round(times_s[-1] * rate_hz) + 1) / rate_hz
    index = np.clip(np.searchsorted(times_s, times, side="right") - 1, 0, len(stops) - 2)
    share = np.clip((times - times_s[index]) / np.diff(times_s)[index], 0.0, 1.0)
    way = minimum_jerk(share)[:, None, None]
    upper, fore, shoulder = np.moveaxis((1.0 - way) * corners[index] + way * corners[index + 1], 1, 0)
    elbow = shoulder + upper / np.linalg.norm(upper, axis=1, keepdims=True)
    hand = elbow + fore / np.linalg.norm(fore, axis=1, keepdims=True)
    return np.stack([shoulder, elbow, hand], axis=1)


def cameras(scene: Scene) -> dict[str, str]:
    """Where the camera stands before each robot, for the person to stand where the model's recordings put people.

    As the parameter `robot_from_camera` takes it.
    """
    from mild_ros.assembly.perception import manifest_of

    arm_from_camera = Camera().arm_from_camera
    return {
        robot: camera_text(facing_camera(manifest_of(model).robot_from_human, scene.interaction, arm_from_camera))
        for robot, model in MODELS.items()
    }


def write_scene(scene: Scene, folder: Path) -> None:
    """Write the bag of a scene, its camera and its SOURCE.md into `folder`, which must not exist."""
    # Only here: what the scenes show is also wanted where there is no ROS.
    from mild_ros.bag.encoding import encode, type_name_of
    from mild_ros.bag.writer import create_bag
    from mild_ros.messages.joint_state import joint_measurement_to_msg
    from mild_ros.messages.marker_array import people_to_marker_array

    body = bodies(arm_track(scene))
    body = with_fist(kneeling(body)) if scene.kneels else body
    robot = ROBOTS[scene.robot]
    with create_bag(folder) as bag:
        at_home = joint_measurement_to_msg(JointMeasurement(START_NS, robot.joint_names, robot.home_rad))
        bag.write("/joint_states", type_name_of(at_home), START_NS, encode(at_home))
        for frame in skeleton_frames(body, RATE_HZ, START_NS):
            seen = replace(frame, positions_m=frame.positions_m.astype(np.float32))  # the tracker's own precision
            message = people_to_marker_array((seen,), SOURCES["azure_kinect"])
            bag.write(TOPIC, type_name_of(message), frame.stamp_ns, encode(message))
    write_camera(folder, cameras(scene))
    (folder / "SOURCE.md").write_text(_source(scene, len(body) / RATE_HZ))


def _source(scene: Scene, duration_s: float) -> str:
    return f"""# {scene.name}

Synthetic: no person was recorded. {scene.what}

Made by `python -m tools.scenes bags` from the poses of `tools/scenes.py`, which are ours: minimum-jerk paths
between them move the right arm of the kinematic person of `mild_ros/simulation/person.py`.

{duration_s:.1f} s. `{TOPIC}`: `visualization_msgs/MarkerArray` as the Azure Kinect driver publishes it, one person of
32 joints in a depth camera's optical frame, {RATE_HZ:g} Hz. `/joint_states`: one message, `{scene.robot}` at home.
`{FILE}` says where the camera stands before YuMi and before Pepper: so that the person stands where people stood in the
recordings of the models {" and ".join(f"`{model}`" for model in MODELS.values())} during this interaction.

Licence: Apache-2.0, as everything here.
"""


def main() -> int:
    """Write every scene into the folder that is named; those that are there already must be removed first."""
    if len(sys.argv) != 2:
        print("python -m tools.scenes FOLDER", file=sys.stderr)
        return 2
    try:
        for scene in (*SCENES, ROCKET_KNEELING):
            write_scene(scene, Path(sys.argv[1], scene.name))
            print(f"{Path(sys.argv[1], scene.name)}: {scene.what}")
    except SetupError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
