# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Hooks of mkdocs: tables from declarations, and additions for pages that are opened from disk."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.exceptions import PluginError
from tables import fill  # mkdocs puts the folder of a hook on the path

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig


def on_page_markdown(markdown: str, **_: object) -> str:
    """Fill in the generated tables of a page."""
    try:
        return fill(markdown)
    except ImportError as error:
        remedy = "the reference needs rclpy: pip install '.[docs,ros]'"
        raise PluginError(f'{error}; {remedy}') from error


def on_post_page(output: str, **_: object) -> str:
    """Name the search dialog for screen readers, and make an empty corner of a table no header."""
    named = output.replace('role="dialog"', 'role="dialog" aria-label="Search"')
    return named.replace('<th></th>', '<td></td>')


def on_post_build(config: MkDocsConfig) -> None:
    """Remove the page for missing pages: its paths are those of a server."""
    Path(config.site_dir, '404.html').unlink(missing_ok=True)
