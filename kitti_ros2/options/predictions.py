# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of predictions and their comparison with labels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from ..model.least_overlaps import KITTI_OVERLAPS, LeastOverlaps
from .class_parsers import parse_least_overlaps
from .declare import option
from .parsers import parse_path

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class PredictionOptions:
    """Options of predictions and their comparison with labels.

    Attributes:
        path: Label files of a detector (a folder) or of a tracker (a file); None is none.
        iou: The IoU above which a prediction is a true positive; None is that of KITTI.

    Raises:
        UsageError: An IoU is given without predictions.
    """

    group: ClassVar = 'Predictions'

    path: Path | None = option(
        None,
        'Result files of a detector (a folder) or of a tracker (a file)',
        parse_path,
        name='predictions',
        unset='none',
        live=True,
    )
    iou: LeastOverlaps | None = option(
        None,
        'True positives have a greater IoU with a label: 0.5 for all classes, Car=0.5 for one',
        parse_least_overlaps,
        unset='0.7 for vehicles, 0.5 for others',
        live=True,
        any_type=True,
        metavar='IOU...',
    )

    def __post_init__(self) -> None:
        if self.path is None and self.iou is not None:
            raise UsageError('--iou is for --predictions; give both')

    @property
    def overlaps(self) -> LeastOverlaps:
        """The IoU above which a prediction is a true positive, by class."""
        return KITTI_OVERLAPS if self.iou is None else self.iou
