# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One frame of a recording: each part is read when it is used."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..drawing.objects import objects_of
from ..files.image_files import decode_image
from ..files.png.encode import encode_png
from ..model.errors import MissingDataError, UsageError
from ..model.samples import PNG, FrameLabels, Image, OxtsPacket, Pose, Scan
from ..model.streams import CAMERA_COUNT, IMAGE_STREAMS, Stream
from .calibration import CalibratedRig
from .objects import FrameObject
from .source import warn

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..drawing.pixels import Pixels
    from ..model.boxes import Box
    from ..model.geometry import Float64Array
    from ..model.recording import FrameOrigin
    from ..model.samples import Float32Array, Sample
    from .source import OpenSource


class Frame:
    """The data of one frame; every part is read from the disk when it is used first.

    Attributes:
        number: KITTI's file number; in a bag not written by to-bag the position, from 0.
        source: The open files of its recording.
    """

    def __init__(self, source: OpenSource, number: int) -> None:
        self.source = source
        self.number = number

    @cached_property
    def stamp_ns(self) -> int:
        """Nanoseconds since 1970 UTC of the scan, or of the first stream that has the frame.

        Nominal in layouts without time (object, tracking): frames at an assumed period. Object sets
        opened with real_time=True have the stamps of their raw drives.
        """
        frames = self.source.frames
        return int(frames.stamps_ns[np.searchsorted(frames.numbers, self.number)])

    @property
    def streams(self) -> tuple[str, ...]:
        """The streams that have this frame: scan, image_2, oxts, pose, labels, ..."""
        found = self.source.frames.streams.items()
        return tuple(name for name, numbers in found if self.number in numbers)

    @property
    def origin(self) -> FrameOrigin | None:
        """The raw drive's frame that it was taken from: drive, number and stamp_ns.

        Of object sets opened with real_time=True, and of their bags; else None.
        """
        return self.source.frames.origins.get(self.number)

    @cached_property
    def points(self) -> Float32Array:
        """The scan: (N, 4) float32, x y z in metres in velo_link, and reflectance 0..1.

        velo_link: x forward, y left, z up. The array is writable and owns its data, so
        torch.from_numpy and open3d.core.Tensor.from_numpy take it without a copy.

        Raises:
            MissingDataError: The frame has no scan.
            KittiRos2Error: The file is truncated.
        """
        points = self._scan.points
        return points if points.flags.writeable else points.copy()

    @property
    def extra(self) -> dict[str, npt.NDArray[np.floating[Any]]]:
        """Further columns of the scan by name, (N,) float32 or float64, such as ring.

        Of recordings opened with columns='x y z intensity ring', and of their bags; else empty.

        Raises:
            MissingDataError, KittiRos2Error: As points.
        """
        return dict(self._scan.extra)

    def points_at(self, stamp_ns: int) -> Float32Array:
        """Return the points as they would have been measured at one moment: motion compensation.

        Each point is moved by the motion of the car between its own time, which follows from its
        azimuth, and the moment. Surroundings are taken as static.

        Args:
            stamp_ns: Nanoseconds since 1970 UTC, such as `stamp_ns` of the frame, at which the
                scanner faces forward, or the stamp of an image.

        Returns:
            (N, 4) float32, x y z in velo_link at that moment and reflectance, in the order of
            `points`.

        Raises:
            MissingDataError: The frame has no scan; or there are no oxts packets or poses near, as
                in the object layout; or the source is a bag not written by to-bag.

        Examples:
            >>> points = frame.points_at(frame.stamp_ns)
        """
        scan = self.source.frames.scan_at(self.number, stamp_ns)
        if scan is None:
            raise self._no('scan', Stream.SCAN.value)
        return scan.points

    @cached_property
    def point_labels(self) -> npt.NDArray[np.uint32]:
        """SemanticKITTI's label of each point, (N,) uint32: low 16 bits class, high 16 instance.

        Raises:
            MissingDataError: The recording was not opened with semantic=True, or has no labels.
        """
        labels = self._scan.labels
        if labels is None:
            reason = next(iter(self._scan.missing.values()), 'open it with semantic=True')
            raise MissingDataError(f'{self._name}: no labels of points: {reason}')
        return labels

    def image(self, camera: int = 2) -> Pixels:
        """Decode the image of a camera.

        Args:
            camera: KITTI's number: 0 and 1 are grey, 2 (left) and 3 (right) colour.

        Returns:
            (H, W, 3) uint8, RGB; of grey cameras all three channels are equal.

        Raises:
            MissingDataError: The frame has no image of it.
            KittiRos2Error: The image is damaged.
        """
        _check_camera(camera)
        pixels = self.source.frames.pixels(camera, self.number)
        if pixels is None:
            raise self._no(f'image of camera {camera}', f'image_{camera}')
        return np.ascontiguousarray(pixels[..., ::-1])

    def png(self, camera: int = 2) -> bytes:
        """Return the PNG file of an image; the file's own bytes if the image is a PNG.

        Raises:
            MissingDataError: The frame has no image of it.
        """
        _check_camera(camera)
        image = cast('Image', self._need(IMAGE_STREAMS[camera], f'image of camera {camera}'))
        return image.data if image.format == PNG else encode_png(decode_image(image))

    @cached_property
    def calibration(self) -> CalibratedRig | None:
        """The calibration of this frame, None if the recording has none."""
        frames = self.source.frames
        found = frames.calibration(self.number)
        if found is None:
            return None
        return CalibratedRig(found, base_t_imu=frames.base_t_imu, camera_names=frames.cameras)

    @cached_property
    def pose(self) -> Float64Array | None:
        """map_T_base, (4, 4) float64: the pose of base_link in map, metres; None without one.

        map is x east, y north, z up, its origin the first base_link position of the recording;
        without gravity (odometry) it is base_link at the first pose.
        """
        found = self.source.frames.read(Stream.POSE, self.number)
        if not isinstance(found, Pose):
            return None
        map_t_base = found.world_T_imu @ self.source.frames.base_t_imu.inverse()
        return map_t_base.matrix()

    @cached_property
    def oxts(self) -> OxtsPacket | None:
        """The packet of the GPS/IMU unit, KITTI's 30 values by name; None without one."""
        found = self.source.frames.read(Stream.OXTS, self.number)
        return found if isinstance(found, OxtsPacket) else None

    @cached_property
    def objects(self) -> list[FrameObject]:
        """The labelled objects, in the order of the file; DontCare regions have a 2D box only.

        Invalid lines are left out, and named by a KittiRos2Warning.
        """
        labels = self.source.frames.read(Stream.LABELS, self.number)
        if not isinstance(labels, FrameLabels):
            return []
        for reason in labels.missing.values():
            warn(reason)
        rig = self.calibration
        found = objects_of(labels, None if rig is None else rig.model)
        lines: list[Box | None] = [box for box in labels.boxes if box is not None]
        pairs = zip(found, lines or [None] * len(found), strict=True)
        return [FrameObject(*pair, self.transform) for pair in pairs]

    def transform(self, target: str | int, source: str | int) -> Float64Array:
        """Return target_T_source, (4, 4) float64: maps points given in source to target.

        Args:
            target: map, base_link, imu_link, velo_link, or KITTI's number of a camera for its
                optical frame (x right, y down, z forward).
            source: The same.

        Raises:
            MissingDataError: A frame is unknown, or calibration or pose is missing.

        Examples:
            >>> map_T_velo = frame.transform('map', 'velo_link')
        """
        rig = self.calibration
        if rig is None:
            raise self._no('calibration', 'calibration')
        return rig.transform(target, source, map_T_base=self.pose)

    @cached_property
    def _scan(self) -> Scan:
        return cast('Scan', self._need(Stream.SCAN, 'scan'))

    def _need(self, stream: Stream, what: str) -> Sample:
        sample = self.source.frames.read(stream, self.number)
        if sample is None:
            raise self._no(what, stream.value)
        return sample

    def _no(self, what: str, stream: str) -> MissingDataError:
        numbers = self.source.frames.streams.get(stream)
        there = 'the recording has none' if numbers is None else f'{len(numbers)} other frames do'
        return MissingDataError(f'{self._name}: no {what} ({there})')

    @property
    def _name(self) -> str:
        return f'{self.source.path}: frame {self.number}'

    def __repr__(self) -> str:
        return f'<kitti_ros2.Frame {self.number} of {self.source.frames.name}>'


def _check_camera(camera: int) -> None:
    if camera not in range(CAMERA_COUNT):
        raise UsageError(f'camera {camera}; expected one of KITTI: 0 to {CAMERA_COUNT - 1}')
