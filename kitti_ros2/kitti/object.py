# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of the object layout: {training,testing}/{image_2,velodyne,calib,label_2,...}/%06d.

Frames come from different days: each has its own calibration, and no time. Stamps are nominal, by
file number. Scans are as measured, not compensated for motion.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from ..samples import FrameLabels, Layout, Stream, TextFile
from . import names
from .label_file import frame_labels, parse_labels
from .recording import KittiRecording, load_calibration
from .store import STORE

if TYPE_CHECKING:
    from pathlib import Path

    from ..options import ReadOptions
    from ..samples import Calibration

_KNOWN = {*names.OBJECT_IMAGES, names.SCANS, names.CALIB, names.OBJECT_LABELS}


class ObjectRecording(KittiRecording):
    """One split (training or testing) of an object detection set."""

    layout = Layout.OBJECT

    def __init__(self, split: Path, options: ReadOptions) -> None:
        super().__init__(split.parent, split.name, options)
        self.split = split
        folders = {
            Stream.CALIBRATION: (names.CALIB, names.TXT),
            Stream.SCAN: (names.SCANS, names.BIN),
            Stream.LABELS: (names.OBJECT_LABELS, names.TXT),
        } | {Stream(folder): (folder, names.PNG) for folder in names.OBJECT_IMAGES}
        for stream, (folder, suffix) in folders.items():
            listing = STORE.list_numbered(split / folder, (suffix,), names.FRAME_DIGITS)
            self._add_nominal(stream, listing.numbers, listing)
            if not len(listing.numbers) and stream not in {
                Stream.IMAGE_0,
                Stream.IMAGE_1,
                Stream.IMAGE_4,
            }:
                self.notes.append(f'{split / folder}: absent or empty, {stream.value} is left out')
        self._find_gaps(folders)
        self._add_turns()
        others = [n for n in STORE.names(split) if n not in _KNOWN and STORE.is_dir(split / n)]
        if others:
            self.notes.append(f'{split}: {", ".join(others)} not converted')
        self._calibration_cached = lru_cache(maxsize=32)(self._calibration)

    def calibration(self, number: int) -> Calibration:
        """The calibration of a frame."""
        return self._calibration_cached(number)

    def _calibration(self, number: int) -> Calibration:
        name = names.file_name(number, names.FRAME_DIGITS, names.TXT)
        path = self.split / names.CALIB / name
        return load_calibration(path, self.root)

    def text_paths(self) -> list[Path]:
        """The lists of frames in ImageSets."""
        folder = self.root / names.IMAGE_SETS
        return [folder / name for name in STORE.names(folder) if name.endswith(names.TXT)]

    def _find_expected_size(self, stream: Stream) -> None:  # noqa: ARG002 - sizes vary by day
        return None

    def _labels(self, number: int) -> FrameLabels:
        path = self._listings[Stream.LABELS].path(number)
        text = STORE.read_text(path)
        source = TextFile(path.relative_to(self.root).as_posix(), text)
        return frame_labels(parse_labels(text, path), source, path)
