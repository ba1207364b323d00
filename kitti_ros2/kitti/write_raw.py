# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: ARG002 - one signature for all layouts, of which each uses its part
"""Writer of the raw layout: DATE/DATE_drive_NNNN_sync (or extract), calibration in DATE."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..model.boxes import box_to_velo
from ..model.errors import UsageError
from ..model.labels import rect_from_velo
from ..model.layouts import Layout
from ..model.losses import runs_of
from ..model.text import format_count
from . import names
from .calib_file import format_raw
from .oxts_file import format_packet
from .scan_file import format_scan
from .stamps_file import format_timestamps
from .store import STORE
from .tracklet_file import (
    TRUNCATION_CUT,
    TRUNCATION_IN_IMAGE,
    Tracklet,
    TrackletPose,
    format_tracklets,
)
from .writer import LayoutWriter

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.geometry import Transform
    from ..model.samples import Calibration, OxtsPacket, Scan

KINDS = ('sync', 'extract')
_MOST_OCCLUDED = 2
_COLOUR_CAMERAS = (2, 3)
_UNKNOWN = -1
_RESIZED = 0.1
_REPORTED_OFF_M = 0.01
_WHOLE = 2  # ends of a run that is not cut
DATAFORMAT = """\
lat: degrees north
lon: degrees east
alt: metres
roll: radians, about the forward axis, left side up is positive
pitch: radians, about the left axis, front down is positive
yaw: radians, 0 is east, counter-clockwise is positive
vn: m/s, to the north
ve: m/s, to the east
vf: m/s, forward, along the ground
vl: m/s, sideways along the ground; positive to the right in the data set
vu: m/s, up
ax: m/s^2, body axis forward, gravity included
ay: m/s^2, body axis left, gravity included
az: m/s^2, body axis up, gravity included
af: m/s^2, forward, along the ground
al: m/s^2, to the left, along the ground
au: m/s^2, up, gravity included
wx: rad/s, about the body axis forward
wy: rad/s, about the body axis left
wz: rad/s, about the body axis up
wf: rad/s, about the levelled forward axis
wl: rad/s, about the levelled left axis
wu: rad/s, about the vertical
pos_accuracy: metres, one standard deviation of the position
vel_accuracy: m/s, one standard deviation of the velocity
navstat: navigation status code
numsats: satellites in use
posmode: position mode code
velmode: velocity mode code
orimode: orientation mode code
"""


class RawWriter(LayoutWriter):
    """Writes one drive.

    Args:
        root: The folder above DATE.
        date: The drive's date, YYYY_MM_DD.
        drive: Its number.
        kind: sync or extract.
    """

    layout: ClassVar[Layout] = Layout.RAW

    def __init__(
        self,
        root: Path,
        date: str = '2011_09_26',
        drive: int = 1,
        kind: str = KINDS[0],
    ) -> None:
        name = f'{date}_drive_{drive:04d}_{kind}'
        if names.RAW_DATE.fullmatch(date) is None or names.RAW_DRIVE.fullmatch(name) is None:
            raise UsageError(
                f'{name} is no drive; expected a date such as 2011_09_26, a number up to 9999,'
                f' and {" or ".join(KINDS)}'
            )
        self.path = root / date / name
        self._stamps: dict[Path, dict[int, int]] = {}
        self._tracks: dict[int, dict[int, Box]] = {}
        self._labelled = False
        self._cut = 0
        self._size_off_m = 0.0
        self._rect_T_velo: Transform | None = None
        self._labels_T_velo: Transform | None = None

    def write_calibration(self, number: int, calibration: Calibration) -> None:
        """Write the three calibration files of DATE; the last ones are kept."""
        self._rect_T_velo = rect_from_velo(calibration)
        self.write_calibration_text(0, format_raw(calibration))

    def place_labels(self, rect_T_velo: Transform) -> None:
        """Take boxes in another frame; tracklets are in the scanner's."""
        self._labels_T_velo = rect_T_velo

    def write_calibration_text(self, number: int, texts: Mapping[str, str]) -> None:
        """Write calibration files of DATE, verbatim."""
        for name, text in texts.items():
            STORE.write_text(self.path.parent / name, text)

    def write_scan(self, number: int, stamp_ns: int, scan: Scan) -> None:
        """Write velodyne_points/data; a sweep without start and end gets its own stamp for both."""
        folder = self.path / names.RAW_SCANS
        self._write_data(folder, number, names.BIN, format_scan(scan.points))
        start = stamp_ns if scan.start_ns is None else scan.start_ns
        end = stamp_ns if scan.end_ns is None else scan.end_ns
        self._stamp(folder / names.TIMESTAMPS, number, stamp_ns)
        self._stamp(folder / names.TIMESTAMPS_START, number, start)
        self._stamp(folder / names.TIMESTAMPS_END, number, end)

    def write_image(self, camera: int, number: int, stamp_ns: int, png: bytes) -> None:
        """Write image_0C/data."""
        self._check_camera(camera)
        folder = self.path / names.RAW_IMAGES[camera]
        self._write_data(folder, number, names.PNG, png)
        self._stamp(folder / names.TIMESTAMPS, number, stamp_ns)

    def depth_folder(self, camera: int) -> str:
        """Return proj_depth/velodyne_raw/image_0C of a colour camera."""
        return f'{names.RAW_DEPTH}/{names.RAW_IMAGES[camera]}' if camera in _COLOUR_CAMERAS else ''

    def write_depth(self, camera: int, number: int, png: bytes) -> None:
        """Write a depth map; see LayoutWriter."""
        name = names.file_name(number, names.RAW_DIGITS, names.PNG)
        STORE.write(self.path / self.depth_folder(camera) / name, png)

    def write_oxts(self, number: int, stamp_ns: int, packet: OxtsPacket | str) -> None:
        """Write oxts/data."""
        folder = self.path / names.RAW_OXTS
        text = packet if isinstance(packet, str) else f'{format_packet(packet)}\n'
        self._write_data(folder, number, names.TXT, text.encode())
        self._stamp(folder / names.TIMESTAMPS, number, stamp_ns)

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write a frame of tracklet_labels.xml; boxes without a 3D box are left out.

        Raises:
            UsageError: The labels are lines of text, which this layout does not support.
            ValueError: A box has no track id, or that of another one.
        """
        if isinstance(labels, str):
            raise UsageError('the raw layout keeps labels as tracklets; hand over boxes, not lines')
        self._labelled = True
        for box in labels:
            if box.size_hwl[0] <= 0:
                continue
            if box.track_id is None:
                raise ValueError('a tracklet needs a track id')
            boxes = self._tracks.setdefault(box.track_id, {})
            if number in boxes:
                raise ValueError(f'two boxes of track {box.track_id} in a frame')
            boxes[number] = box

    def close(self) -> None:
        """Write the time stamp files, dataformat.txt and tracklet_labels.xml.

        Raises:
            UsageError: There are labels but no calibration to transform them to velo_link.
        """
        for path, stamps in self._stamps.items():
            STORE.write_text(path, format_timestamps(fill_stamps(stamps)))
        if self.path / names.RAW_OXTS / names.TIMESTAMPS in self._stamps:
            STORE.write_text(self.path / names.RAW_OXTS / names.DATAFORMAT, DATAFORMAT)
        if self._labelled:
            STORE.write_text(self.path / names.RAW_TRACKLETS, format_tracklets(self._tracklets()))

    def notes(self) -> list[str]:
        """Return remarks on tracklets, each of which has one class and size."""
        found = []
        if self._cut:
            found.append(
                f'tracklets have one class and size: {format_count(self._cut, "track")} became'
                f' several, each from where the class changes, or the size by more than 10 %'
            )
        if self._size_off_m > _REPORTED_OFF_M:
            found.append(
                f'tracklets have one size, the median of their boxes, which differ from it by up to'
                f' {self._size_off_m:.2f} m'
            )
        return found

    def _write_data(self, folder: Path, number: int, suffix: str, data: bytes) -> None:
        name = names.file_name(number, names.RAW_DIGITS, suffix)
        STORE.write(folder / names.RAW_DATA / name, data)

    def _stamp(self, path: Path, number: int, stamp_ns: int) -> None:
        self._stamps.setdefault(path, {})[number] = stamp_ns

    def _tracklets(self) -> list[Tracklet]:
        """Return a tracklet for each run of consecutive frames of each track, by track id.

        A tracklet has one class and one size: a run ends where they change.
        """
        tracklets = []
        for _, boxes in sorted(self._tracks.items()):
            for first, last in runs_of(sorted(boxes)):
                run = [boxes[n] for n in range(first, last + 1)]
                starts = [0, *_changes(run), len(run)]
                self._cut += len(starts) > _WHOLE
                for start, end in pairwise(starts):
                    tracklets.append(self._tracklet(first + start, run[start:end]))
        return tracklets

    def _tracklet(self, first: int, boxes: list[Box]) -> Tracklet:
        """Return the tracklet of boxes of a class and of almost the same size."""
        sizes = np.array([box.size_hwl for box in boxes])
        height, width, length = np.median(sizes, axis=0).tolist()
        off_m = float(np.abs(sizes - (height, width, length)).max())
        self._size_off_m = max(self._size_off_m, off_m)
        poses = [self._tracklet_pose(box) for box in boxes]
        return Tracklet(boxes[0].class_name, (height, width, length), first, poses)

    def _tracklet_pose(self, box: Box) -> TrackletPose:
        labels_t_velo = self._labels_T_velo or self._rect_T_velo
        if labels_t_velo is None:
            raise UsageError('tracklets are in the scanner frame: write_calibration comes first')
        # Tracklets are upright in the scanner's frame, labels in the camera's: the middle agrees.
        half = box.size_hwl[0] / 2
        middle = np.array(box.location) - [0.0, half, 0.0]
        (x, y, z), yaw = box_to_velo(middle, box.rotation_y, labels_t_velo)
        truncation = TRUNCATION_CUT if box.truncated > 0 else TRUNCATION_IN_IMAGE
        occlusion = box.occluded if box.occluded <= _MOST_OCCLUDED else _UNKNOWN
        return TrackletPose((x, y, z - half), yaw, occlusion, truncation)


def _changes(boxes: Sequence[Box]) -> Iterator[int]:
    """Yield the places in a run at which its class changes, or its size by more than a tenth."""
    first = boxes[0]
    for place, box in enumerate(boxes):
        sizes = zip(box.size_hwl, first.size_hwl, strict=True)
        resized = any(abs(size - before) > _RESIZED * before for size, before in sizes)
        if resized or box.class_name != first.class_name:
            yield place
            first = box


def fill_stamps(stamps: Mapping[int, int]) -> list[int]:
    """Return stamps by line for file numbers 0 to the last; missing ones are interpolated.

    KITTI's own files contain a stamp for a missing file. Line n stays file number n; stamps before
    the first file are extrapolated by the mean period.
    """
    numbers = sorted(stamps)
    first, last = numbers[0], numbers[-1]
    period = (stamps[last] - stamps[first]) // max(last - first, 1)
    filled = [stamps[first] - period * (first - number) for number in range(first)]
    for left, right in pairwise(numbers):
        step = stamps[right] - stamps[left]
        filled += [stamps[left] + step * k // (right - left) for k in range(right - left)]
    return [*filled, stamps[last]]
