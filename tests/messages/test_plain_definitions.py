# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Plain definitions of types, beside what rosbags reads of the same texts."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from kitti_ros2.bags.stored_messages import parse_definition, shortened
from kitti_ros2.messages.type_definitions import parse_plain

DIVIDER = '=' * 80
JAZZY = get_typestore(Stores.ROS2_JAZZY)
KINDS = (
    *('bool', 'byte', 'char', 'float64', 'uint8', 'int64', 'int6', 'string', 'wstring'),
    *('Header', 'time', 'duration', 'Point', 'std_msgs/Header', 'a_b/msg/C', 'x/action/Goal'),
    *('a/b/C', 'a__b/C', 'a_/C', 'msg/X', 'string_t', '_x', '1x', 'stringy', '/x', 'x/', 'A/B'),
    *('string<=5', 'string<='),
)
MANY = ('', '[]', '[3]', '[<=4]', '[0]', '[03]', '[<=]', '[', ' []', '[3][3]')
NAMES = ('x', 'X', 'UPPER_CASE', 'UPPER__CASE', 'Mixed_', 'a__b', '_a', '9', 'class', 'X1', '')
VALUES = (
    *('', '=1', ' = -5', '=0', '=007', '=0x1f', '=1.5', '=true', '="a"', ' 5', '=+3', '=1 # one'),
    *(' # comment', '#', '=99999999999999999999', '= 5 6', "='a#b'"),
)
LINES = st.builds(
    '{}{}{}{}{}{}'.format, st.sampled_from(('', ' ', '\t')), st.sampled_from(KINDS),
    st.sampled_from(MANY), st.sampled_from((' ', '  ', '\t', '')), st.sampled_from(NAMES),
    st.sampled_from(VALUES),
)  # fmt: skip
HEADS = st.sampled_from(
    (
        *(f'{DIVIDER}\nMSG: a/B', f'{DIVIDER}\nMSG: a/msg/B ', f'{DIVIDER} \nMSG: a/C'),
        *(f'{DIVIDER}\nMSG: msg/X', DIVIDER, '@verbatim', 'MSG: a/B'),
    )
)


def rosbags_reads(msgtype, text):
    try:
        return get_types_from_msg(text, msgtype)
    except TypesysError:
        return None


@pytest.mark.parametrize('name', sorted(JAZZY.fielddefs))
def test_types_of_ros_2_are_read_as_rosbags_reads_them(name):
    text = shortened(JAZZY.generate_msgdef(name, ros_version=2)[0])
    assert parse_plain(name, text) in (None, get_types_from_msg(text, name))


def test_most_types_of_ros_2_are_plain():
    texts = {name: shortened(JAZZY.generate_msgdef(name)[0]) for name in JAZZY.fielddefs}
    plain = [name for name, text in texts.items() if parse_plain(name, text) is not None]
    assert len(plain) > 0.9 * len(texts)


@example('a/msg/X', ['uint8 x'] * 3)
@given(
    st.sampled_from(('a/msg/X', 'a/X', 'a/action/X_Goal', 'msg/X', 'X', 'a/b/X', 'a/msg/X-1')),
    st.lists(LINES | HEADS, max_size=6),
)
def test_what_is_read_is_what_rosbags_reads(msgtype, lines):
    text = shortened('\n'.join(lines))
    found = parse_plain(msgtype, text)
    assert found is None or found == rosbags_reads(msgtype, f'{text}\n')


@pytest.mark.parametrize('encoding', ['ros2msg', 'ros1msg'])
def test_a_type_without_fields_may_be_the_last(encoding):
    text = f'Empty nothing\nuint8 MODE=0x10\n{DIVIDER}\nMSG: a/Empty'
    assert parse_definition('a/msg/X', text, encoding)['a/msg/Empty'] == ([], [])
