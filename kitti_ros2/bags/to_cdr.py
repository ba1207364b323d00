# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of stored messages to CDR: those of ROS 1, compressed ones, and Foxglove's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .decompressors import ZSTD_MAGIC, decompress_message
from .foxglove_channels import FoxgloveChannel, translator
from .ros1_messages import ros1_to_cdr

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosbags.typesys.store import Typestore

    from .definitions import Definitions
    from .foxglove_channels import Translate
    from .pieces import Buffer, StoredChannel

READ = frozenset({'cdr', 'ros1'})
"""Encodings of channels that are read."""


def is_stored_as_cdr(channel: StoredChannel) -> bool:
    """Whether messages of a channel are in their file as they are read."""
    return channel.encoding == 'cdr' and not isinstance(channel, FoxgloveChannel)


class ToCdr:
    """Converts messages of channels to CDR.

    Args:
        typestore: Returns the types as the bags define them.
        as_stored: Whether messages of ROS 1 stay as they are.
    """

    def __init__(self, typestore: Callable[[], Typestore], *, as_stored: bool) -> None:
        self._typestore = typestore
        self._as_stored = as_stored
        self._translators: dict[StoredChannel, Translate] = {}

    def prepare(self, channel: StoredChannel, definitions: Definitions) -> None:
        """Make what the messages of a channel are converted with.

        Raises:
            MissingLibraryError: The library that reads them is not installed.
            ValueError: The definition of the channel is damaged, or its messages become a type that
                a bag defines otherwise.
        """
        if isinstance(channel, FoxgloveChannel):
            definitions.check_known(channel.msgtype)
            self._translators[channel] = translator(channel, self._typestore)
        elif channel.encoding == 'ros1' and not self._as_stored:
            definitions.check_extent(channel.msgtype)

    def __call__(self, channel: StoredChannel, stored: Buffer, log_ns: int) -> Buffer:
        """Convert a message.

        Args:
            channel: Its channel, prepared.
            stored: The message as stored.
            log_ns: Its log time, nanoseconds.

        Raises:
            Exception: It cannot be converted.
        """
        # The first bytes distinguish a CDR message from one that rosbag2 compressed.
        data = decompress_message(stored) if stored[:4] == ZSTD_MAGIC else stored
        if channel in self._translators:
            return self._translators[channel](data, log_ns)
        if channel.encoding == 'ros1' and not self._as_stored:
            return ros1_to_cdr(self._typestore(), stored, channel.msgtype)
        return stored if channel.encoding == 'ros1' else data
