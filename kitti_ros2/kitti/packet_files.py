# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files of an unsynchronised drive's packets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..model.errors import BadFileError
from .oxts_file import parse_packet
from .store import STORE

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.samples import OxtsPacket
    from ..options.imu import ImuStamps
    from .store import Listing


@dataclass(frozen=True)
class PacketFiles:
    """The files of an unsynchronised drive's packets.

    Attributes:
        drive: Its name.
        listing: The files.
        stamps: The kind of stamps that the packets have in the recording.
    """

    drive: str
    listing: Listing
    stamps: ImuStamps

    def path(self, number: int) -> Path:
        """Return the file of a packet."""
        return self.listing.path(number)

    def packet(self, number: int) -> OxtsPacket:
        """Read a packet; it has no source, since it is no file of the recording."""
        path = self.path(number)
        return parse_packet(STORE.read_text(path), path)

    def text(self, number: int) -> str | None:
        """Read the text of a packet, None if it cannot be read."""
        try:
            return STORE.read_text(self.path(number))
        except (BadFileError, OSError):
            return None

    def describe(self) -> dict[str, str]:
        """Return what the description of the recording says of them."""
        return {'drive': self.drive, 'stamps': self.stamps.value}
