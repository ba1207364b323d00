# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks that several stacks share. Each makes a function of Seen that returns the faults."""

from __future__ import annotations

import numpy as np
from seen import FLOAT32, UINT16, stamp_ns

from kitti_ros2.model.bag_formats import CAMERA_INFO, CLOUD, IMAGE

EDGE = 2
"""Clouds at the ends of a recording that an Imu or a transform need not surround."""


def is_type(topic, msgtype):
    """There are messages of a type on a topic."""

    def check(seen):
        if not seen.messages.get(topic):
            return [f'no message on {topic}']
        found = seen.types[topic]
        return [] if found == msgtype else [f'{topic} is {found}']

    return check


def every(*checks):
    """All of these checks."""
    return lambda seen: [fault for each in checks for fault in each(seen)]


def cloud_on(topic):
    """PointCloud2 on a topic, in little-endian, with a stamp and a frame."""

    def check(seen):
        faults = is_type(topic, CLOUD)(seen)
        for message in [] if faults else seen.messages[topic]:
            if message.is_bigendian or not message.header.frame_id or not stamp_ns(message):
                faults.append('header or byte order')
            if message.row_step != message.width * message.point_step:
                faults.append('row_step')
        return faults

    return check


def reliable(*topics):
    """The publisher offers what a reliable subscription needs, and so a best-effort one, too."""

    def check(seen):
        return [
            f'{topic}: {seen.qos[topic]}'
            for topic in topics
            if (seen.qos[topic]['reliability'], seen.qos[topic]['durability'])
            not in {('reliable', 'volatile'), (1, 2)}
        ]

    return check


def of_clouds(topic, fault_of):
    """No cloud has a fault; fault_of returns its text, '' for none."""

    def check(seen):
        return [fault for each in seen.clouds(topic) if (fault := fault_of(each))]

    return check


def fields(topic, **kinds):
    """The cloud has fields of these types, without NaN in them, that do not overlap."""

    def fault_of(cloud):
        for name, kind in kinds.items():
            if cloud.fields.get(name, (0,))[0] != kind:
                return f'{name} is {cloud.fields.get(name)}'
        return ''

    return of_clouds(topic, fault_of)


def xyz(topic):
    return fields(topic, x=FLOAT32, y=FLOAT32, z=FLOAT32)


def velodyne(topic):
    """The fields that pcl reads into the structures of LIO-SAM and FAST-LIO2, by name and type."""
    return fields(
        topic, x=FLOAT32, y=FLOAT32, z=FLOAT32, intensity=FLOAT32, ring=UINT16, time=FLOAT32
    )


def one_time(topic, names, *kinds):
    """Exactly one of these fields, of one of these types."""

    def fault_of(cloud):
        found = [name for name in names if name in cloud.fields]
        if len(found) != 1:
            return f'fields {list(cloud.fields)}'
        kind = cloud.fields[found[0]][0]
        return '' if kind in kinds else f'{found[0]} is of type {kind}'

    return of_clouds(topic, fault_of)


def time_of(cloud, names=('t', 'time', 'timestamp')):
    """The times of a cloud in seconds since its stamp; NaN if it has none."""
    found = [name for name in names if name in cloud.fields]
    return cloud.seconds(found[0]) if found else np.array([np.nan])


def times(topic, holds, what):
    """A property of the times of all points."""
    return of_clouds(topic, lambda cloud: '' if holds(time_of(cloud)) else what)


def a_turn(values):
    """Times differ, and span about a turn."""
    return 0.08 < values.max() - values.min() < 0.12


def begins_at_0(values):
    return abs(values.min()) < 1e-3


def last_is_the_end(values):
    """Ascending from the stamp: the last point's time ends the scan."""
    return bool((np.diff(values) >= 0).all()) and 0.08 < values[-1] < 0.12


def imu_covers(cloud_topic, imu_topic):
    """Every cloud but those at the ends has Imu messages before its start and after its end."""

    def check(seen):
        stamps = np.array([stamp_ns(each) for each in seen.messages.get(imu_topic, [])])
        if not len(stamps):
            return [f'no message on {imu_topic}']
        clouds = seen.clouds(cloud_topic)
        late = [
            each.stamp_ns
            for each in clouds
            if not stamps.min() <= each.stamp_ns
            or not each.stamp_ns + time_of(each)[-1] * 1e9 <= stamps.max()
        ]
        return [f'no Imu around {len(late)} clouds'] if len(late) > EDGE else []

    return check


def static_frames(base, *topics):
    """The frames of these messages are below a frame in /tf_static."""

    def check(seen):
        frames = {each.header.frame_id for topic in topics for each in seen.messages.get(topic, [])}
        above = {frame: seen.above(frame, seen.static) for frame in frames}
        missing = [frame for frame, found in above.items() if base not in found]
        return [f'{frame} is not below {base}' for frame in missing] or (
            [] if frames else ['no messages']
        )

    return check


def one_parent(*moving):
    """No frame has two parents once the stack publishes its links, nor is its own parent."""

    def check(seen):
        links = {child: set(parents) for child, parents in seen.static.items()}
        for child, parents in seen.moving.items():
            links.setdefault(child, set()).update(parents)
        for parent, child in moving:
            links.setdefault(child, set()).add(parent)
        faults = [f'{child} below {sorted(p)}' for child, p in links.items() if len(p) > 1]
        for frame in [] if faults else links:
            seen.above(frame, links)
        return faults

    return check


def pose_at_stamp(fixed, topic):
    """/tf has the frame of each cloud in a fixed frame, before and after its stamp."""

    def check(seen):
        stamps = [
            stamp_ns(each)
            for message in seen.messages.get('/tf', [])
            for each in message.transforms
            if each.header.frame_id == fixed
        ]
        if not stamps:
            return [f'nothing moves in {fixed}']
        clouds = seen.clouds(topic)
        links = {**seen.static, **seen.moving}
        above = {fixed in seen.above(each.message.header.frame_id, links) for each in clouds}
        late = [each for each in clouds if not min(stamps) <= each.stamp_ns <= max(stamps)]
        return ([] if above == {True} else ['not in one tree']) + (
            [f'no pose around {len(late)} clouds'] if len(late) > EDGE else []
        )

    return check


def images_on(*topics):
    return every(*(is_type(topic, IMAGE) for topic in topics))


def infos_on(*topics):
    return every(*(is_type(topic, CAMERA_INFO) for topic in topics))


def same_stamps(*topics):
    """These topics have messages with the same stamps."""

    def check(seen):
        found = [[stamp_ns(each) for each in seen.messages.get(topic, [])] for topic in topics]
        return [] if found[0] and all(each == found[0] for each in found) else ['stamps differ']

    return check


def near_stamps(limit_ns, *topics):
    """Each message of the first topic has one of the others nearby."""

    def check(seen):
        found = [np.array([stamp_ns(each) for each in seen.messages[topic]]) for topic in topics]
        far = [
            stamp
            for stamp in found[0]
            for others in found[1:]
            if np.abs(others - stamp).min() > limit_ns
        ]
        return [f'{len(far)} stamps are far from the others'] if far else []

    return check


def encodings(*allowed, topics):
    def check(seen):
        found = {each.encoding for topic in topics for each in seen.messages.get(topic, [])}
        return [] if found and found <= set(allowed) else [f'encodings {sorted(found)}']

    return check


def stereo_pair(left, right):
    """The right CameraInfo has the baseline in P."""

    def check(seen):
        faults = []
        pairs = zip(seen.messages.get(left, []), seen.messages.get(right, []), strict=True)
        for first, second in pairs:
            baseline = -second.p[3] / second.p[0]
            if first.p[3] or not 0.3 < baseline < 0.8 or first.p[0] != second.p[0]:
                faults.append(f'P {first.p[3]}, baseline {baseline}')
        return faults or ([] if seen.messages.get(left) else ['no CameraInfo'])

    return check


def one_frame(*topics):
    def check(seen):
        frames = {each.header.frame_id for topic in topics for each in seen.messages[topic]}
        return [] if len(frames) == 1 else [f'frames {sorted(frames)}']

    return check
