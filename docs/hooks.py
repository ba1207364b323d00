# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Hooks of mkdocs: tables from declarations."""

from __future__ import annotations

from mkdocs.exceptions import PluginError
from tables import fill  # mkdocs puts the folder of a hook on the path


def on_page_markdown(markdown: str, **_: object) -> str:
    """Fill in the generated tables of a page."""
    try:
        return fill(markdown)
    except ImportError as error:
        remedy = "the reference needs rclpy: pip install '.[docs,ros]'"
        raise PluginError(f'{error}; {remedy}') from error
