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

import math
from dataclasses import dataclass
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from ..model.boxes import Cuboid
from ..model.errors import BadFileError
from ..model.geometry import Transform, rotation_from_rpy
from ..model.samples import FrameLabels
from . import names

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path
    from xml.etree.ElementTree import Element  # the type alone; defusedxml does the parsing

MOST_BYTES = 256 << 20
_EXPECTED = 'a tracklet_labels.xml of the raw data devkit'
_STATES = range(-1, 100)
_LIST, _ITEM, _POSES = 'tracklets', 'item', 'poses'

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
    """The pose of an object in one frame.

    Attributes:
        translation: Bottom face's centre in velo_link, metres.
        yaw: About velo_link's z, radians.
        occlusion: -1 unset, 0 visible, 1 partly, 2 fully.
        truncation: -1 unset, 0 in the image, 1 truncated, 2 out of it, 99 behind.
        state: 0 unset, 1 interpolated, 2 labelled.
    """

    translation: tuple[float, float, float]
    yaw: float
    occlusion: int = -1
    truncation: int = -1
    state: int = LABELLED


@dataclass(frozen=True)
class Tracklet:
    """One object over consecutive frames.

    Attributes:
        class_name: Its objectType.
        size_hwl: Height, width, length, metres.
        first_frame: File number of the first pose.
        poses: One a frame.
    """

    class_name: str
    size_hwl: tuple[float, float, float]
    first_frame: int
    poses: Sequence[TrackletPose]


def parse_tracklets(data: bytes, path: Path | str) -> list[Tracklet]:
    """Parse the tracks of a tracklet_labels.xml.

    Raises:
        BadFileError: The XML is truncated, too large or incomplete, or defines entities.
    """
    from defusedxml import DefusedXmlException  # noqa: PLC0415 - only where there are tracklets
    from defusedxml.ElementTree import ParseError, iterparse  # noqa: PLC0415

    if len(data) > MOST_BYTES:
        raise BadFileError(path, f'{len(data)} bytes', f'at most {MOST_BYTES} bytes of XML')
    try:
        return _TrackParser(path).parse(iterparse(BytesIO(data), ('start', 'end')))
    except ParseError as error:
        line, _ = error.position
        raise BadFileError(path, f'no whole XML ({error})', _EXPECTED, line=line) from None
    except (LookupError, ValueError) as error:
        if isinstance(error, DefusedXmlException):
            found = f'XML with entities ({type(error).__name__})'
        else:
            found = f'XML in an encoding that is not known ({error})'
        raise BadFileError(path, found, _EXPECTED) from None


class _TrackParser:
    """Parses tracks as their elements end, and drops these: they take 20 times their text."""

    def __init__(self, path: Path | str) -> None:
        self._path = path
        self._open: list[Element] = []
        self._poses: list[TrackletPose] = []
        self._tracklets: list[Tracklet] | None = None

    def parse(self, events: Iterable[tuple[str, Element]]) -> list[Tracklet]:
        """Return the tracks.

        Raises:
            BadFileError: An element is missing or invalid.
        """
        for event, element in events:
            if event == 'start':
                self._open.append(element)
            else:
                self._open.pop()
                self._end(element, tuple(each.tag for each in self._open[1:]))
        if self._tracklets is None:
            raise BadFileError(self._path, 'no element tracklets', _EXPECTED)
        return self._tracklets

    def _end(self, element: Element, parents: tuple[str, ...]) -> None:
        if element.tag == _LIST and not parents:
            self._tracklets = self._tracklets or []
        elif element.tag != _ITEM:
            return
        elif parents == (_LIST, _ITEM, _POSES):
            where = f'{self._where()}, pose {len(self._poses)}'
            self._poses.append(_parse_pose(element, where))
            self._open[-1].clear()
        elif parents == (_LIST,):
            self._tracklets = self._tracklets or []
            self._tracklets.append(_parse_tracklet(element, self._poses, self._where()))
            self._poses = []
            self._open[-1].clear()

    def _where(self) -> str:
        return f'{self._path}: item {len(self._tracklets or ())}'


def _parse_tracklet(item: Element, poses: list[TrackletPose], where: str) -> Tracklet:
    return Tracklet(
        class_name=item.findtext('objectType') or _missing('objectType', where),
        size_hwl=(_number(item, 'h', where), _number(item, 'w', where), _number(item, 'l', where)),
        first_frame=_integer(item, 'first_frame', where, range(10**names.FRAME_DIGITS)),
        poses=poses,
    )


def _parse_pose(item: Element, where: str) -> TrackletPose:
    tx, ty, tz, yaw = (_number(item, name, where) for name in ('tx', 'ty', 'tz', 'rz'))
    state, occlusion, truncation = (
        _integer(item, name, where, _STATES) for name in ('state', 'occlusion', 'truncation')
    )
    return TrackletPose((tx, ty, tz), yaw, occlusion, truncation, state)


def _number(item: Element, name: str, where: str) -> float:
    text = item.findtext(name)
    if text is None:
        _missing(name, where)
    try:
        value = float(text or '')
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadFileError(where, f'{name} is {text!r}', 'a finite number')
    return value


def _integer(item: Element, name: str, where: str, allowed: range) -> int:
    value = _number(item, name, where)
    if not value.is_integer() or int(value) not in allowed:
        expected = f'a whole number from {allowed[0]} to {allowed[-1]}'
        raise BadFileError(where, f'{name} is {value:g}', expected)
    return int(value)


def _missing(name: str, where: str) -> NoReturn:
    raise BadFileError(where, f'no element {name}', _EXPECTED)


def cuboids_by_frame(tracklets: Iterable[Tracklet]) -> dict[int, list[Cuboid]]:
    """Map file numbers to boxes in velo_link; a track's place in the file is its id."""
    frames: dict[int, list[Cuboid]] = {}
    for track, tracklet in enumerate(tracklets):
        height, width, length = tracklet.size_hwl
        for offset, pose in enumerate(tracklet.poses):
            x, y, z = pose.translation
            middle = np.array([x, y, z + height / 2])
            velo_t_box = Transform(rotation_from_rpy(0.0, 0.0, pose.yaw), middle)
            cuboid = Cuboid(
                tracklet.class_name, str(track), velo_t_box, (length, width, height), track_id=track
            )
            frames.setdefault(tracklet.first_frame + offset, []).append(cuboid)
    return frames


def labels_of_tracklets(cuboids: Sequence[Cuboid], path: Path | str) -> FrameLabels:
    """Return the labels of a frame from its boxes; those of invalid size are listed in missing."""
    missing = {
        cuboid.identity: f'{path}: item {cuboid.identity} is of length, width, height'
        f' {" ".join(f"{v:g}" for v in cuboid.size_lwh)}; expected positive sizes; it gets no'
        f' marker and no 3D detection'
        for cuboid in cuboids
        if min(cuboid.size_lwh) <= 0
    }
    sound = [cuboid for cuboid in cuboids if cuboid.identity not in missing]
    return FrameLabels(cuboids=sound, missing=missing)


def format_tracklets(tracklets: Iterable[Tracklet]) -> str:
    """Format a tracklet_labels.xml.

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
        f'\t\t<objectType>{escape(tracklet.class_name, quote=False)}</objectType>',
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
        'state': f'{pose.state}',
        'occlusion': f'{pose.occlusion}',
        'occlusion_kf': '0',
        'truncation': f'{pose.truncation}',
        **dict.fromkeys(_UNSET_FIELDS, '-1'),
    }
    item = ' class_id="3" tracking_level="0" version="2"' if first else ''
    fields = [f'\t\t\t\t<{name}>{value}</{name}>' for name, value in values.items()]
    return [f'\t\t\t<item{item}>', *fields, '\t\t\t</item>']
