# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A survey of the beginning of a program: the frames of its topics, and its transforms.

It precedes all output: a camera's boxes may come before its first image, and a view needs its frame
at the start.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.camera_info import camera_model, decode_static
from ..messages.cdr import peek_header
from ..messages.naming import without_transport
from ..messages.rectified_cameras import viewpoints
from ..messages.tf_tree import FrameTree
from ..model.bag_formats import CAMERA_INFO, CLOUD, COMPRESSED, DETECTIONS_2D, IMAGE, TF, VIDEOS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..messages.camera_info import CameraModel
    from ..messages.cdr import Message
    from ..messages.rectified_cameras import Viewpoint
    from ..model.geometry import Transform
    from ..player.program import Program


IMAGES = (COMPRESSED, IMAGE, *sorted(VIDEOS))

_LONGEST_NS = 3_000_000_000
_MOST = 3000
_BESIDE_M = 1e-3
_STAMPED = frozenset({CAMERA_INFO, CLOUD, DETECTIONS_2D, *IMAGES})


@dataclass
class ProgramSurvey:
    """The result of a survey.

    Attributes:
        topics: Topic to message type, in the program's order.
        frames: Topic of clouds, cameras and their boxes to the frame of the first message.
        cameras: CameraInfo topic to the model of the first message.
        parents: Frame to its parent.
        links: Frame to its parent and parent_T_frame, static links only.
    """

    topics: dict[str, str]
    frames: dict[str, str] = field(default_factory=dict)
    cameras: dict[str, CameraModel] = field(default_factory=dict)
    parents: dict[str, str] = field(default_factory=dict)
    links: dict[str, tuple[str, Transform]] = field(default_factory=dict)

    def of_type(self, *msgtypes: str) -> list[str]:
        """Return the topics with one of these types."""
        return [topic for topic, msgtype in self.topics.items() if msgtype in msgtypes]

    def info_of(self, image: str) -> str | None:
        """Return the CameraInfo topic of an image topic: camera_info in the same namespace."""
        stem = without_transport(image)
        info = f'{stem.rpartition("/")[0]}/camera_info'
        return info if self.topics.get(info) == CAMERA_INFO else None

    def images_of(self, info: str) -> list[str]:
        """Return the image topics of a CameraInfo topic."""
        return [image for image in self.of_type(*IMAGES) if self.info_of(image) == info]

    def images_in(self, frame: str) -> list[str]:
        """Return the image topics of the camera at a frame.

        A right camera's images have the left one's frame_id; they are skipped if the left one's
        images are present.
        """
        inside = [image for image in self.of_type(*IMAGES) if self.frames.get(image) == frame]
        unshifted = [image for image in inside if not self._is_beside(self.info_of(image))]
        return unshifted or inside

    def tree(self) -> FrameTree:
        """Return the links as a tree."""
        fixed = [(parent, child, link) for child, (parent, link) in self.links.items()]
        moving = set(self.parents) - set(self.links)
        return FrameTree(fixed, [(self.parents[child], child) for child in moving])

    def _is_beside(self, info: str | None) -> bool:
        """Return whether a camera is beside its frame, as a right one with the left one's frame."""
        model = self.cameras.get(info or '')
        return model is not None and float(np.abs(model.offset).max()) > _BESIDE_M

    def vehicle(self) -> str:
        """Return the frame of the view: the mount of clouds, else of cameras; '' without any."""
        for topic in (*self.of_type(CLOUD), *self.of_type(*IMAGES), *self.of_type(CAMERA_INFO)):
            if topic in self.frames:
                return self._mount(self.frames[topic])
        moving = sorted(set(self.parents) - set(self.links))
        return moving[0] if moving else self._mount(next(iter(self.parents), ''))

    def _mount(self, frame: str) -> str:
        visited = {frame}
        while frame in self.links and self.links[frame][0] not in visited:
            frame = self.links[frame][0]
            visited.add(frame)
        return frame


class ProgramCameras:
    """The cameras of a program, each with the model of its last CameraInfo."""

    def __init__(self, survey: ProgramSurvey) -> None:
        self._tree = survey.tree()
        self._models = dict(survey.cameras)

    def update(self, topic: str, model: CameraModel) -> Viewpoint:
        """Set the model of a CameraInfo topic, and return the camera's viewpoint.

        The reference of a right camera's offset differs between bags; see
        messages/rectified_cameras.py.
        """
        self._models[topic] = model
        # Sorted by name, a left camera precedes its right one.
        numbers = {name: number for number, name in enumerate(sorted(self._models))}
        models = {numbers[name]: camera for name, camera in self._models.items()}
        return viewpoints(self._tree, models)[0][numbers[topic]]


def make_survey(program: Program) -> ProgramSurvey:
    """Survey the messages up to the first of every topic, at most three seconds.

    Undecodable messages are ignored here.
    """
    survey = ProgramSurvey({outlet.topic: outlet.msgtype for outlet in program.channels})
    unseen = set(range(len(program.channels)))
    for due in _first_messages(program):
        _note(survey, program, due, first=due.channel in unseen)
        unseen.discard(due.channel)
        if not unseen:
            break
    return survey


def _first_messages(program: Program) -> Iterator[Message]:
    yield from program.latched_before(0)
    every = range(len(program.channels))
    last_ns = int(program.stamps_ns[0]) + _LONGEST_NS
    for index, stamp_ns in enumerate(program.stamps_ns[:_MOST].tolist()):
        if stamp_ns > last_ns:
            return
        yield from program.fetch(index, every)[0]


def _note(survey: ProgramSurvey, program: Program, due: Message, *, first: bool) -> None:
    outlet = program.channels[due.channel]
    try:
        if outlet.msgtype in _STAMPED and first:
            survey.frames[outlet.topic] = frame_name(peek_header(due.data)[1])
        if outlet.msgtype == CAMERA_INFO and first:
            info: Any = program.typestore.deserialize_cdr(due.data, CAMERA_INFO)
            survey.cameras[outlet.topic] = camera_model(info)
        if outlet.msgtype == TF:
            message: Any = program.typestore.deserialize_cdr(due.data, TF)
            static = outlet.latched or outlet.topic.endswith('tf_static')
            for parent, child, link in decode_static(message):
                survey.parents[frame_name(child)] = frame_name(parent)
                if static:
                    survey.links[frame_name(child)] = (frame_name(parent), link)
    except Exception:  # noqa: BLE001, S110 - a recorder may have written any bytes; reported later
        pass


def frame_name(frame_id: str) -> str:
    """Return a frame's name; as in tf2, without the leading slash of ROS 1."""
    return frame_id.lstrip('/')
