# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of remote files."""

from s3_buckets import impatient, s3, s3_process

__all__ = ['impatient', 's3', 's3_process']
