# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag of to-bag in which the definition of a message type is damaged is read without it."""

from __future__ import annotations

import re
from functools import partial
from io import BytesIO

import pytest
from mcap.writer import Writer

from kitti_ros2.cli import main
from kitti_ros2.cli.exits import EXIT_LOSSES, EXIT_USAGE
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.streams import Layout

from builders import convert_recording  # isort: skip
from stored_messages import messages_of  # isort: skip

DESCRIPTION = 'std_msgs/msg/String'
NEEDS_UNKNOWN = 'x_msgs/Unknown field\n'
DELAY_NS = 1_234_567


def written(messages, kind, change, delay_ns):
    """The bytes of an MCAP file, recorded later, with another definition of a type."""
    target = BytesIO()
    writer = Writer(target)
    writer.start('ros2')
    channels = {}
    for number, (topic, msgtype, stamp_ns, data) in enumerate(messages):
        if topic not in channels:
            text = TYPESTORE.generate_msgdef(msgtype, 2)[0]
            text = change(text) if msgtype == kind else text
            schema = writer.register_schema(msgtype, 'ros2msg', text.encode())
            channels[topic] = writer.register_channel(topic, 'cdr', schema)
        log_ns = stamp_ns + number * delay_ns
        writer.add_message(channels[topic], log_ns, data, stamp_ns)
    writer.finish()
    return target.getvalue()


def run(command, path, out, capsys):
    """The exit code, and all that was said."""
    words = {'report': ['--out', f'{out}.html'], 'to-kitti': [str(out)]}.get(command, [])
    code = main([command, str(path), *words])
    return code, ''.join(capsys.readouterr())


@pytest.fixture
def messages(recordings, tmp_path, layout):
    """The first messages of a bag."""
    convert_recording(recordings[layout], tmp_path / 'whole.mcap')
    return messages_of(tmp_path / 'whole.mcap')


@pytest.mark.parametrize('command', ['report', 'validate', 'to-kitti'])
@pytest.mark.parametrize('layout', list(Layout))
@pytest.mark.parametrize('delay_ns', [0, DELAY_NS])
def test_all_else_is_read(messages, tmp_path, capsys, command, delay_ns):
    for number, kind in enumerate(sorted({kind for _, kind, _, _ in messages})):
        path = tmp_path / f'{number}.mcap'
        path.write_bytes(written(messages, kind, lambda _: NEEDS_UNKNOWN, delay_ns))
        code, said = run(command, path, tmp_path / f'out_{number}', capsys)
        assert 'internal error' not in said, kind
        if kind == DESCRIPTION and command == 'to-kitti':  # which layout? is the answer
            assert code == EXIT_USAGE
        else:
            assert code == EXIT_LOSSES or command == 'validate', (kind, said)
            assert f'defines {kind}' in said or 'its type is not defined' in said


@pytest.mark.parametrize('command', ['info', 'report', 'to-kitti'])
@pytest.mark.parametrize('layout', list(Layout))
def test_a_type_that_others_contain_may_be_damaged(messages, tmp_path, capsys, command):
    damaged = partial(re.sub, 'builtin_interfaces/Time stamp', 'x_msgs/Unknown stamp')
    for number, kind in enumerate(sorted({kind for _, kind, _, _ in messages})):
        path = tmp_path / f'{number}.mcap'
        order = sorted(messages, key=lambda each: each[1] != kind)  # the first definition counts
        path.write_bytes(written(order, kind, damaged, DELAY_NS))
        _, said = run(command, path, tmp_path / f'out_{number}', capsys)
        assert 'internal error' not in said, kind


@pytest.mark.parametrize('layout', [Layout.RAW])
def test_images_whose_type_only_another_topic_defines_do_not_stop_a_plan(
    messages, tmp_path, capsys
):
    kind = 'sensor_msgs/msg/CompressedImage'  # markers contain one
    path, out = tmp_path / 'o.mcap', tmp_path / 'set'
    path.write_bytes(written(messages, kind, lambda _: NEEDS_UNKNOWN, 0))
    assert main(['to-kitti', str(path), str(out), '--layout', 'object']) == EXIT_LOSSES
    assert f'defines {kind}' in capsys.readouterr().err
    assert len([*out.glob('training/velodyne/*.bin')]) == 2
    assert not [*out.glob('training/image_2/*')]
