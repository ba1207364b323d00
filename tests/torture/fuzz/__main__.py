# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the fuzzer: python -m tests.torture.fuzz."""

from __future__ import annotations

import sys
from pathlib import Path

# The tests are no package; their folder is where pytest finds the modules that several share.
_TORTURE = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TORTURE), str(_TORTURE.parent)]

from fuzz.command import main  # noqa: E402 - the path comes first

sys.exit(main())
