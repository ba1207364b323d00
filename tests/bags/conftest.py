# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the bags' tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope='session')
def real_bags(real_kitti: Path) -> Path:
    """The folder of bags that other projects recorded."""
    folder = real_kitti / 'bags'
    if not folder.is_dir():
        pytest.skip(f'the real bags are not there: {folder}')
    return folder
