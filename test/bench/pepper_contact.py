# SPDX-License-Identifier: Apache-2.0
"""Pepper and a person shake hands: `python -m test.bench.pepper_contact docs/pictures/pepper_handshake.png`.

The learned motion is that of a partner who offers a hand as people do; the person's hand is 7.5 cm beside it, and
inverse kinematics brings the two together. Whole bodies, face to face: at rest, on the way, and where hands meet.
"""

from __future__ import annotations

import sys

import numpy as np
from PIL import Image

from mild_core.retargeting.chain import chain_of
from mild_core.retargeting.robots.pepper import FLOOR_M, PEPPER
from mild_core.shapes import FloatArray
from mild_ros.simulation.person import BODY_JOINTS, SHOULDER_HEIGHT_M, bodies
from mild_ros.viewing.body import Places, body_parts
from mild_ros.viewing.renderer import View, open_renderer
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


def main() -> int:
    """Draw it."""
    offer = Offer(PEPPER, learned_hand(PEPPER) + BESIDE_M)
    commands, _ = answered(offer)
    people = [person(offer, offer.raised(moment)) for moment in MOMENTS_S]
    view = View((0.45, 0.0, 0.0), 4.2, 194.0, 9.0, 26.0)
    pictures = []
    with open_renderer(PEPPER, FLOOR_M) as renderer:
        renderer.add_person(body_parts(people))
        for moment, places in zip(MOMENTS_S, people, strict=True):
            command = next(each for each in commands if each.stamp_ns >= START_NS + round(moment * 1e9))
            joints = dict(PEPPER.rest) | dict(zip(PEPPER.joint_names, command.positions_rad.tolist(), strict=True))
            renderer.place(joints, places)
            pictures.append(np.asarray(renderer.picture(view, *PANEL)))
            apart = np.linalg.norm(chain_of(PEPPER).tool(command.positions_rad) - places["right_hand"])
            print(f"{moment:.1f} s: hands {100 * apart:.1f} cm apart")
    Image.fromarray(np.concatenate(pictures, axis=1)).save(sys.argv[1])
    return 0


if __name__ == "__main__":
    sys.exit(main())
