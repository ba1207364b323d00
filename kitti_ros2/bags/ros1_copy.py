# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS 1 bag to which the messages of another are copied byte for byte, with its definitions."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from ..files.staging import Staging, keep_all, keep_all_but_bags, reported
from .ros1_scan import Ros1Channel
from .ros1_writer import Ros1Writer
from .writer import output_path

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from rosbags.interfaces import Connection
    from typing_extensions import Self

    from ..options.bag import BagOptions
    from .contract import Parts
    from .pieces import SourceChannel


class Ros1Copy:
    """A .bag file being written, as BagWriter has it, but that channels are those of another bag.

    Attributes:
        path: Where it will be once closed.

    Raises:
        UsageError: The path's ending contradicts the options.
        OutputExistsError: Something is there already and may not be replaced.
        OutputError: Another run is writing there, or the disk refuses.
    """

    def __init__(self, path: Path, options: BagOptions) -> None:
        refusal = keep_all_but_bags if options.overwrite else keep_all
        self._staging = Staging(output_path(path, options), refusal)
        self.path = self._staging.path
        self._connections: list[Connection] = []
        try:
            with reported(self.path):
                self._writer = Ros1Writer(self._staging.content, options.compression)
                self._writer.open()
        except BaseException:
            self._staging.discard()
            raise

    def add_channel(self, channel: SourceChannel) -> int:
        """Write a connection as it is in the other bag, and return its id.

        Raises:
            TypeError: The channel is of no ROS 1 bag.
            OutputError: The disk refuses.
        """
        if not isinstance(channel, Ros1Channel):
            raise TypeError(f'{channel.topic} is of no ROS 1 bag')
        with reported(self.path):
            connection = self._writer.add_connection(
                channel.topic,
                channel.msgtype,
                msgdef=channel.definition,
                md5sum=channel.md5sum,
                callerid=channel.callerid,
                latching=int(channel.latched_depth > 0),
            )
        self._connections.append(connection)
        return len(self._connections) - 1

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message.

        Raises:
            OutputError: The disk refuses.
        """
        with reported(self.path):
            self._writer.write(self._connections[channel_id], stamp_ns, b''.join(parts))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                with reported(self.path):
                    self._writer.close()
                self._staging.publish()
            else:
                with suppress(OSError):
                    self._writer.abort()
        finally:
            self._staging.discard()
