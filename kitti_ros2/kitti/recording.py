# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of the readers of all layouts: samples, calibration and description."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, TypeVar

from ..files.image_files import parse_image
from ..model.errors import BadFileError, UsageError, describe_error
from ..model.layouts import Layout
from ..model.losses import runs_of
from ..model.nominal import NOMINAL_VELO_T_IMU
from ..model.samples import Calibration, Description, Image, Sample, Scan, TextFile
from ..model.streams import CAMERA_NAMES, Clock, Stream
from ..options.read import ScanStamp
from .calib_archives import describe_source
from .calib_file import parse_calibration
from .names import FRAME_NAMES, TXT, describe_names
from .recording_poses import RecordingPoses
from .scan_check import ScanLook, look_at_scans
from .scan_file import parse_points
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

    from ..options.read import ReadOptions

T = TypeVar('T')


class KittiRecording(RecordingPoses):
    """The common part of the readers of all layouts."""

    layout: Layout
    image_topic = 'image_rect'
    common_numbers = True
    clock = Clock.NOMINAL

    def __init__(self, root: Path, name: str, options: ReadOptions) -> None:
        super().__init__(root, options)
        self.name = name
        self._first_sizes: dict[Stream, tuple[int, int]] = {}
        self._expected_size = lru_cache(maxsize=None)(self._find_expected_size)

    @property
    def period_ns(self) -> int:
        """Time between frames without stamps, and length of a turn that is not known."""
        return self.options.period_ns

    @property
    def cameras(self) -> dict[int, str]:
        """Camera index to name: KITTI's four, or plain numbers on another rig."""
        present = [stream.camera for stream in self.streams if stream.camera is not None]
        if present and self.calibration(self._first_number).independent_cameras:
            return {index: str(index) for index in present}
        return {index: CAMERA_NAMES.get(index, str(index)) for index in present}

    def text_paths(self) -> list[Path]:
        """List the existing text files of the whole recording."""
        return []

    def calibration(self, number: int) -> Calibration:  # noqa: ARG002 - one for all frames
        """Return the calibration of a frame; absent parts are listed in its missing."""
        return self._calibration

    @cached_property
    def _calibration(self) -> Calibration:
        """The calibration of layouts that have one for all frames."""
        raise NotImplementedError

    def describe(self) -> Description:
        """Describe the recording as a whole."""
        folders = {
            stream.value: {
                'folder': listing.folder.relative_to(self.root).as_posix(),
                **describe_names(listing.names),
                'numbers': runs_of(listing.numbers.tolist()),
            }
            for stream, listing in self._listings.items()
        }
        values: dict[str, object] = {
            'layout': self.layout.value,
            'name': self.name,
            'epoch_ns': self.options.epoch_ns,
            'period_ns': self.options.period_ns,
            'scan_stamp': self._scan_stamp.value,
            'files': folders,
        }
        if self.frames.stems:
            values[FRAME_NAMES] = [*self.frames.stems]
        if self.deskew is not None:
            values['deskew'] = self.deskew.value
        if self.extract is not None:
            values['imu_from'] = self.extract.describe()
        if self.stereo:
            values['stereo'] = True
        if self.options.columns is not None:
            values['columns'] = self.options.columns.text
        files: list[TextFile] = []
        missing: dict[str, str] = {}
        for path in self.text_paths():
            try:
                files.append(self._verbatim(path, self.common_files.take_text(path)))
            except (BadFileError, OSError) as error:
                missing[path.relative_to(self.root).as_posix()] = describe_error(error)
        return Description(values, files, missing)

    @cached_property
    def scan_look(self) -> ScanLook:
        """What its scans are, by the first ones."""
        return look_at_scans(self, labelled=self.layout.traits.point_labels)

    @property
    def scan_error(self) -> BadFileError | None:
        """The error if its scans are not KITTI's and the options have no columns."""
        return self.scan_look.error if self.options.columns is None else None

    def check_scan(self, path: Path, data: npt.NDArray[np.uint8]) -> None:
        """Check that a scan has the columns of the others, if the options have none.

        Raises:
            BadFileError: It has others.
        """
        if self.options.columns is None:
            self.scan_look.check(path, data)

    def prepare_columns(self) -> None:
        """Note what the options leave out of scans; without columns, check that they are KITTI's.

        Raises:
            BadFileError: They are not.
            UsageError: Columns are given for text files, which have four.
        """
        listing, columns = self.listings.get(Stream.SCAN), self.options.columns
        if listing is None or columns is None:
            if self.scan_error is not None:
                raise self.scan_error
            return
        if any(listing.path(n).suffix.lower() == TXT for n in listing.numbers[:1].tolist()):
            raise UsageError(f'{listing.folder}: columns are for binary scans; these are text')
        if columns.skipped:
            self.notes.append(f'{listing.folder}: {columns.describe_skipped()} left out (-)')
        if columns.reflectance is None:
            self.notes.append(f'{listing.folder}: no column of intensity, which is 0 then')
        doubt = self.scan_look.doubt(columns)
        self.notes += [doubt] if doubt else []

    def read(self, stream: Stream, number: int) -> Sample:
        """Read the sample of a stream with a file number; see model.recording."""
        if stream.camera is not None:
            return self._image(stream, number)
        if stream is Stream.SCAN:
            return self.adjust_scan(number, self._scan(number))
        if stream is Stream.PREDICTIONS and self.results is not None:
            return self.results.read(number)
        if stream is Stream.OXTS_EXTRACT and self.extract is not None:
            return self.extract.packet(number)
        readers: dict[Stream, Callable[[int], Sample]] = {
            Stream.OXTS: self._packet_cached,
            Stream.POSE: self._pose,
            Stream.LABELS: self._labels,
            Stream.CALIBRATION: self.calibration,
        }
        return readers[stream](number)

    def _scan(self, number: int) -> Scan:
        path = self._listings[Stream.SCAN].path(number)
        data = STORE.read_array(path)
        self.check_scan(path, data)
        scan = parse_points(data, path, self.options.columns)
        return replace(scan, turn=self.turns.get(number))

    @property
    def _first_number(self) -> int:
        """The lowest file number of any image stream."""
        return min(
            int(index.numbers[0])
            for stream, index in self.streams.items()
            if stream.camera is not None
        )

    def _image(self, stream: Stream, number: int) -> Image:
        path = self._listings[stream].path(number)
        image = parse_image(STORE.read(path), path)
        if number == self.streams[stream].numbers[0]:
            self._first_sizes[stream] = image.width, image.height
        expected = self._expected_size(stream)
        if expected is not None and (image.width, image.height) != expected:
            raise BadFileError(
                path,
                f'the image is {image.width}x{image.height}',
                f'{expected[0]}x{expected[1]}, as the rest of its camera',
                remedy='calibration holds for one size only',
            )
        return image

    def _find_expected_size(self, stream: Stream) -> tuple[int, int] | None:
        """Return the size of a camera's images: the calibration's, else the first valid image's."""
        camera = self.calibration(0).cameras.get(stream.camera or 0)
        if camera is not None and camera.size is not None:
            return camera.size
        if stream in self._first_sizes:
            return self._first_sizes[stream]
        for number in self.streams[stream].numbers.tolist():
            path = self._listings[stream].path(number)
            try:
                image = parse_image(STORE.read(path), path)
            except (BadFileError, OSError):
                continue
            return image.width, image.height
        return None

    @property
    def _scan_stamp(self) -> ScanStamp:
        """The moment of a scan that is its stamp; a compensated scan has no start of a turn."""
        return self.options.scan_stamp if self.turns else ScanStamp.FORWARD

    def _verbatim(self, path: Path, text: str) -> TextFile:
        """Return a text of a file, or a part of it, under the file's name in the recording."""
        return TextFile(path.relative_to(self.root).as_posix(), text)

    def _text(self, path: Path, stream: Stream) -> str:
        """Read a text file; one that is absent is empty, an unreadable one also a loss."""
        if not path.is_file():
            return ''
        try:
            return self.common_files.read_text(path)
        except (BadFileError, OSError) as error:
            self._lose_lines(stream, describe_error(error))
            return ''

    def _parsed(self, path: Path, stream: Stream, parse: Callable[[str, Path], T]) -> T:
        """Parse a text file that _text reads; one that cannot be parsed is a loss, and empty."""
        text = self._text(path, stream)
        try:
            return parse(text, path)
        except BadFileError as error:
            self._lose_lines(stream, str(error))
            return parse('', path)

    def _load_calibration(self, path: Path) -> Calibration:
        """Read a calibration of a single file; an unreadable one is empty, with the reason."""
        files: tuple[TextFile, ...] = ()
        try:
            text = STORE.read_text(path)
            files = (self._verbatim(path, text),)
            return parse_calibration(text, path, files[0].name, self._scanner_source(path))
        except FileNotFoundError:
            reason = f'{path}: no such file; {describe_source(self.layout, path)}'
        except BadFileError as error:
            reason = str(error)
        except OSError as error:
            reason = describe_error(error)
            self._lose_late(Stream.CALIBRATION, reason)
        return no_calibration(reason, files)

    def _scanner_source(self, path: Path) -> str:
        """Describe where a calibration with the scanner's place can be had, if it is known."""
        if self.layout is not Layout.ODOMETRY:
            return ''
        source = describe_source(self.layout, path)
        return f'{source}; the {path.name} of the image archives has none'


def no_calibration(reason: str, files: tuple[TextFile, ...] = ()) -> Calibration:
    """Return an empty calibration."""
    return Calibration(
        {},
        None,
        None,
        NOMINAL_VELO_T_IMU,
        nominal=('velo_T_imu',),
        missing={'file': reason},
        files=files,
    )
