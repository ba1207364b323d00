# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of KITTI's files one by one, in their own units and frames.

Every function takes a path. A file that cannot be used raises a KittiRos2Error whose `path` and
`line` say where; one that is missing is a FileNotFoundError as well. Writers create folders, and
replace a file that exists.
"""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..drawing.pixels import colour_pixels
from ..files.png.decode import decode_png
from ..files.png.encode import encode_png
from ..files.png.header import parse_image
from ..kitti import names
from ..kitti.calib_file import (
    format_object,
    format_odometry,
    format_raw,
    format_tracking,
    parse_calibration,
    parse_raw_calibration,
)
from ..kitti.label_file import format_object_labels, format_tracking_labels, parse_labels
from ..kitti.oxts_file import format_packet, parse_packet
from ..kitti.poses_file import format_poses, parse_poses
from ..kitti.scan_file import format_scan, format_scan_text, parse_scan, parse_scan_text
from ..kitti.semantic_file import format_point_labels, parse_point_labels
from ..kitti.stamps_file import format_times, format_timestamps, parse_times, parse_timestamps
from ..kitti.store import STORE
from ..kitti.tracklet_file import Tracklet, format_tracklets, parse_tracklets
from ..model.errors import BadFileError, MissingPathError, UnreadableFileError, UsageError
from ..model.layouts import Layout
from .calibration import CalibratedRig

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator

    import numpy.typing as npt

    from ..kitti.text_file import Lines
    from ..model.boxes import Box
    from ..model.samples import Float32Array, Int64Array, OxtsPacket

    AnyPath = str | os.PathLike[str]

T = TypeVar('T')

_POINT_COLUMNS = 4
_RAW_CALIBRATION = (names.CALIB_CAM_TO_CAM, names.CALIB_VELO_TO_CAM, names.CALIB_IMU_TO_VELO)


def read_scan(path: AnyPath) -> Float32Array:
    """Read velodyne_points/data/*.bin or velodyne/*.bin (or .txt of a raw extract).

    Returns:
        (N, 4) float32, writable: x y z in metres in velo_link (x forward, y left, z up), and
        reflectance 0..1.

    Raises:
        KittiRos2Error: The file is missing, empty, or truncated inside a point.
    """
    with _reading(path) as file:
        if file.suffix == names.TXT:
            return parse_scan_text(STORE.read(file), file)
        return parse_scan(STORE.read_array(file), file)


def write_scan(path: AnyPath, points: npt.ArrayLike) -> None:
    """Write a scan; the inverse of read_scan. A .txt file has three decimals, as raw extracts.

    Args:
        path: Ends in .bin or .txt.
        points: (N, 4), as of read_scan.

    Raises:
        KittiRos2Error: Another shape, or the file cannot be written.
    """
    values = np.asarray(points, np.float32)
    if values.ndim != 2 or values.shape[1] != _POINT_COLUMNS:
        raise UsageError(f'points of shape {values.shape}; expected (N, 4): x y z reflectance')
    with _writing(path) as file:
        text = file.suffix == names.TXT
        STORE.write(file, format_scan_text(values) if text else format_scan(values))


def read_point_labels(path: AnyPath) -> npt.NDArray[np.uint32]:
    """Read SemanticKITTI's labels/*.label: (N,) uint32, low 16 bits class, high 16 instance.

    Raises:
        KittiRos2Error: The file is missing or truncated.
    """
    with _reading(path) as file:
        data = STORE.read(file)
        return np.array(parse_point_labels(data, (len(data) + 3) // 4, file))


def write_point_labels(path: AnyPath, labels: npt.NDArray[np.uint32]) -> None:
    """Write the labels of points; the inverse of read_point_labels."""
    with _writing(path) as file:
        STORE.write(file, format_point_labels(labels))


def read_image(path: AnyPath) -> npt.NDArray[np.uint8]:
    """Read a PNG: (H, W, 3) uint8 RGB; of a grey one all three channels are equal.

    Raises:
        KittiRos2Error: The file is missing or damaged.
    """
    with _reading(path) as file:
        image = parse_image(STORE.read(file), file)
        try:
            return np.ascontiguousarray(colour_pixels(decode_png(image))[..., ::-1])
        except ValueError as error:
            raise BadFileError(file, str(error), 'a whole PNG') from None


def write_image(path: AnyPath, pixels: npt.NDArray[np.uint8]) -> None:
    """Write a PNG, without loss: (H, W) grey or (H, W, 3) RGB, uint8.

    Raises:
        KittiRos2Error: Another shape or dtype, or the file cannot be written.
    """
    if pixels.dtype != np.uint8 or pixels.ndim not in {2, 3} or pixels.shape[2:] not in {(), (3,)}:
        found = f'pixels of shape {pixels.shape}, {pixels.dtype}'
        raise UsageError(f'{found}; expected (H, W) or (H, W, 3) uint8')
    bgr = pixels if pixels.ndim == 2 else pixels[..., ::-1]
    with _writing(path) as file:
        STORE.write(file, encode_png(np.ascontiguousarray(bgr)))


def read_labels(path: AnyPath) -> list[Box]:
    """Read label_2/*.txt (object), label_02/*.txt (tracking) or result files with a score.

    Returns:
        A Box for each line, with the file's own values: pixels, metres in the rectified camera 0
        (x right, y down, z forward), radians. Boxes of tracking have frame and track_id.

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with _reading(path) as file:
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
    with _writing(path) as file:
        STORE.write_text(file, text)


def read_calibration(path: AnyPath) -> CalibratedRig:
    """Read a calibration in any of KITTI's forms.

    Args:
        path: calib/*.txt (object, tracking), calib.txt (odometry), or the date's folder of a raw
            drive with its three files.

    Raises:
        KittiRos2Error: A file is missing or invalid.
    """
    with _reading(path) as file:
        if file.is_dir():
            texts = {
                name: STORE.read_text(file / name)
                for name in _RAW_CALIBRATION
                if (file / name).is_file()
            }
            found = parse_raw_calibration(texts, file, rectified=True)
        else:
            found = parse_calibration(STORE.read_text(file), file, file.name)
        for reason in found.missing.values():
            raise BadFileError(file, reason, 'a whole calibration')
        return CalibratedRig(found)


def write_calibration(
    path: AnyPath, calibration: CalibratedRig, layout: str | Layout = Layout.OBJECT
) -> None:
    """Write a calibration in the form of a layout; the inverse of read_calibration.

    Args:
        path: The file; for raw the folder of the date, where three files are written.
        calibration: Has at least one camera, and the place of the scanner. Loaders read four
            cameras, so an absent one gets the projection of the first.
        layout: object, tracking, odometry or raw.

    Raises:
        KittiRos2Error: A part of the calibration is missing, or the file cannot be written.
    """
    try:
        files = _CALIBRATION_FORMATS[Layout(layout)](calibration.model)
    except ValueError as error:
        raise UsageError(f'{path}: {error}') from None
    with _writing(path) as file:
        for name, text in files.items():
            STORE.write_text(file / name if name else file, text)


def read_oxts(path: AnyPath) -> list[OxtsPacket]:
    """Read packets of the GPS/IMU unit: one of oxts/data/*.txt (raw), all of oxts/*.txt (tracking).

    Returns:
        A packet for each line: KITTI's 30 values by name (lat, lon in degrees, alt in metres, roll,
        pitch, yaw in radians, velocities in m/s, ...).

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with _reading(path) as file:
        lines = STORE.read_text(file).rstrip().splitlines()
        return [parse_packet(line, file, number) for number, line in enumerate(lines, 1)]


def write_oxts(path: AnyPath, packets: Iterable[OxtsPacket]) -> None:
    """Write packets, one a line; the inverse of read_oxts."""
    with _writing(path) as file:
        STORE.write_text(file, ''.join(f'{format_packet(each)}\n' for each in packets))


def read_poses(path: AnyPath) -> npt.NDArray[np.float64]:
    """Read poses/NN.txt: (N, 4, 4) float64, first_T_cam0 of the rectified camera 0, metres.

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with _reading(path) as file:
        rows = _all(parse_poses(STORE.read_text(file), file))
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = np.array(rows).reshape(-1, 3, 4)
    return poses


def write_poses(path: AnyPath, poses: npt.ArrayLike) -> None:
    """Write poses, (N, 3, 4) or (N, 4, 4); the inverse of read_poses, to seven digits."""
    with _writing(path) as file:
        STORE.write_text(file, format_poses(np.asarray(poses, np.float64)))


def read_stamps(path: AnyPath) -> Int64Array:
    """Read timestamps.txt (raw) or times.txt (odometry): (N,) int64 nanoseconds.

    Of timestamps.txt since 1970, its times taken as UTC; of times.txt from the start.

    Raises:
        KittiRos2Error: The file is missing, or a line is invalid.
    """
    with _reading(path) as file:
        parse = parse_times if file.name == names.TIMES else parse_timestamps
        return np.array(_all(parse(STORE.read_text(file), file)), np.int64)


def write_stamps(path: AnyPath, stamps_ns: Iterable[int]) -> None:
    """Write stamps; the inverse of read_stamps, of times.txt to seven digits."""
    with _writing(path) as file:
        form = format_times if file.name == names.TIMES else format_timestamps
        STORE.write_text(file, form(int(stamp) for stamp in stamps_ns))


def read_tracklets(path: AnyPath) -> list[Tracklet]:
    """Read tracklet_labels.xml of a raw drive: an object over consecutive frames, in velo_link.

    Raises:
        KittiRos2Error: The file is missing or invalid.
    """
    with _reading(path) as file:
        return parse_tracklets(STORE.read(file), file)


def write_tracklets(path: AnyPath, tracklets: Iterable[Tracklet]) -> None:
    """Write tracklet_labels.xml; the inverse of read_tracklets."""
    with _writing(path) as file:
        STORE.write_text(file, format_tracklets(tracklets))


@contextmanager
def _reading(path: AnyPath) -> Iterator[Path]:
    """Yield the path; errors of the operating system are raised as KittiRos2Error."""
    try:
        yield Path(path)
    except MissingPathError:
        raise
    except FileNotFoundError as error:
        raise MissingPathError(error.filename or str(path)) from None
    except OSError as error:
        raise UnreadableFileError(error.filename or str(path), error) from None


_writing = _reading


def _all(lines: Lines[T]) -> list[T]:
    for error in lines.errors.values():
        raise error
    return [value for value in lines.values if value is not None]


_CALIBRATION_FORMATS = {
    Layout.OBJECT: lambda model: {'': format_object(model)},
    Layout.TRACKING: lambda model: {'': format_tracking(model)},
    Layout.ODOMETRY: lambda model: {'': format_odometry(model)},
    Layout.RAW: format_raw,
}
