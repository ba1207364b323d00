# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: ARG002 - one signature for all layouts, of which each uses its part
"""Writer of the tracking layout: training (or testing), one folder or file a sequence."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from ..model.layouts import Layout
from ..model.streams import Stream
from . import names
from .calib_file import format_tracking
from .label_file import format_tracking_labels
from .oxts_file import format_packet
from .scan_file import format_scan
from .store import STORE
from .writer import LayoutWriter

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.samples import Calibration, OxtsPacket, Scan

PARTLY_TRUNCATED = 0.15
LARGELY_TRUNCATED = 0.5


class TrackingWriter(LayoutWriter):
    """Writes one sequence. The layout has no time: stamps are not written.

    Args:
        root: The dataset folder, above training.
        sequence: The sequence's number.
        split: training or testing.
    """

    layout: ClassVar[Layout] = Layout.TRACKING

    def __init__(
        self,
        root: Path,
        sequence: int = 0,
        split: str = names.SPLITS[0],
    ) -> None:
        if split not in names.SPLITS:
            raise UsageError(f'no split {split!r}; there are {" and ".join(names.SPLITS)}')
        self.path = root / split
        self._sequence = f'{sequence:0{names.SEQUENCE_DIGITS}d}'
        self._packets: list[str] = []
        self._labels: list[str] = []
        self._labelled = False

    def write_calibration(self, number: int, calibration: Calibration) -> None:
        """Write calib/SSSS.txt; the last one is kept."""
        STORE.write_text(self._table(names.CALIB), format_tracking(calibration))

    def write_calibration_text(self, number: int, texts: Mapping[str, str]) -> None:
        """Write calib/SSSS.txt, verbatim."""
        for text in texts.values():
            STORE.write_text(self._table(names.CALIB), text)

    def write_scan(self, number: int, stamp_ns: int, scan: Scan) -> None:
        """Write velodyne/SSSS/NNNNNN.bin."""
        STORE.write(self._file(names.SCANS, number, names.BIN), format_scan(scan.points))

    def write_image(self, camera: int, number: int, stamp_ns: int, png: bytes) -> None:
        """Write image_0C/SSSS/NNNNNN.png."""
        if Stream(f'image_{camera}') not in self.accepts:
            raise self._no_place(Stream(f'image_{camera}'))
        STORE.write(self._file(names.TRACKING_IMAGES[camera], number, names.PNG), png)

    def write_oxts(self, number: int, stamp_ns: int, packet: OxtsPacket | str) -> None:
        """Write a line of oxts/SSSS.txt.

        Raises:
            UsageError: The number is not the next one.
        """
        if number != len(self._packets):
            raise UsageError(
                f'{self._table(names.OXTS)}: line n is frame n, so the packet of frame'
                f' {len(self._packets)} must come before that of frame {number};'
                f' number the frames from 0 without a gap'
            )
        text = packet if isinstance(packet, str) else format_packet(packet)
        self._packets.append(text.rstrip('\r\n'))

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write lines of label_02/SSSS.txt; a truncated fraction becomes a level 0, 1 or 2.

        Raises:
            ValueError: A box has no track id.
        """
        self._labelled = True
        if not isinstance(labels, str):
            boxes = (
                replace(box, frame=number, truncated=truncation_level(box.truncated))
                for box in labels
            )
            labels = format_tracking_labels(boxes)
        if labels:
            self._labels.append(labels if labels.endswith('\n') else f'{labels}\n')

    def close(self) -> None:
        """Write oxts/SSSS.txt and label_02/SSSS.txt."""
        if self._packets:
            lines = ''.join(f'{packet}\n' for packet in self._packets)
            STORE.write_text(self._table(names.OXTS), lines)
        if self._labelled:
            STORE.write_text(self._table(names.TRACKING_LABELS), ''.join(self._labels))

    def _file(self, folder: str, number: int, suffix: str) -> Path:
        name = names.file_name(number, names.FRAME_DIGITS, suffix)
        return self.path / folder / self._sequence / name

    def _table(self, folder: str) -> Path:
        return self.path / folder / f'{self._sequence}{names.TXT}'


def truncation_level(truncated: float) -> float:
    """Return the level 0, 1 or 2 of a fraction, by the object benchmark's two limits.

    Whole numbers are levels already and are kept.
    """
    if truncated.is_integer():
        return truncated
    return float((truncated > PARTLY_TRUNCATED) + (truncated > LARGELY_TRUNCATED))
