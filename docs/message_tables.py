# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the topics, clouds and frames."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from markdown_tables import attributes, code, table

from kitti_ros2.messages.camera_info import static_links
from kitti_ros2.messages.naming import PRESETS, FrameNames, base_t_imu, make_frames
from kitti_ros2.messages.topics import EVERY_MESSAGE, make_table
from kitti_ros2.model.bag_formats import FORMATS, VALUES, Order
from kitti_ros2.options.messages import MessageOptions, Preset
from kitti_ros2.synthetic.scene import make_calibration

if TYPE_CHECKING:
    from kitti_ros2.model.bag_formats import CloudField

CAMERAS = '{gray,color}_{left,right}'


def topics() -> str:
    """Return the table of topics, with streams, QoS and the names of the preset kitti2bag."""
    options = dataclasses.replace(EVERY_MESSAGE, annotated=True)
    rows = [
        (
            code(row.topic),
            code(row.msgtype.replace('/msg/', '/')),
            'image' if row.stream.camera is not None else row.stream.value,
            f'latched, depth {row.depth}' if row.latched else f'depth {row.depth}',
        )
        for row in make_table({0: CAMERAS}, 'image_rect', options)
    ]
    return table(('topic', 'type', 'stream', 'QoS'), rows)


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
