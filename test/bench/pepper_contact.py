# SPDX-License-Identifier: Apache-2.0
"""Pepper and a person shake hands: `./mild measure pepper_contact docs/pictures/pepper_handshake.png`.

A name that ends in `.html` makes a page of it, to turn around and play in any browser, offline.

The learned motion is that of a partner who offers a hand as people do; the person's hand is 7.5 cm beside it, and
inverse kinematics brings the two together. Whole bodies, face to face: at rest, on the way, and where hands meet.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from mild_core.retargeting.robot_model.chain import chain_of
from mild_core.retargeting.robots.pepper import FLOOR_M, PEPPER
from mild_core.shapes import FloatArray
from mild_core.signals import JointCommand, MotionWindow
from mild_ros.replay.recorded import JointTrack
from mild_ros.simulation.person import BODY_JOINTS, SHOULDER_HEIGHT_M, bodies
from mild_ros.viewing.body import Places, body_parts
from mild_ros.viewing.page import FRAMES_PER_SECOND, write_page
from mild_ros.viewing.placing import stood_on
from mild_ros.viewing.renderer import Viewpoint, open_renderer
from mild_ros.viewing.staging import Staged
from test.core.retargeting.offering import RAISING_S, Offer, answered, learned_hand
from test.core.retargeting.perfect import START_NS

BESIDE_M = np.array([0.04, -0.05, 0.04])
HANGING_M, HELD_M = np.array([[0.0, 0.0, -1.0], [0.05, 0.0, -1.0]]), np.array([[0.45, 0.1, -0.88], [0.66, 0.1, -0.74]])
"""Directions of the person's upper arm and forearm."""

MOMENTS_S = (0.5, 0.6 + 0.62 * RAISING_S, 0.6 + RAISING_S + 0.9)
PANEL = (560, 720)


def person(offer: Offer, raised: float) -> Places:
    """The person of whom the hand that is held out is where the offer says."""
    bones = HANGING_M + raised * (HELD_M - HANGING_M)
    turned = np.diag([-1.0, -1.0, 1.0])
    held, now = (_body(each) for each in (HELD_M, bones))
    stands_m = offer.hand_m - turned @ held[BODY_JOINTS.index("right_hand")]
    stands_m[2] = FLOOR_M + SHOULDER_HEIGHT_M
    return dict(zip(BODY_JOINTS, now @ turned.T + stands_m, strict=True))


def _body(bones: FloatArray) -> FloatArray:
    """(32, 3) joints of a body whose arm has these directions, in the arm frame."""
    arm = np.cumsum(np.vstack([np.zeros(3), bones / np.linalg.norm(bones, axis=1, keepdims=True)]), axis=0)
    body: FloatArray = bodies(arm[None])[0]
    return body


def staged(offer: Offer, commands: Sequence[JointCommand]) -> Staged:
    """The whole of it, ready to be shown."""
    times_s = np.arange(0.0, offer.duration_s, 1.0 / FRAMES_PER_SECOND)
    stamps = np.array([command.stamp_ns for command in commands])
    positions = np.array([command.positions_rad for command in commands])
    people = stood_on([person(offer, offer.raised(moment)) for moment in times_s], FLOOR_M)
    track = JointTrack(PEPPER.joint_names, stamps, stamps, positions, np.zeros_like(positions))
    tool = chain_of(PEPPER).tool
    reached = np.array([tool(angles) for angles in track.at(START_NS + np.round(times_s * 1e9).astype(np.int64))])
    hand = np.array([at["right_hand"] for at in people])
    return Staged(
        times_s=times_s,
        bodies=people,
        hand_m=hand,
        track=track,
        home=dict(PEPPER.rest),
        gap_m=np.linalg.norm(reached - hand, axis=1),
        floor_m=FLOOR_M,
        interaction="handshake",
        motions=tuple(given for _, given in offer.inputs() if isinstance(given, MotionWindow)),
        start_ns=START_NS,
    )


def draw(shown: Staged, path: Path) -> None:
    """Three moments beside each other."""
    view = Viewpoint((0.45, 0.0, 0.0), 4.2, 194.0, 9.0, 26.0)
    pictures = []
    with open_renderer(PEPPER, FLOOR_M) as renderer:
        renderer.add_person(body_parts(shown.bodies))
        for moment in MOMENTS_S:
            frame = shown.frame_at(moment)
            renderer.place(shown.joints_at(moment), shown.bodies[frame])
            pictures.append(np.asarray(renderer.picture(view, *PANEL)))
            print(f"{moment:.1f} s: hands {100 * shown.gap_m[frame]:.1f} cm apart")
    Image.fromarray(np.concatenate(pictures, axis=1)).save(path)


def main() -> None:
    """Draw it, or make a page of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="a picture (.png) or a page (.html)")
    path = parser.parse_args().file
    offer = Offer(PEPPER, learned_hand(PEPPER) + BESIDE_M)
    shown = staged(offer, answered(offer)[0])
    if path.suffix == ".html":
        write_page(shown, PEPPER, path, "Pepper and a person shake hands")
    else:
        draw(shown, path)


if __name__ == "__main__":
    main()
