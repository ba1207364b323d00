# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Wide strings, in bytes that ROS 2 itself serialised."""

from __future__ import annotations

import struct

import pytest
from rosbags.serde import SerdeError

from kitti_ros2.bags.stored_messages import parse_definition, typestore_of
from kitti_ros2.messages.type_descriptions import defined_hash

NAME = 'test_msgs/msg/WStrings'
# The fields of the type in ros-jazzy-test-msgs 2.0.3, whose hash is the same in 2.3.0 of Kilted.
TEXT = """\
wstring wstring_value
wstring wstring_value_default1 "Hello world!"
wstring wstring_value_default2 "Hellö wörld!"
wstring wstring_value_default3 "ハローワールド"
#wstring WSTRING_CONST="Hello world!"
wstring[3] array_of_wstrings
wstring[<=3] bounded_sequence_of_wstrings
wstring[] unbounded_sequence_of_wstrings
"""
HASH = 'RIHS01_5a2c8ddb2054600023b9a180652f2ba895373217cad4b1f0fc1258c9e4424a79'
VALUES = ['a\U0001f600b', '', 'hé', 'ハ', ['', 'x', ''], [], ['x', 'yz']]
# rclpy.serialization.serialize_message of both distributions, up to the end of the last string.
SERIALISED = bytes.fromhex(
    '00010000'
    '04000000 61000000 3dd80000 00de0000 62000000'
    '00000000'
    '02000000 68000000 e9000000'
    '01000000 cf300000'
    '00000000 01000000 78000000 00000000'
    '00000000'
    '02000000 01000000 78000000 02000000 79000000 7a000000'
)
IDL = """\
module test_msgs { module msg {
  typedef wstring wstring__3[3];
  struct WStrings {
    wstring wstring_value;
    wstring wstring_value_default1;
    wstring wstring_value_default2;
    wstring wstring_value_default3;
    wstring__3 array_of_wstrings;
    sequence<wstring, 3> bounded_sequence_of_wstrings;
    sequence<wstring> unbounded_sequence_of_wstrings;
  };
}; };
"""


def values_of(message):
    return [getattr(message, name) for name in message.__dataclass_fields__ if name[0] != '_']


def swapped(data):
    words = struct.unpack(f'<{len(data) // 4 - 1}I', data[4:])
    return b'\0\0\0\0' + struct.pack(f'>{len(words)}I', *words)


@pytest.mark.parametrize('serialised', [SERIALISED, swapped(SERIALISED)], ids=['little', 'big'])
@pytest.mark.parametrize(('text', 'encoding'), [(TEXT, 'ros2msg'), (IDL, 'ros2idl')])
def test_wide_strings_are_read_as_ros_2_writes_them(text, encoding, serialised):
    store = typestore_of(parse_definition(NAME, text, encoding))
    assert values_of(store.deserialize_cdr(serialised, NAME)) == VALUES
    assert defined_hash(NAME, store) == HASH


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        ('wstring<=5 text', {'text'}),
        ('  wstring[<=2]  text  # of a sign', {'text'}),
        ('wstring<=5[3] text', {'text'}),
        ('wstring WIDE="a=b"', set()),
        ('string text "wstring is not a type here"', {'text'}),
        ('uint8[] wstring', {'wstring'}),
    ],
)
def test_every_form_of_a_field_is_read(line, expected):
    fields = parse_definition('a/msg/B', f'{line}\nstring<=3 after "x"', 'ros2msg')['a/msg/B'][1]
    assert {name for name, _ in fields} == expected | {'after'}


def test_bounds_are_part_of_the_hash():
    hashes = {
        defined_hash('a/msg/B', typestore_of(parse_definition('a/msg/B', line, 'ros2msg')))
        for line in ('wstring x', 'wstring<=5 x', 'wstring<=6 x', 'string<=5 x')
    }
    assert len(hashes) == 4


@pytest.mark.parametrize(
    'body',
    [b'\xff\xff\xff\xff', b'\1\0\0\0\0\0\1\0', b'\2\0\0\0a\0b\0'],
    ids=['long', 'wide', 'two'],
)
def test_a_damaged_wide_string_is_refused(body):
    store = typestore_of(parse_definition('a/msg/B', 'wstring text', 'ros2msg'))
    with pytest.raises(SerdeError):
        store.deserialize_cdr(b'\0\1\0\0' + body, 'a/msg/B')
