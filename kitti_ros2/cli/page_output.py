# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""HTML pages as outputs: their endings, and the browser that shows them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .text import complain

if TYPE_CHECKING:
    from pathlib import Path

ENDINGS = ('.html', '.htm')


def open_page(page: Path) -> None:
    """Open a page in the browser, or say that there is none."""
    import webbrowser

    address = page.resolve().as_uri()
    if not webbrowser.open(address):
        complain(f'no browser is found; open {address}')
