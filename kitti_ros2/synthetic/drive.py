# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic recording: in memory, every sample on demand, and written in any layout."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..files.threads import Threads
from ..kitti.find import make_writer
from ..kitti.scan_grid import compensated, on_grid
from ..model.errors import OutputExistsError, UsageError
from ..model.samples import Scan, rect_from_velo
from ..model.streams import NS_PER_S, Layout, PngForm, Stream
from .fisheye import FisheyeCamera
from .render import Cameras, encode_image
from .scene import (
    CAR_T_VELO,
    Motion,
    PlacedSolid,
    SyntheticOptions,
    build_street,
    make_calibration,
    make_fisheyes,
    motion_at,
    packet_of,
    place_solids,
)
from .sensors import (
    Arrivals,
    box_solids,
    cast_scan,
    ground_reflectance,
    kitti_twist,
    label_solids,
    list_arrivals,
    measure,
    scan_points,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..kitti.writers import LayoutWriter
    from ..model.boxes import Box
    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Calibration, Image, Int64Array, OxtsPacket
    from .render import Canvas
    from .textures import Picture


# The synthetic recording in memory: every sample of every frame, on demand.
#
# A frame is one instant: the scan is a snapshot, and the four images show it. The stamps of its
# samples differ by constant offsets, as KITTI's do: the images' come 10 ms after the sweep's
# middle. Options make scans that take the time of a turn, and packets of their own time
# (SyntheticOptions).

START_NS = 1_317_042_000_123_456_789
PERIOD_NS = 100_000_000
LABEL_CAMERA = 2
_JITTER_NS = 300_000
_HALF_SWEEP_NS = 49_731_519
_CAMERA_OFFSETS_NS = (10_412_837, 10_427_341, 10_003_129, 10_018_773)
_OXTS_OFFSET_NS = 4_871_233
_REFLECTANCE_SPREAD = 0.03
_REFLECTANCE_STEPS = 256  # of scans off the grid
_LEAST_MOVED_M = 0.2
_DIGITS = 10  # of KITTI-360's mounts


class FrameStamps(NamedTuple):
    """The stamps of one frame's samples, nanoseconds since 1970-01-01 UTC.

    Attributes:
        scan: Middle of the sweep, and the instant that the whole frame shows.
        scan_start, scan_end: Of the sweep.
        images: By camera.
        oxts: Of the packet.
    """

    scan: int
    scan_start: int
    scan_end: int
    images: tuple[int, ...]
    oxts: int


class SyntheticDrive:
    """A drive of options.frames frames, numbered from 0.

    Samples can be requested in any order, from any thread: each is a function of the options and
    the frame, computed by each call.

    Attributes:
        options: Its options.
        calibration: The rig.

    Args:
        options: See there.
        layout: The layout whose rig, scans and labels it has; those of KITTI's are the same.
    """

    def __init__(
        self, options: SyntheticOptions | None = None, layout: Layout = Layout.RAW
    ) -> None:
        self.options = options or SyntheticOptions()
        self._traits = layout.traits
        size = self.options.image_size
        self.calibration: Calibration = make_calibration(size)
        if self._traits.raw_cameras:
            rig = make_calibration(size, _DIGITS)
            self.calibration = replace(rig, cameras={**rig.cameras, **make_fisheyes(size)})
        self._rect_T_velo = rect_from_velo(self.calibration)
        self._car_T_imu = CAR_T_VELO @ self.calibration.velo_T_imu
        self._course = self.options.course
        duration = self.options.frames * PERIOD_NS / NS_PER_S
        self._solids = build_street(self.options.seed, duration, self._course.speed)
        rng = np.random.default_rng([self.options.seed, 7])
        self._jitter_ns = rng.integers(-_JITTER_NS, _JITTER_NS, self.options.frames)
        self._jitter_ns[0] = 0
        focal = float(self.calibration.cameras[0].p_rect[0, 0])
        self._last_placed: tuple[int, list[PlacedSolid]] = (-1, [])
        self._last_cast: tuple[int, Float64Array, Int64Array] | None = None
        self._cameras = Cameras(self.options.image_size, focal, self.options.seed, self._course)

    def __len__(self) -> int:
        return self.options.frames

    def stamps(self, frame: int) -> FrameStamps:
        """Return the stamps of the samples of a frame."""
        middle = START_NS + frame * PERIOD_NS + int(self._jitter_ns[frame])
        return FrameStamps(
            scan=middle,
            scan_start=middle - _HALF_SWEEP_NS,
            scan_end=middle + _HALF_SWEEP_NS,
            images=tuple(middle + offset for offset in _CAMERA_OFFSETS_NS),
            oxts=middle + _OXTS_OFFSET_NS,
        )

    def packet_stamp(self, frame: int) -> int:
        """Return the stamp of the packet of a frame."""
        stamp = self.stamps(frame).oxts
        return int(self.arrivals.stamps_ns[self._arrival(stamp)]) if self.options.extract else stamp

    def motion(self, frame: int) -> Motion:
        """Return the ground truth: pose and motion of the GPS/IMU unit."""
        return self.motion_at(self.stamps(frame).scan)

    def motion_at(self, time_ns: int) -> Motion:
        """Return the same at any moment, in the time of the stamps."""
        return motion_at((time_ns - START_NS) / NS_PER_S, self._car_T_imu, self._course)

    def packet(self, frame: int) -> OxtsPacket:
        """Return the packet of the GPS/IMU unit."""
        if self.options.extract:
            return self.arrived(self._arrival(self.stamps(frame).oxts))
        return packet_of(self.motion(frame))

    @cached_property
    def arrivals(self) -> Arrivals:
        """The 100 Hz packets of the unsynchronised drive, numbered from 0."""
        last = self.stamps(len(self) - 1).scan
        return list_arrivals(self.options.seed, self.stamps(0).scan, last)

    def arrived(self, number: int) -> OxtsPacket:
        """Return a packet of the unsynchronised drive."""
        return packet_of(self.motion_at(int(self.arrivals.times_ns[number])))

    def _arrival(self, stamp_ns: int) -> int:
        """Return the number of the packet nearest to a stamp."""
        return int(np.argmin(np.abs(self.arrivals.stamps_ns - stamp_ns)))

    def pose(self, frame: int) -> Transform:
        """Return first_T_cam0: the rectified camera 0 in its own first frame."""
        cam0_t_imu = self._rect_T_velo @ CAR_T_VELO.inverse() @ self._car_T_imu
        first, now = self.motion(0).map_T_imu, self.motion(frame).map_T_imu
        return cam0_t_imu @ first.inverse() @ now @ cam0_t_imu.inverse()

    @cached_property
    def posed(self) -> frozenset[int]:
        """The frames with a pose: in KITTI-360 not the first, and none without movement before."""
        if Stream.POSE not in self._traits.numbered_lines:
            return frozenset(range(len(self)))
        listed: list[int] = []
        for frame in range(1, len(self)):
            moved = self.pose(listed[-1]).inverse() @ self.pose(frame) if listed else None
            if moved is None or np.linalg.norm(moved.translation) >= _LEAST_MOVED_M:
                listed.append(frame)
        return frozenset(listed)

    def placed(self, frame: int) -> list[PlacedSolid]:
        """Return the boxes around the scanner, in velo_link, nearest first."""
        last_frame, placed = self._last_placed
        if last_frame != frame:
            time = (self.stamps(frame).scan - START_NS) / NS_PER_S
            placed = place_solids(self._solids, time, self.motion(frame).street_T_car, self._course)
            self._last_placed = (frame, placed)
        return placed

    def scan(self, frame: int, *, is_compensated: bool = False) -> Scan:
        """Return the sweep of a frame, on KITTI's grid as it was measured.

        Args:
            frame: The frame.
            is_compensated: Whether it is measured in a turn and compensated as those of odometry.
        """
        placed = self.placed(frame)
        ranges, hits = self._cast(frame)
        rng = np.random.default_rng([self.options.seed, 8, frame])
        street_t_velo = self.motion(frame).street_T_car @ CAR_T_VELO
        albedos = np.array([*(one.solid.look.reflectance for one in placed), 0.0])
        reflectance = np.where(
            hits < 0, ground_reflectance(ranges, street_t_velo, self._course), albedos[hits]
        ) + rng.normal(0.0, _REFLECTANCE_SPREAD, ranges.shape)
        noise = None
        if self.options.range_noise_m > 0:
            noise = rng.normal(0.0, self.options.range_noise_m, ranges.shape)
        stamps = self.stamps(frame)
        points = scan_points(ranges, reflectance, noise)
        forward_s = (stamps.scan - START_NS) / NS_PER_S
        if self.options.swept or is_compensated:
            points = measure(points, self._course, forward_s, _HALF_SWEEP_NS / NS_PER_S)
        if not self._traits.scans_on_grid:
            points[:, 3] = np.rint(points[:, 3] * _REFLECTANCE_STEPS) / _REFLECTANCE_STEPS
            return Scan(points)
        xyz = points[:, :3] = on_grid(points[:, :3])
        if is_compensated:
            twist = kitti_twist(self._course, forward_s)
            points[:, :3] = compensated(xyz.astype(np.float64), twist)
        return Scan(points, start_ns=stamps.scan_start, end_ns=stamps.scan_end)

    def _cast(self, frame: int) -> tuple[Float64Array, Int64Array]:
        """Return the ranges of the rays, and the indices in placed(frame) of what they hit."""
        last = self._last_cast
        if last is None or last[0] != frame:
            last = frame, *cast_scan(self.placed(frame), self.options.lidar_columns)
            self._last_cast = last
        return last[1:]

    def picture(self, frame: int, camera: int) -> Picture:
        """Return the pixels of an image: (height, width) of grey cameras, else (..., 3) BGR."""
        street_t_velo = self.motion(frame).street_T_car @ CAR_T_VELO
        placed = self.placed(frame)
        if camera in self._fisheyes:
            fisheye, texture = self._fisheyes[camera], self._cameras.texture
            return fisheye.photograph(camera, frame, placed, street_t_velo, texture)
        projection, grey = self.projection(camera), self._traits.is_grey(camera)
        return self._cameras.photograph(camera, frame, placed, projection, street_t_velo, grey=grey)

    @cached_property
    def _fisheyes(self) -> dict[int, FisheyeCamera]:
        cameras, seed = self.calibration.cameras, self.options.seed
        return {
            camera: FisheyeCamera(cameras[camera], seed, self._course)
            for camera in self._traits.raw_cameras
        }

    def image(self, frame: int, camera: int, form: PngForm = PngForm.KITTI) -> Image:
        """Return an image as a PNG file."""
        return encode_image(self.picture(frame, camera), form)

    def instances(self, frame: int, camera: int) -> Canvas:
        """Return the index in placed(frame), plus one, of each pixel of an image, and its depth.

        The depth of a fisheye is the distance from it.
        """
        if camera in self._fisheyes:
            return self._fisheyes[camera].instances(self.placed(frame))
        return self._cameras.instances(self.placed(frame), self.projection(camera))

    def boxes(self, frame: int) -> list[Box]:
        """Return the labels of the objects that camera 2 sees, with frame and track id.

        Boxes in the world are those of all objects that the scanner sees.
        """
        placed = self.placed(frame)
        if self._traits.world_boxes:
            return box_solids(placed, self._cast(frame)[1], self._rect_T_velo, frame)
        canvas = self.instances(frame, LABEL_CAMERA)
        p_rect = self.calibration.cameras[LABEL_CAMERA].p_rect
        return label_solids(placed, canvas, p_rect, self._rect_T_velo, frame)

    def projection(self, camera: int) -> Float64Array:
        """Return (3, 4), velo_link to a rectified camera's pixels: P_i R0_rect Tr_velo_to_cam."""
        projection: Float64Array = (
            self.calibration.cameras[camera].p_rect @ self._rect_T_velo.matrix()
        )
        return projection


# Writing of the synthetic recording to disk, in any layout.

DATE = '2011_09_26'


def write_synthetic(
    root: Path,
    layout: Layout,
    options: SyntheticOptions | None = None,
    *,
    progress: Callable[[int], None] | None = None,
) -> Path:
    """Write a synthetic recording.

    Everything is written beside root and moved there when complete, so an interrupted run leaves
    no incomplete recording under its name.

    Args:
        root: A folder that does not exist, or is empty.
        layout: The layout to write.
        options: Options of the recording.
        progress: Called with the number of frames done after each frame.

    Returns:
        The folder to convert: the drive (raw), else root.

    Raises:
        OutputExistsError: root exists and is not empty.
        UsageError: The options request an unsynchronised drive, which the layout does not have.
        OSError: A file cannot be written.
    """
    if options is not None and options.extract and not layout.traits.extracts:
        raise UsageError(f'layout {layout.value} has no unsynchronised drives; expected raw')
    root = Path(os.path.realpath(root))
    if root.exists() and not (root.is_dir() and not any(root.iterdir())):
        raise OutputExistsError(root, 'choose a folder that is not there yet, or is empty')
    partial = root.with_name(f'.{root.name}.partial')
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        _write(partial, layout, SyntheticDrive(options, layout), progress)
        if root.exists():
            root.rmdir()
        partial.rename(root)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return root / DATE / _name(layout) if layout.traits.dated else root


def _name(layout: Layout) -> str:
    return layout.traits.default_name.format(date=DATE, kind='sync')


def extract_of(drive: Path) -> Path:
    """Return the folder of the unsynchronised drive beside a synchronised one."""
    return drive.with_name(drive.name.removesuffix('sync') + 'extract')


def _write(
    root: Path, layout: Layout, drive: SyntheticDrive, progress: Callable[[int], None] | None
) -> None:
    cameras, form = layout.traits.cameras + layout.traits.raw_cameras, layout.traits.png
    with (
        Threads(os.cpu_count() or 1, 'image') as threads,
        make_writer(layout, root, _name(layout)) as writer,
    ):
        for frame in range(len(drive)):
            images = [
                threads.submit(partial(drive.image, frame, camera, form)) for camera in cameras
            ]
            _write_frame(writer, drive, frame)
            stamps = drive.stamps(frame).images
            for camera, image in zip(cameras, images, strict=True):
                writer.write_image(camera, frame, stamps[camera], image.result().data)
            if progress is not None:
                progress(frame + 1)
    if drive.options.extract:
        write_extract(root, drive)


def write_extract(root: Path, drive: SyntheticDrive) -> None:
    """Write the packets of the unsynchronised drive below the folder of its date."""
    name = Layout.RAW.traits.default_name.format(date=DATE, kind='extract')
    with make_writer(Layout.RAW, root, name) as writer:
        for number, stamp_ns in enumerate(drive.arrivals.stamps_ns.tolist()):
            writer.write_oxts(number, stamp_ns, drive.arrived(number))


def _write_frame(writer: LayoutWriter, drive: SyntheticDrive, frame: int) -> None:
    """Write the samples of a frame that the layout has, without the images."""
    stamps = drive.stamps(frame)
    if frame == 0 or writer.layout.traits.calibration_per_frame:
        writer.write_calibration(frame, drive.calibration)
    is_compensated = writer.layout.traits.compensated_scans
    writer.write_scan(frame, stamps.scan, drive.scan(frame, is_compensated=is_compensated))
    if Stream.OXTS in writer.accepts:
        writer.write_oxts(frame, drive.packet_stamp(frame), drive.packet(frame))
    is_posed = frame in drive.posed
    if Stream.POSE in writer.accepts and is_posed:
        writer.write_pose(frame, stamps.scan, drive.pose(frame).matrix()[:3])
    if Stream.LABELS in writer.accepts and is_posed:
        writer.write_labels(frame, drive.boxes(frame))
