# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of text files: labels, packets of the GPS/IMU unit, poses, stamps, tracklets.

Values keep the files' own units and frames.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..kitti import names
from ..kitti.label_file import format_object_labels, format_tracking_labels, parse_labels
from ..kitti.oxts_file import format_packet, parse_packet
from ..kitti.poses_file import format_poses, parse_poses
from ..kitti.stamps_file import format_times, format_timestamps, parse_times, parse_timestamps
from ..kitti.store import STORE
from ..kitti.tracklet_file import Tracklet, format_tracklets, parse_tracklets
from .paths import file_at

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy.typing as npt

    from ..kitti.text_file import Lines
    from ..model.boxes import Box
    from ..model.samples import Int64Array, OxtsPacket
    from .paths import AnyPath

T = TypeVar('T')


def read_labels(path: AnyPath) -> list[Box]:
    """Read label_2/*.txt (object), label_02/*.txt (tracking) or result files with a score.

    Returns:
        A Box for each line, with the file's own values: pixels, metres in the rectified camera 0
        (x right, y down, z forward), radians. Boxes of tracking have frame and track_id.

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with file_at(path) as file:
        return _all(parse_labels(STORE.read_text(file), file))


def write_labels(path: AnyPath, boxes: Iterable[Box], decimals: int = 2) -> None:
    """Write a label file: of tracking where all boxes have frame and track_id, else of object.

    Args:
        path: The file.
        boxes: As read_labels returns them, or made by CalibratedRig.label.
        decimals: Of an object file; KITTI's own have two. Tracking files have six.

    Raises:
        KittiRos2Error: The file cannot be written.
    """
    rows = list(boxes)
    tracking = bool(rows) and all(b.frame is not None and b.track_id is not None for b in rows)
    text = format_tracking_labels(rows) if tracking else format_object_labels(rows, decimals)
    with file_at(path) as file:
        STORE.write_text(file, text)


def read_oxts(path: AnyPath) -> list[OxtsPacket]:
    """Read packets of the GPS/IMU unit: one of oxts/data/*.txt (raw), all of oxts/*.txt (tracking).

    Returns:
        A packet for each line: KITTI's 30 values by name (lat, lon in degrees, alt in metres, roll,
        pitch, yaw in radians, velocities in m/s, ...).

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with file_at(path) as file:
        lines = STORE.read_text(file).rstrip().splitlines()
        return [parse_packet(line, file, number) for number, line in enumerate(lines, 1)]


def write_oxts(path: AnyPath, packets: Iterable[OxtsPacket]) -> None:
    """Write packets, one a line; the inverse of read_oxts."""
    with file_at(path) as file:
        STORE.write_text(file, ''.join(f'{format_packet(each)}\n' for each in packets))


def read_poses(path: AnyPath) -> npt.NDArray[np.float64]:
    """Read poses/NN.txt: (N, 4, 4) float64, first_T_cam0 of the rectified camera 0, metres.

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with file_at(path) as file:
        rows = _all(parse_poses(STORE.read_text(file), file))
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = np.array(rows).reshape(-1, 3, 4)
    return poses


def write_poses(path: AnyPath, poses: npt.ArrayLike) -> None:
    """Write poses, (N, 3, 4) or (N, 4, 4); the inverse of read_poses, to seven digits."""
    with file_at(path) as file:
        STORE.write_text(file, format_poses(np.asarray(poses, np.float64)))


def read_stamps(path: AnyPath) -> Int64Array:
    """Read timestamps.txt (raw) or times.txt (odometry): (N,) int64 nanoseconds.

    Of timestamps.txt since 1970, its times taken as UTC; of times.txt from the start.

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with file_at(path) as file:
        parse = parse_times if file.name == names.TIMES else parse_timestamps
        return np.array(_all(parse(STORE.read_text(file), file)), np.int64)


def write_stamps(path: AnyPath, stamps_ns: Iterable[int]) -> None:
    """Write stamps; the inverse of read_stamps, of times.txt to seven digits."""
    with file_at(path) as file:
        form = format_times if file.name == names.TIMES else format_timestamps
        STORE.write_text(file, form(int(stamp) for stamp in stamps_ns))


def read_tracklets(path: AnyPath) -> list[Tracklet]:
    """Read tracklet_labels.xml of a raw drive: an object over consecutive frames, in velo_link.

    Raises:
        KittiRos2Error: The file is missing or invalid.
    """
    with file_at(path) as file:
        return parse_tracklets(STORE.read(file), file)


def write_tracklets(path: AnyPath, tracklets: Iterable[Tracklet]) -> None:
    """Write tracklet_labels.xml; the inverse of read_tracklets."""
    with file_at(path) as file:
        STORE.write_text(file, format_tracklets(tracklets))


def _all(lines: Lines[T]) -> list[T]:
    for error in lines.errors.values():
        raise error
    return [value for value in lines.values if value is not None]
