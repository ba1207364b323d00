# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Repair of truncated or damaged bags: every readable message is copied unchanged."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..files.staging import lies_inside
from ..model.bag_formats import CONTAINERS
from ..model.errors import BadBagError, KittiRos2Error, NotABagError, UsageError, describe_error
from ..options.outputs import BagOptions
from .locate import locate_bag
from .reader import BagMessages
from .writer import guess_storage, open_bag

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from .locate import BagFiles
    from .reader import BagMessage
    from .writer import BagWriter


@dataclass(frozen=True)
class RecoveryReport:
    """The result of a repair.

    Attributes:
        path: The repaired bag.
        counts: Messages by topic, including topics without messages.
        size_bytes: Bytes of all messages.
        losses: Damaged or skipped parts, one line each.
        lost: Number of messages known to be lost.
        lost_exactly: Whether no others are lost.
        notes: Notes, one line each.
    """

    path: Path
    counts: dict[str, int]
    size_bytes: int
    losses: tuple[str, ...]
    lost: int
    lost_exactly: bool
    notes: tuple[str, ...]


def recover(
    path: Path,
    out: Path,
    storage: str | None = None,
    *,
    overwrite: bool = False,
    fsync: bool = True,
    progress: Callable[[int, int], None] = lambda _done, _expected: None,
) -> RecoveryReport:
    """Copy the readable messages of a bag to a new bag, in the order of log times.

    Args:
        path: The bag, of any container.
        out: The repaired bag: a name with the suffix of a container, or a rosbag2 directory.
        storage: One of model.bag_formats; by default that of out's suffix, else the bag's own.
        overwrite: Whether an existing bag may be replaced.
        fsync: Whether the repaired bag outlasts a power cut.
        progress: Called with the number of messages done and the number expected.

    Raises:
        BadBagError: The path holds no bag, or one that cannot be read at all.
        UsageError: The path is a KITTI folder or in one, or the storage and out's suffix contradict
            each other, or out is the bag itself.
        OutputExistsError: The output exists and may not be replaced.
        OutputError: The output cannot be written.
    """
    bag = _located(path)
    if lies_inside(out, path):
        raise UsageError(f'{out}: is the bag that is to be read, or in it; give another name')
    storage = guess_storage(out, storage, default=bag.storage)
    as_stored = CONTAINERS[bag.storage].encoding in {'cdr', CONTAINERS[storage].encoding}
    with BagMessages([path], as_stored=as_stored) as messages:
        compression = _compression(messages, storage)
        options = BagOptions(storage, compression, overwrite=overwrite, fsync=fsync)
        with open_bag(out, options, messages.typestore) as writer:
            copy = _Copy(writer, messages, storage)
            expected = messages.expected
            for done, message in enumerate(messages, 1):
                copy.take(message)
                progress(done, expected)
            if messages.losses and not any(copy.counts.values()):
                reason = next(iter(messages.losses))
                text = f'holds no message that can be read ({reason})'
                raise BadBagError(path, text, 'one at least')
    losses = {**messages.losses, **copy.losses}
    return RecoveryReport(
        path=writer.path,
        counts=copy.counts,
        size_bytes=copy.size_bytes,
        losses=tuple(losses),
        lost=sum(filter(None, losses.values())),
        lost_exactly=None not in losses.values(),
        notes=tuple(problem for problem in messages.problems if problem not in losses),
    )


def _located(path: Path) -> BagFiles:
    try:
        return locate_bag(path)
    except NotABagError as error:
        from .bag_files import explain_no_bag  # noqa: PLC0415 - readers of KITTI, for errors only

        raise explain_no_bag(path, error) from None


class _Copy:
    """A copy in progress: writes messages, and counts those that the new bag cannot hold.

    Attributes:
        counts: Messages by topic.
        size_bytes: Bytes of all messages.
        losses: Reasons why messages cannot be written, with the number of messages.
    """

    def __init__(self, writer: BagWriter, messages: BagMessages, storage: str) -> None:
        self._writer = writer
        self._storage = storage
        self._ids: dict[str, int] = {}
        self._unwritten: dict[str, str] = {}
        self._first_lost: dict[tuple[str, str], str] = {}
        self.counts: dict[str, int] = {}
        self.size_bytes = 0
        self.losses: Counter[str] = Counter()
        for topic, channel in sorted(messages.sources.items()):
            try:
                self._ids[topic] = writer.add_channel(channel)
            except (KittiRos2Error, MemoryError):
                raise
            except Exception as error:  # noqa: BLE001 - types of any kind
                circular = isinstance(error, RecursionError)
                why = 'its definition refers to itself' if circular else error
                text = f'{topic}: {channel.msgtype} cannot be written to {storage} ({why})'
                self._unwritten[topic] = text
                self.losses[text] = 0
            else:
                self.counts[topic] = 0

    def take(self, message: BagMessage) -> None:
        """Write a message.

        Raises:
            OutputError: The disk refuses.
        """
        topic = message.topic
        if topic not in self._ids:
            self.losses[self._unwritten[topic]] += 1
            return
        try:
            _check_stamp(message.stamp_ns, self._storage)
            self._writer.write(self._ids[topic], message.stamp_ns, [message.data])
        except (KittiRos2Error, MemoryError):
            raise
        except Exception as error:  # noqa: BLE001 - converters may raise anything
            reason = describe_error(error)
            text = f'{topic}: messages from {message.stamp_ns} on cannot be written ({reason})'
            self.losses[self._first_lost.setdefault((topic, reason), text)] += 1
            return
        self.counts[topic] += 1
        self.size_bytes += len(message.data)


def _check_stamp(stamp_ns: int, storage: str) -> None:
    # A damaged record may have any stamp.
    if not 0 <= stamp_ns < CONTAINERS[storage].stamp_limit_ns:
        raise ValueError(f'{storage} has no such time')


def _compression(messages: BagMessages, storage: str) -> str:
    """Return the bag's own compression if the new container supports it, else none."""
    supported = sorted(messages.compressions & CONTAINERS[storage].compressions.keys() - {'none'})
    return supported[0] if supported else 'none'
