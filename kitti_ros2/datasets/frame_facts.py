# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The facts of one frame that statistics use: labels, pose, and counts of points."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.semantic import SEMANTIC_NAMES
from ..kitti.recording import no_calibration
from ..model.boxes import count_points
from ..model.errors import KittiRos2Error, describe_error
from ..model.labels import cuboids_of
from ..model.samples import FrameLabels, Pose, Scan
from ..model.streams import Stream

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    import numpy.typing as npt

    from ..model.boxes import Box, Cuboid
    from ..model.samples import Sample
    from ..pictures.frame import FrameSource


@dataclass
class FrameFacts:
    """The facts of one frame; no scan is kept.

    Attributes:
        number: The frame.
        labels: Its labels; None without, or if unreadable.
        pose: Pose of the vehicle, if any.
        scan_points: Number of points of the scan, if it was read.
        box_points: Class and number of points inside each 3D box, if the scan was read.
        point_classes: Number of points by SemanticKITTI's name, of a scan with labels.
        missing: Missing or unreadable data: stream and reason, one line.
    """

    number: int
    labels: Sequence[Box | Cuboid] | None = None
    pose: Pose | None = None
    scan_points: int | None = None
    box_points: list[tuple[str, int]] = field(default_factory=list)
    point_classes: Counter[str] = field(default_factory=Counter)
    missing: list[tuple[str, str]] = field(default_factory=list)


def read_facts(source: FrameSource, number: int, streams: Collection[Stream]) -> FrameFacts:
    """Read some streams of a frame: labels, poses, scans."""
    facts = FrameFacts(number)
    samples: dict[Stream, Sample | None] = {}
    for stream in streams:
        try:
            samples[stream] = source.read(stream, number)
        except (KittiRos2Error, OSError) as error:
            facts.missing.append((stream.value, describe_error(error)))
    labels, pose, scan = (samples.get(each) for each in (Stream.LABELS, Stream.POSE, Stream.SCAN))
    if isinstance(labels, FrameLabels):
        facts.labels = [*labels.cuboids, *(box for box in labels.boxes if box is not None)]
        facts.missing += [(Stream.LABELS.value, reason) for reason in labels.missing.values()]
    if isinstance(pose, Pose):
        facts.pose = pose
    if isinstance(scan, Scan):
        facts.scan_points = len(scan.points)
        facts.missing += [(Stream.SCAN.value, reason) for reason in scan.missing.values()]
        if scan.labels is not None and not scan.missing:
            facts.point_classes = _count_classes(scan.labels)
        if isinstance(labels, FrameLabels):
            _count_in_boxes(source, labels, scan, facts)
    return facts


def _count_classes(labels: npt.NDArray[np.uint32]) -> Counter[str]:
    counts = np.bincount(labels & 0xFFFF)
    found = np.flatnonzero(counts).tolist()
    return Counter({SEMANTIC_NAMES.get(each, f'class {each}'): int(counts[each]) for each in found})


def _count_in_boxes(
    source: FrameSource, labels: FrameLabels, scan: Scan, facts: FrameFacts
) -> None:
    """Count the points inside the 3D boxes of a frame."""
    calibration = source.calibration(facts.number) or no_calibration('')
    try:
        cuboids = cuboids_of(labels, calibration)
    except ValueError as error:
        reasons = source.frame(facts.number, frozenset()).missing.values()
        reason = f'{next(iter(reasons), error)}; points in boxes are not counted'
        facts.missing.append((Stream.CALIBRATION.value, reason))
        return
    counts = count_points(cuboids, scan.points)
    facts.box_points = [
        (each.class_name, count) for each, count in zip(cuboids, counts, strict=True)
    ]
