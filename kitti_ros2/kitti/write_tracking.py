# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writer of the tracking layout: training (or testing), one folder or file a sequence.

Files of a sequence: calib/SSSS.txt, oxts/SSSS.txt, label_02/SSSS.txt, velodyne/SSSS/NNNNNN.bin and
image_0C/SSSS/NNNNNN.png.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from ..model.layouts import Layout
from . import names
from .calib_file import format_tracking
from .label_file import format_tracking_labels
from .oxts_file import format_packet
from .store import STORE
from .writer import LayoutWriter, require_next

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.samples import Calibration, OxtsPacket

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
    _images = names.TRACKING_IMAGES

    def __init__(self, root: Path, sequence: int = 0, split: str = names.SPLITS[0]) -> None:
        names.check_split(split)
        self.path = root / split
        self._sequence = f'{sequence:0{names.SEQUENCE_DIGITS}d}'
        self._packets: list[str] = []
        self._labels: list[str] = []
        self._labelled = False

    def write_oxts(
        self,
        number: int,
        stamp_ns: int,  # noqa: ARG002 - the layout has no time
        packet: OxtsPacket | str,
    ) -> None:
        """Write a line of oxts/SSSS.txt.

        Raises:
            UsageError: The number is not the next one.
        """
        require_next(self._table(names.OXTS), 'packet', len(self._packets), number)
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

    def _calibration_path(self, number: int) -> Path:  # noqa: ARG002 - one for the sequence
        return self._table(names.CALIB)

    def _format_calibration(self, calibration: Calibration) -> str:
        return format_tracking(calibration)

    def _file(self, folder: str, number: int, suffix: str) -> Path:
        return super()._file(f'{folder}/{self._sequence}', number, suffix)

    def _table(self, folder: str) -> Path:
        return self.path / folder / f'{self._sequence}{names.TXT}'


def truncation_level(truncated: float) -> float:
    """Return the level 0, 1 or 2 of a fraction, by the object benchmark's two limits.

    Whole numbers are levels already and are kept.
    """
    if truncated.is_integer():
        return truncated
    return float((truncated > PARTLY_TRUNCATED) + (truncated > LARGELY_TRUNCATED))
