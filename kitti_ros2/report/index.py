# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The HTML page that lists the reports of a collection."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import quote

from .. import __version__
from .page import environment, printable

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


@dataclass(frozen=True)
class IndexEntry:
    """The report of a recording or bag.

    Attributes:
        name: Of the recording or bag in the collection.
        page: Its report, relative to the index.
        frames: Number of frames.
        losses: Number of findings that are losses.
    """

    name: str
    page: Path
    frames: int
    losses: int

    @property
    def address(self) -> str:
        """The link to the report."""
        return f'./{quote(os.fsencode(self.page))}'


def make_index(name: str, entries: Sequence[IndexEntry]) -> str:
    """Make the HTML document that lists reports.

    Args:
        name: Of the collection.
        entries: The reports, in their order.
    """
    page = environment().get_template('index.html')
    return printable(page.render(version=__version__, name=name, entries=entries))
