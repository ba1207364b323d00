# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The checksums of zlib, many times faster where isal is installed."""

from __future__ import annotations

try:
    from isal.isal_zlib import adler32, crc32
except ImportError:  # a workspace may do without
    from zlib import adler32, crc32

__all__ = ['adler32', 'crc32']
