# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A session: the thread that publishes the due messages of one program."""

from __future__ import annotations

import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..files.processes import FreeMemory
from ..messages.cdr import CdrWriter, LastKeys, restamp_message
from ..messages.markers import encode_clear
from ..messages.naming import FrameNames
from ..model.bag_formats import MARKERS
from ..model.streams import format_stamp
from ..options.outputs import Stamps
from .playback import Idle, Jump, Playback, Send, Tick
from .program import ReadAhead

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ..messages.cdr import Message
    from ..model.bag_formats import Channel
    from ..options.table import PlaySettings
    from .playback import Event, PlaybackState
    from .program import Program


# The interface between a session and its middleware or server, and statistics of subscribers.

SETTLED_NS = 1_000_000_000
"""Time without changes of subscriptions before playback begins.

`ros2 bag record -a` looks for topics ten times a second and subscribes to them one by one;
starting at the first match would lose messages of topics that are not matched yet.
"""

_QUERY_EVERY_NS = 50_000_000


class Audience(NamedTuple):
    """The subscribers of the topics that are played.

    Attributes:
        subscribers: Nodes with a matched subscription to at least one of the topics.
        subscriptions: Matched subscriptions of all topics.
    """

    subscribers: int
    subscriptions: int


class Transport(ABC):
    """The carrier of the messages of a program: a middleware or a server; used by one thread.

    Args:
        channels: The topics.

    Attributes:
        channels: The topics.
        unpublishable: Channels that cannot be published, with the reason.
    """

    def __init__(self, channels: Sequence[Channel]) -> None:
        self.channels = channels
        self.unpublishable: dict[int, str] = {}
        self._wanted: frozenset[int] = frozenset()
        self._queried_ns = 0

    def query_wanted(self) -> frozenset[int]:
        """Return the on-demand outlets that have a subscriber now."""
        self._queried_ns = time.monotonic_ns()
        self._wanted = frozenset(
            index
            for index, outlet in enumerate(self.channels)
            if outlet.on_demand and index not in self.unpublishable and self.has_subscriber(index)
        )
        return self._wanted

    def wanted(self, now_ns: int) -> frozenset[int]:
        """Return the same, cached for a short time; now_ns is steady time."""
        if now_ns - self._queried_ns > _QUERY_EVERY_NS:
            self.query_wanted()
        return self._wanted

    @abstractmethod
    def audience(self) -> Audience:
        """Count the current subscribers."""

    @abstractmethod
    def has_subscriber(self, outlet: int) -> bool:
        """Return whether an outlet has a subscriber now."""

    @abstractmethod
    def publish(self, outlet: int, data: bytes, stamp_ns: int) -> None:
        """Publish serialised data; stamp_ns is its time in the recording."""

    def make_room(self, outlet: int, seconds: float) -> bool:  # noqa: ARG002 - always room here
        """Wait until an outlet has room for one more message; return whether it has."""
        return True

    def may_begin(self, frame: int, seconds: float) -> bool:  # noqa: ARG002 - always here
        """Wait until the messages of a frame may be published, in lossless mode; return whether."""
        return True

    @abstractmethod
    def publish_time(self, stamp_ns: int) -> None:
        """Publish the recording's time."""

    def jump(self, stamp_ns: int) -> None:  # noqa: B027 - subscribers may notice it themselves
        """Announce a seek to a time: what subscribers hold of another time is outdated."""

    @abstractmethod
    def finish(self, seconds: float) -> tuple[str, ...]:
        """Wait until all messages have arrived; return the topics whose messages have not."""

    @abstractmethod
    def close(self) -> None:
        """Remove the topics."""


class SubscriberWait:
    """Decides when to begin: enough subscribers, and no new subscription for SETTLED_NS.

    Args:
        needed: Number of subscribers; 0 does not wait.
    """

    def __init__(self, needed: int) -> None:
        self.needed = needed
        self._audience = Audience(0, 0)
        self._since_ns = 0

    def over(self, audience: Audience, now_ns: int) -> bool:
        """Return whether to begin, given the current audience; now_ns is steady time."""
        if audience != self._audience:
            self._audience, self._since_ns = audience, now_ns
        enough = audience.subscribers >= self.needed
        return enough and now_ns - self._since_ns >= SETTLED_NS

    def beginning(self) -> str:
        """Return the message shown when the wait begins, one line."""
        nodes = 'a subscriber' if self.needed == 1 else f'{self.needed} subscribers'
        return f'waiting for {nodes}; --wait-for 0 starts at once'

    def ending(self) -> str:
        """Return the message shown when the wait ends, one line."""
        subscribers, subscriptions = self._audience
        return f'subscribers: {subscribers}, with {subscriptions} subscriptions'


class Reception:
    """Counts messages with and without a subscriber at the time they were due, by topic.

    Latched messages are not counted: late subscribers receive them.
    """

    def __init__(self) -> None:
        self._received: Counter[int] = Counter()
        self._missed: Counter[int] = Counter()

    def note(self, outlet: int, *, received: bool) -> None:
        """Count one message of an outlet."""
        (self._received if received else self._missed)[outlet] += 1

    def describe(self) -> str:
        """Describe the messages without a subscriber in one line; empty if all had one."""
        missed, received = dict(self._missed), dict(self._received)  # another thread keeps counting
        count = sum(missed.values())
        if not count:
            return ''
        total = count + sum(received.values())
        text = f'{count} of {total} messages had no subscriber (latched ones are not counted)'
        partly = sum(count for outlet, count in missed.items() if outlet in received)
        if partly:
            text += f'; {partly} of these on topics that had one at another time'
        return text


LAST_WAIT_S = 1.4
"""Limit of the wait until the last messages have arrived."""

_STOPPED_WAIT_S = 0.4
_PATIENCE_S = 0.2
_LONG_GAP_NS = 20_000_000


# How long a decoding thread may keep the interpreter while a message is due.
_SWITCH_INTERVAL_S = 0.0005


def favour_what_is_due() -> None:
    """Shorten the thread switch interval, so that decoding does not delay due messages."""
    sys.setswitchinterval(_SWITCH_INTERVAL_S)


@dataclass
class Counts:
    """The statistics of a session so far.

    Attributes:
        messages: Published messages.
        failures: Messages that could not be made.
        late_ns: Maximum delay of a published message, nanoseconds.
        frames: Played frames; a frame counts again when it is played again.
        dropped: The number of failures by reason.
    """

    messages: int = 0
    failures: int = 0
    late_ns: int = 0
    frames: int = 0
    dropped: Counter[str] = field(default_factory=Counter)


class Session:
    """Plays a program until it ends or is stopped.

    Args:
        program: The program; closed at the end.
        settings: Playback settings.
        connect: Creates the topics of a program.
        warn: Called once with each reason why something cannot be published.
        changed: Called, from the session's thread, when the state has changed.
        say: Called with one line when the wait for subscribers begins and when it ends.

    Attributes:
        playback: The controls.
        counts: Statistics so far.
        reception: Counts of messages with and without a subscriber.
        late: Topics whose last messages had not arrived LAST_WAIT_S after the end.
        on_publish: Called with each outlet, its sample's due time and the time of the call, steady
            nanoseconds; for benchmarks.
    """

    on_publish: Callable[[int, int, int], None] | None = None

    def __init__(
        self,
        program: Program,
        settings: PlaySettings,
        connect: Callable[[Program], Transport],
        warn: Callable[[str], None],
        changed: Callable[[], None],
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.program = program
        self._settings = settings
        self._connect = connect
        self._warn = warn
        self._changed = changed
        self._say = say
        self.playback = Playback(
            program.stamps_ns,
            program.frames,
            settings.playback,
            longest_gap_ns=program.longest_gap_ns,
        )
        self.counts = Counts()
        self.reception = Reception()
        self.late: tuple[str, ...] = ()
        self._wait = SubscriberWait(settings.playback.subscribers)
        self._thread = threading.Thread(target=self._run, name='playback', daemon=True)
        self._done: Callable[[BaseException | None], None] = lambda _: None
        self._warned: set[str] = set()
        self._last_keys = LastKeys()
        self._free_memory = FreeMemory()
        self._markers = [
            index for index, outlet in enumerate(program.channels) if outlet.msgtype == MARKERS
        ]
        self._stale: set[int] = set()
        self._frame: int | None = None
        self._at_rest = True
        self._wall_ns = 0

    def start(self, done: Callable[[BaseException | None], None]) -> None:
        """Create the topics and begin.

        Args:
            done: Called at the end, from the session's thread, with the error that caused it.
        """
        self._transport = self._connect(self.program)
        self._done = done
        for reason in (*self.program.losses, *self._transport.unpublishable.values()):
            self._warn_once(reason, 0)
        self._thread.start()

    def stop(self) -> None:
        """Stop, and remove the topics."""
        self.playback.stop()
        if self._thread.ident is not None:
            self._thread.join()
            self._transport.close()
        self.program.close()

    def _run(self) -> None:
        error: BaseException | None = None
        try:
            self._play()
        except BaseException as caught:  # noqa: BLE001 - done hands it to the main thread
            error = caught
        self._done(error)

    def _play(self) -> None:
        frames = len(set(self.program.frames.tolist()))
        samples = -(-len(self.program.stamps_ns) * self._settings.read_ahead // frames)
        with ReadAhead(self.program, samples, polite=not self._settings.playback.lossless) as ahead:
            ahead.want(self._transport.query_wanted())
            ahead.refill()
            self._prepare(0, ahead)
            if self.playback.state().waiting:
                self._say(self._wait.beginning())
            for event in self.playback.events():
                self._do(event, ahead)
            if self.playback.stopped:
                self._transport.finish(_STOPPED_WAIT_S)
                return
            self.late = self._transport.finish(LAST_WAIT_S)
            if self.late and self.playback.options.lossless:
                self._warn(
                    f'{", ".join(self.late)}: the last messages were not acknowledged within'
                    f' {LAST_WAIT_S:g} s; a subscriber may have lost them'
                )
        for reason in self.program.losses:
            self._warn_once(reason, 0)  # those found since the start

    def _prepare(self, position: int, ahead: ReadAhead) -> None:
        """Wait for the rest of the frame at a position: else it would be late, by its making."""
        frames = self.program.frames[position:]
        if len(frames):
            others = np.flatnonzero(frames != frames[0])
            ahead.prepare(position, int(others[0]) if len(others) else len(frames))

    def _do(self, event: Event, ahead: ReadAhead) -> None:
        if isinstance(event, Send):
            self._send(event, ahead)
        elif isinstance(event, Tick):
            self._publish_time(event.stamp_ns)
        elif isinstance(event, Jump):
            self._jump(event, ahead)
        elif isinstance(event, Idle):
            self._update_wanted(ahead, at_rest=event.for_ns is None)
            # Decoding delays the next due message: a long gap is the best time for it.
            is_long = event.for_ns is None or event.for_ns > _LONG_GAP_NS
            if is_long or ahead.low():
                ahead.refill()
            if is_long:
                self._free_memory.give_back()
            if event.for_ns is None:
                self._clear_stale()
                self._look_for_subscribers()
            self._changed()

    def _update_wanted(self, ahead: ReadAhead, *, at_rest: bool) -> frozenset[int]:
        """Set the outlets with a subscriber in read-ahead; return them.

        A subscriber that comes while messages are due waits until they are made for it; one that
        came while none were misses nothing.
        """
        begins = self._at_rest and not at_rest
        transport = self._transport
        wanted = transport.query_wanted() if begins else transport.wanted(time.monotonic_ns())
        ahead.want(wanted, at_once=at_rest or begins or self.playback.options.lossless)
        self._at_rest = at_rest
        return wanted

    def _look_for_subscribers(self) -> None:
        if not self.playback.state().waiting:
            return
        if self._wait.over(self._transport.audience(), time.monotonic_ns()):
            self._say(self._wait.ending())
            self.playback.begin()

    def _send(self, event: Send, ahead: ReadAhead) -> None:
        wanted = self._update_wanted(ahead, at_rest=False)
        messages, losses = ahead.take(event.position)
        for loss in losses:
            self._warn_once(loss.message, loss.count)
        frame = int(self.program.frames[event.position])
        if frame != self._frame:
            if self.playback.options.lossless and not self._wait_for(
                lambda seconds: self._transport.may_begin(frame, seconds)
            ):
                return
            if self._frame is not None:
                self._clear_stale()
            self._frame = frame
            self.counts.frames += 1
        sent = 0
        for message in messages:
            if self.playback.stopped:
                break
            is_unmade = message.channel not in wanted or not message.parts
            if self.program.channels[message.channel].on_demand and is_unmade:
                self.reception.note(message.channel, received=False)
                continue
            sent += self._publish(message, message.stamp_ns, event.due_ns)
        self.playback.sent(sent)
        if ahead.low():
            ahead.refill()
        self._changed()

    def _publish(self, message: Message, stamp_ns: int, due_ns: int) -> int:
        """Publish a message unless it is unchanged; return the number published."""
        outlet = message.channel
        if self._last_keys.repeats(outlet, message.key):
            return 0
        self._stale.discard(outlet)
        if outlet in self._transport.unpublishable:
            self._count_dropped(self._transport.unpublishable[outlet], 1)
            return 0
        data = message.data
        if self._settings.stamps is Stamps.NOW:
            data = restamp_message(
                data, self.program.channels[outlet].msgtype, self._wall_time(due_ns)
            )
        if self.playback.options.lossless and not self._wait_for(
            lambda seconds: self._transport.make_room(outlet, seconds)
        ):
            return 0
        now = time.monotonic_ns()
        if self.on_publish is not None:
            self.on_publish(outlet, due_ns, now)
        if not self.program.channels[outlet].latched:
            self.reception.note(outlet, received=self._transport.has_subscriber(outlet))
        self._transport.publish(outlet, data, stamp_ns)
        self.counts.messages += 1
        self.counts.late_ns = max(self.counts.late_ns, now - due_ns)
        return 1

    def _wait_for(self, ready: Callable[[float], bool]) -> bool:
        """Wait for subscribers, by a function that waits some seconds; False if stopped."""
        while not ready(_PATIENCE_S):
            if self.playback.stopped:
                return False
        return True

    def _wall_time(self, due_ns: int) -> int:
        """Convert steady time to wall time; constant per input unless the clock is set."""
        offset = time.time_ns() - time.monotonic_ns()
        if abs(offset - self._wall_ns) > 1_000_000:
            self._wall_ns = offset
        return due_ns + self._wall_ns

    def _jump(self, event: Jump, ahead: ReadAhead) -> None:
        """Prepare the next frame, resend latched messages, and mark all markers as stale."""
        self._free_memory.give_back()  # at a high rate there is no long gap
        self._prepare(event.position, ahead)
        self._last_keys = LastKeys()
        self._stale = set(self._markers)
        self._frame = None
        self._transport.jump(event.stamp_ns)
        self._publish_time(event.stamp_ns)
        if event.position:
            now = time.monotonic_ns()
            for message in self.program.latched_before(event.position):
                self._publish(message, event.stamp_ns, now)

    def _clear_stale(self) -> None:
        """Delete markers of another time that were not replaced."""
        for outlet in sorted(self._stale):
            stamp_ns = self.playback.state().stamp_ns
            (data,) = encode_clear(stamp_ns, FrameNames().map)
            self._transport.publish(outlet, bytes(data), stamp_ns)
        self._stale.clear()

    def _publish_time(self, stamp_ns: int) -> None:
        if self._settings.stamps is Stamps.ORIGINAL and self._settings.playback.clock_hz:
            self._transport.publish_time(stamp_ns)

    def _warn_once(self, reason: str, messages: int) -> None:
        """Warn of a reason once; always count its messages."""
        self._count_dropped(reason, messages)
        if reason not in self._warned:
            self._warned.add(reason)
            self._warn(reason)

    def _count_dropped(self, reason: str, messages: int) -> None:
        self.counts.failures += messages
        self.counts.dropped[reason] += messages


# A state in words -> diagnostic_msgs/DiagnosticArray, which viewers display.

OK = 0
WARN = 1
"""DiagnosticStatus.level."""


def encode_diagnostics(
    stamp_ns: int,
    *,
    level: int,
    name: str,
    message: str,
    hardware_id: str,
    values: Mapping[str, str],
) -> bytes:
    """Make a DiagnosticArray with one DiagnosticStatus, serialised.

    Args:
        stamp_ns: Stamp of the header, nanoseconds.
        level: OK or WARN.
        name: Name of the component that reports.
        message: Its state, in a line.
        hardware_id: Subject of the report.
        values: Its state in detail.
    """
    cdr = CdrWriter()
    cdr.header(stamp_ns, '')
    cdr.uint32(1)
    cdr.byte(level)
    for text in (name, message, hardware_id):
        cdr.text(text)
    cdr.uint32(len(values))
    for key, value in values.items():
        cdr.text(key)
        cdr.text(value)
    return cdr.finish()


# The state of a player as text and as a message.


def where(playback: Playback) -> str:
    """Describe the state in words, such as 'paused, frame 5'."""
    state = playback.state()
    return f'{_doing(state)}, frame {state.frame}'


def _doing(state: PlaybackState) -> str:
    if state.paused:
        return 'paused'
    return 'waiting for subscribers' if state.waiting else 'playing'


def encode_state(name: str, source: str, state: PlaybackState, counts: Counts) -> bytes:
    """Encode the state as a DiagnosticArray: OK, or WARN if messages could not be made.

    Args:
        name: The player's name.
        source: The source's name.
        state: The current state.
        counts: The statistics so far.
    """
    values = {
        'source': source,
        'frame': state.frame,
        'time': format_stamp(state.stamp_ns),
        'seconds': f'{state.offset_ns / 1e9:.3f}',
        'rate': f'{state.rate:g}',
        'paused': str(state.paused).lower(),
        'finished': str(state.finished).lower(),
        'round': state.round,
        'messages': counts.messages,
        'failures': counts.failures,
        'late_ms': f'{counts.late_ns / 1e6:.1f}',
    }
    doing = 'finished' if state.finished else _doing(state)
    return encode_diagnostics(
        state.stamp_ns,
        level=WARN if counts.failures else OK,
        name=name,
        message=f'{doing}, frame {state.frame}'
        + (f'; {counts.failures} messages could not be made' if counts.failures else ''),
        hardware_id=source,
        values={key: str(value) for key, value in values.items()},
    )
