# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reading ahead is advice to the system: within the file, and without effect on what is read."""

from __future__ import annotations

import os

import foreign
import pytest

from kitti_ros2.bags.container_file import FileBytes, NamedFile
from kitti_ros2.bags.reader import open_messages


@pytest.fixture(params=['mcap', 'sqlite3', 'ros1'])
def bag(request, tmp_path):
    name = {'mcap': 'bag.mcap', 'sqlite3': 'bag', 'ros1': 'bag.bag'}[request.param]
    return foreign.write_foreign(tmp_path / name, foreign.make_truth(), request.param)


def stamps_and_sizes(bag):
    with open_messages([bag]) as messages:
        return [(each.topic, each.stamp_ns, len(each.data)) for each in messages]


def test_advice_changes_nothing(bag, monkeypatch):
    expected = stamps_and_sizes(bag)
    given = []

    def refuse(*arguments):
        given.append(arguments)
        raise OSError('no page cache')

    monkeypatch.setattr(os, 'posix_fadvise', refuse)
    assert stamps_and_sizes(bag) == expected
    assert given
    monkeypatch.delattr(os, 'posix_fadvise')
    assert stamps_and_sizes(bag) == expected


def test_advice_stays_in_the_file(tmp_path, monkeypatch):
    path = tmp_path / 'file'
    path.write_bytes(bytes(2**20))
    file = FileBytes(NamedFile(path, path))
    given = []
    monkeypatch.setattr(os, 'posix_fadvise', lambda _, *span: given.append(span))
    for start, length in ((0, 2**30), (2**20, 5), (2**21, 2**20)):
        file.expect(start, length)
    assert [start for start, _, _ in given] == [0, 2**18, 2**19, 3 * 2**18]
    file.close()
