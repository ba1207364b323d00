# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of the object layout: {training,testing}/{image_2,velodyne,calib,label_2,...}/%06d.

Frames come from different days: each has its own calibration, and no time stamp. Stamps are
nominal, by file number; in real time they are those of the raw drives (see real_time.py), and
frames without one are left out. Scans are as measured, not compensated for motion.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError, UsageError, describe_error
from ..model.layouts import Layout
from ..model.recording import StreamIndex
from ..model.samples import TextFile
from ..model.streams import Clock, Stream
from . import append_journal, names
from .calib_archives import describe_source
from .label_file import frame_labels, parse_labels
from .listings import listings_kept
from .object_mapping import find_mapping, find_raw_root
from .real_time import ENDS, REAL_TIME, STARTS, DriveStamps, describe_times
from .recording import KittiRecording, no_calibration
from .store import STORE

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.samples import Calibration, Description, FrameLabels
    from ..options.read import ReadOptions
    from .append_journal import AppendJournal
    from .real_time import RealTimes
    from .store import Listing

_KNOWN = {*names.OBJECT_IMAGES, names.SCANS, names.CALIB}


class ObjectRecording(KittiRecording):
    """One split (training or testing) of an object detection set."""

    layout = Layout.OBJECT

    @listings_kept()
    def __init__(self, split: Path, options: ReadOptions) -> None:
        super().__init__(split.parent, split.name, options)
        self.split = split
        self._journal = self._find_journal()
        present = STORE.names(split)
        labels = names.WAYMO_LABELS if names.WAYMO_LABELS in present else names.OBJECT_LABELS
        folders = {
            Stream.CALIBRATION: (split / names.CALIB, (names.TXT,)),
            Stream.SCAN: (split / names.SCANS, (names.BIN,)),
            Stream.LABELS: (split / labels, (names.TXT,)),
        } | {
            Stream(folder): (split / folder, names.IMAGE_SUFFIXES) for folder in names.OBJECT_IMAGES
        }
        self._name_frames(dict(folders.values()), names.FRAME_DIGITS)
        for stream, (folder, suffixes) in folders.items():
            listing = self._without_unfinished(stream, self._list(folder, suffixes))
            self._add_nominal(stream, listing.numbers, listing)
            known = stream.camera in (None, *self.layout.traits.cameras)
            if known and not len(listing.numbers) and not listing.strays:
                self.notes.append(f'{folder}: absent or empty, {stream.value} is left out')
        if labels == names.WAYMO_LABELS:
            self.notes.append(
                f'{split / labels}: 2D boxes of cameras other than 2 are left out;'
                ' the boxes in space are read'
            )
        self._require_common_names()
        self._find_gaps(folders)
        self._times: RealTimes | None = None
        if options.real_time:
            self._times = self._set_real_time()
            self._add_turns(*map(self._times.turn_stamps, (STARTS, ENDS)))
        else:
            self._add_turns()
        others = [n for n in present if n not in {*_KNOWN, labels} and (split / n).is_dir()]
        if others:
            self.notes.append(f'{split}: {", ".join(others)} not converted')
        self._calibration_cached = lru_cache(maxsize=32)(self._calibration_of)

    def _set_real_time(self) -> RealTimes:
        """Replace the nominal stamps by true ones; samples without one are losses.

        Raises:
            UsageError: There is no mapping or no raw drive, or not one true stamp.
        """
        if self.name == names.SPLITS[1]:
            raise UsageError(f'{self.split}: the devkit has the drives of training frames only')
        mapping = find_mapping(self.root, self.options.mapping)
        raw = find_raw_root(self.root, self.options.raw)
        numbers = {n for index in self.streams.values() for n in index.numbers.tolist()}
        drives = DriveStamps(mapping, raw, numbers)
        times = drives.read([*self.streams])
        for stream, index in [*self.streams.items()]:
            stamps = times.stamps(stream)
            known = [n for n in index.numbers.tolist() if n in stamps]
            absent = sorted(set(index.numbers.tolist()).difference(known))
            for reason, frames in drives.reasons_of(stream, absent).items():
                escaped = reason.replace('{', '(').replace('}', ')')
                self._lose(stream, frames, f'{escaped}; no true stamp for frames {{}}')
            stamps_ns = np.array([stamps[n] for n in known], dtype=np.int64)
            self.streams[stream] = StreamIndex(np.array(known, dtype=np.int64), stamps_ns)
        self.streams = {stream: index for stream, index in self.streams.items() if len(index)}
        if not self.streams and self.losses:
            reason = self.losses[-1].message.partition(';')[0]
            raise UsageError(f'{self.split}: no frame has a true stamp: {reason}; see --raw')
        self.clock = Clock.UTC
        left = {n for index in self.streams.values() for n in index.numbers.tolist()}
        self.origins = {n: origin for n, origin in times.origins.items() if n in left}
        return times

    def _find_journal(self) -> AppendJournal | None:
        """Find the journal of an incomplete append: its frames are left out."""
        work = self.root / append_journal.FOLDER
        try:
            journal = append_journal.find_journal(self.root)
        except (BadFileError, OSError) as error:
            self._lose_lines(Stream.RECORDING, describe_error(error))
            return None
        if work.is_dir():
            self.notes.append(
                f'{work}: an append is running or was interrupted; its frames are left out'
            )
        return journal

    def _without_unfinished(self, stream: Stream, listing: Listing) -> Listing:
        """Return the files of a stream without those of an incomplete append."""
        if self._journal is None or self._journal.split != self.name:
            return listing
        ours = np.isin(listing.numbers, np.array(self._journal.numbers, dtype=np.int64))
        self._lose(
            stream,
            listing.numbers[ours].tolist(),
            f'{self.root}: frames {{}} are of an append that is not complete;'
            f' the next to-kitti --append removes them',
        )
        return replace(listing, numbers=listing.numbers[~ours])

    def describe(self) -> Description:
        """Describe the set; lists of frames are as before an incomplete append."""
        found = super().describe()
        if self._times is not None:
            values = {**found.values, REAL_TIME: describe_times(self._times)}
            found = replace(found, values=values)
        if self._journal is None:
            return found
        before = self.root / append_journal.FOLDER / append_journal.BEFORE
        earlier = [
            TextFile(path, STORE.read_text(before / path))
            for path in map(str, self._journal.lists)
            if (before / path).is_file()  # else it has been restored already
        ]
        replaced = {file.name for file in earlier} | set(map(str, self._journal.files))
        files = [file for file in found.files if file.name not in replaced]
        return replace(found, files=sorted([*files, *earlier], key=lambda file: file.name))

    def calibration(self, number: int) -> Calibration:
        """Return the calibration of a frame."""
        return self._calibration_cached(number)

    def _calibration_of(self, number: int) -> Calibration:
        folder = self.split / names.CALIB
        if Stream.CALIBRATION not in self.streams:
            source = describe_source(self.layout, folder)
            return no_calibration(f'{folder}: no calibration; {source}')
        return self._load_calibration(self._listings[Stream.CALIBRATION].path(number))

    def text_paths(self) -> list[Path]:
        """List the lists of frames in ImageSets."""
        folder = self.root / names.IMAGE_SETS
        return [folder / name for name in STORE.names(folder) if name.endswith(names.TXT)]

    def _find_expected_size(self, stream: Stream) -> None:  # noqa: ARG002 - sizes vary by day
        return None

    def _labels(self, number: int) -> FrameLabels:
        path = self._listings[Stream.LABELS].path(number)
        text = STORE.read_text(path)
        return frame_labels(parse_labels(text, path).rows(), self._verbatim(path, text), path)
