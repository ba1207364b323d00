# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The overview of a KITTI folder or a bag: series, gaps, sizes, calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..bags.reader import bag_stamps, open_messages, opened, summarize_bag
from ..bags.summary import TopicSummary, summarize_topic
from ..exporter.schedule import frames_of
from ..messages.camera_info import encode_camera_info, image_frame_camera
from ..messages.cdr import deserialize
from ..messages.moment import make_rig
from ..messages.mounts import with_nominal_mounts
from ..messages.source import RECORDING
from ..messages.transforms import decode_static, static_links
from ..model.errors import KittiRos2Error
from ..model.geometry import rotation_to_rpy
from ..model.losses import format_numbers
from ..model.streams import Clock
from ..options.messages import MessageOptions
from ..own_bags.numbering import number_bag

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from ..bags.reader import BagSource, BagSummary
    from ..kitti.recording import KittiRecording
    from ..messages.ros_types import CameraInfo
    from ..model.geometry import Transform
    from ..model.losses import Loss

_CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
_TF = 'tf2_msgs/msg/TFMessage'
_MOST_TF = 200


@dataclass(frozen=True)
class CameraGlance:
    """A camera's numbers: name, image size, focal lengths and centre in pixels, baseline in m.

    Unknown values are None: the size if only images have it, the rest of an uncalibrated camera.
    """

    name: str
    width: int | None
    height: int | None
    fx: float | None
    fy: float | None
    cx: float | None
    cy: float | None
    baseline_m: float | None


@dataclass(frozen=True)
class LinkGlance:
    """A static transform: child in parent, xyz in metres, roll pitch yaw in degrees."""

    parent: str
    child: str
    xyz_m: tuple[float, float, float]
    rpy_deg: tuple[float, float, float]


@dataclass(frozen=True)
class Overview:
    """The overview of a recording or a bag, as shown by info.

    Attributes:
        path: The folder or the bag.
        kind: KITTI layout, or bag container.
        name: Drive, split or sequence; files of a bag.
        series: Streams or topics; unknown times are None.
        frames: Number of frames; None in a bag not written by to-bag.
        clock: The meaning of the stamps.
        start_ns, end_ns: First and last stamp, None without any or if the date is assumed.
        duration_ns: From the first to the last; None if no time is known.
        size_bytes: Total size of its files.
        compression: Compression of a bag; None for a folder.
        cameras, links: Calibration.
        losses: Missing or unusable data.
        notes: Remarks.
        complete: False for a truncated or damaged bag.
    """

    path: Path
    kind: str
    name: str
    series: tuple[TopicSummary, ...]
    frames: int | None
    clock: Clock
    start_ns: int | None
    end_ns: int | None
    duration_ns: int | None
    size_bytes: int
    compression: str | None
    cameras: tuple[CameraGlance, ...]
    links: tuple[LinkGlance, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]
    complete: bool = True


def inspect_recording(recording: KittiRecording, path: Path) -> Overview:
    """Inspect a KITTI recording; its data files are listed and not read."""
    series = tuple(
        summarize_topic(stream.value, format_numbers(index.numbers.tolist(), 2), index.stamps_ns)
        for stream, index in recording.streams.items()
    )
    cameras, links, notes = _recording_calibration(recording)
    numbers = {stream: index.numbers for stream, index in recording.streams.items()}
    times = _times(series, recording.clock)
    return Overview(
        path=path,
        kind=recording.layout.value,
        name=recording.name,
        series=tuple(_known(each, recording.clock) for each in series),
        frames=len(frames_of(numbers, common=recording.common_numbers)),
        clock=recording.clock,
        start_ns=times.start_ns,
        end_ns=times.end_ns,
        duration_ns=times.duration_ns,
        size_bytes=_size_bytes(recording),
        compression=None,
        cameras=cameras,
        links=links,
        losses=(*recording.losses, *recording.late_losses),
        notes=tuple(recording.notes) + notes,
    )


def inspect_bag(source: BagSource) -> Overview:
    """Inspect a bag: its index, and the first camera_info and static transforms.

    Raises:
        BadBagError: The path is not a bag, or is unreadable.
    """
    with opened(source) as bag:
        summary = summarize_bag(bag)
        own = any(topic.name == RECORDING and topic.count for topic in summary.topics)
        numbered = number_bag(bag, bag_stamps(bag), by_header=False) if own else None
        cameras, links, notes = _bag_calibration(bag, summary)
    clock = Clock.UTC if numbered is None else numbered.clock
    times = _times(summary.topics, clock)
    incomplete = 'parts of the bag are missing or damaged; whole messages are counted'
    cut = () if summary.complete else (incomplete,)
    return Overview(
        path=bag.path,
        kind=summary.container,
        name=', '.join(file.name for file in summary.files[:3])
        + (' ...' if len(summary.files) > 3 else ''),
        series=tuple(_known(topic, clock) for topic in summary.topics),
        frames=None if numbered is None else len(numbered.frames),
        clock=clock,
        start_ns=times.start_ns,
        end_ns=times.end_ns,
        duration_ns=times.duration_ns,
        size_bytes=summary.size_bytes,
        compression=summary.compression,
        cameras=cameras,
        links=links,
        losses=(),
        notes=(*cut, *summary.findings, *notes),
        complete=summary.complete,
    )


class _Times(NamedTuple):
    """The known times of a recording, nanoseconds."""

    start_ns: int | None
    end_ns: int | None
    duration_ns: int | None


def _times(series: Iterable[TopicSummary], clock: Clock) -> _Times:
    """Return the times of all series, without those unknown to the layout."""
    starts = [each.start_ns for each in series if each.start_ns is not None]
    ends = [each.end_ns for each in series if each.end_ns is not None]
    if not starts or clock is Clock.NOMINAL:
        return _Times(None, None, None)
    start_ns, end_ns = min(starts), max(ends)
    if clock is Clock.RELATIVE:
        return _Times(None, None, end_ns - start_ns)
    return _Times(start_ns, end_ns, end_ns - start_ns)


def _known(series: TopicSummary, clock: Clock) -> TopicSummary:
    """Return a series without the dates or times that its clock does not provide."""
    if clock is Clock.NOMINAL:
        return TopicSummary(series.name, series.msgtype, series.count)
    if clock is Clock.RELATIVE:
        return replace(series, start_ns=None, end_ns=None, largest_gap_at_ns=None)
    return series


def _size_bytes(recording: KittiRecording) -> int:
    """Return the size of the data files; a file of several streams counts once."""
    paths = {
        recording.path(stream, number)
        for stream, index in recording.streams.items()
        for number in index.numbers.tolist()
    }
    return sum(path.stat().st_size for path in paths if path.is_file())


Calibrated = tuple[tuple[CameraGlance, ...], tuple[LinkGlance, ...], tuple[str, ...]]


def _recording_calibration(recording: KittiRecording) -> Calibrated:
    first = min(int(index.numbers[0]) for index in recording.streams.values())
    calibration = recording.calibration(first)
    rig = make_rig(recording, MessageOptions())
    cameras = []
    for index, camera in sorted(calibration.cameras.items()):
        frame = rig.frames.camera(image_frame_camera(calibration, index))
        info = encode_camera_info(calibration, index, camera.size or (0, 0), 0, frame)
        cameras.append(_camera_glance(f'camera_{rig.frames.cameras.get(index, index)}', info))
    mounted = with_nominal_mounts(calibration, rig.cameras)
    links = static_links(mounted, rig.base_t_imu, rig.frames)
    notes = tuple(
        reason for part, reason in calibration.missing.items() if not part.startswith('P')
    )
    nominal = tuple(f'{part} is nominal, not in the calibration' for part in mounted.nominal)
    return tuple(cameras), _link_glances(links), notes + nominal


def _bag_calibration(bag: BagSource, summary: BagSummary) -> Calibrated:
    infos = {
        topic.name for topic in summary.topics if topic.msgtype == _CAMERA_INFO and topic.count
    }
    statics = {
        topic.name: min(topic.count, _MOST_TF)
        for topic in summary.topics
        if topic.msgtype == _TF and topic.name.endswith('tf_static')
    }
    cameras: dict[str, CameraGlance] = {}
    links: dict[str, tuple[str, str, Transform]] = {}
    due = sum(statics.values())
    if not infos and not due:
        return (), (), ()
    try:
        with open_messages(bag, infos | set(statics)) as messages:
            for message in messages:
                if message.topic in statics and due:
                    due -= 1
                    decoded = decode_static(deserialize(message.data, message.msgtype))
                    links |= {child: (parent, child, place) for parent, child, place in decoded}
                elif message.topic not in cameras:
                    info = deserialize(message.data, message.msgtype)
                    cameras[message.topic] = _camera_glance(message.topic, info)
                if not due and len(cameras) == len(infos):
                    break
    except KittiRos2Error as error:
        return (), (), (f'calibration not shown: {error}',)
    except Exception as error:  # noqa: BLE001 - a recorder may have written any bytes
        return (), (), (f'calibration not shown, its messages do not decode: {error}',)
    return tuple(cameras[name] for name in sorted(cameras)), _link_glances(links.values()), ()


def _camera_glance(name: str, info: CameraInfo) -> CameraGlance:
    k, p = info.k.reshape(3, 3), info.p.reshape(3, 4)
    focal = float(p[0, 0]) or float(k[0, 0])
    values = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], -p[0, 3] / focal if focal else np.nan)
    # Drivers of uncalibrated cameras fill in zeros.
    known = bool(k[0, 0]) and bool(k[1, 1])
    fx, fy, cx, cy, baseline = (_finite(float(value)) if known else None for value in values)
    return CameraGlance(name, info.width or None, info.height or None, fx, fy, cx, cy, baseline)


def _finite(value: float) -> float | None:
    """Return the value without negative zero; None if it is not finite."""
    return value + 0.0 if np.isfinite(value) else None


def _link_glances(links: Iterable[tuple[str, str, Transform]]) -> tuple[LinkGlance, ...]:
    return tuple(
        LinkGlance(
            parent,
            child,
            _rounded(transform.translation.tolist()),
            _rounded([np.degrees(angle) for angle in rotation_to_rpy(transform.rotation)]),
        )
        for parent, child, transform in links
    )


def _rounded(values: Sequence[float]) -> tuple[float, float, float]:
    """Round to a micrometre or a millionth of a degree, without negative zeros."""
    x, y, z = (round(float(value), 6) + 0.0 for value in values)
    return x, y, z
