# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is in a bag, from one pass over it: stamps, frames, calibration, and a look at each topic.

Of large messages the header alone is read, so the pass goes as fast as the bag can be read.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.header import peek_header
from ..messages.source import decode_text
from ..messages.transforms import decode_static
from .blueprint import CALIBRATION
from .sync import usable_stamps

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import TypeAlias

    from ..bags.reader import BagMessage, BagMessages
    from ..geometry import Transform
    from ..samples import Int64Array, TextFile

CLOUD = 'sensor_msgs/msg/PointCloud2'
IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED = 'sensor_msgs/msg/CompressedImage'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
IMU = 'sensor_msgs/msg/Imu'
FIX = 'sensor_msgs/msg/NavSatFix'
TWIST = 'geometry_msgs/msg/TwistStamped'
ODOMETRY = 'nav_msgs/msg/Odometry'
POSE = 'geometry_msgs/msg/PoseStamped'
PATH = 'nav_msgs/msg/Path'
TF_TYPES = frozenset({'tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage'})
DETECTIONS = 'vision_msgs/msg/Detection3DArray'
MARKERS = 'visualization_msgs/msg/MarkerArray'
STRING = 'std_msgs/msg/String'
LABEL_LINES = '/kitti/source/labels'

_HEADED = frozenset(
    {CLOUD, IMAGE, COMPRESSED, CAMERA_INFO, IMU, FIX, TWIST, ODOMETRY, POSE, PATH, DETECTIONS}
)
_READ = _HEADED | TF_TYPES | {MARKERS}
_STILL_M = 1e-6
_LOOKS = 8

Link: TypeAlias = 'tuple[str, str, Transform]'


@dataclass
class TopicSurvey:
    """One topic.

    Attributes:
        name, msgtype: As the bag has them.
        log_ns: Log times in the order of reading, nanoseconds.
        header_ns: Header stamps of the same messages; empty where the type has no header.
        frames: Header frames, with how often each comes.
        looks: A few decoded messages, evenly spread by doubling distances.
        failure: Why a look could not be decoded, empty where all could.
    """

    name: str
    msgtype: str
    log_ns: list[int] = field(default_factory=list)
    header_ns: list[int] = field(default_factory=list)
    frames: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    looks: list[Any] = field(default_factory=list)
    failure: str = ''

    @property
    def count(self) -> int:
        """Messages."""
        return len(self.log_ns)

    @property
    def frame(self) -> str:
        """The frame of most of its messages, without a leading slash."""
        return max(self.frames, key=lambda name: self.frames[name]) if self.frames else ''

    def stamps(self) -> tuple[Int64Array, str | None]:
        """The stamps to go by, (N,) nanoseconds in the order of reading, and why not the headers'.

        Header stamps of 0 or out of order cannot be meant; log time takes their place.
        """
        log = np.array(self.log_ns, dtype=np.int64)
        if len(self.header_ns) != len(self.log_ns):
            return log, None
        return usable_stamps(np.array(self.header_ns, dtype=np.int64), log)


@dataclass(frozen=True)
class Survey:
    """What a pass found.

    Attributes:
        topics: By name; types that nothing is made of have counts only.
        static: Static transforms (parent, child, parent_T_child), those of /tf that never move
            among them.
        moving: (parent, child) of the others.
        changing: (parent, child) of static links that were told anew and differently.
        calibrations: The calibration files that a bag of our own carries, each with the stamp from
            which it holds, in order.
    """

    topics: Mapping[str, TopicSurvey]
    static: Sequence[Link]
    moving: Sequence[tuple[str, str]]
    changing: Sequence[tuple[str, str]] = ()
    calibrations: Sequence[tuple[int, TextFile]] = ()

    def of_type(self, *msgtypes: str) -> list[TopicSurvey]:
        """The topics of some types that have messages, by name."""
        found = [each for each in self.topics.values() if each.msgtype in msgtypes and each.count]
        return sorted(found, key=lambda each: each.name)


def survey_bag(messages: BagMessages) -> Survey:
    """Pass over a bag once.

    Raises:
        BadBagError: It cannot be read.
    """
    topics = {name: TopicSurvey(name, msgtype) for name, msgtype in messages.channels}
    links = _Links()
    calibrations: list[tuple[int, TextFile]] = []
    for message in messages:
        topic = topics[message.topic]
        topic.log_ns.append(message.stamp_ns)
        if topic.name == CALIBRATION and topic.msgtype == STRING:
            text = _decoded(topic, messages, message)
            if text is not None:
                calibrations.append((message.stamp_ns, decode_text(text)))
        if topic.msgtype not in _READ:
            continue
        if topic.msgtype in TF_TYPES:
            links.add(_decoded(topic, messages, message), still='static' in topic.name)
            continue
        if topic.msgtype in _HEADED:
            _enter_header(topic, message)
        if topic.count.bit_count() == 1 and len(topic.looks) < _LOOKS:
            look = _decoded(topic, messages, message)
            if look is not None:
                topic.looks.append(look)
    return Survey(topics, *links.sorted(), calibrations)


def _enter_header(topic: TopicSurvey, message: BagMessage) -> None:
    try:
        stamp_ns, frame = peek_header(message.data)
    except ValueError as error:
        topic.failure = topic.failure or str(error)
        stamp_ns, frame = 0, ''
    topic.header_ns.append(stamp_ns)
    topic.frames[frame.lstrip('/')] += 1


def _decoded(topic: TopicSurvey, messages: BagMessages, message: BagMessage) -> Any:  # noqa: ANN401
    try:
        return messages.typestore.deserialize_cdr(message.data, message.msgtype)
    except Exception as error:  # noqa: BLE001 - generated code lets anything out
        topic.failure = topic.failure or f'{type(error).__name__}: {error}'
        return None


class _Links:
    """Transforms by (parent, child): the first of each, and whether it ever moved."""

    def __init__(self) -> None:
        self._first: dict[tuple[str, str], Transform] = {}
        self._seen: dict[tuple[str, str], int] = defaultdict(int)
        self._moving: set[tuple[str, str]] = set()
        self._static: set[tuple[str, str]] = set()
        self._changing: set[tuple[str, str]] = set()

    def add(self, message: Any, *, still: bool) -> None:  # noqa: ANN401 - of the bag's types
        for parent, child, transform in decode_static(message) if message is not None else ():
            key = (parent.lstrip('/'), child.lstrip('/'))
            first = self._first.setdefault(key, transform)
            self._seen[key] += 1
            if still:
                # The last word on a static link holds, as for any late subscriber.
                if _differ(first, transform):
                    self._changing.add(key)
                self._first[key] = transform
                self._static.add(key)
            elif key not in self._moving and _differ(first, transform):
                self._moving.add(key)

    def sorted(self) -> tuple[list[Link], list[tuple[str, str]], list[tuple[str, str]]]:
        """Static links, moving ones, static ones that changed; one seen once on /tf moves."""
        moving = {key for key in self._moving if key not in self._static}
        moving |= {key for key, n in self._seen.items() if n == 1 and key not in self._static}
        still = [(*key, pose) for key, pose in self._first.items() if key not in moving]
        return still, sorted(moving), sorted(self._changing)


def _differ(first: Transform, second: Transform) -> bool:
    return bool((np.abs(first.matrix() - second.matrix()) > _STILL_M).any())
