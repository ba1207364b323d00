# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the fuzzer: python -m tests.fuzz."""

from __future__ import annotations

import sys
from pathlib import Path

# The tests are no package; their folder is where pytest finds the modules that several share.
sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from fuzz.command import main  # noqa: E402 - the path comes first

sys.exit(main())
