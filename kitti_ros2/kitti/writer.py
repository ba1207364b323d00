# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: ARG002 - one signature for all layouts, of which each uses its part
"""The base class of the writers of all layouts: a method a stream, called in time order.

A writer gets samples as a recording yields them and keeps only the small tables that KITTI has in
one file (time stamps, poses, tracks); close() writes these.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from ..model.streams import Stream
from . import names
from .scan_file import format_scan
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from typing_extensions import Self

    from ..model.boxes import Box
    from ..model.geometry import Float64Array, Transform
    from ..model.layouts import Layout
    from ..model.samples import Calibration, OxtsPacket, Scan


class LayoutWriter:
    """Writes one drive, sequence or set of frames.

    Leaving the ``with`` block closes the writer. After an exception the tables are not written, and
    the caller removes the files.

    Attributes:
        layout: The layout that it writes.
        path: The folder of the drive, sequence or split.
    """

    layout: ClassVar[Layout]
    path: Path
    _images: ClassVar[tuple[str, ...]] = names.OBJECT_IMAGES

    @property
    def accepts(self) -> frozenset[Stream]:
        """The streams that the layout has a place for; a sample of another is a UsageError."""
        return self.layout.traits.streams

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.close()

    def write_calibration(self, number: int, calibration: Calibration) -> None:
        """Write the calibration valid from a frame on; object sets need one for each frame."""
        STORE.write_text(self._calibration_path(number), self._format_calibration(calibration))

    def write_calibration_text(self, number: int, texts: Mapping[str, str]) -> None:
        """Write calibration files verbatim, by file name."""
        for text in texts.values():
            STORE.write_text(self._calibration_path(number), text)

    def write_scan(self, number: int, stamp_ns: int, scan: Scan) -> None:
        """Write one sweep."""
        STORE.write(self._file(names.SCANS, number, names.BIN), format_scan(scan.points))

    def write_image(self, camera: int, number: int, stamp_ns: int, png: bytes) -> None:
        """Write one image, as the bytes of its PNG file."""
        self._check_camera(camera)
        STORE.write(self._file(self._images[camera], number, names.PNG), png)

    def depth_folder(self, camera: int) -> str:
        """Return the folder of depth maps of a camera, empty where the layout has none."""
        return ''

    def write_depth(self, camera: int, number: int, png: bytes) -> None:
        """Write a depth map of a camera with a depth_folder.

        Args:
            camera: KITTI index.
            number: The frame's.
            png: 16 bits grey: depth in metres times 256, 0 without one (readme.txt of the depth
                devkit).
        """
        STORE.write(self._file(self.depth_folder(camera), number, names.PNG), png)

    def write_oxts(self, number: int, stamp_ns: int, packet: OxtsPacket | str) -> None:
        """Write one packet of the GPS/IMU unit, or its line verbatim."""
        raise self._no_place(Stream.OXTS)

    def write_pose(self, number: int, stamp_ns: int, first_T_cam0: Float64Array) -> None:
        """Write the (3, 4) pose of the rectified camera 0 in its own first frame."""
        raise self._no_place(Stream.POSE)

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write the labelled objects of a frame, or its label lines verbatim."""
        raise self._no_place(Stream.LABELS)

    def place_labels(self, rect_T_velo: Transform) -> None:
        """Take boxes in another frame than that of the rectified camera 0.

        Only for a layout that stores them in the scanner's frame, which boxes that are upright on
        the ground may be upright in while the camera leans.
        """
        raise NotImplementedError

    def leave_out(self, number: int) -> None:
        """Keep an incomplete frame out of lists of frames; other layouts have none."""

    def notes(self) -> list[str]:
        """Return remarks on what the files cannot hold, once they are written."""
        return []

    def close(self) -> None:
        """Write the files that KITTI has once for the whole recording."""

    def _check_camera(self, camera: int) -> None:
        """Raise UsageError if the layout has no place for the images of a camera."""
        stream = Stream(f'image_{camera}')
        if stream not in self.accepts:
            raise self._no_place(stream)

    def _calibration_path(self, number: int) -> Path:
        """Return the calibration file of a frame, or that of all frames, where the last is kept."""
        raise NotImplementedError

    def _format_calibration(self, calibration: Calibration) -> str:
        raise NotImplementedError

    def _file(self, folder: str, number: int, suffix: str) -> Path:
        """Return the file of a frame in a folder of the layout."""
        return self.path / folder / names.file_name(number, names.FRAME_DIGITS, suffix)

    def _no_place(self, stream: Stream) -> UsageError:
        return UsageError(
            f'the {self.layout.value} layout has no place for {stream.value};'
            f' it holds {", ".join(sorted(kept.value for kept in self.accepts))}'
        )


def require_next(path: Path, noun: str, expected: int, number: int) -> None:
    """Require the next number, in a file whose line n is frame n.

    Args:
        path: The file.
        noun: The content of a line.
        expected: The number of lines so far.
        number: The frame's.

    Raises:
        UsageError: The number is not the next one.
    """
    if number != expected:
        raise UsageError(
            f'{path}: line n is frame n, so the {noun} of frame {expected} must come before that of'
            f' frame {number}; number the frames from 0 without a gap'
        )
