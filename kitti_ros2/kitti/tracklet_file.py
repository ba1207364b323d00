# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tracklets, the labelled objects of raw drives; the parser of XML."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np

from ..kitti import names
from ..model.boxes import Cuboid
from ..model.errors import (
    BadFileError,
    shown,
)
from ..model.geometry import Transform, rotation_from_rpy
from ..model.samples import FrameLabels

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path


# tracklet_labels.xml: the labelled objects of a raw drive, one item a track.
#
# A boost serialization archive (source: readme.txt and tracklets.h of the raw data devkit):
#
# - objectType, h w l in metres, first_frame (file number), then one pose a frame without a gap
# - tx ty tz: the bottom face's centre in velo_link, metres; rx ry are 0, rz is the yaw, radians
# - state: 0 unset, 1 interpolated, 2 labelled; occlusion: -1 unset, 0 visible, 1 partly, 2 fully
# - truncation: -1 unset, 0 in the image, 1 truncated, 2 out of the image, 99 behind it
# - occlusion_kf and the amt_ fields are the annotation tool's own; -1 is unset

MOST_BYTES = 256 << 20
_EXPECTED = 'a tracklet_labels.xml of the raw data devkit'
_MOST_LEVELS = 100
_LIST, _ITEM, _CLASS_NAME = 'tracklets', 'item', 'objectType'
_TRACK_ITEM = [_LIST, _ITEM]
_POSE_ITEM = [_LIST, _ITEM, 'poses', _ITEM]
_TRACK_NUMBERS = ('h', 'w', 'l', 'first_frame')
_POSE_NUMBERS = ('tx', 'ty', 'tz', 'rz', 'state', 'occlusion', 'truncation')
_WHOLE = {
    'first_frame': range(10**names.FRAME_DIGITS),
    **dict.fromkeys(('state', 'occlusion', 'truncation'), range(-1, 100)),
}

LABELLED = 2
FULLY_OCCLUDED = 2
TRUNCATION_IN_IMAGE = 0
TRUNCATION_CUT = 1
_OUT_OF_IMAGE = (2, 99)

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


@dataclass(frozen=True, slots=True)
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
    return _TrackParser(path).parse(data)


class XmlParser:
    """Parses XML from expat's events, without entities: a tree takes 20 times its text.

    Args:
        path: For the errors.
        expected: The expected file, for the errors.
    """

    def __init__(self, path: Path | str, expected: str) -> None:
        self._path = path
        self._expected = expected
        self._open: list[str] = []
        self._text: list[str] = []
        self._expat = ParserCreate()
        self._expat.buffer_text = True
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.CharacterDataHandler = self._text.append
        self._expat.EntityDeclHandler = self._refuse_entity

    def read(self, data: bytes) -> None:
        """Read a whole file.

        Raises:
            BadFileError: The XML is truncated, too large or invalid, or defines entities.
        """
        if len(data) > MOST_BYTES:
            problem = f'{len(data)} bytes'
            raise BadFileError(self._path, problem, f'at most {MOST_BYTES} bytes of XML')
        try:
            self._expat.Parse(data, True)  # noqa: FBT003 - it takes no name
        except ExpatError as error:
            problem = f'no whole XML ({error})'
            raise BadFileError(self._path, problem, self._expected, line=error.lineno) from None
        except (LookupError, ValueError) as error:
            problem = f'XML in an encoding that is not known ({error})'
            raise BadFileError(self._path, problem, self._expected) from None

    def _start(self, name: str, _: dict[str, str]) -> None:
        if len(self._open) == _MOST_LEVELS:
            self._refuse(f'more than {_MOST_LEVELS} levels of elements', self._expected)
        self._open.append(name)
        self._text.clear()

    def _end(self, name: str) -> None:
        self._take(name)
        self._open.pop()
        self._text.clear()

    def _take(self, name: str) -> None:
        """Take the text of an element at its end."""
        raise NotImplementedError

    def _where(self) -> str:
        """Return the object that is read, for the errors."""
        return ''

    def _refuse_entity(self, name: str, *_: object) -> None:
        self._refuse(f'XML with entities ({shown(name)})', self._expected)

    def _refuse(self, problem: str, expected: str) -> NoReturn:
        line = self._expat.CurrentLineNumber
        raise BadFileError(self._path, self._where() + problem, expected, line=line)


class _TrackParser(XmlParser):
    """Parses tracks."""

    def __init__(self, path: Path | str) -> None:
        super().__init__(path, _EXPECTED)
        self._track: dict[str, float] = {}
        self._class_name = ''
        self._pose: dict[str, float] = {}
        self._poses: list[TrackletPose] = []
        self._tracklets: list[Tracklet] = []
        self._is_list = False

    def parse(self, data: bytes) -> list[Tracklet]:
        """Return the tracks.

        Raises:
            BadFileError: An element is missing or invalid.
        """
        self.read(data)
        if not self._is_list:
            raise BadFileError(self._path, 'no element tracklets', _EXPECTED)
        return self._tracklets

    def _take(self, name: str) -> None:
        parents = self._open[1:-1]
        if parents == _POSE_ITEM:
            if name in _POSE_NUMBERS:
                self._pose.setdefault(name, self._number(name))
        elif parents == _TRACK_ITEM:
            if name in _TRACK_NUMBERS:
                self._track.setdefault(name, self._number(name))
            elif name == _CLASS_NAME:
                self._class_name = self._class_name or ''.join(self._text)
        elif name == _ITEM and parents == _POSE_ITEM[:-1]:
            self._end_pose()
        elif name == _ITEM and parents == _TRACK_ITEM[:-1]:
            self._end_track()
        elif name == _LIST and len(self._open) == len(_TRACK_ITEM):
            self._is_list = True

    def _end_pose(self) -> None:
        tx, ty, tz, yaw, state, occlusion, truncation = self._all(self._pose, _POSE_NUMBERS)
        pose = TrackletPose((tx, ty, tz), yaw, int(occlusion), int(truncation), int(state))
        self._poses.append(pose)
        self._pose.clear()

    def _end_track(self) -> None:
        if not self._class_name:
            self._refuse(f'no element {_CLASS_NAME}', _EXPECTED)
        height, width, length, first_frame = self._all(self._track, _TRACK_NUMBERS)
        size_hwl = (height, width, length)
        self._tracklets.append(Tracklet(self._class_name, size_hwl, int(first_frame), self._poses))
        self._track.clear()
        self._class_name = ''
        self._poses = []

    def _all(self, fields: dict[str, float], needed: Iterable[str]) -> list[float]:
        for name in needed:
            if name not in fields:
                self._refuse(f'no element {name}', _EXPECTED)
        return [fields[name] for name in needed]

    def _number(self, name: str) -> float:
        text = ''.join(self._text)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        whole = _WHOLE.get(name)
        if whole is None:
            if not math.isfinite(value):
                self._refuse(f'{name} is {shown(text)}', 'a finite number')
        elif not (value.is_integer() and int(value) in whole):
            expected = f'a whole number from {whole[0]} to {whole[-1]}'
            self._refuse(f'{name} is {shown(text)}', expected)
        return value

    def _where(self) -> str:
        if self._open[1:5] == _POSE_ITEM:
            return f'item {len(self._tracklets)}, pose {len(self._poses)}: '
        return f'item {len(self._tracklets)}: ' if self._open[1:3] == _TRACK_ITEM else ''


def cuboids_by_frame(tracklets: Iterable[Tracklet]) -> dict[int, list[Cuboid]]:
    """Map file numbers to boxes in velo_link; a track's index in the file is its id.

    An occlusion of 2, fully, has no level of its own in labels: it is their 2, largely.
    """
    frames: dict[int, list[Cuboid]] = {}
    for track, tracklet in enumerate(tracklets):
        height, width, length = tracklet.size_hwl
        for offset, pose in enumerate(tracklet.poses):
            x, y, z = pose.translation
            middle = np.array([x, y, z + height / 2])
            velo_t_box = Transform(rotation_from_rpy(0.0, 0.0, pose.yaw), middle)
            cuboid = Cuboid(
                tracklet.class_name,
                str(track),
                velo_t_box,
                (length, width, height),
                track_id=track,
                occluded=pose.occlusion if 0 <= pose.occlusion <= FULLY_OCCLUDED else None,
                truncation=_truncation_level(pose.truncation),
            )
            frames.setdefault(tracklet.first_frame + offset, []).append(cuboid)
    return frames


def _truncation_level(truncation: int) -> int | None:
    if truncation in _OUT_OF_IMAGE:
        return 2
    return truncation if truncation in {TRUNCATION_IN_IMAGE, TRUNCATION_CUT} else None


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
    from html import escape  # noqa: PLC0415 - 2 ms, for files of tracklets only

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
