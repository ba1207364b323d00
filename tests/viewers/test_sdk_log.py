# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Few lines of what the SDK logs."""

import logging

import pytest

from kitti_ros2.viewers.foxglove_server import LEVEL_VARIABLE, few_lines


@pytest.fixture(autouse=True)
def no_level(monkeypatch):
    monkeypatch.delenv(LEVEL_VARIABLE, raising=False)


def test_lines_about_viewers_hide_no_others():
    told = []
    with few_lines(told.append):
        for _ in range(100):
            logging.getLogger('foxglove.websocket.connected_client').error('nonsense')
        logging.getLogger('foxglove.channel').warning('no %s', 'room')
        logging.getLogger('foxglove.channel').info('all is well')
    assert told[:3] == ['foxglove-sdk: nonsense'] * 3
    assert told[3].startswith('foxglove-sdk: more lines about viewers are not shown')
    assert told[4:] == ['foxglove-sdk: no room']


def test_afterwards_nothing_is_passed_on():
    told = []
    with few_lines(told.append):
        pass
    logging.getLogger('foxglove').error('nonsense')
    assert not told


def test_a_level_of_the_users_own_is_left_to_the_sdk(monkeypatch):
    monkeypatch.setenv(LEVEL_VARIABLE, 'debug')
    told = []
    with few_lines(told.append):
        logging.getLogger('foxglove').error('nonsense')
    assert not told
