# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a frame's labels, collected: arrays of one stamp, 2D boxes beside 3D boxes."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .frames import Frames
    from .plan import LabelPlan


class LabelMessages:
    """Collects the messages of each frame's labels until all of them were read.

    Args:
        plan: Names the topics, None without labels.
        frames: The frames, and the messages of their labels.
        first: The number of the first frame.
    """

    def __init__(self, plan: LabelPlan | None, frames: Frames, first: int) -> None:
        self._due: dict[tuple[str, int], list[int]] = defaultdict(list)
        self._left: dict[int, int] = {}
        self._solid: dict[int, list[Any]] = defaultdict(list)
        self._flat: dict[int, list[Any]] = defaultdict(list)
        self._flat_topic = '' if plan is None else plan.boxes_2d
        if plan is None:
            return
        for number, places in enumerate(frames.label_places, first):
            for place in places:
                self._due[plan.topic, place].append(number)
            self._left[number] = len(places)
        for number, places in enumerate(frames.places_2d, first):
            # Boxes in the image alone do not make a frame's labels where the others are missing.
            if self._left.get(number):
                for place in places:
                    self._due[plan.boxes_2d, place].append(number)
                self._left[number] += len(places)

    @property
    def topics(self) -> set[str]:
        """The topics to read."""
        return {topic for topic, _ in self._due}

    def frames_of(self, topic: str, place: int) -> Sequence[int]:
        """Return the numbers of the frames that a message belongs to."""
        return self._due.get((topic, place), ())

    def take(
        self,
        topic: str,
        place: int,
        message: Any,  # noqa: ANN401 - of the bag's types
    ) -> list[tuple[int, list[Any], list[Any]]]:
        """Enter a message, None for one that cannot be decoded.

        Returns:
            The frames that are complete by it: number, messages with boxes, and those with boxes in
            the image. A frame of which no message could be decoded is left out.
        """
        complete = []
        for number in self.frames_of(topic, place):
            self._left[number] -= 1
            if message is not None and topic == self._flat_topic:
                self._flat[number].append(message)
            elif message is not None:
                self._solid[number].append(message)
            if not self._left[number]:
                solid, flat = self._solid.pop(number, []), self._flat.pop(number, [])
                if solid:
                    complete.append((number, solid, flat))
        return complete

    def rest(self) -> list[tuple[int, list[Any], list[Any]]]:
        """Return the frames of which some messages were read, as take does."""
        found = [
            (number, solid, self._flat.get(number, []))
            for number, solid in sorted(self._solid.items())
        ]
        self._solid.clear()
        return found


def joined(messages: Sequence[Any]) -> Sequence[Any]:
    """Return messages of one moment; of MarkerArrays one with all markers, in their order.

    Those have no frame of their own, and one may delete the markers of another.
    """
    if len(messages) == 1 or not hasattr(messages[0], 'markers'):
        return messages
    return [_Markers([marker for message in messages for marker in message.markers])]


class _Markers:
    """A MarkerArray."""

    def __init__(self, markers: list[Any]) -> None:
        self.markers = markers
