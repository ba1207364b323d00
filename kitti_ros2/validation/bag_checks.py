# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of a bag in one pass over its messages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..bags.bag_files import OpenBag
from ..bags.decoding import Decoder
from ..bags.reader import open_messages
from ..messages.header import peek_header
from ..messages.pixels import size_of
from ..model.containers import CONTAINERS
from ..model.errors import BadBagError, KittiRos2Error
from ..model.msgtypes import CAMERA_INFO, CLOUD, COMPRESSED, FIX, IMAGE, IMU, TF_TYPES
from ..rig.tf_tree import FrameTree, LinkTally
from .bag_rules import BAG_RULES, BagFacts
from .message_rules import CHECKED_TYPES, MESSAGE_RULES, CheckedMessage
from .report import CheckedSource
from .rule import find_breaches
from .source_rules import SOURCE_RULES, Unopened
from .topic_rules import TOPIC_RULES, TopicTrack

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    from ..bags.reader import BagMessage, BagMessages
    from ..options.validating import ValidateOptions
    from .report import FindingTally

_HEADED = frozenset({CLOUD, IMAGE, COMPRESSED, CAMERA_INFO, IMU, FIX})
"""Types of sensors, which begin with a header."""


def check_bag(
    path: Path,
    options: ValidateOptions,
    tally: FindingTally,
    progress: Callable[[int, int], None],
) -> CheckedSource:
    """Check a bag.

    Args:
        path: A file or folder.
        options: How much is read.
        tally: Breaches are entered there.
        progress: Called with the messages done, and the number expected.
    """
    try:
        with OpenBag(path) as bag:
            return _Pass(bag, options, tally).run(progress)
    except (KittiRos2Error, OSError) as error:
        tally.add(find_breaches(SOURCE_RULES, Unopened(path, error)))
        return CheckedSource(path, 'bag', path.name, 0, 0, 0, is_bag=True)


class _Pass:
    """One pass over an open bag."""

    def __init__(self, bag: OpenBag, options: ValidateOptions, tally: FindingTally) -> None:
        self._bag = bag
        self._options = options
        self._tally = tally
        self._facts = BagFacts(bag.path)
        self._tracks: dict[str, TopicTrack] = {}
        self._links = LinkTally()

    def run(self, progress: Callable[[int, int], None]) -> CheckedSource:
        """Read the bag, and apply the rules."""
        located = self._bag.located
        try:
            with open_messages(self._bag) as messages:
                if not self._options.quick:
                    self._read(messages, progress)
                self._facts.losses = list(messages.losses)
                self._facts.notes = [
                    each for each in messages.findings if each not in messages.losses
                ]
                self._facts.left_out = [loss for _, loss in messages.left_out]
        except BadBagError as error:
            self._tally.add(find_breaches(SOURCE_RULES, Unopened(self._bag.path, error)))
        index = self._bag.index
        known = {*self._facts.losses, *self._facts.notes}
        self._facts.notes = [*self._facts.notes, *(set(index.findings) - known)]
        self._facts.messages = index.total
        static, moving, changing = self._links.sorted()
        if static or moving:
            self._facts.tree = FrameTree(static, moving)
            self._facts.changing = changing
        for track in self._tracks.values():
            self._tally.add(find_breaches(TOPIC_RULES, track))
        self._tally.add(find_breaches(BAG_RULES, self._facts))
        size = sum(file.stat().st_size for file in located.files)
        name = self._bag.path.name
        count = len(located.files)
        return CheckedSource(
            self._bag.path, located.container, name, index.total, count, size, is_bag=True
        )

    def _read(self, messages: BagMessages, progress: Callable[[int, int], None]) -> None:
        decode = Decoder(messages.typestore)
        has_qos = CONTAINERS[self._bag.located.storage].in_rosbag2
        expected = messages.expected
        for done, message in enumerate(messages, 1):
            track = self._tracks.get(message.topic)
            if track is None:
                latched = message.topic in messages.latched
                track = TopicTrack(self._bag.path, message.topic, latched, has_qos)
                self._tracks[message.topic] = track
            track.log_ns.append(message.stamp_ns)
            if message.msgtype in _HEADED:
                self._enter_header(message, track)
            if message.msgtype in CHECKED_TYPES:
                self._check(message, decode)
            progress(done, expected)

    def _enter_header(self, message: BagMessage, track: TopicTrack) -> None:
        try:
            stamp_ns, frame = peek_header(message.data)
        except ValueError:
            return  # it cannot be decoded either
        track.header_ns.append(stamp_ns)
        self._facts.frames.setdefault(frame.lstrip('/'), message.topic)

    def _check(self, message: BagMessage, decode: Decoder) -> None:
        value, error = None, ''
        try:
            value = decode(message)
        except ValueError as failure:
            error = str(failure)
        checked = CheckedMessage(
            self._bag.path,
            message.topic,
            message.msgtype,
            message.stamp_ns,
            value,
            error,
            self._options.decode,
        )
        self._tally.add(find_breaches(MESSAGE_RULES, checked))
        if value is not None:
            self._enter(message, value)

    def _enter(self, message: BagMessage, value: Any) -> None:  # noqa: ANN401 - of the bag's types
        if message.msgtype in TF_TYPES:
            self._links.add(value, still=message.topic.endswith('tf_static'))
        elif message.msgtype == CAMERA_INFO:
            self._facts.cameras[message.topic] = int(value.width), int(value.height)
        elif message.msgtype in {IMAGE, COMPRESSED} and message.topic not in self._facts.images:
            size = size_of(value)
            if size is not None:
                self._facts.images[message.topic] = size
