# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Results as JSON on standard output."""

from __future__ import annotations

import sys

from ..files.json_text import json_text, losses_json


def print_json(values: object) -> None:
    """Print one JSON document; NaN and infinite numbers are null."""
    sys.stdout.write(json_text(values))
