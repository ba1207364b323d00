# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Repair of truncated or damaged bags: every readable message is copied unchanged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..files.staging import lies_inside
from ..model.bag_formats import CONTAINERS
from ..model.errors import BadBagError, NotABagError, UsageError
from ..options.outputs import BagOptions
from .copy_messages import MessageCopy, open_copied, outlets_of
from .locate import locate_bag
from .writer import guess_storage, open_bag

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from .locate import BagFiles
    from .reader import BagMessages


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
    with open_copied([path], storage) as messages:
        compression = _compression(messages, storage)
        options = BagOptions(storage, compression, overwrite=overwrite, fsync=fsync)
        made = outlets_of(messages, storage)
        with open_bag(out, options, made.typestore) as writer:
            copy = MessageCopy(messages, storage, made, writer)
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
        notes=(
            *(problem for problem in messages.problems if problem not in losses),
            *copy.notes,
        ),
    )


def _located(path: Path) -> BagFiles:
    try:
        return locate_bag(path)
    except NotABagError as error:
        from .bag_files import explain_no_bag  # noqa: PLC0415 - readers of KITTI, for errors only

        raise explain_no_bag(path, error) from None


def _compression(messages: BagMessages, storage: str) -> str:
    """Return the bag's own compression if the new container supports it, else none."""
    supported = sorted(messages.compressions & CONTAINERS[storage].compressions.keys() - {'none'})
    return supported[0] if supported else 'none'
