# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Hooks of mkdocs: additions for pages that are opened from disk."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig


def on_post_page(output: str, **_: object) -> str:
    """Name the search dialog for screen readers, and make an empty corner of a table no header."""
    named = output.replace('role="dialog"', 'role="dialog" aria-label="Search"')
    return named.replace('<th></th>', '<td></td>')


def on_post_build(config: MkDocsConfig) -> None:
    """Remove the page for missing pages: its paths are those of a server."""
    Path(config.site_dir, '404.html').unlink(missing_ok=True)
