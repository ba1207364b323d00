# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writer of the object layout: training (or testing) with a calibration a frame, and ImageSets.

Files of a frame: calib/NNNNNN.txt, velodyne/NNNNNN.bin, image_C/NNNNNN.png, label_2/NNNNNN.txt.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, ClassVar

from ..model.layouts import Layout
from . import names
from .calib_file import format_object
from .label_file import format_object_labels
from .store import STORE
from .writer import LayoutWriter

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.samples import Calibration

_COLOUR_CAMERA = 2


@dataclass(frozen=True)
class WriteOptions:
    """How a set is written.

    Attributes:
        label_decimals: Digits behind the point in labels; KITTI's own have 2, a centimetre.
        train_fraction: The part of the frames for training, 0 to 1; the rest is for validation.
    """

    label_decimals: int = 2
    train_fraction: float = 0.5


class ObjectWriter(LayoutWriter):
    """Writes a set of frames. The layout has no time: stamps are not written.

    Args:
        root: The dataset folder, above training and ImageSets.
        split: training or testing.
        options: Decimals of labels, parts of the set.
    """

    layout: ClassVar[Layout] = Layout.OBJECT

    def __init__(
        self,
        root: Path,
        split: str = names.SPLITS[0],
        options: WriteOptions | None = None,
    ) -> None:
        names.check_split(split)
        self.path = root / split
        self._sets_path = root / names.IMAGE_SETS
        self._split = split
        self._options = options or WriteOptions()
        self._numbers: set[int] = set()
        self._unlisted: set[int] = set()
        self._formatted: tuple[Calibration, str] | None = None

    def depth_folder(self, camera: int) -> str:
        """Return depth_2 for camera 2."""
        return names.OBJECT_DEPTH if camera == _COLOUR_CAMERA else ''

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write label_2/NNNNNN.txt."""
        if not isinstance(labels, str):
            labels = format_object_labels(labels, self._options.label_decimals)
        STORE.write_text(self._file(names.OBJECT_LABELS, number, names.TXT), labels)

    def leave_out(self, number: int) -> None:
        """Keep an incomplete frame out of ImageSets: loaders read the frames listed there."""
        self._unlisted.add(number)

    def close(self) -> None:
        """Write ImageSets: test.txt, trainval.txt and its parts train.txt and val.txt.

        The first frames train: neighbours in time must not be in both. Loaders open all of the
        lists: those of the other split are written empty, unless they exist.
        """
        numbers = sorted(self._numbers - self._unlisted)
        part = ceil(len(numbers) * self._options.train_fraction)
        sets = {'test': numbers}
        if self._split == names.SPLITS[0]:
            sets = {'trainval': numbers, 'train': numbers[:part], 'val': numbers[part:]}
        for name in ('trainval', 'train', 'val', 'test'):
            path = self._sets_path / f'{name}{names.TXT}'
            if name in sets or not path.is_file():
                members = sets.get(name, [])
                text = ''.join(f'{number:0{names.FRAME_DIGITS}d}\n' for number in members)
                STORE.write_text(path, text)

    def _calibration_path(self, number: int) -> Path:
        return self._file(names.CALIB, number, names.TXT)

    def _format_calibration(self, calibration: Calibration) -> str:
        # Frames share their calibration, and formatting it takes longer than writing it.
        if self._formatted is None or self._formatted[0] is not calibration:
            self._formatted = calibration, format_object(calibration)
        return self._formatted[1]

    def _file(self, folder: str, number: int, suffix: str) -> Path:
        self._numbers.add(number)
        return super()._file(folder, number, suffix)
