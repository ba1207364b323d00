# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The labels of a frame as boxes in velo_link, and the trails of tracks over frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .boxes import cuboid_of, has_cuboid, is_absurd
from .geometry import Transform
from .streams import Stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from .boxes import Box, Cuboid
    from .geometry import Float64Array
    from .layouts import Layout
    from .losses import Loss
    from .samples import Calibration, FrameLabels


def rect_from_velo(calibration: Calibration) -> Transform:
    """Return rect_T_velo, velo_link to the rectified camera 0.

    Raises:
        ValueError: The calibration has no r0_rect or cam0_T_velo.
    """
    if calibration.r0_rect is None or calibration.cam0_T_velo is None:
        raise ValueError('boxes need a calibration with r0_rect and cam0_T_velo')
    return Transform(calibration.r0_rect, np.zeros(3)) @ calibration.cam0_T_velo


def cuboids_of(labels: FrameLabels, calibration: Calibration) -> list[Cuboid]:
    """Return the 3D boxes of a frame in velo_link.

    Raises:
        ValueError: They are in the camera's frame, and the calibration has no transform from it.
    """
    if labels.cuboids:
        return list(labels.cuboids)
    solid = [
        (identity, box)
        for identity, box in identified(labels)
        if has_cuboid(box) and not is_absurd(box)
    ]
    if not solid:
        return []
    rect_t_velo = rect_from_velo(calibration)
    return [cuboid_of(box, identity, rect_t_velo) for identity, box in solid]


def identified(labels: FrameLabels) -> list[tuple[str, Box]]:
    """Return each box of a frame with its id: its track's, or its place in the file."""
    return [
        (str(place) if box.track_id is None else _track_identity(box.track_id, place), box)
        for place, box in enumerate(labels.boxes)
        if box is not None
    ]


def _track_identity(track_id: int, place: int) -> str:
    """Return the id of a box; DontCare regions all have track -1, so theirs is their place."""
    return str(track_id) if track_id >= 0 else f'{track_id}.{place}'


def has_complete_labels(layout: Layout, losses: Iterable[Loss]) -> bool:
    """Whether a frame of a labelled recording has no object if it has no labels.

    Then the labels of all frames are in one file, and nothing of it is lost.

    Args:
        layout: Of the recording.
        losses: Of the recording; those of a bag may concern labels if they name no other stream.
    """
    others = {each.value for each in Stream} - {Stream.LABELS.value}
    return layout.traits.common_labels and all(loss.stream in others for loss in losses)


class Trails:
    """The positions of all tracks of a recording, in the fixed frame of its poses."""

    def __init__(
        self,
        frames: Mapping[int, Sequence[Cuboid]],
        world_t_velo: Callable[[int], Transform | None],
    ) -> None:
        self._numbers: dict[int, list[int]] = {}
        self._places: dict[int, list[Float64Array]] = {}
        for number in sorted(frames):
            pose = world_t_velo(number)
            for cuboid in frames[number] if pose is not None else ():
                if cuboid.track_id is not None and cuboid.track_id >= 0 and pose is not None:
                    self._numbers.setdefault(cuboid.track_id, []).append(number)
                    place = (pose @ cuboid.velo_T_box).translation
                    self._places.setdefault(cuboid.track_id, []).append(place)

    def up_to(self, number: int) -> dict[int, Float64Array]:
        """Map the track ids of a frame to their positions up to it, (N, 3) metres in the world."""
        return {
            track: np.array(self._places[track][: numbers.index(number) + 1])
            for track, numbers in self._numbers.items()
            if number in numbers
        }
