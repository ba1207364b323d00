# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The facts of a drive for parameter files: extrinsics, cameras, rates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..messages.camera_info import projection
from ..messages.naming import base_t_imu
from ..model.errors import MissingDataError
from ..model.samples import Image, Scan
from ..model.streams import IMAGE_STREAMS, Stream
from ..options.messages import MessageOptions
from ..stacks.rig_facts import CameraFacts, RigFacts

if TYPE_CHECKING:
    from ..model.recording import ReadableRecording
    from ..model.samples import Calibration

_NOMINAL_HZ = 10.0
_SCANS = 8


def facts_of(recording: ReadableRecording) -> tuple[RigFacts, tuple[str, ...]]:
    """Return the facts of a recording, and notes on those that are not in its files.

    Raises:
        KittiRos2Error, OSError: The calibration or an image cannot be read.
    """
    if not recording.streams:
        raise MissingDataError(f'{recording.root}: no data, so no calibration to write')
    first = min(int(index.numbers[0]) for index in recording.streams.values())
    calibration = recording.calibration(first)
    lowest, highest = _elevations(recording)
    fast = Stream.OXTS_EXTRACT
    packets = fast if fast in recording.streams else Stream.OXTS
    facts = RigFacts(
        base_T_imu=base_t_imu(MessageOptions()),
        imu_T_velo=calibration.velo_T_imu.inverse(),
        cameras={
            index: _camera(recording, calibration, index) for index in sorted(calibration.cameras)
        },
        imu_hz=_rate(recording, packets) or _NOMINAL_HZ,
        scan_hz=_rate(recording, Stream.SCAN) or _NOMINAL_HZ,
        lowest_deg=lowest,
        highest_deg=highest,
        deskew=not recording.layout.traits.compensated_scans,
    )
    nominal = (f'{part} is nominal, not in the calibration' for part in calibration.nominal)
    return facts, (*nominal, *calibration.notes, *calibration.missing.values())


def _camera(recording: ReadableRecording, calibration: Calibration, index: int) -> CameraFacts:
    camera = projection(calibration, index)
    width, height = calibration.cameras[index].size or _size(recording, index)
    return CameraFacts(
        fx=float(camera[0, 0]),
        fy=float(camera[1, 1]),
        cx=float(camera[0, 2]),
        cy=float(camera[1, 2]),
        baseline=float(-camera[0, 3] / camera[0, 0]) if index % 2 else 0.0,
        width=width,
        height=height,
    )


def _size(recording: ReadableRecording, camera: int) -> tuple[int, int]:
    """Return the size of the first image of a camera, zeros if there is none."""
    stream = IMAGE_STREAMS[camera]
    index = recording.streams.get(stream)
    if index is None or not len(index):
        return 0, 0
    image = recording.read(stream, int(index.numbers[0]))
    return (image.width, image.height) if isinstance(image, Image) else (0, 0)


def _elevations(recording: ReadableRecording) -> tuple[float, float]:
    """Return the lowest and the highest elevation of points in some scans, degrees.

    The lasers are not in one point, so that near points are outside the angles of the lasers.
    """
    lowest, highest = RigFacts.lowest_deg, RigFacts.highest_deg
    index = recording.streams.get(Stream.SCAN)
    numbers = [] if index is None else index.numbers[:: max(1, len(index) // _SCANS)].tolist()
    for number in numbers:
        scan = recording.read(Stream.SCAN, number)
        if isinstance(scan, Scan) and len(scan.points):
            x, y, z = (scan.points[:, axis].astype(np.float64) for axis in range(3))
            found = np.degrees(np.arctan2(z, np.hypot(x, y)))
            lowest, highest = min(lowest, found.min()), max(highest, found.max())
    return float(lowest), float(highest)


def _rate(recording: ReadableRecording, stream: Stream) -> float:
    """Return the rate of a stream, to a tenth of a hertz; 0 if it is not known."""
    index = recording.streams.get(stream)
    if index is None or len(index) < 2:
        return 0.0
    step_ns = float(np.median(np.diff(index.stamps_ns)))
    return round(1e9 / step_ns, 1) if step_ns > 0 else 0.0
