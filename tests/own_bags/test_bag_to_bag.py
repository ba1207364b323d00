# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag of to-bag stays one whatever the containers that it is written to after another."""

from __future__ import annotations

from test_restore import back, files_of, to_bag

from kitti_ros2.cli import main

CHAIN = [
    ('a.mcap', '--compression', 'zstd'),
    ('b', '--storage', 'sqlite3'),
    ('c.bag', '--compression', 'lz4'),
    ('d', '--split-size', '1MB'),
    ('e.bag',),
    ('f', '--storage', 'sqlite3', '--compression', 'zstd'),
]


def test_every_file_comes_back_from_the_last_of_a_chain(recording_path, tmp_path):
    bag = to_bag(recording_path, tmp_path, 'mcap')
    back(bag, tmp_path / 'expected')
    for name, *words in CHAIN:
        assert main(['to-bag', str(bag), str(tmp_path / name), '-q', *words]) == 0
        bag = tmp_path / name
    back(bag, tmp_path / 'again')
    assert files_of(tmp_path / 'again') == files_of(tmp_path / 'expected')
    assert main(['validate', str(bag), '-q']) == 0
