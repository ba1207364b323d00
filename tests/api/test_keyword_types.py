# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The types of the library's keywords are those of the options' declarations."""

from __future__ import annotations

import keyword_types


def test_the_file_is_as_the_options_are_declared():
    written = keyword_types.FILE.read_text('utf-8')
    assert written == keyword_types.text(), 'run python tests/api/keyword_types.py'
