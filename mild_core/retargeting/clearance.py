# SPDX-License-Identifier: Apache-2.0
"""Distances and speeds of a robot's poses to itself and to people, compiled: what the guard decides by.

Speeds of capsules are bounds over all their points: the ends of the axis, and what the link's turning adds at the
surface. Speeds towards somebody are those of the nearest point of each capsule. Distances are exact for capsules.
"""

from __future__ import annotations

import numpy as np

from mild_core.compiled import compiled
from mild_core.retargeting.chain import frames_of, least_clearance, nearest_points, place_capsules
from mild_core.shapes import FloatArray

LOOK_SELF_M, SLACK_M = 0.08, 0.005
"""Distances of the robot to itself beyond the first count as this: the nearer, the faster they are computed. They are
computed again when less than the second may be left: what a speed between two looks adds."""


@compiled
def link_twists(
    frames: FloatArray, velocities_rad_s: FloatArray, columns: FloatArray, axes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(C + 1, 3) and (C + 1, 3): angular velocity of each frame, and velocity of its point in the base's origin."""
    count = len(columns)
    turning, moving = np.zeros((count + 1, 3)), np.zeros((count + 1, 3))
    for joint in range(count):
        frame, rate = frames[joint + 1], velocities_rad_s[int(columns[joint])]
        x, y, z = axes[joint, 0], axes[joint, 1], axes[joint, 2]
        # The axis is the same before and after the joint has turned about it.
        ax = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
        ay = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
        az = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
        ox, oy, oz = frame[0, 3], frame[1, 3], frame[2, 3]
        turning[joint + 1, 0] = turning[joint, 0] + rate * ax
        turning[joint + 1, 1] = turning[joint, 1] + rate * ay
        turning[joint + 1, 2] = turning[joint, 2] + rate * az
        moving[joint + 1, 0] = moving[joint, 0] - rate * (ay * oz - az * oy)
        moving[joint + 1, 1] = moving[joint, 1] - rate * (az * ox - ax * oz)
        moving[joint + 1, 2] = moving[joint, 2] - rate * (ax * oy - ay * ox)
    return turning, moving


@compiled
def evaluate_poses(
    times_s: FloatArray,
    positions_rad: FloatArray,
    velocities_rad_s: FloatArray,
    columns: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    mounted: FloatArray,
    ends_m: FloatArray,
    sizes_m: FloatArray,
    outer_m: FloatArray,
    pairs: FloatArray,
    moving: FloatArray,
    people_m: FloatArray,
    people_m_s: FloatArray,
    radii_m: FloatArray,
    horizon_s: float,
    far_m: float,
    zones_m: FloatArray,
    apart_m: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """What is to be known of K poses (K, J) that move at (K, J), among S body segments that move on.

    Args:
        times_s: (K,) from when the segments are where they are told.
        positions_rad: (K, J) of the joints.
        velocities_rad_s: (K, J) of the joints.
        columns: Of `Chain`.
        offsets: Of `Chain`.
        axes: Of `Chain`.
        mounted: Of `Capsules`.
        ends_m: Of `Capsules`.
        sizes_m: Of `Capsules`.
        outer_m: Of `Capsules`.
        pairs: Of `Capsules`.
        moving: (M,) places of those that are kept away from people.
        people_m: (S, 2, 3) ends of the segments' axes ...
        people_m_s: (S, 2, 3) ... and how they move, for `horizon_s` at most ...
        radii_m: (S,) ... and their radii.
        horizon_s: See there.
        far_m: Distances beyond are not computed.
        zones_m: (S,) nearer than this the rates are computed.
        apart_m: Distance that parts of the robot keep from each other; infinite if that does not matter here.

    Returns:
        (K,) clearance to itself beyond `apart_m` [m], at most `LOOK_SELF_M`; while two parts that come together as
            fast as they can are still apart, the distance that is left of the last exact one stands for it;
        (K,) greatest speed of a point of the moving capsules [m/s];
        (K, S) clearance to each segment [m], at most `far_m`;
        (K, S) greatest speed of the nearest point of a capsule inside the zone towards the segment [m/s], not below 0;
        (K, S) greatest speed of the segment towards such a capsule [m/s], not below 0.
    """
    count, others = len(positions_rad), len(radii_m)
    own, speed = np.full(count, LOOK_SELF_M), np.zeros(count)
    clear, toward, approach = np.full((count, others), far_m), np.zeros((count, others)), np.zeros((count, others))
    placed, ends_m_s = np.empty((len(mounted), 3, 3)), np.empty((len(moving), 2, 3))
    rim_m_s, segment = np.empty(len(moving)), np.empty((3, 3))
    for row in range(count):
        frames = frames_of(positions_rad[row], columns, offsets, axes)
        place_capsules(frames, mounted, ends_m, placed)
        turning, shift = link_twists(frames, velocities_rad_s[row], columns, axes)
        cx, cy, cz = 0.0, 0.0, 0.0
        for number in range(len(moving)):
            part = int(moving[number])
            frame = int(mounted[part])
            wx, wy, wz = turning[frame, 0], turning[frame, 1], turning[frame, 2]
            rim_m_s[number] = np.sqrt(wx * wx + wy * wy + wz * wz) * outer_m[part]
            for end in range(2):
                px, py, pz = placed[part, end, 0], placed[part, end, 1], placed[part, end, 2]
                vx = wy * pz - wz * py + shift[frame, 0]
                vy = wz * px - wx * pz + shift[frame, 1]
                vz = wx * py - wy * px + shift[frame, 2]
                ends_m_s[number, end, 0], ends_m_s[number, end, 1], ends_m_s[number, end, 2] = vx, vy, vz
                speed[row] = max(speed[row], np.sqrt(vx * vx + vy * vy + vz * vz) + rim_m_s[number])
            cx += placed[part, 2, 0] / len(moving)
            cy += placed[part, 2, 1] / len(moving)
            cz += placed[part, 2, 2] / len(moving)
        if row > 0:
            own[row] = own[row - 1] - 2.0 * max(speed[row - 1], speed[row]) * (times_s[row] - times_s[row - 1])
        if not np.isinf(apart_m) and (row == 0 or own[row] <= SLACK_M):
            own[row] = least_clearance(placed, sizes_m, placed, sizes_m, pairs, LOOK_SELF_M) - apart_m
        around = 0.0  # radius of a ball about the whole arm
        for number in range(len(moving)):
            part = int(moving[number])
            x, y, z = placed[part, 2, 0] - cx, placed[part, 2, 1] - cy, placed[part, 2, 2] - cz
            around = max(around, np.sqrt(x * x + y * y + z * z) + sizes_m[part, 1] + outer_m[part])
        ahead_s = min(times_s[row], horizon_s)
        for other in range(others):
            half = 0.0
            for i in range(3):
                for end in range(2):
                    segment[end, i] = people_m[other, end, i] + ahead_s * people_m_s[other, end, i]
                segment[2, i] = 0.5 * (segment[0, i] + segment[1, i])
                half += (0.5 * (segment[1, i] - segment[0, i])) ** 2
            half = np.sqrt(half)
            x, y, z = segment[2, 0] - cx, segment[2, 1] - cy, segment[2, 2] - cz
            reach = around + half + radii_m[other] + far_m
            if x * x + y * y + z * z >= reach * reach:
                continue
            zone = min(zones_m[other], far_m)
            for number in range(len(moving)):
                part = int(moving[number])
                radii = outer_m[part] + radii_m[other]
                x = placed[part, 2, 0] - segment[2, 0]
                y = placed[part, 2, 1] - segment[2, 1]
                z = placed[part, 2, 2] - segment[2, 2]
                reach = radii + sizes_m[part, 1] + half + max(zone, clear[row, other])
                if reach <= 0.0 or x * x + y * y + z * z >= reach * reach:
                    continue
                distance, s, t = nearest_points(placed[part, 0], placed[part, 1], segment[0], segment[1])
                clear[row, other] = min(clear[row, other], distance - radii)
                if distance - radii >= zone:
                    continue
                closing, coming, way = 0.0, 0.0, max(distance, 1e-9)
                for i in range(3):
                    here = placed[part, 0, i] + s * (placed[part, 1, i] - placed[part, 0, i])
                    there = segment[0, i] + t * (segment[1, i] - segment[0, i])
                    n = (there - here) / way
                    # What turning adds at the surface there is at right angles to the way between both.
                    closing += n * (ends_m_s[number, 0, i] + s * (ends_m_s[number, 1, i] - ends_m_s[number, 0, i]))
                    if times_s[row] < horizon_s:
                        moves = people_m_s[other, 0, i] + t * (people_m_s[other, 1, i] - people_m_s[other, 0, i])
                        coming -= n * moves
                toward[row, other] = max(toward[row, other], closing)
                approach[row, other] = max(approach[row, other], coming)
    return own, speed, clear, toward, approach


LEAST_M_S = 0.03
"""A slower motion towards somebody is none: parts of an arm that gives way as a whole turn so slowly."""


@compiled
def path_bounds(
    times_s: FloatArray,
    own: FloatArray,
    speed: FloatArray,
    clear: FloatArray,
    toward: FloatArray,
    approach: FloatArray,
    people_speed_m_s: FloatArray,
    zones_m: FloatArray,
    near_speed_m_s: float,
    jerk_m_s3: float,
) -> FloatArray:
    """(K - 1, 1 + 4 S) of a path, for each time between two of K looks: what holds during all of it.

    During that time the arm is no faster than at its ends and by what jerk can add (a curve stays within a eighth of
    its second derivative times the square of the time about its chord), and comes no nearer than at that speed.

    Args:
        times_s: (K,) of the looks.
        own: As `evaluate_poses` returns it, and the next four.
        speed: See there.
        clear: See there.
        toward: See there.
        approach: See there.
        people_speed_m_s: (S,) greatest speed of each segment.
        zones_m: (S,) nearer than this, speed is limited ...
        near_speed_m_s: ... to this, and towards a segment to this less its own approach.
        jerk_m_s3: Greatest jerk of a point of the arm.

    Returns:
        Clearance to itself [m]; then of each segment the least clearance [m], that at the looks [m], by how much the
        arm is too fast near it, and by how much it is too fast towards it [m/s].
    """
    others = len(zones_m)
    bounds = np.zeros((len(times_s) - 1, 1 + 4 * others))
    for look in range(len(times_s) - 1):
        during_s = times_s[look + 1] - times_s[look]
        more = jerk_m_s3 * during_s * during_s / 8.0
        fastest = max(speed[look], speed[look + 1]) + more
        bounds[look, 0] = min(own[look], own[look + 1])
        for other in range(others):
            a, b, place = clear[look, other], clear[look + 1, other], 1 + 4 * other
            nearest = min(min(a, b), 0.5 * (a + b - (fastest + people_speed_m_s[other]) * during_s))
            bounds[look, place], bounds[look, place + 1] = nearest, min(a, b)
            if nearest < zones_m[other]:
                coming = max(approach[look, other], approach[look + 1, other])
                to = max(toward[look, other], toward[look + 1, other])
                bounds[look, place + 2] = max(0.0, fastest - near_speed_m_s)
                bounds[look, place + 3] = max(0.0, to - max(0.0, near_speed_m_s - coming) - LEAST_M_S)
    return bounds


BREACHES = ("", "refused_self_collision", "refused_keep_out", "refused_speed")
"""Why a motion is refused, as it is counted: `find_breach` numbers them."""


@compiled
def find_breach(bounds: FloatArray, least: FloatArray, keep_m: FloatArray, rounding: float) -> tuple[int, int]:
    """The first rule that a path breaks, as a place in `BREACHES`, and of which of S segments (-1: of none).

    Args:
        bounds: (I, 1 + 4 S) of the path.
        least: (I, 1 + 4 S) of another that is always allowed, since nothing better can be done: what is not worse than
            that breaks no rule; or none (0, 1 + 4 S).
        keep_m: (S,) distance to keep.
        rounding: Less than this is not worse.
    """
    excused = len(least) == len(bounds)
    for row in range(len(bounds)):
        if bounds[row, 0] < (min(0.0, least[row, 0] - rounding) if excused else 0.0):
            return 1, -1
        for other in range(len(keep_m)):
            place = 1 + 4 * other
            if bounds[row, place] < keep_m[other] and not (
                # A bound between looks is worse for what moves than for what stands; who moves away is no nearer.
                excused and bounds[row, place + 1] >= least[row, place + 1] - rounding
            ):
                return 2, other
            for rate in range(place + 2, place + 4):
                if bounds[row, rate] > rounding + (least[row, rate] if excused else 0.0):
                    return 3, other
    return 0, -1


@compiled
def nearest_rows(
    position_rad: FloatArray,
    columns: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    mounted: FloatArray,
    ends_m: FloatArray,
    outer_m: FloatArray,
    moving: FloatArray,
    people_m: FloatArray,
    people_m_s: FloatArray,
    radii_m: FloatArray,
    far_m: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """What moves the arm away from people, at the nearest place of each link to each of S segments.

    Args:
        position_rad: (J,) of the joints.
        columns: Of `Chain`.
        offsets: Of `Chain`.
        axes: Of `Chain`.
        mounted: Of `Capsules`.
        ends_m: Of `Capsules`.
        outer_m: Of `Capsules`.
        moving: Of `Capsules`.
        people_m: (S, 2, 3) ends of the segments' axes ...
        people_m_s: (S, 2, 3) ... and how they move ...
        radii_m: (S,) ... and their radii.
        far_m: Places further away are left out.

    Returns:
        (R, J) how fast the distance grows when a joint turns at 1 rad/s [m];
        (R,) the clearance there [m];
        (R,) how fast the segment comes towards it [m/s];
        (R,) the place of the segment among S.
    """
    joints, links = len(columns), len(columns) + 1
    rows = np.zeros((links * len(radii_m), len(position_rad)))
    clear, coming, which = np.empty(len(rows)), np.empty(len(rows)), np.empty(len(rows))
    frames = frames_of(position_rad, columns, offsets, axes)
    placed = np.empty((len(mounted), 3, 3))
    place_capsules(frames, mounted, ends_m, placed)
    found = 0
    for other in range(len(radii_m)):
        for link in range(1, links):
            least, part, s, t = far_m, -1, 0.0, 0.0
            for number in range(len(moving)):
                one = int(moving[number])
                if int(mounted[one]) != link:
                    continue
                distance, first, second = nearest_points(
                    placed[one, 0], placed[one, 1], people_m[other, 0], people_m[other, 1]
                )
                if distance - outer_m[one] - radii_m[other] < least:
                    least, part, s, t = distance - outer_m[one] - radii_m[other], one, first, second
            if part < 0:
                continue
            distance, rate = max(least + outer_m[part] + radii_m[other], 1e-9), 0.0
            here, away = np.empty(3), np.empty(3)
            for i in range(3):
                here[i] = placed[part, 0, i] + s * (placed[part, 1, i] - placed[part, 0, i])
                there = people_m[other, 0, i] + t * (people_m[other, 1, i] - people_m[other, 0, i])
                away[i] = (here[i] - there) / distance
                rate += away[i] * (people_m_s[other, 0, i] + t * (people_m_s[other, 1, i] - people_m_s[other, 0, i]))
            for joint in range(min(link, joints)):
                frame, (x, y, z) = frames[joint + 1], axes[joint]
                ax = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
                ay = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
                az = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
                dx, dy, dz = here[0] - frame[0, 3], here[1] - frame[1, 3], here[2] - frame[2, 3]
                rows[found, int(columns[joint])] += (
                    away[0] * (ay * dz - az * dy) + away[1] * (az * dx - ax * dz) + away[2] * (ax * dy - ay * dx)
                )
            clear[found], coming[found], which[found] = least, rate, other
            found += 1
    return rows[:found], clear[:found], coming[:found], which[:found]
