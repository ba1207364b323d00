# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about the tracklets of a raw drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_in

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..model.samples import FrameLabels


@dataclass(frozen=True, eq=False)
class TrackletFrame:
    """The tracklets of a frame, and their file."""

    path: Path
    labels: FrameLabels


def _find_sizes(frame: TrackletFrame) -> Iterator[Breach]:
    for reason in frame.labels.missing.values():
        yield breach_in(reason.partition('; it gets no')[0], frame.path)


TRACKLET_RULES: tuple[Rule[TrackletFrame], ...] = (
    Rule(
        'tracklet-size',
        RuleSeverity.ERROR,
        RuleScope.FRAME,
        'Tracklets have positive heights, widths and lengths',
        'correct the item of tracklet_labels.xml',
        _find_sizes,
    ),
)
