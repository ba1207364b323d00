# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""tracklet_labels.xml: the labelled objects of a raw drive, one item a track.

A boost serialization archive (source: readme.txt and tracklets.h of the raw data devkit):

- objectType, h w l in metres, first_frame (file number), then one pose a frame without a gap
- tx ty tz: the bottom face's centre in velo_link, metres; rx ry are 0, rz is the yaw, radians
- state: 0 unset, 1 interpolated, 2 labelled; occlusion: -1 unset, 0 visible, 1 partly, 2 fully
- truncation: -1 unset, 0 in the image, 1 truncated, 2 out of the image, 99 behind it
- occlusion_kf and the amt_ fields are the annotation tool's own; -1 is unset
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

LABELLED = 2
TRUNCATION_IN_IMAGE = 0
TRUNCATION_CUT = 1

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>\n'
    '<!DOCTYPE boost_serialization>\n'
    '<boost_serialization signature="serialization::archive" version="9">\n'
)
_UNSET_FIELDS = (
    'amt_occlusion',
    'amt_occlusion_kf',
    'amt_border_l',
    'amt_border_r',
    'amt_border_kf',
)


@dataclass(frozen=True)
class TrackletPose:
    """Where an object is in one frame.

    Attributes:
        translation: Bottom face's centre in velo_link, metres.
        yaw: About velo_link's z, radians.
        occlusion: -1 unset, 0 visible, 1 partly, 2 fully.
        truncation: -1 unset, 0 in the image, 1 truncated, 2 out of it, 99 behind.
    """

    translation: tuple[float, float, float]
    yaw: float
    occlusion: int = -1
    truncation: int = -1


@dataclass(frozen=True)
class Tracklet:
    """One object over consecutive frames.

    Attributes:
        kind: Class name.
        size_hwl: Height, width, length, metres.
        first_frame: File number of the first pose.
        poses: One a frame.
    """

    kind: str
    size_hwl: tuple[float, float, float]
    first_frame: int
    poses: Sequence[TrackletPose]


def format_tracklets(tracklets: Iterable[Tracklet]) -> str:
    """The text of a tracklet_labels.xml.

    Boost writes class ids only where a class occurs first: on the first track and its first pose.
    """
    items = list(tracklets)
    lines = ['<tracklets class_id="0" tracking_level="0" version="0">']
    lines += [f'\t<count>{len(items)}</count>', '\t<item_version>1</item_version>']
    for index, tracklet in enumerate(items):
        lines += _format_tracklet(tracklet, first=index == 0)
    lines += ['</tracklets>', '</boost_serialization>']
    return _HEAD + '\n'.join(lines) + '\n'


def _format_tracklet(tracklet: Tracklet, *, first: bool) -> list[str]:
    height, width, length = tracklet.size_hwl
    item = ' class_id="1" tracking_level="0" version="1"' if first else ''
    poses = ' class_id="2" tracking_level="0" version="0"' if first else ''
    lines = [
        f'\t<item{item}>',
        f'\t\t<objectType>{escape(tracklet.kind)}</objectType>',
        f'\t\t<h>{height:.9g}</h>',
        f'\t\t<w>{width:.9g}</w>',
        f'\t\t<l>{length:.9g}</l>',
        f'\t\t<first_frame>{tracklet.first_frame}</first_frame>',
        f'\t\t<poses{poses}>',
        f'\t\t\t<count>{len(tracklet.poses)}</count>',
        '\t\t\t<item_version>2</item_version>',
    ]
    for index, pose in enumerate(tracklet.poses):
        lines += _format_pose(pose, first=first and index == 0)
    return [*lines, '\t\t</poses>', '\t\t<finished>1</finished>', '\t</item>']


def _format_pose(pose: TrackletPose, *, first: bool) -> list[str]:
    tx, ty, tz = (f'{value:.17g}' for value in pose.translation)
    values = {
        'tx': tx,
        'ty': ty,
        'tz': tz,
        'rx': '0',
        'ry': '0',
        'rz': f'{pose.yaw:.17g}',
        'state': f'{LABELLED}',
        'occlusion': f'{pose.occlusion}',
        'occlusion_kf': '0',
        'truncation': f'{pose.truncation}',
        **dict.fromkeys(_UNSET_FIELDS, '-1'),
    }
    item = ' class_id="3" tracking_level="0" version="2"' if first else ''
    fields = [f'\t\t\t\t<{name}>{value}</{name}>' for name, value in values.items()]
    return [f'\t\t\t<item{item}>', *fields, '\t\t\t</item>']
