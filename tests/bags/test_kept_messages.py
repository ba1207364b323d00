# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of a message does not keep the chunk that it was read from."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from bag_samples import make_samples, write_bag

import kitti_ros2
from kitti_ros2.bags.reader import LENT_FROM, Decoder, open_messages
from kitti_ros2.model.bag_formats import CLOUD
from kitti_ros2.options.outputs import BagOptions

PACKAGE = Path(kitti_ros2.__file__).parent
OPTIONS = {
    'mcap': ('bag.mcap', BagOptions()),
    'zstd': ('bag.mcap', BagOptions(compression='zstd')),
    'sqlite3': ('bag', BagOptions(storage='sqlite3')),
    'ros1': ('bag.bag', BagOptions(storage='ros1')),
}


@pytest.mark.parametrize('container', OPTIONS)
def test_small_messages_have_bytes_of_their_own(tmp_path, container):
    name, options = OPTIONS[container]
    samples = make_samples(rounds=2, cloud_bytes=LENT_FROM)
    path = write_bag(tmp_path / name, options, samples)
    with open_messages(path) as messages:
        found = list(messages)
    assert len(found) == len(samples)
    small = [each for each in found if len(each.data) < LENT_FROM]
    assert 0 < len(small) < len(found)
    assert {type(each.data) for each in small} == {bytes}


@pytest.mark.parametrize('lent', [False, True])
def test_arrays_of_a_large_message_are_views_only_if_they_are_lent(tmp_path, lent):
    samples = make_samples(rounds=1, cloud_bytes=2 * LENT_FROM)
    path = write_bag(tmp_path / 'bag.mcap', BagOptions(), samples)
    with open_messages(path) as messages:
        decode = Decoder(messages.typestore, lent=lent)
        (cloud,) = [each for each in messages if each.msgtype == CLOUD]
        values = decode(cloud).data
    assert np.shares_memory(values, np.frombuffer(cloud.data, np.uint8)) is lent


# Texts and numbers are taken out of each message, and it is dropped.
DROPPED = {'own_bags/numbering.py', 'report/overview.py', 'viewers/rerun_series.py',
           'viewers/rerun_show.py'}  # fmt: skip


def test_messages_of_bags_are_decoded_by_the_decoder_only():
    found = set()
    for path in PACKAGE.rglob('*.py'):
        calls = [
            node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)
        ]
        for call in calls:
            name = getattr(call.func, 'attr', getattr(call.func, 'id', ''))
            if name in {'deserialize', 'deserialize_cdr'} and isinstance(
                call.args[0], ast.Attribute
            ):
                found.add(str(path.relative_to(PACKAGE)))
    assert found == DROPPED
