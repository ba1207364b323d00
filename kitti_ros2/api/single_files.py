# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of files one by one: scans, images, labels, packets, poses, stamps."""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from ..drawing.labelled_objects import colour_pixels
from ..files.image_files import decode_image, encode_png, parse_image
from ..files.remote import as_path
from ..kitti import names
from ..kitti.kitti360_boxes import WorldBox, parse_world_boxes
from ..kitti.label_file import format_object_labels, format_tracking_labels, parse_labels
from ..kitti.scan_file import (
    HEAD_BYTES,
    find_mismatch,
    format_point_labels,
    format_scan,
    format_scan_text,
    mismatch_error,
    parse_point_labels,
    parse_points,
    parse_scan,
    parse_scan_text,
)
from ..kitti.store import STORE
from ..kitti.text_file import (
    format_packet,
    format_poses,
    format_times,
    format_timestamps,
    parse_packet,
    parse_poses,
    parse_times,
    parse_timestamps,
)
from ..kitti.tracklet_file import Tracklet, format_tracklets, parse_tracklets
from ..model.errors import BadFileError, MissingPathError, UnreadableFileError, UsageError
from ..model.streams import ScanColumns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    import numpy.typing as npt

    from ..kitti.text_file import Lines
    from ..model.boxes import Box
    from ..model.samples import Float32Array, Int64Array, OxtsPacket


# Paths of single files.
#
# An unusable file raises a KittiRos2Error with `path` and `line`, a missing one also a
# FileNotFoundError. Writers create folders, and replace existing files.

AnyPath: TypeAlias = str | os.PathLike[str]


@contextmanager
def file_at(path: AnyPath) -> Iterator[Path]:
    """Yield the path; raise errors of the operating system as KittiRos2Error."""
    try:
        yield as_path(path)
    except MissingPathError:
        raise
    except FileNotFoundError as error:
        raise MissingPathError(error.filename or str(path)) from None
    except OSError as error:
        raise UnreadableFileError(error.filename or str(path), error) from None


# Files with one array: scans, labels of points, images.

_POINT_COLUMNS = 4
_CHECKED: set[Path] = set()
"""Folders whose scans have KITTI's columns."""


def read_scan(path: AnyPath, *, columns: str | None = None) -> Float32Array:
    """Read velodyne_points/data/*.bin or velodyne/*.bin (or .txt of a raw extract).

    Args:
        path: A .bin or .txt file.
        columns: Columns of a .bin file of others, such as 'x y z intensity - ring': - skips one,
            and :f8 behind a name is float64.

    Returns:
        (N, 4) float32, writable: x y z in metres in velo_link (x forward, y left, z up), and
        reflectance 0..1. Other named columns follow: (N, 4 + K).

    Raises:
        KittiRos2Error: The file is missing, empty, or truncated inside a point; or its size or
            values show other columns.
    """
    with file_at(path) as file:
        if file.suffix == names.TXT:
            return parse_scan_text(STORE.read(file), file)
        data = STORE.read_array(file)
        if columns is not None:
            scan = parse_points(data, file, ScanColumns.parse(columns))
            return np.column_stack([scan.points, *scan.extra.values()]).astype(np.float32)
        _check_first(file, data)
        return parse_scan(data, file)


def _check_first(file: Path, data: npt.NDArray[np.uint8]) -> None:
    """Check the columns of the first scan of a folder."""
    if file.parent not in _CHECKED:
        mismatch = find_mismatch([(data[:HEAD_BYTES].tobytes(), len(data))])
        if mismatch is not None:
            raise mismatch_error(file, mismatch)
        _CHECKED.add(file.parent)


def write_scan(path: AnyPath, points: npt.ArrayLike) -> None:
    """Write a scan; the inverse of read_scan. A .txt file has three decimals, as raw extracts.

    Args:
        path: A .bin or .txt file.
        points: (N, 4), as read_scan returns.

    Raises:
        KittiRos2Error: Another shape, or the file cannot be written.
    """
    values = np.asarray(points, np.float32)
    if values.ndim != 2 or values.shape[1] != _POINT_COLUMNS:
        raise UsageError(f'points of shape {values.shape}; expected (N, 4): x y z reflectance')
    with file_at(path) as file:
        text = file.suffix == names.TXT
        STORE.write(file, format_scan_text(values) if text else format_scan(values))


def read_point_labels(path: AnyPath) -> npt.NDArray[np.uint32]:
    """Read SemanticKITTI's labels/*.label: (N,) uint32, low 16 bits class, high 16 instance.

    Raises:
        KittiRos2Error: The file is missing or truncated.
    """
    with file_at(path) as file:
        data = STORE.read(file)
        return np.array(parse_point_labels(data, (len(data) + 3) // 4, file))


def write_point_labels(path: AnyPath, labels: npt.NDArray[np.uint32]) -> None:
    """Write the labels of points; the inverse of read_point_labels."""
    with file_at(path) as file:
        STORE.write(file, format_point_labels(labels))


def read_image(path: AnyPath) -> npt.NDArray[np.uint8]:
    """Read a PNG or JPEG: (H, W, 3) uint8 RGB; a grey one has three equal channels.

    Raises:
        KittiRos2Error: The file is missing or damaged.
    """
    with file_at(path) as file:
        image = parse_image(STORE.read(file), file)
        try:
            return np.ascontiguousarray(colour_pixels(decode_image(image))[..., ::-1])
        except ValueError as error:
            raise BadFileError(file, str(error), 'a whole image') from None


def write_image(path: AnyPath, pixels: npt.NDArray[np.uint8]) -> None:
    """Write a PNG, without loss: (H, W) grey or (H, W, 3) RGB, uint8.

    Raises:
        KittiRos2Error: Another shape or dtype, or the file cannot be written.
    """
    if pixels.dtype != np.uint8 or pixels.ndim not in {2, 3} or pixels.shape[2:] not in {(), (3,)}:
        pixels_text = f'pixels of shape {pixels.shape}, {pixels.dtype}'
        raise UsageError(f'{pixels_text}; expected (H, W) or (H, W, 3) uint8')
    bgr = pixels if pixels.ndim == 2 else pixels[..., ::-1]
    with file_at(path) as file:
        STORE.write(file, encode_png(np.ascontiguousarray(bgr)))


# Text files: labels, packets of the GPS/IMU, poses, stamps, tracklets.
#
# Values have the units and coordinate frames of the files.

T = TypeVar('T')


def read_labels(path: AnyPath) -> list[Box]:
    """Read label_2/*.txt (object), label_02/*.txt (tracking) or result files with a score.

    Returns:
        A Box for each line, with the values of the file: pixels, metres in the rectified camera 0
        (x right, y down, z forward), radians. Boxes of tracking have frame and track_id.

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with file_at(path) as file:
        return _all(parse_labels(STORE.read_text(file), file))


def write_labels(path: AnyPath, boxes: Iterable[Box], decimals: int = 2) -> None:
    """Write a label file, of tracking if all boxes have frame and track_id, else of object.

    Args:
        path: The file.
        boxes: Boxes of read_labels or CalibratedRig.label.
        decimals: Decimals of an object file; KITTI's have two. Tracking files have six.

    Raises:
        KittiRos2Error: The file cannot be written.
    """
    rows = list(boxes)
    tracking = bool(rows) and all(b.frame is not None and b.track_id is not None for b in rows)
    text = format_tracking_labels(rows) if tracking else format_object_labels(rows, decimals)
    with file_at(path) as file:
        STORE.write_text(file, text)


def read_oxts(path: AnyPath) -> list[OxtsPacket]:
    """Read packets of the GPS/IMU: one of oxts/data/*.txt (raw), all of oxts/*.txt (tracking).

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
    """Write packets, one per line; the inverse of read_oxts."""
    with file_at(path) as file:
        STORE.write_text(file, ''.join(f'{format_packet(packet)}\n' for packet in packets))


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

    timestamps.txt: since 1970, its times taken as UTC; times.txt: from the start.

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


def read_world_boxes(path: AnyPath) -> list[WorldBox]:
    """Read data_3d_bboxes/train/*.xml of KITTI-360: boxes in the world of its poses.

    Objects that are no boxes, such as the ground of train_full, are left out.

    Returns:
        A WorldBox for each: metres, x east, y north, z up. Not proved on files of the data set, of
        which none was at hand.

    Raises:
        KittiRos2Error: The file is missing, or an object is invalid.
    """
    with file_at(path) as file:
        boxes, errors, _ = parse_world_boxes(STORE.read(file), file)
    for error in errors:
        raise error
    return boxes


def _all(lines: Lines[T]) -> list[T]:
    for error in lines.errors.values():
        raise error
    return [value for value in lines.values if value is not None]
