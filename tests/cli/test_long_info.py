# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of info end after 200 rows, and say how many more there are."""

from __future__ import annotations

import json

import pytest
from mcap.writer import Writer

from kitti_ros2.cli import main

TOPICS = 450
MESSAGE = b'\0\1\0\0\2\0\0\0a\0'


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / 'long.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        for number in range(TOPICS):
            channel = writer.register_channel(f'/topic_{number:03}', 'cdr', schema)
            for again in range(2):
                writer.add_message(channel, 10**18 + again, MESSAGE, 10**18 + again)
        writer.finish()
    return path


def test_many_topics_end_in_a_line_that_counts_the_rest(bag, capsys):
    assert main(['info', str(bag)]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = [line.split()[0] for line in lines if line.startswith('/topic_')]
    assert rows == [f'/topic_{number:03}' for number in range(200)]
    assert lines[-1] == '... and 250 more topics with 500 messages; all with --json'


def test_json_has_all_topics(bag, capsys):
    assert main(['info', str(bag), '--json']) == 0
    series = json.loads(capsys.readouterr().out)['series']
    assert [each['name'] for each in series] == [f'/topic_{n:03}' for n in range(TOPICS)]
