# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A report of a recording or a bag: one self-contained HTML page."""

from .gather import gather
from .page import make_page
from .publish import check_output, write_page

__all__ = ['check_output', 'gather', 'make_page', 'write_page']
