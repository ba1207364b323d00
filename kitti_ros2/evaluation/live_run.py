# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One run of a stack: it is started, played to, recorded and stopped."""

from __future__ import annotations

import threading
import time
from contextlib import nullcontext
from typing import TYPE_CHECKING

from ..bags.writer import guess_storage, open_bag
from ..messages.cdr import deserialize
from ..messages.header import peek_header, stamp_ns_of
from ..messages.ros_types import TYPESTORE
from ..model.channels import Channel
from ..model.errors import KittiRos2Error, UsageError
from ..model.losses import Loss
from ..model.msgtypes import MARKERS, TF
from ..model.spelling import did_you_mean
from ..model.stamps import NS_PER_S
from ..model.text import format_count, some_of
from ..options.bag import BagOptions
from ..player.answers import Answers
from .live_losses import LiveRun, enter_losses, why_nothing
from .node_process import NodeProcess, StackError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from ..bags.writer import BagWriter
    from ..node.live_player import LivePlayer
    from ..options.eval_live import LiveOptions

    Progress = Callable[[int, int], None]

_LOOK_EVERY_S = 0.02
_TRANSFORMS = (Channel('/tf', TF, depth=100), Channel('/tf_static', TF, latched=True, depth=100))


def record_run(
    source: Path,
    options: LiveOptions,
    played: Mapping[str, object],
    bag: Path,
    accept: Callable[[str], None],
    show: Callable[[bytes], object],
    progress: Progress,
) -> LiveRun:
    """Play a source to a stack and write its results to a bag, with the transforms.

    Args:
        source: A KITTI folder or a bag.
        options: Those of the run.
        played: Those of the player, by name.
        bag: The bag to write.
        accept: Called with the type of the topic; raises an error if it cannot be scored.
        show: Called with each line of the node's output.
        progress: Called with the numbers of answered frames and of all.

    Raises:
        KittiRos2Error: The source cannot be played, or the stack does not start or answer.
    """
    from ..node.live_player import open_live_player  # noqa: PLC0415 - needs rclpy

    answers = Answers(options.timeout_ns)
    storage = BagOptions(storage=guess_storage(bag), overwrite=options.overwrite)
    with (
        open_bag(bag, storage, TYPESTORE) as writer,
        open_live_player(source, played, options.wait_for, answers) as player,
        nullcontext() if options.node is None else NodeProcess(options.node, show) as node,
    ):
        stage = _Stage(player, node, options, writer, answers, accept)
        try:
            stage.wait_until_ready()
            stage.play(progress)
        finally:
            stage.end_recording()
    if node is not None and node.killed:
        stage.run.notes.append('the node was killed: it ended neither by SIGINT nor by SIGTERM')
    return stage.run


class _Stage:
    """The player, the node and the bag of a run."""

    def __init__(
        self,
        player: LivePlayer,
        node: NodeProcess | None,
        options: LiveOptions,
        bag: BagWriter,
        answers: Answers,
        accept: Callable[[str], None],
    ) -> None:
        self._player = player
        self._node = node
        self._options = options
        self._bag = bag
        self._answers = answers
        self._accept = accept
        self._begin_ns = int(player.session.program.stamps_ns[0])
        self._error: KittiRos2Error | None = None
        self._writing = threading.Lock()
        self._recording = True
        self.run = LiveRun(answers, options.topic, notes=[*player.session.program.notes()])

    def wait_until_ready(self) -> None:
        """Wait until the topic has a publisher, and enough nodes subscribe.

        Raises:
            StackError: The node has ended, or the time is up.
            KittiRos2Error: Results of the topic's type cannot be scored.
        """
        self._refuse_own_topic()
        end = time.monotonic() + self._options.start_timeout_ns / NS_PER_S
        while not (self._hears() and not self._player.playback.state().waiting):
            if self._node is not None and (how := self._node.ended()):
                raise StackError(f'the node ended before the first frame: {how}')
            if time.monotonic() > end:
                raise StackError(self._what_is_missing())
            time.sleep(_LOOK_EVERY_S)
        topic = self._options.topic
        if (publishers := self._player.count_publishers(topic)) > 1:
            self.run.notes.append(f'{topic} has {publishers} publishers: their results are mixed')
        for channel in _TRANSFORMS:
            self._record(channel)

    def play(self, progress: Progress) -> None:
        """Play everything and wait for the last answer; what went wrong becomes a loss.

        Raises:
            StackError: The stack has answered no frame.
            KittiRos2Error: The player or the bag failed.
        """
        player, answers = self._player, self._answers
        total = len({*player.session.program.frames.tolist()})
        player.playback.resume()
        problem = ''
        while not (problem or player.error or (player.ended.is_set() and answers.all_in())):
            time.sleep(_LOOK_EVERY_S)
            progress(len(answers.latencies_ns), total)
            problem = self._problem()
        player.playback.stop()
        player.ended.wait()
        if player.error is not None:
            raise player.error
        if not answers.latencies_ns:
            raise StackError(why_nothing(self.run, problem))
        enter_losses(self.run, problem, total)
        for reason, lost in player.session.counts.dropped.items():
            self.run.losses.append(Loss('player', max(1, lost), reason))

    def _hears(self) -> bool:
        """Subscribe to the topic once it has a publisher; return whether it is connected."""
        topic = self._options.topic
        found = [] if self.run.msgtype else self._player.types_of(topic)
        if found:
            self.run.msgtype = self._choose(found)
            self._record(Channel(topic, self.run.msgtype))
        return self._player.hears(topic)

    def _choose(self, found: list[str]) -> str:
        """Return the type to subscribe to, of those that the topic has.

        Raises:
            KittiRos2Error: It is not the one requested, one of several, or none that can be scored.
        """
        chosen = self._options.msgtype or found[0]
        if chosen not in found or (len(found) > 1 and self._options.msgtype is None):
            raise UsageError(f'{self._options.topic} is {" and ".join(found)}; give --type')
        self._accept(chosen)
        return chosen

    def _record(self, channel: Channel) -> None:
        """Subscribe to a topic, and write its messages to the bag."""
        with self._writing:
            number = self._bag.add_channel(channel)
        is_result = channel.topic == self._options.topic

        def receive(data: bytes) -> None:
            try:
                if is_result:
                    self._answers.received(stamp_of(data, channel.msgtype))
                with self._writing:
                    if self._recording:
                        stamp_ns = self._answers.newest_ns or self._begin_ns
                        self._bag.write(number, stamp_ns, (data,))
            except KittiRos2Error as error:
                self._error = self._error or error

        self._player.hear(channel.topic, channel.msgtype, receive)

    def end_recording(self) -> None:
        """Ignore what is received from now on: a player that closes slowly still receives."""
        with self._writing:
            self._recording = False

    def _problem(self) -> str:
        """Return why the run cannot continue; empty if it can."""
        answers = self._answers
        if self._error is not None:
            raise self._error
        if self._node is not None and (how := self._node.ended()):
            return f'the node ended early: {how}'
        if answers.flooded():
            frames = format_count(len(answers.frames()), 'frame')
            return f'{answers.messages} messages for {frames}; a node answers each frame once'
        if answers.silent():
            return f'no answer within {self._options.timeout_ns / NS_PER_S:g} s'
        return ''

    def _refuse_own_topic(self) -> None:
        topics = [channel.topic for channel in self._player.session.program.channels]
        if self._options.topic in topics:
            raise UsageError(f'{self._options.topic} is played itself; give a topic of the node')

    def _what_is_missing(self) -> str:
        topic, seconds = self._options.topic, self._options.start_timeout_ns / NS_PER_S
        if not self._player.hears(topic):
            others = self._player.others()
            hint = did_you_mean(topic, others) or (
                f'; others publish {some_of(others)}' if others else '; nobody publishes anything'
            )
            return f'{topic} has no publisher after {seconds:g} s{hint}'
        channels = self._player.session.program.channels
        offered = some_of([each.topic for each in channels if each.on_demand])
        needed = self._options.wait_for
        few = 'no node' if needed == 1 else f'fewer than {needed} nodes'
        return f'{few} subscribed to the player within {seconds:g} s; it offers {offered}'


def stamp_of(data: bytes, msgtype: str) -> int | None:
    """Return the stamp of a serialised result, nanoseconds; None if it has none.

    That of a MarkerArray is the latest of its markers: the first may only delete the others.
    """
    try:
        if msgtype != MARKERS:
            return peek_header(data)[0]
        markers = deserialize(data, MARKERS).markers
    except Exception:  # noqa: BLE001 - a damaged message may raise anything
        return -1
    return max((stamp_ns_of(marker.header) for marker in markers), default=0) or None
