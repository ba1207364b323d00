# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the topics, clouds and frames."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from markdown_tables import attributes, code, table

from kitti_ros2.messages.camera_info import static_links
from kitti_ros2.messages.naming import PRESETS, FrameNames, base_t_imu, make_frames
from kitti_ros2.messages.topics import EVERY_MESSAGE, make_table, view_topics
from kitti_ros2.model.bag_formats import FORMATS, VALUES, Order
from kitti_ros2.options.messages import MessageOptions, Preset
from kitti_ros2.synthetic.scene import make_calibration

if TYPE_CHECKING:
    from kitti_ros2.model.bag_formats import CloudField

CAMERAS = '{gray,color}_{left,right}'
_CAMERA = f'/kitti/camera_{CAMERAS}'
_VIEW = '/kitti/camera_{2,3}/pinhole'
_OPTICAL = 'the camera'
_COLOUR = 'camera_color_left_optical_frame'
_FRAMES = '10 Hz'
_PACKETS = '10 Hz; 100 Hz with `--imu-from`'
_TOPICS = {
    '/kitti/velo/points': ('velo_link', 'scan', _FRAMES),
    '/kitti/sick/points': ('sick_link', 'line scan of KITTI-360', 'several a frame'),
    f'{_CAMERA}/image_rect/compressed': (_OPTICAL, "image: the PNG's own bytes", _FRAMES),
    f'{_CAMERA}/image_rect': (_OPTICAL, 'image as pixels: `--images raw`', _FRAMES),
    f'{_CAMERA}/camera_info': (_OPTICAL, 'calibration of the image', _FRAMES),
    f'{_VIEW}/image_rect/compressed': (_OPTICAL, 'PNG of the view: `--fisheye pinhole`', _FRAMES),
    f'{_VIEW}/image_rect': (_OPTICAL, 'its pixels: `--images raw`', _FRAMES),
    f'{_VIEW}/camera_info': (_OPTICAL, 'a pinhole without distortion', _FRAMES),
    f'{_CAMERA}/semantic/compressed': (_OPTICAL, 'class of each pixel: KITTI-360', _FRAMES),
    f'{_CAMERA}/semantic_rgb/compressed': (_OPTICAL, 'the same in colours', _FRAMES),
    f'{_CAMERA}/instance/compressed': (_OPTICAL, 'class * 1000 + instance', _FRAMES),
    f'{_CAMERA}/confidence/compressed': (_OPTICAL, 'confidence of the label', _FRAMES),
    '/kitti/oxts/imu': ('imu_link', 'accelerations with gravity, rates, orientation', _PACKETS),
    '/kitti/oxts/fix': ('imu_link', 'latitude, longitude, altitude above the sea', _PACKETS),
    '/kitti/oxts/vel': ('imu_link', 'velocity and rates, along the axes of the unit', _PACKETS),
    '/kitti/oxts/vel_with_covariance': ('imu_link', 'the same: `--covariances`', _PACKETS),
    '/tf': ('map', 'ground truth: `map` to `base_link`', _FRAMES),
    '/tf_static': ('', 'all other frames', 'once'),
    '/kitti/ground_truth/odometry': ('map', 'pose of `base_link`', _FRAMES),
    '/kitti/ground_truth/path': ('map', 'all poses of `base_link`', 'once'),
    '/kitti/labels/detections': ('velo_link', '3D boxes; `id` is the track', _FRAMES),
    '/kitti/labels/boxes_2d': (_COLOUR, '2D boxes in the image of camera 2', _FRAMES),
    '/kitti/labels/markers': ('velo_link', 'boxes, headings, texts; trails in `map`', _FRAMES),
    '/kitti/labels/detected_objects': ('base_link', '`--objects autoware`', _FRAMES),
    '/kitti/labels/tracked_objects': ('base_link', 'the same with tracks', _FRAMES),
    '/kitti/predictions/detections': ('velo_link', 'results of `--predictions`', _FRAMES),
    '/kitti/predictions/boxes_2d': (_COLOUR, 'their 2D boxes', _FRAMES),
    '/kitti/predictions/markers': ('velo_link', 'compared with the labels', _FRAMES),
    '/kitti/predictions/detected_objects': ('base_link', '`--objects autoware`', _FRAMES),
    '/kitti/predictions/tracked_objects': ('base_link', 'the same with tracks', _FRAMES),
    f'{_CAMERA}/annotated': (_OPTICAL, 'labels drawn on the image: `play --annotated`', _FRAMES),
    f'{_CAMERA}/annotations': ('', '2D boxes for Foxglove: `--annotations`', _FRAMES),
    f'{_CAMERA}/prediction_annotations': ('', 'the same of `--predictions`', _FRAMES),
    '/kitti/label_info': ('', 'names of the classes of label images', 'once'),
    '/kitti/source/recording': ('', 'name and layout of the recording', 'once'),
    '/kitti/source/files': ('', 'text files of the recording', 'once'),
    '/kitti/source/calibration': ('', 'calibration files', 'once; each frame in object sets'),
    '/kitti/source/oxts': ('', 'lines of packets', _FRAMES),
    '/kitti/source/labels': ('', 'lines of labels', _FRAMES),
    '/kitti/source/sweep': ('', 'start and end of the turn', _FRAMES),
    '/kitti/source/points': ('velo_link', 'points of the files, with other `--points`', _FRAMES),
}
"""By topic, in the order of the table: frame, meaning, rate."""


def topics() -> str:
    """Return the table of topics with frame, meaning, rate and QoS, the sensors first."""
    options = dataclasses.replace(EVERY_MESSAGE, annotated=True)
    made = {row.topic: row for row in make_table({0: CAMERAS, 1: CAMERAS}, 'image_rect', options)}
    views = {row.topic: row for row in view_topics().values()}
    made |= {topic.replace('_2/', '_{2,3}/'): views[topic] for topic in views if '_2/' in topic}
    order = {topic: place for place, topic in enumerate(_TOPICS)}
    rows = []
    for topic in sorted(made, key=order.__getitem__):
        row, (frame, meaning, rate) = made[topic], _TOPICS[topic]
        qos = f'latched, depth {row.depth}' if row.latched else f'depth {row.depth}'
        kind = row.msgtype.replace('/msg/', '/')
        named = code(frame) if '_' in frame or frame == 'map' else frame
        rows.append((code(topic), code(kind), named, meaning, rate, qos))
    return table(('topic', 'type', 'frame', 'meaning', 'rate', 'QoS'), rows)


def clouds() -> str:
    """Return the formats of clouds."""
    rows = [
        (
            code(name.value),
            each.follows,
            ', '.join(f'{code(field.name)} {_field_type(field)}' for field in each.fields),
            str(each.point_step),
            '64 x N, NaN without a return' if each.order is Order.GRID else '1 x N',
            each.order.value,
            'start of the turn' if each.is_timed else 'facing forward',
        )
        for name, each in FORMATS.items()
    ]
    head = ('--points', 'as', 'fields, with offset', 'bytes', 'size', 'order', 'stamp of a scan')
    return table(head, rows)


def cloud_fields() -> str:
    """Return the fields of clouds with their values."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for name, each in FORMATS.items():
        for field in each.fields_of(timed=True, labelled=each.extensible):
            kind = _field_type(field).partition(' ')[0]
            is_label = field.value.startswith('label')
            of = '--semantic' if is_label else name.value
            known = rows.setdefault((field.name, kind, VALUES[field.value]), [])
            known += [of] if of not in known else []
    return table(
        ('field', 'type', 'value', 'in'),
        ((code(name), kind, value, ', '.join(map(code, of)))
         for (name, kind, value), of in rows.items()),
    )  # fmt: skip


def _field_type(field: CloudField) -> str:
    names = {'f': 'float', 'u': 'uint'}
    return f'{names[field.kind[1]]}{8 * int(field.kind[2])} at {field.offset}'


def renamed_topics() -> str:
    """Return the topics that the preset kitti2bag renames."""
    rows = [(code(own), code(renamed)) for own, renamed in PRESETS[Preset.KITTI2BAG].topics.items()]
    return table(('default', 'kitti2bag'), rows)


def frames() -> str:
    """Return the frames of a rectified recording, with parents and names by preset."""
    meaning = attributes(FrameNames)
    kinds = {'map': '', 'base': '', 'imu': '', 'velo': ''}
    ours, theirs = (make_frames(preset, {}) for preset in Preset)
    links = static_links(make_calibration(), base_t_imu(MessageOptions()), ours)
    parents = {child: parent for parent, child, _ in links} | {ours.base: ours.map}
    names = [(getattr(ours, kind), getattr(theirs, kind), meaning[kind]) for kind in kinds]
    names += [
        (ours.camera(index), theirs.camera(index), f'Optical frame of camera {index}')
        for index in range(4)
    ]
    rows = [
        (code(name), code(parents[name]) if name in parents else '', code(renamed), text)
        for name, renamed, text in names
    ]
    return table(('frame', 'parent', 'preset kitti2bag', 'is'), rows)
