# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of raw drives: DATE/DATE_drive_NNNN_{sync,extract}.

Each stream has its own numbers and its own stamps. In sync the same number is the same moment; in
extract the numbers of streams are independent and the images are not rectified. Scans are as
measured, not compensated for motion.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError, describe_error
from ..model.layouts import Layout
from ..model.samples import Scan, TextFile
from ..model.streams import Clock, Stream
from . import names
from .calib_archives import day_of_drive, describe_source
from .calib_file import parse_raw_calibration
from .listings import listings_kept
from .oxts_file import parse_packet
from .recording import KittiRecording
from .scan_file import parse_scan_text
from .stamps_file import parse_timestamps
from .store import STORE
from .tracklet_file import cuboids_by_frame, labels_of_tracklets, parse_tracklets

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.boxes import Cuboid
    from ..model.samples import Calibration, FrameLabels, OxtsPacket
    from ..options.read import ReadOptions
    from .store import Listing
    from .text_file import Lines


class RawRecording(KittiRecording):
    """One raw drive."""

    layout = Layout.RAW

    @listings_kept()
    def __init__(self, drive: Path, options: ReadOptions) -> None:
        super().__init__(drive.parent, drive.name, options)
        self.drive = drive
        self.rectified = not self.layout.traits.is_extract(drive.name)
        self.common_numbers = self.rectified
        self.image_topic = 'image_rect' if self.rectified else 'image_raw'
        folders = {
            Stream.OXTS: (names.RAW_OXTS, (names.TXT,)),
            Stream.SCAN: (names.RAW_SCANS, (names.BIN, names.TXT)),
        } | {
            Stream(f'image_{index}'): (folder, names.IMAGE_SUFFIXES)
            for index, folder in enumerate(names.RAW_IMAGES)
        }
        if self.common_numbers:
            data = {drive / name / names.RAW_DATA: suffixes for name, suffixes in folders.values()}
            self._name_frames(data, names.RAW_DIGITS)
        else:  # each stream has numbers of its own
            self.frames = names.FileNames(names.RAW_DIGITS)
        self._stampless = not any(
            (drive / folder / names.TIMESTAMPS).is_file() for folder, _ in folders.values()
        )
        self.clock = Clock.NOMINAL if self._stampless else Clock.UTC
        self._unread: set[Stream] = set()
        for stream, (folder, suffixes) in folders.items():
            self._add_folder(stream, drive / folder, suffixes)
        self._require_common_names()
        if Stream.OXTS in self.streams:
            packets = self.streams[Stream.OXTS]
            self._add(Stream.POSE, packets.numbers, packets.stamps_ns, None)
        self._sweeps = tuple(
            self._sweep_stamps(name) for name in (names.TIMESTAMPS_START, names.TIMESTAMPS_END)
        )
        self._add_turns(
            *(
                {number: stamp for number, stamp in enumerate(stamps) if stamp is not None}
                for stamps in self._sweeps
            )
        )
        self._add_tracklets()
        if self._stampless and self.streams:
            self._find_gaps(folders)
            self.notes.append(f'{drive}: no {names.TIMESTAMPS} in any stream; {self._nominal_time}')

    def _add_folder(self, stream: Stream, folder: Path, suffixes: tuple[str, ...]) -> None:
        if not folder.is_dir():
            self.notes.append(f'{folder}: absent, {stream.value} is left out')
            return
        try:
            listing = self._list(folder / names.RAW_DATA, suffixes)
        except OSError as error:
            self._lose_lines(stream, describe_error(error))
            self._unread.add(stream)
            return
        stamps_path = folder / names.TIMESTAMPS
        if self._stampless:
            self._add_nominal(stream, listing.numbers, listing)
        elif stamps_path.exists():
            stamps, reason = self._stamps(stamps_path)
            if stamps is None:
                self._unread.add(stream)
                self._lose_all(stream, listing, f'{reason}; so no stamps')
            else:
                self._add_stamped(stream, listing, stamps, stamps_path)
        else:
            self._lose_all(stream, listing, f'{stamps_path}: no such file, so no stamps')

    def _lose_all(self, stream: Stream, listing: Listing, reason: str) -> None:
        self._lose(stream, listing.numbers.tolist(), f'{reason} for frames {{}}')

    def _stamps(self, path: Path) -> tuple[Lines[int] | None, str]:
        """Read the stamps of a file; None and the reason if it is unreadable."""
        try:
            return parse_timestamps(self.common_files.read_text(path), path), ''
        except (BadFileError, OSError) as error:
            return None, describe_error(error).replace('{', '(').replace('}', ')')

    @cached_property
    def _calibration(self) -> Calibration:
        """The calibration of the drive's date."""
        day = day_of_drive(self.name)
        # A folder that is not of the drive's day may have drives of others.
        dated = day in {self.root.name, ''}
        folders = (self.root, self.drive) if dated else (self.drive, self.root)
        known = (each for each in folders if any((each / n).is_file() for n in names.RAW_CALIB))
        folder = next(known, folders[0])
        texts, missing = {}, {}
        for name in names.RAW_CALIB:
            try:
                texts[name] = STORE.read_text(folder / name)
            except FileNotFoundError:
                continue
            except BadFileError as error:
                missing[name] = str(error)
            except OSError as error:
                missing[name] = describe_error(error)
                self._lose_late(Stream.CALIBRATION, missing[name])
        source = describe_source(self.layout, folder, self.name)
        found = parse_raw_calibration(
            texts, folder, rectified=self.rectified, source=source, day=day
        )
        place = folder.relative_to(self.root)
        files = tuple(TextFile((place / file.name).as_posix(), file.text) for file in found.files)
        return replace(found, files=files, missing={**found.missing, **missing})

    def text_paths(self) -> list[Path]:
        """List the time stamps and data format of every stream, and the tracklets."""
        files = (names.TIMESTAMPS, names.TIMESTAMPS_START, names.TIMESTAMPS_END, names.DATAFORMAT)
        folders = (*names.RAW_IMAGES, names.RAW_SCANS, names.RAW_OXTS)
        paths = [self.drive / folder / file for folder in folders for file in files]
        return [path for path in (*paths, self.drive / names.RAW_TRACKLETS) if path.is_file()]

    def _scan(self, number: int) -> Scan:
        path = self._listings[Stream.SCAN].path(number)
        start, end = (stamps[number] if number < len(stamps) else None for stamps in self._sweeps)
        if path.suffix.lower() == names.TXT:
            scan = Scan(parse_scan_text(STORE.read(path), path), turn=self.turns.get(number))
        else:
            scan = super()._scan(number)
        return replace(scan, start_ns=start, end_ns=end)

    def _sweep_stamps(self, name: str) -> list[int | None]:
        """Read the starts or ends of all sweeps; missing ones are losses."""
        path = self.drive / names.RAW_SCANS / name
        if not path.is_file():
            return []
        stamps, reason = self._stamps(path)
        values = stamps.values if stamps is not None else []
        for error in stamps.errors.values() if stamps is not None else ():
            self._lose_lines(Stream.SCAN, f'{error}; its sweep goes without')
        scans = self.streams[Stream.SCAN].numbers.tolist() if Stream.SCAN in self.streams else []
        beyond = [number for number in scans if number >= len(values)]
        reason = f'{reason}; so none' if reason else f'{path}: no line'
        self._lose(Stream.SCAN, beyond, f'{reason} for the sweeps of frames {{}}')
        return values

    @cached_property
    def _cuboids(self) -> dict[int, list[Cuboid]]:
        path = self.drive / names.RAW_TRACKLETS
        if not path.is_file():
            return {}
        try:
            return cuboids_by_frame(parse_tracklets(self.common_files.read(path), path))
        except (BadFileError, OSError) as error:
            self._lose_lines(Stream.LABELS, describe_error(error))
            return {}

    def _add_tracklets(self) -> None:
        """Add the tracklets; their frames have the stamps of the scans, or else of the images."""
        if not self._cuboids:
            return
        # An unreadable folder of scans does not change the stamps of the labels.
        scanned = Stream.SCAN in self.streams or Stream.SCAN in self._unread
        scan_stamps = f'{names.RAW_SCANS}/{names.TIMESTAMPS}'
        path = self.drive / (scan_stamps if scanned else names.RAW_LABEL_STAMPS)
        stamps, _ = self._stamps(path) if path.is_file() else (None, '')
        numbers = sorted(self._cuboids)
        if self._stampless:
            self._add_nominal(Stream.LABELS, np.array(numbers, dtype=np.int64), None)
            return
        without = self._add_at(Stream.LABELS, numbers, [] if stamps is None else stamps.values)
        self._lose(Stream.LABELS, without, f'{path}: no stamp for the tracklets of frames {{}}')

    def _labels(self, number: int) -> FrameLabels:
        return labels_of_tracklets(self._cuboids[number], self.drive / names.RAW_TRACKLETS)

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        if stream is Stream.LABELS:
            return self.drive / names.RAW_TRACKLETS
        return super().path(stream, number)

    def _packet(self, number: int) -> OxtsPacket:
        path = self._listings[Stream.OXTS].path(number)
        text = STORE.read_text(path)
        return parse_packet(text, path, 1, self._verbatim(path, text))
