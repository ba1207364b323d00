# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag of to-bag in which a topic has messages of another type is read without that topic."""

from __future__ import annotations

import pytest

from kitti_ros2.cli import main
from kitti_ros2.cli.exits import EXIT_LOSSES, EXIT_USAGE
from kitti_ros2.messages.naming import FILES, RECORDING
from kitti_ros2.messages.topics import own_topics
from kitti_ros2.model.bag_formats import CAMERA_INFO, IMU, STRING
from kitti_ros2.model.streams import Layout

from builders import convert_recording  # isort: skip
from stored_messages import make_mcap, messages_of  # isort: skip

OTHERS = [CAMERA_INFO, STRING, IMU]
DELAY_NS = 1_234_567


@pytest.fixture
def messages(recordings, tmp_path, layout):
    """The first messages of a bag, and of a drive's, which has all types."""
    found = {}
    for each in {layout, Layout.RAW}:
        convert_recording(recordings[each], tmp_path / f'{each}.mcap')
        found[each] = messages_of(tmp_path / f'{each}.mcap')
    others = {kind: data for _, kind, _, data in found[Layout.RAW]}
    return found[layout], others


@pytest.mark.parametrize('layout', list(Layout))
@pytest.mark.parametrize('command', ['report', 'validate', 'to-kitti'])
@pytest.mark.parametrize('delay_ns', [0, DELAY_NS], ids=['own', 'recorded'])
@pytest.mark.parametrize('other', OTHERS)
def test_all_other_topics_are_read(messages, tmp_path, capsys, command, delay_ns, other, layout):
    stored, others = messages
    restored = {t for t, *_ in stored if own_topics()[t].restores} | {RECORDING}
    for number, topic in enumerate(sorted(restored)):
        changed = [
            (t, *((other, stamp_ns, others[other]) if t == topic else (kind, stamp_ns, data)))
            for t, kind, stamp_ns, data in stored
        ]
        path, out = tmp_path / f'{number}.mcap', tmp_path / f'out_{number}'
        path.write_bytes(make_mcap([(*each[:2], each[2] + delay_ns, each[3]) for each in changed]))
        words = {'report': ['--out', f'{out}.html'], 'to-kitti': [str(out)]}.get(command, [])
        code = main([command, str(path), *words])
        said = ''.join(capsys.readouterr())
        assert 'internal error' not in said, topic
        expected = own_topics()[topic].msgtype
        if command != 'to-kitti' or other == expected:
            continue
        planned = topic == FILES and not layout.traits.from_others
        if topic == RECORDING or planned:  # which layout? is the answer
            assert code == EXIT_USAGE
        else:
            assert code == EXIT_LOSSES
            assert f'is a {other}, not a {expected}' in said
