# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Exit codes of the command line."""

EXIT_OK = 0
"""Everything was written; or what reads the output had enough of it, as `head` does."""
EXIT_LOSSES = 1
"""Some data was missing or bad: it is listed, also with -q, and everything else was written."""
EXIT_USAGE = 2
"""Invalid usage, or an unreadable input or output: one line says what to do."""
EXIT_INTERRUPTED = 130
"""Interrupted by Ctrl-C; no incomplete output is left behind."""
EXIT_TERMINATED = 143
"""Ended by SIGTERM; no incomplete output is left behind."""
