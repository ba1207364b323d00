# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the rest of the package sees of a bag being written, and what a storage must offer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from types import TracebackType

    from rosbags.typesys.store import Typestore
    from typing_extensions import Self

    from ..options.bag import BagOptions

Parts: TypeAlias = Sequence[bytes | memoryview]
"""One CDR message (encapsulation header included) as buffers to be laid end to end, so that a bulk
payload is never copied. A memoryview is flat bytes (format 'B'); no buffer may change afterwards.
"""


@dataclass(frozen=True)
class Channel:
    """A topic of a bag.

    Attributes:
        topic: Full topic name.
        msgtype: ROS 2 type name, such as sensor_msgs/msg/Imu.
        latched: Whether late subscribers get the last messages: QoS transient local.
        depth: History depth of the offered QoS (keep last).
        reliable: Whether the offered QoS is reliable.
    """

    topic: str
    msgtype: str
    latched: bool = False
    depth: int = 10
    reliable: bool = True


@dataclass
class Tally:
    """Messages counted: of a whole bag, or of one of its files.

    Attributes:
        counts: Messages by channel id.
        start_ns, end_ns: Least and greatest stamp; meaningless while empty.
    """

    counts: list[int] = field(default_factory=list)
    start_ns: int = 2**63 - 1
    end_ns: int = -(2**63)

    @property
    def total(self) -> int:
        """All messages."""
        return sum(self.counts)

    @property
    def span(self) -> tuple[int, int]:
        """First stamp and duration in nanoseconds, (0, 0) without messages."""
        return (self.start_ns, self.end_ns - self.start_ns) if self.total else (0, 0)


class BagWriter(Protocol):
    """A bag open for writing; as a context manager it closes on success and aborts on failure."""

    @property
    def path(self) -> Path:
        """Where the bag will be once closed."""
        ...

    def add_channel(self, channel: Channel) -> int:
        """Declare a topic and return its channel id.

        Raises:
            UsageError: The topic is declared already.
            OutputError: The disk refuses.
        """
        ...

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message.

        Args:
            channel_id: From add_channel.
            stamp_ns: Log and publish time, nanoseconds since 1970, not negative.
            parts: The message as CDR, little endian.

        Raises:
            OutputError: The disk refuses; the bag is given up, and every later call says so.
        """
        ...

    def close(self) -> None:
        """Complete the bag and put it where it belongs; nothing happens the second time.

        Raises:
            OutputError: The disk refuses; nothing is left behind.
            OutputExistsError: Something else took the output's name meanwhile.
        """
        ...

    def abort(self) -> None:
        """Give the bag up and remove what there is of it; never raises."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


@dataclass(frozen=True)
class SegmentContext:
    """What the writer of one file is given.

    Attributes:
        options: Storage, compression and level.
        typestore: Knows the definition of every channel's type.
        source_metadata: Where the data came from, kept in the file where the storage can.
    """

    options: BagOptions
    typestore: Typestore
    source_metadata: Mapping[str, str]


class SegmentWriter(Protocol):
    """The writer of one file of one storage, free to raise OSError and its library's errors."""

    def __init__(self, path: Path, context: SegmentContext) -> None: ...

    def add_channel(self, channel_id: int, channel: Channel) -> None:
        """Declare a channel under an id that the bag chose (0, 1, 2, ...)."""
        ...

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message."""
        ...

    def close(self, information: str) -> None:
        """Complete the file; information is the bag's metadata as YAML, where it is kept."""
        ...

    def abort(self) -> None:
        """Release everything without completing the file."""
        ...
