# SPDX-License-Identifier: Apache-2.0
"""Distances and speeds of a robot's poses to itself and to people, compiled: what the guard decides by.

Speeds of capsules are bounds over all their points: the ends of the axis, and what the link's turning adds at the
surface. Speeds towards a person are those of the nearest point of each capsule, and of points of its surface that come
nearer faster, where these are asked for. Distances are exact for capsules.
"""

from __future__ import annotations

import numpy as np

from mild_core.compiled import compiled
from mild_core.retargeting.robot_model.chain import frames_of, least_clearance, nearest_points, place_capsules
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
    surface_m_s: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """What is to be known of K poses (K, J) that move at (K, J), among S body segments that move on.

    Args:
        times_s: (K,) since the segments were at their given places.
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
        surface_m_s: Where a capsule's and a segment's speeds may add up to more than this, points all around the
            capsule count towards the segment too; infinite if only the nearest does.

    Returns:
        (K,) clearance to itself beyond `apart_m` [m], at most `LOOK_SELF_M`; while two parts that come together as
            fast as they can are still apart, the distance that is left of the last exact one stands for it;
        (K,) greatest speed of a point of the moving capsules [m/s];
        (K, S) clearance to each segment [m], at most `far_m`;
        (K, S) greatest speed of the nearest point of a capsule inside the zone, and of others as above, towards the
            segment [m/s], not below 0;
        (K, S) greatest speed of the segment towards such a capsule [m/s], not below 0.
    """
    count, others = len(positions_rad), len(radii_m)
    own, speed = np.full(count, LOOK_SELF_M), np.zeros(count)
    clear, toward, approach = np.full((count, others), far_m), np.zeros((count, others)), np.zeros((count, others))
    placed, ends_m_s = np.empty((len(mounted), 3, 3)), np.empty((len(moving), 2, 3))
    rim_m_s, most_m_s, segment = np.empty(len(moving)), np.empty(len(moving)), np.empty((3, 3))
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
            most_m_s[number] = 0.0
            for end in range(2):
                px, py, pz = placed[part, end, 0], placed[part, end, 1], placed[part, end, 2]
                vx = wy * pz - wz * py + shift[frame, 0]
                vy = wz * px - wx * pz + shift[frame, 1]
                vz = wx * py - wy * px + shift[frame, 2]
                ends_m_s[number, end, 0], ends_m_s[number, end, 1], ends_m_s[number, end, 2] = vx, vy, vz
                most_m_s[number] = max(most_m_s[number], np.sqrt(vx * vx + vy * vy + vz * vz) + rim_m_s[number])
            speed[row] = max(speed[row], most_m_s[number])
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
            half, comes = 0.0, 0.0
            if times_s[row] < horizon_s:
                for end in range(2):
                    x, y, z = people_m_s[other, end, 0], people_m_s[other, end, 1], people_m_s[other, end, 2]
                    comes = max(comes, np.sqrt(x * x + y * y + z * z))
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
                if comes > 0.0 and most_m_s[number] + comes > surface_m_s:
                    frame = int(mounted[part])
                    closing = max(
                        closing,
                        surface_speed(
                            *(placed[part], ends_m_s[number], turning[frame], outer_m[part], s),
                            *(segment, radii_m[other] + zone),
                        ),
                    )
                toward[row, other] = max(toward[row, other], closing)
                approach[row, other] = max(approach[row, other], coming)
    return own, speed, clear, toward, approach


@compiled
def surface_speed(
    axis_m: FloatArray,
    axis_m_s: FloatArray,
    turning: FloatArray,
    radius_m: float,
    nearest: float,
    segment: FloatArray,
    within_m: float,
) -> float:
    """Greatest speed towards a segment of points around a capsule [m/s]: at both ends, and where it is nearest.

    Of the points around the axis it is the one that is fastest towards the segment, to first order of the radius: a
    point beside the nearest one is moved by the link's turning, and sees the segment in another direction.

    Args:
        axis_m: (2, 3) or more: ends of the axis ...
        axis_m_s: (2, 3) ... and how they move.
        turning: (3,) angular velocity of the link.
        radius_m: Of the capsule.
        nearest: Share of the way along the axis where the segment is nearest.
        segment: (2, 3) or more: ends of the segment.
        within_m: Points further than this from its axis do not count.
    """
    greatest = 0.0
    at, rate, way = np.empty(3), np.empty(3), np.empty(3)
    aside, out = np.empty(3), np.empty(3)
    for place in range(3):
        share = nearest if place == 0 else place - 1.0
        for i in range(3):
            at[i] = axis_m[0, i] + share * (axis_m[1, i] - axis_m[0, i])
            rate[i] = axis_m_s[0, i] + share * (axis_m_s[1, i] - axis_m_s[0, i])
        far, closing, inside = _toward(at, rate, segment, way)
        if far - radius_m >= within_m:
            continue
        greatest = max(greatest, closing)
        square, slides, length = 1e-12, 0.0, 0.0
        for i in range(3):
            out[i] = segment[1, i] - segment[0, i]
            square += out[i] * out[i]
            slides += rate[i] * out[i]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            # Where the nearest place of the segment slides along with a point, the direction to it does not turn.
            across = rate[i] - closing * way[i] - (slides / square * out[i] if inside else 0.0)
            aside[i] = way[j] * turning[k] - way[k] * turning[j] - across / far
            length += aside[i] * aside[i]
        length = max(np.sqrt(length), 1e-9)
        for i in range(3):
            out[i] = radius_m * aside[i] / length
            at[i] += out[i]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            rate[i] += turning[j] * out[k] - turning[k] * out[j]
        far, closing, _ = _toward(at, rate, segment, way)
        if far < within_m:
            greatest = max(greatest, closing)
    return greatest


@compiled
def _toward(at: FloatArray, rate: FloatArray, segment: FloatArray, way: FloatArray) -> tuple[float, float, bool]:
    """Distance from a point to the axis of a segment, its speed towards it, and whether that is between its ends.

    Fills in (3,) the direction.
    """
    _, _, share = nearest_points(at, at, segment[0], segment[1])
    far, closing = 0.0, 0.0
    for i in range(3):
        way[i] = segment[0, i] + share * (segment[1, i] - segment[0, i]) - at[i]
        far += way[i] * way[i]
    far = max(np.sqrt(far), 1e-9)
    for i in range(3):
        way[i] /= far
        closing += way[i] * rate[i]
    return far, closing, 0.0 < share < 1.0


LEAST_M_S = 0.03
"""A motion towards a person slower than this is ignored while the arm gives way: parts of it turn that slowly [m/s]."""


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
    least_m_s: float,
    unsure_m_s: FloatArray,
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
        least_m_s: A slower motion towards a segment is none.
        unsure_m_s: (S,) how much faster each segment may come than it is seen to.

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
                coming += unsure_m_s[other]
                to = max(toward[look, other], toward[look + 1, other])
                bounds[look, place + 2] = max(0.0, fastest - near_speed_m_s)
                bounds[look, place + 3] = max(0.0, to - max(0.0, near_speed_m_s - coming) - least_m_s)
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
