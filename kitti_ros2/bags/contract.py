# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The data of bags being written, and the interface that the writer of a container implements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosbags.typesys.store import Typestore

    from ..model.channels import Channel
    from ..options.bag import BagOptions

Parts: TypeAlias = Sequence[bytes | memoryview]
"""One CDR message (encapsulation header included) as buffers to be concatenated, so that a bulk
payload is never copied. A memoryview is flat bytes (format 'B'); no buffer may change afterwards.
"""


@dataclass
class Tally:
    """Message counts of a whole bag, or of one of its files.

    Attributes:
        counts: Messages by channel id.
        start_ns, end_ns: Least and greatest stamp; undefined without messages.
    """

    counts: list[int] = field(default_factory=list)
    start_ns: int = 2**63 - 1
    end_ns: int = -(2**63)

    @property
    def total(self) -> int:
        """Number of all messages."""
        return sum(self.counts)


@dataclass(frozen=True)
class SegmentContext:
    """Arguments of the writer of one file.

    Attributes:
        options: Storage, compression and level.
        typestore: Contains the definition of every channel's type.
        source_metadata: Origin of the data, stored in the file if the container supports that.
        threads: Number of threads that compress.
    """

    options: BagOptions
    typestore: Typestore
    source_metadata: Mapping[str, str]
    threads: int = 1


class SegmentWriter(Protocol):
    """The writer of one file of a container; it may raise OSError and errors of its library."""

    def add_channel(self, channel_id: int, channel: Channel) -> None:
        """Declare a channel under an id of the bag (0, 1, 2, ...)."""
        ...

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message."""
        ...

    def close(self, information: bytes) -> None:
        """Complete the file; information is the bag's metadata as YAML, empty outside rosbag2."""
        ...

    def abort(self) -> None:
        """Release everything without completing the file."""
        ...
