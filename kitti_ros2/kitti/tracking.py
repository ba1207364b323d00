# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of the tracking layout: {training,testing}/{image_02,velodyne,...}/SSSS/%06d.

Calibration, oxts and labels are one file a sequence; a packet's line, and a label's first column,
is the frame number. There is no time: stamps are nominal, by frame number. Scans are as
measured, not compensated for motion.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..model.layouts import Layout
from ..model.streams import IMAGE_STREAMS, Stream
from . import names
from .listings import listings_kept
from .oxts_file import packet_lines, parse_packet
from .recording import KittiRecording
from .track_file import TrackFile

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.samples import Calibration, FrameLabels, OxtsPacket
    from ..options.read import ReadOptions


class TrackingRecording(KittiRecording):
    """One sequence of a tracking set."""

    layout = Layout.TRACKING

    @listings_kept()
    def __init__(self, split: Path, sequence: str, options: ReadOptions) -> None:
        super().__init__(split.parent, sequence, options)
        self.split = split
        file = f'{sequence}{names.TXT}'
        self._calib_path = split / names.CALIB / file
        self._oxts_path = split / names.OXTS / file
        self._labels_path = split / names.TRACKING_LABELS / file
        folders = {Stream.SCAN: (split / names.SCANS / sequence, (names.BIN,))} | {
            Stream(f'image_{index}'): (split / folder / sequence, names.IMAGE_SUFFIXES)
            for index, folder in enumerate(names.TRACKING_IMAGES)
        }
        self._name_frames(dict(folders.values()), names.FRAME_DIGITS)
        for stream, (folder, suffixes) in folders.items():
            listing = self._list(folder, suffixes)
            self._add_nominal(stream, listing.numbers, listing)
            known = stream.camera in (None, *self.layout.traits.cameras)
            if known and not len(listing.numbers) and not listing.strays:
                self.notes.append(f'{folder}: absent or empty, {stream.value} is left out')
        self._require_common_names()
        packets = np.arange(len(self._oxts_lines), dtype=np.int64)
        self._add_nominal(Stream.OXTS, packets, None)
        self._find_gaps([Stream.OXTS, Stream.SCAN, *IMAGE_STREAMS])
        self._add_turns()
        self._add_nominal(Stream.POSE, packets, None)
        self._add_nominal(Stream.LABELS, np.array(sorted(self._tracks.rows), dtype=np.int64), None)

    @cached_property
    def _oxts_lines(self) -> list[str]:
        if not self._oxts_path.is_file():
            self.notes.append(f'{self._oxts_path}: absent, oxts and pose are left out')
        return self._parsed(self._oxts_path, Stream.OXTS, packet_lines)

    @cached_property
    def _tracks(self) -> TrackFile:
        """The label file; a line without a frame number is a loss."""
        tracks = self._parsed(self._labels_path, Stream.LABELS, TrackFile)
        for error in tracks.errors:
            self._lose_lines(Stream.LABELS, str(error))
        return tracks

    @cached_property
    def _calibration(self) -> Calibration:
        return self._load_calibration(self._calib_path)

    def text_paths(self) -> list[Path]:
        """List the oxts and label files."""
        return [path for path in (self._oxts_path, self._labels_path) if path.is_file()]

    def _packet(self, number: int) -> OxtsPacket:
        line = self._oxts_lines[number]
        source = self._verbatim(self._oxts_path, line)
        return parse_packet(line, self._oxts_path, number + 1, source)

    def _labels(self, number: int) -> FrameLabels:
        return self._tracks.labels(number, self._labels_path.relative_to(self.root).as_posix())

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        whole = {
            Stream.OXTS: self._oxts_path,
            Stream.POSE: self._oxts_path,
            Stream.LABELS: self._labels_path,
            Stream.CALIBRATION: self._calib_path,
        }
        return whole.get(stream) or super().path(stream, number)
