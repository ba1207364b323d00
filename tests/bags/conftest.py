# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the bags' tests."""

from __future__ import annotations

from pathlib import Path

import pytest

_KITTI = Path(__file__).resolve().parents[3] / 'shared' / 'kitti'


@pytest.fixture(scope='session')
def real_bags() -> Path:
    """The folder of bags that other projects recorded."""
    folder = _KITTI / 'bags'
    if not folder.is_dir():
        pytest.skip(f'the real bags are not there: {folder}')
    return folder
