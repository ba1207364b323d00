# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The overview of a KITTI folder or a bag: series, gaps, sizes, calibration."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..bags.container_file import TopicSummary, summarize_topic
from ..bags.reader import bag_stamps, open_messages, read_earlier_losses, summarize_bag
from ..messages.camera_info import (
    decode_static,
    encode_camera_info,
    image_frame_camera,
    static_links,
    with_nominal_mounts,
)
from ..messages.cdr import deserialize
from ..messages.naming import make_rig
from ..model.bag_formats import CAMERA_INFO, TF
from ..model.errors import KittiRos2Error, format_count, format_numbers
from ..model.geometry import rotation_to_rpy
from ..model.streams import Clock
from ..options.messages import MessageOptions
from ..own_bags.numbering import absent_frames, number_bag
from ..own_bags.schedule import frames_of
from ..own_bags.source_files import read_source_files

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from ..bags.bag_files import OpenBag
    from ..bags.container_file import BagSummary
    from ..kitti.kitti_recording import KittiRecording
    from ..messages.ros_types import CameraInfo
    from ..model.errors import Loss
    from ..model.geometry import Transform
    from ..model.recording import FrameOrigin
    from ..own_bags.numbering import NumberedBag
    from ..own_bags.source_files import SourceFiles


# The cameras and static transforms of a recording or a bag.

_MOST_TF = 200
_FISHEYES = ('mei', 'equidistant', 'fisheye')


@dataclass(frozen=True)
class CameraSummary:
    """A camera's numbers: name, image size, focal lengths and centre in pixels, baseline in m.

    Unknown values are None: the size if only images have it, the rest of an uncalibrated camera.
    The focal lengths of a fisheye, whose model is named, give no field of view.
    """

    name: str
    width: int | None
    height: int | None
    fx: float | None
    fy: float | None
    cx: float | None
    cy: float | None
    baseline_m: float | None
    fisheye: str | None = None

    def cells(self) -> tuple[str, ...]:
        """Format name, fx, fy, cx, cy and baseline for a table; unknown values are empty."""
        pixels = (self.fx, self.fy, self.cx, self.cy)
        name = self.name.removesuffix('/camera_info')
        return (
            f'{name} ({self.fisheye})' if self.fisheye else name,
            *('' if value is None else f'{value:.2f}' for value in pixels),
            f'{self.baseline_m:.4f}' if abs(self.baseline_m or 0) > 1e-6 else '',
        )


@dataclass(frozen=True)
class LinkSummary:
    """A static transform: child in parent, xyz in metres, roll pitch yaw in degrees."""

    parent: str
    child: str
    xyz_m: tuple[float, float, float]
    rpy_deg: tuple[float, float, float]


CalibrationSummary = tuple[tuple[CameraSummary, ...], tuple[LinkSummary, ...], tuple[str, ...]]


def calibration_of(recording: KittiRecording) -> CalibrationSummary:
    """Return the cameras and static transforms of a recording, and notes on missing parts."""
    first = min(int(index.numbers[0]) for index in recording.streams.values())
    calibration = recording.calibration(first)
    rig = make_rig(recording, MessageOptions())
    cameras = []
    for index, camera in sorted(calibration.cameras.items()):
        frame = rig.frames.camera(image_frame_camera(calibration, index))
        info = encode_camera_info(calibration, index, camera.size or (0, 0), 0, frame)
        cameras.append(_camera_summary(f'camera_{rig.frames.cameras.get(index, index)}', info))
    mounted = with_nominal_mounts(calibration, rig.cameras)
    links = static_links(mounted, rig.base_t_imu, rig.frames)
    of_streams = {f'P{stream.camera}' for stream in recording.streams if stream.camera is not None}
    notes = tuple(dict.fromkeys(
        reason
        for part, reason in calibration.missing.items()
        if part in of_streams or not re.fullmatch(r'P\d+', part)
    ))  # fmt: skip
    nominal = tuple(f'{part} is nominal, not in the calibration' for part in mounted.nominal)
    return tuple(cameras), _link_summaries(links), notes + calibration.notes + nominal


def bag_calibration(bag: OpenBag, summary: BagSummary) -> CalibrationSummary:
    """Return the cameras and static transforms in the first messages of a bag."""
    infos = {topic.name for topic in summary.topics if topic.msgtype == CAMERA_INFO and topic.count}
    statics = {
        topic.name: min(topic.count, _MOST_TF)
        for topic in summary.topics
        if topic.msgtype == TF and topic.name.endswith('tf_static')
    }
    cameras: dict[str, CameraSummary] = {}
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
                    links |= {child: (parent, child, pose) for parent, child, pose in decoded}
                elif message.topic not in cameras:
                    info = deserialize(message.data, message.msgtype)
                    cameras[message.topic] = _camera_summary(message.topic, info)
                if not due and len(cameras) == len(infos):
                    break
    except KittiRos2Error as error:
        return (), (), (f'calibration not shown: {error}',)
    except Exception as error:  # noqa: BLE001 - a recorder may have written any bytes
        return (), (), (f'calibration not shown, its messages do not decode: {error}',)
    return tuple(cameras[name] for name in sorted(cameras)), _link_summaries(links.values()), ()


def _camera_summary(name: str, info: CameraInfo) -> CameraSummary:
    k, p = info.k.reshape(3, 3), info.p.reshape(3, 4)
    focal = float(p[0, 0]) or float(k[0, 0])
    values = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], -p[0, 3] / focal if focal else np.nan)
    # Drivers of uncalibrated cameras fill in zeros.
    calibrated = bool(k[0, 0]) and bool(k[1, 1])
    fx, fy, cx, cy, baseline = (_finite(float(value)) if calibrated else None for value in values)
    size = (info.width or None, info.height or None)
    fisheye = info.distortion_model if info.distortion_model in _FISHEYES else None
    return CameraSummary(name, *size, fx, fy, cx, cy, baseline, fisheye)


def _finite(value: float) -> float | None:
    """Return the value without negative zero; None if it is not finite."""
    return value + 0.0 if np.isfinite(value) else None


def _link_summaries(links: Iterable[tuple[str, str, Transform]]) -> tuple[LinkSummary, ...]:
    return tuple(
        LinkSummary(
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


MOST_SERIES = 200
"""Maximum number of streams or topics shown; a bag may have tens of thousands."""

_SAMPLES = {'stream': 'sample', 'topic': 'message'}


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
        notes: One line each.
        complete: False for a truncated or damaged bag.
        origins: By number the raw drive's frame of an object set in real time.
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
    cameras: tuple[CameraSummary, ...]
    links: tuple[LinkSummary, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]
    complete: bool = True
    origins: Mapping[int, FrameOrigin] = field(default_factory=dict)


def describe_rest(counts: Sequence[int], kind: str) -> str:
    """Describe the rest of a list, such as ... and 3 more topics with 6 messages.

    Args:
        counts: Samples of each.
        kind: stream or topic.
    """
    more = format_count(len(counts), f'more {kind}')
    return f'... and {more} with {format_count(sum(counts), _SAMPLES[kind])}'


def inspect_recording(recording: KittiRecording, path: Path) -> Overview:
    """Inspect a KITTI recording; its data files are listed and not read."""
    series = tuple(
        summarize_topic(stream.value, format_numbers(index.numbers.tolist(), 2), index.stamps_ns)
        for stream, index in recording.streams.items()
    )
    cameras, links, notes = calibration_of(recording)
    numbers = {stream: index.numbers for stream, index in recording.streams.items()}
    start_ns, end_ns, duration_ns = _times(series, recording.clock)
    return Overview(
        path=path,
        kind=recording.layout.value,
        name=recording.name,
        series=tuple(_limit_times(topic, recording.clock) for topic in series),
        frames=len(frames_of(numbers, common=recording.common_numbers)),
        clock=recording.clock,
        start_ns=start_ns,
        end_ns=end_ns,
        duration_ns=duration_ns,
        size_bytes=_size_bytes(recording),
        compression=None,
        cameras=cameras,
        links=links,
        losses=(*recording.losses, *recording.late_losses),
        notes=tuple(recording.notes) + notes,
        origins=recording.origins,
    )


def inspect_bag(bag: OpenBag) -> tuple[Overview, SourceFiles | None]:
    """Inspect a bag: its index, description, and the first camera_info and static transforms.

    Returns:
        The overview, and the layout of the recording if to-bag wrote the bag.

    Raises:
        BadBagError: The bag is unreadable.
    """
    summary = summarize_bag(bag)
    counts = {topic.name: topic.count for topic in summary.topics}
    source_files, losses = read_source_files(bag, counts)
    numbered = None
    if source_files is not None:
        losses += absent_frames(source_files)
        numbered = number_bag(bag, bag_stamps(bag), source_files=source_files, by_header=False)
    cameras, links, notes = bag_calibration(bag, summary)
    clock = Clock.UTC if numbered is None else numbered.clock
    start_ns, end_ns, duration_ns = _times(summary.topics, clock)
    damaged = 'parts of the bag are missing or damaged; whole messages are counted'
    cut = () if summary.complete else (damaged,)
    deskew = None if source_files is None else source_files.deskew
    deskewed = () if deskew is None else (f'scans are {deskew.state}',)
    overview = Overview(
        path=bag.path,
        kind=summary.container,
        name=', '.join(file.name for file in summary.files[:3])
        + (' ...' if len(summary.files) > 3 else ''),
        series=tuple(_limit_times(topic, clock) for topic in summary.topics),
        frames=None if numbered is None else len(numbered.frames),
        clock=clock,
        start_ns=start_ns,
        end_ns=end_ns,
        duration_ns=duration_ns,
        size_bytes=summary.size_bytes,
        compression=summary.compression,
        cameras=cameras,
        links=links,
        losses=losses,
        notes=(*cut, *deskewed, *summary.problems, *read_earlier_losses(bag), *notes),
        complete=summary.complete,
        origins={} if numbered is None else _origins(numbered),
    )
    return overview, source_files


def _origins(bag: NumberedBag) -> Mapping[int, FrameOrigin]:
    """Return the raw drives' frames of the frames in a bag."""
    times = bag.source_files.times
    origins = {} if times is None else times.origins
    return {n: origins[n] for n in bag.frames.tolist() if n in origins}


def _times(
    series: Iterable[TopicSummary], clock: Clock
) -> tuple[int | None, int | None, int | None]:
    """Return start, end and duration of all series, None for those unknown to the layout."""
    starts = [summary.start_ns for summary in series if summary.start_ns is not None]
    ends = [summary.end_ns for summary in series if summary.end_ns is not None]
    if not starts or clock is Clock.NOMINAL:
        return None, None, None
    start_ns, end_ns = min(starts), max(ends)
    if clock is Clock.RELATIVE:
        return None, None, end_ns - start_ns
    return start_ns, end_ns, end_ns - start_ns


def _limit_times(series: TopicSummary, clock: Clock) -> TopicSummary:
    """Remove the dates or times of a series that its clock does not provide."""
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
