# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tests that attack: README's command leaves them out, and a workflow runs them each night.

Files that lie, commands that are killed or starved, long runs. All of them take half an hour on two
cores; with --sample every SAMPLED-th runs.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from s3_buckets import impatient, s3, s3_process

__all__ = ['impatient', 's3', 's3_process']  # fixtures

SAMPLED = 6
_TESTS = Path(__file__).resolve().parents[1]
# What the tests of these rooms share.
sys.path += [
    str(_TESTS / room)
    for room in ('bags', 'batch', 'datasets', 'importer', 'kitti', 'remote', 'robots')
]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption('--sample', action='store_true', help=f'every {SAMPLED}th test')


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption('sample'):
        items[:] = items[::SAMPLED]
