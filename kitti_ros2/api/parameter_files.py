# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Facts of a drive, and parameter files of a stack with these facts."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.camera_info import projection
from ..messages.naming import base_t_imu
from ..model.errors import MissingDataError
from ..model.samples import Image, Scan
from ..model.streams import IMAGE_STREAMS, Stream
from ..options.messages import MessageOptions

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from ..model.geometry import Float64Array, Transform
    from ..model.recording import ReadableRecording
    from ..model.samples import Calibration
    from ..options.stack_catalogue import Stack


WRITTEN = '# Written by kitti-ros2 stacks'
"""Beginning of the files that may be overwritten."""
_LOWEST_DEG, _HIGHEST_DEG = -24.8, 2.0  # of the lasers of an HDL-64E
_NOMINAL_HZ = 10.0
_SCANS = 8
_DIGITS = 9


@dataclass(frozen=True)
class CameraFacts:
    """A rectified camera.

    Attributes:
        fx, fy, cx, cy: Pixels.
        baseline: Metres from the camera left of it; 0 for a left camera.
        width, height: Pixels; 0 without images.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float
    width: int
    height: int


@dataclass(frozen=True)
class RigFacts:
    """The rig of a drive; a_T_b maps points of b to a. Files of stacks name its attributes.

    Attributes:
        base_T_imu: imu_link in base_link.
        imu_T_velo: velo_link in imu_link.
        cameras: The cameras by KITTI's index.
        imu_hz: Rate of the Imu.
        scan_hz: Rate of the scans.
        lowest_deg, highest_deg: Elevations of the lasers, or of points beyond.
        has_times: True if points have times; scans of odometry sequences are compensated.
    """

    base_T_imu: Transform
    imu_T_velo: Transform
    cameras: Mapping[int, CameraFacts]
    imu_hz: float
    scan_hz: float
    lowest_deg: float
    highest_deg: float
    has_times: bool

    @property
    def velo_T_imu(self) -> Transform:
        """imu_link in velo_link."""
        return self.imu_T_velo.inverse()

    @property
    def base_T_velo(self) -> Transform:
        """velo_link in base_link."""
        return self.base_T_imu @ self.imu_T_velo

    @property
    def base_T_imu_xyzw_xyz(self) -> Float64Array:
        """Quaternion and translation."""
        return np.hstack([self.base_T_imu.quaternion(), self.base_T_imu.translation])

    @property
    def base_T_velo_xyzw_xyz(self) -> Float64Array:
        """Quaternion and translation."""
        return np.hstack([self.base_T_velo.quaternion(), self.base_T_velo.translation])

    @property
    def velo_T_imu_xyz_xyzw(self) -> Float64Array:
        """Translation and quaternion."""
        return np.hstack([self.velo_T_imu.translation, self.velo_T_imu.quaternion()])

    @property
    def imu_hz_or_30(self) -> float:
        """Rate of the Imu, at least 30 Hz."""
        return max(30.0, self.imu_hz)

    @property
    def scan_hz_rounded(self) -> int:
        """Rate of the scans, a whole number."""
        return round(self.scan_hz)

    @property
    def image_jitter_ms(self) -> float:
        """One and a half times the period of images."""
        return 1500.0 / self.scan_hz

    @property
    def below_horizon_rad(self) -> float:
        """Field of view below the horizon, a degree more than that of the points."""
        return round(radians(1.0 - self.lowest_deg), 6)

    @property
    def above_horizon_rad(self) -> float:
        """Field of view above the horizon, a degree more than that of the points."""
        return round(radians(1.0 + self.highest_deg), 6)


# The facts of a drive: extrinsics, cameras, rates.


def facts_of(recording: ReadableRecording) -> tuple[RigFacts, tuple[str, ...]]:
    """Return the facts of a recording, and notes on facts missing in its files.

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
        has_times=not recording.layout.traits.compensated_scans,
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
    """Return the size of the first image of a camera, zeros without images."""
    stream = IMAGE_STREAMS[camera]
    index = recording.streams.get(stream)
    if index is None or not len(index):
        return 0, 0
    image = recording.read(stream, int(index.numbers[0]))
    return (image.width, image.height) if isinstance(image, Image) else (0, 0)


def _elevations(recording: ReadableRecording) -> tuple[float, float]:
    """Return the lowest and the highest elevation of points in some scans, degrees.

    The lasers are not in one point, so near points are outside of the lasers' angles.
    """
    lowest, highest = _LOWEST_DEG, _HIGHEST_DEG
    index = recording.streams.get(Stream.SCAN)
    numbers = [] if index is None else index.numbers[:: max(1, len(index) // _SCANS)].tolist()
    for number in numbers:
        scan = recording.read(Stream.SCAN, number)
        if isinstance(scan, Scan) and len(scan.points):
            x, y, z = (scan.points[:, axis].astype(np.float64) for axis in range(3))
            elevations = np.degrees(np.arctan2(z, np.hypot(x, y)))
            lowest, highest = min(lowest, elevations.min()), max(highest, elevations.max())
    return float(lowest), float(highest)


def _rate(recording: ReadableRecording, stream: Stream) -> float:
    """Return the rate of a stream, to a tenth of a hertz; 0 if unknown."""
    index = recording.streams.get(stream)
    if index is None or len(index) < 2:
        return 0.0
    step_ns = float(np.median(np.diff(index.stamps_ns)))
    return round(1e9 / step_ns, 1) if step_ns > 0 else 0.0


# Texts of parameter files, in the formats of stacks.


def parameter_texts(stack: Stack, facts: RigFacts, drive: Path) -> dict[str, str]:
    """Return the texts of a stack's parameter files by name.

    Args:
        stack: The stack.
        facts: The rig of the drive.
        drive: The path of the drive, for errors.

    Raises:
        MissingDataError: The calibration of a camera that the stack needs is missing.
    """
    try:
        files = {name: _with_facts(values, facts) for name, values in stack.parameter_files.items()}
    except KeyError as missing:
        raise MissingDataError(
            f'{drive}: no calibration of camera {missing}, which {stack.name} needs'
        ) from None
    head = f'{WRITTEN}: {stack.title}, {stack.version}.\n'
    texts = {}
    for name, values in files.items():
        if name.endswith('.json'):
            texts[name] = json.dumps(values, indent=2) + '\n'
        elif stack.opencv:
            texts[name] = _opencv_text(values)
        else:
            texts[name] = head + ''.join(f'{line}\n' for line in _yaml_lines(values))
    return texts


def _with_facts(value: Any, facts: RigFacts) -> Any:  # noqa: ANN401 - a value of a YAML file
    """Return a value with facts in place of their names."""
    if isinstance(value, dict):
        return {name: _with_facts(child, facts) for name, child in value.items()}
    if not (isinstance(value, str) and value.startswith('$')):
        return value
    fact: Any = facts
    for name in value[1:].split('.'):
        fact = fact[int(name)] if name.isdecimal() else getattr(fact, name)
    if isinstance(fact, np.ndarray):
        return [round(float(number), _DIGITS) + 0.0 for number in fact.ravel()]
    return fact


def _yaml_lines(values: Mapping[str, Any]) -> Iterator[str]:
    """Return a line for each value, also for a list."""
    import yaml  # noqa: PLC0415 - for one command

    for name, value in values.items():
        if isinstance(value, dict):
            yield f'{name}:'
            yield from (f'  {line}' for line in _yaml_lines(value))
        else:
            text = yaml.safe_dump(value, default_flow_style=True, width=float('inf'))
            yield f'{name}: {text.splitlines()[0]}'


def _opencv_text(values: Mapping[str, Any]) -> str:
    """Return the text of a flat OpenCV FileStorage, with texts in quotes."""
    lines = (
        f'{name}: "{value}"' if isinstance(value, str) else f'{name}: {value}'
        for name, value in values.items()
    )
    return '\n'.join(['%YAML:1.0', '---', *lines, ''])
