# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of a bag of any container to a bag of another, as a whole or a part of it."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from ..files.staging import lies_inside
from ..messages.foxglove_scene import PIXEL_WIDTH_M
from ..messages.topics import match_names, unmatched
from ..model.bag_formats import MARKERS
from ..model.errors import BadBagError, KittiRos2Error, Loss, UsageError, damage, format_count
from ..model.streams import format_stamp
from ..options.declare import parse_values
from ..options.table import TO_BAG
from .copy_messages import MessageCopy, open_copied, outlets_of
from .stored_messages import stored_channel
from .writer import guess_storage, open_bag

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Mapping
    from pathlib import Path

    from ..options.read import Bound, SelectionOptions
    from ..options.table import Settings
    from .bag_files import OpenBag
    from .reader import BagMessage, BagMessages


@dataclass(frozen=True)
class ConversionReport:
    """The result of a conversion.

    Attributes:
        path: The new bag.
        counts: Messages by topic, including topics without messages.
        size_bytes: Bytes of all messages.
        first_ns, last_ns: Log times of the first and the last message; 0 without messages.
        losses: Data that was skipped.
        notes: Notes, one line each.
    """

    path: Path
    counts: dict[str, int]
    size_bytes: int
    first_ns: int
    last_ns: int
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def convert(
    bag: OpenBag,
    out: Path,
    settings: Settings,
    progress: Callable[[int, int], None] = lambda _done, _expected: None,
) -> ConversionReport:
    """Write a bag as a bag of the container that out names, in the order of log times.

    Latched messages from before the start come first, with its time.

    Args:
        bag: The bag.
        out: The new bag: a name with the suffix of a container, or a rosbag2 directory.
        settings: The storage, the options of the bag, the selected topics and times, and whether
            to stop at the first loss.
        progress: Called with the number of messages done and the number expected.

    Raises:
        BadBagError: The bag holds no message that can be read, or with strict not all.
        UsageError: The selection takes no message, or out is the bag itself.
        OutputExistsError: The output exists and may not be replaced.
        OutputError: The output cannot be written.
    """
    if lies_inside(out, bag.path):
        raise UsageError(f'{out}: is the bag that is to be read, or in it; give another name')
    storage = guess_storage(out, settings.storage)
    options = settings.bag(storage)
    part = BagPart(bag, storage, settings.selection)
    with part.open() as messages:
        made = outlets_of(messages, storage)
        with open_bag(out, options, made.typestore) as writer:
            copy = MessageCopy(messages, storage, made, writer)
            with closing(part.messages(messages)) as selected:
                expected = messages.expected
                for done, message in enumerate(selected, 1):
                    copy.take(message)
                    progress(done, expected)
                    if settings.strict:
                        _refuse_losses(messages, copy)
            _refuse_nothing(bag.path, settings.selection, messages, copy)
            if settings.strict:
                _refuse_losses(messages, copy)
    losses = {**part.losses, **messages.losses, **copy.losses}
    notes = [problem for problem in messages.problems if problem not in losses]
    return ConversionReport(
        writer.path,
        copy.counts,
        copy.size_bytes,
        copy.first_ns or 0,
        copy.last_ns,
        damage(losses, str(bag.path)),
        (*part.notes, *notes, *copy.notes, *_changes_of_types(messages)),
    )


# Options that the conversion of a bag takes.
_OF_BAGS = frozenset(
    {
        'storage',
        'compression',
        'compression_level',
        'split_size',
        'split_duration',
        'overwrite',
        'fsync',
        'keep_partial',
        'strict',
        'topics',
        'exclude_topics',
        'start',
        'end',
    }
)


def check_options(bag: Path, given: Mapping[str, object], jobs: int | None) -> None:
    """Check that no option of to-bag is given that is for KITTI folders.

    Args:
        bag: The bag.
        given: Values of options by name.
        jobs: Number of worker processes; None is not given.

    Raises:
        UsageError: One is given, with another value than its default.
    """
    values = parse_values(given, TO_BAG)
    others = [
        opt.flag
        for opt in TO_BAG
        if opt.name not in _OF_BAGS and values.get(opt.name, opt.default) != opt.default
    ]
    others += ['--jobs'] * (jobs is not None)
    if others:
        raise UsageError(
            f'{bag}: {others[0]} is for KITTI folders, and this is a bag: it is written as it is;'
            f' leave {others[0]} out'
        )


class BagPart:
    """The part of a bag that is converted.

    Attributes:
        notes: Notes on the selection, one line each.
        losses: Damage found before the start, as BagMessages has it.
    """

    def __init__(self, bag: OpenBag, storage: str, selection: SelectionOptions) -> None:
        self._bag, self._storage = bag, storage
        if selection.streams:
            raise UsageError(f'{bag.path}: a bag has topics, no streams; choose by --topics')
        self._topics: frozenset[str] | None = None
        self.notes: list[str] = []
        self.losses: dict[str, int | None] = {}
        if selection.topics or selection.exclude_topics:
            names = {topic for topic, _ in bag.index.stamps}
            self._topics = frozenset(match_names(sorted(names), selection))
            self.notes += unmatched(names, selection)
        self._start_ns = self._bound_ns('start', selection.start)
        self._end_ns = self._bound_ns('end', selection.end)
        if self._start_ns is not None and self._start_ns > self._extent[1]:
            last = f'the last is of {format_stamp(self._extent[1])}'
            why = last if self._extent[1] else 'the bag has none'
            raise UsageError(f'{bag.path}: {selection} takes no message; {why}')

    def _bound_ns(self, name: str, bound: Bound | None) -> int | None:
        if bound is None:
            return None
        if bound.stamp_ns is not None:
            return bound.stamp_ns
        if bound.offset_ns is None:
            raise UsageError(
                f'{self._bag.path}: --{name} {bound.frame} is a frame of a KITTI folder; of a bag'
                f" give seconds from its start (3.5s) or a time ('2011-09-26 13:02:26')"
            )
        return self._extent[0] + bound.offset_ns

    @cached_property
    def _extent(self) -> tuple[int, int]:
        """The first and the last stamp of the bag."""
        stamps = [array for array in self._bag.index.by_topic().values() if len(array)]
        ends = [int(end) for array in stamps for end in (array.min(), array.max())]
        return min(ends, default=0), max(ends, default=0)

    def open(self) -> BagMessages:
        """Open the bag to copy the selected topics."""
        return open_copied([self._bag], self._storage, self._topics, foxglove=True)

    def messages(self, messages: BagMessages) -> Generator[BagMessage]:
        """Yield the messages of the part; latched ones from before it come first."""
        if self._start_ns is not None and messages.latched:
            latched = open_copied(
                [self._bag], self._storage, frozenset(messages.latched), foxglove=True
            )
            with latched:
                for message in latched:
                    if message.stamp_ns >= self._start_ns:
                        break
                    yield message._replace(stamp_ns=self._start_ns)
                self.losses = latched.losses
        for message in messages.since(self._start_ns):
            if self._end_ns is not None and message.stamp_ns > self._end_ns:
                return
            yield message


def _refuse_losses(messages: BagMessages, copy: MessageCopy) -> None:
    if not (messages.complete and copy.complete):
        reason = next(iter({**messages.losses, **copy.losses}))
        raise KittiRos2Error(f'{reason}; stopped there because of --strict')


def _refuse_nothing(
    path: Path, selection: SelectionOptions, messages: BagMessages, copy: MessageCopy
) -> None:
    """Refuse a copy without messages, unless the bag itself has none."""
    if any(copy.counts.values()):
        return
    losses = {**messages.losses, **copy.losses}
    if losses:
        reason = next(iter(losses))
        text = f'holds no message that can be written ({reason})'
        raise BadBagError(path, text, 'one at least')
    if not selection.is_whole and messages.expected:
        raise UsageError(f'{path}: {selection} takes no message')


_CHANGED_SHAPES = f'; widths in pixels become {PIXEL_WIDTH_M} m, cones cylinders'


def _changes_of_types(messages: BagMessages) -> list[str]:
    """Return a note for each schema that becomes a ROS type, with the number of its topics."""
    changes: Counter[tuple[str, str]] = Counter()
    for channel in messages.sources.values():
        stored = stored_channel(channel)
        if stored.msgtype != channel.msgtype:
            changes[f'{stored.msgtype} in {stored.encoding}', channel.msgtype] += 1
    return [
        f'{schema} is written as {msgtype} ({format_count(count, "topic")})'
        f'{_CHANGED_SHAPES * (msgtype == MARKERS)}'
        for (schema, msgtype), count in sorted(changes.items())
    ]
