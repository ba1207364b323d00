# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Decoded messages of a plan's frames -> the files of their samples."""

from __future__ import annotations

from collections import Counter
from threading import Lock
from typing import TYPE_CHECKING, Any

from ..model.streams import Stream
from .calibration_source import is_extract
from .convert_scans import dropped_notes
from .depth_maps import DepthMaps
from .frames import frame_topics
from .frames_at import BoxTimes
from .label_messages import joined
from .pose_track import camera_poses
from .sync import NONE

if TYPE_CHECKING:
    from ..kitti.writer import LayoutWriter
    from ..rig.pose_track import Track
    from .apply_calibration import Rigging
    from .frames import Frames
    from .plan import Plan
    from .riggings import Riggings


class SampleWriter:
    """Converts messages to samples and writes them; scans and images from several threads.

    Attributes:
        plan: The rules.
        frames: Those to write.
        riggings: Convert messages to samples.
        writer: Of the layout.
        first: The number of the first frame.
        empty_labels: Number of frames without a box so far.
    """

    def __init__(
        self, plan: Plan, frames: Frames, riggings: Riggings, writer: LayoutWriter, first: int
    ) -> None:
        self.plan = plan
        self.frames = frames
        self.riggings = riggings
        self.writer = writer
        self.first = first
        self.empty_labels = 0
        rigging = riggings.first
        labels_t_velo = rigging.labels.standing.frame_T_velo
        if labels_t_velo is not None:
            writer.place_labels(labels_t_velo)
        self._depth_maps = DepthMaps(plan, rigging, writer, unrectified=is_extract(plan))
        self._lock = Lock()  # for the counts of scans
        self._points_dropped: Counter[str] = Counter()

    def write_calibration(self) -> int:
        """Write the calibration of every frame, or of all; return how many were written."""
        count = 0
        stamps_ns = self.frames.stamps_ns.tolist()
        if not self.plan.layout.traits.calibration_per_frame:
            del stamps_ns[1:]
        for number, stamp_ns in enumerate(stamps_ns, self.first):
            calibration = self._rigging(number).calibrations.at(stamp_ns)
            if calibration is not None:
                self.writer.write_calibration(number, calibration)
                count += 1
        return count

    def write_scan(self, number: int, topic: str, place: int, cloud: Any) -> int:  # noqa: ANN401 - of the bag
        """Write a scan, by its place in its topic; return its bytes.

        Raises:
            ValueError: No point is left of it.
        """
        stamp_ns = self._stamp_ns(number, topic, place)
        rigging = self._rigging(number)
        scan, dropped = rigging.scans.scan(cloud, self._own_ns(topic, place), place)
        with self._lock:
            self._points_dropped.update(dropped)
        if not len(scan.points):
            reasons = ', '.join(reason for reason, count in dropped.items() if count)
            raise ValueError(f'no point is left of it: {reasons}' if reasons else 'it has no point')
        self.writer.write_scan(number, stamp_ns, scan)
        self._depth_maps.write(number, stamp_ns, scan.points, rigging)
        return scan.points.nbytes

    def write_image(self, camera: int, number: int, topic: str, place: int, image: Any) -> int:  # noqa: ANN401 - of the bag
        """Write an image, by its place in its topic; return its bytes."""
        png = self._rigging(number).images.png(camera, image)
        self.writer.write_image(camera, number, self._stamp_ns(number, topic, place), png)
        return len(png)

    def write_labels(self, number: int, solid: list[Any], flat: list[Any]) -> int:
        """Write the labels of a frame; return 0: sizes are those of scans and images.

        Args:
            number: Of the frame.
            solid: The messages with boxes.
            flat: Those with boxes in the image.
        """
        frame = number - self.first
        times = times_of_boxes(self.plan, self.frames, frame)
        stamp_ns = int(self.frames.stamps_ns[frame])
        boxes = self._rigging(number).labels.boxes(joined(solid), stamp_ns, times, flat)
        self.writer.write_labels(number, boxes)
        self.empty_labels += not boxes
        return 0

    def write_poses(self, track: Track) -> int:
        """Write the poses of the frames, each of which must have one; return how many."""
        stamps_ns = self.frames.stamps_ns
        poses = camera_poses(track, stamps_ns, self.riggings.first.body_t_rect())
        known = [pose for pose in poses if pose is not None]
        for number, (stamp_ns, pose) in enumerate(zip(stamps_ns.tolist(), known, strict=True)):
            self.writer.write_pose(number, stamp_ns, pose)
        return len(known)

    def notes(self) -> list[str]:
        """Return what was written of depth maps and tracks, and which points were dropped."""
        notes = [*self._depth_maps.notes(), *self.writer.notes()]
        if self.plan.scan is not None:
            notes += dropped_notes(self.plan.scan.topic, self._points_dropped)
        return notes

    def _rigging(self, number: int) -> Rigging:
        return self.riggings.of(number - self.first)

    def _stamp_ns(self, number: int, topic: str, place: int) -> int:
        """Return a sample's own stamp where the layout stores it, else the frame's."""
        if self.plan.layout.traits.stamps_per_stream:
            return self._own_ns(topic, place)
        return int(self.frames.stamps_ns[number - self.first])

    def _own_ns(self, topic: str, place: int) -> int:
        return int(self.frames.stamps[topic][place])


def times_of_boxes(plan: Plan, frames: Frames, frame: int) -> BoxTimes:
    """Return when the boxes of a frame and its scan are placed, by the position of the frame."""
    topics = frame_topics(plan)
    place = int(frames.samples[Stream.LABELS][frame])
    boxes = topics[Stream.LABELS]
    own_ns, moved_ns = (int(each[boxes][place]) for each in (frames.stamps, frames.moved_ns))
    cloud_ns = int(frames.stamps_ns[frame])
    scans = frames.samples.get(Stream.SCAN)
    if scans is not None and scans[frame] != NONE:
        cloud_ns = int(frames.stamps[topics[Stream.SCAN]][scans[frame]])
    return BoxTimes(own_ns - moved_ns, cloud_ns, moved_ns)
