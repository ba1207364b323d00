# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""3D boxes of any message type that has them -> boxes in velo_link."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..model.geometry import Transform
from .autoware_objects import cuboids_of_objects
from .detections import cuboids_of_detections, frames_of_detections
from .marker_boxes import cuboids_of_markers, frames_of_markers

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.boxes import Cuboid


def cuboids_in(
    message: Any,  # noqa: ANN401 - of the bag's types
    to_velo: Mapping[str, Transform],
    *,
    scores: bool,
) -> tuple[list[Cuboid], list[str]]:
    """Decode a Detection3DArray, DetectedObjects, TrackedObjects or MarkerArray.

    Args:
        message: Of the bag's own types.
        to_velo: velo_T_frame by frame name.
        scores: Whether the boxes have scores.

    Returns:
        The boxes in velo_link, and the reasons why others were skipped.

    Raises:
        ValueError: All boxes are in frames that are not joined.
    """
    if hasattr(message, 'detections'):
        return cuboids_of_detections(message, to_velo, scores=scores)
    if hasattr(message, 'objects'):
        return cuboids_of_objects(message, to_velo, scores=scores)
    return cuboids_of_markers(message, to_velo, scores=scores)


def boxes_in(message: Any) -> list[Cuboid]:  # noqa: ANN401 - as above
    """Return the boxes that cuboids_in decodes, each in its own frame.

    Raises:
        ValueError: They cannot be read.
    """
    here = dict.fromkeys(frames_in(message), Transform.identity())
    return cuboids_in(message, here, scores=False)[0]


def box_count(message: Any) -> int:  # noqa: ANN401 - as above
    """Return the number of detections or objects of a message."""
    return len(message.detections if hasattr(message, 'detections') else message.objects)


def frames_in(message: Any) -> set[str]:  # noqa: ANN401 - as above
    """Return the frames of the boxes that cuboids_in decodes, without leading slashes."""
    if hasattr(message, 'detections'):
        return frames_of_detections(message)
    if hasattr(message, 'objects'):
        return {message.header.frame_id.lstrip('/')} if message.objects else set()
    return frames_of_markers(message)
