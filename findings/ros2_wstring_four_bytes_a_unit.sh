#!/usr/bin/env bash
# ROS 2: a wstring is UTF-16 in memory, but each of its code units takes four bytes in a message.
#
# Versions: ros-jazzy-rclpy 7.1.6 with rmw_fastrtps_cpp, ros-jazzy-test-msgs 2.0.3,
# mcap-ros2-support 0.6.0, rosbags 0.11.9, Python 3.11. Kilted's wheels write the same bytes.
#
# Behaviour: serialize_message writes the number of UTF-16 code units, then each unit as a uint32,
# and no terminator. A character outside of the basic plane is two surrogates in eight bytes. A
# string, in the same message, counts bytes and the terminator that follows them.
#
# Why it surprises: ROS 2 documents wstring as UTF-16 and holds it in a u16string, so that a reader
# of bags expects two bytes a unit (or, from the size, UTF-32 with one number a character: both
# guesses are wrong). There is little to copy from: mcap-ros2-support raises NotImplementedError
# for the type, and the .msg parser of rosbags takes it for a message "wstring" of the same package.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import struct

from mcap_ros2 import _dynamic
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg
from test_msgs.msg import WStrings

text = 'a\U0001d11eb'  # three characters, four units
message = WStrings(wstring_value=text)
data = serialize_message(message)
count, *units = struct.unpack_from('<5I', data, 4)
print(f'{len(text)} characters: count {count}, then', [hex(unit) for unit in units])
assert (count, units) == (4, [0x61, 0xD834, 0xDD1E, 0x62]), (count, units)
(following,) = struct.unpack_from('<I', data, 24)
assert following == len('Hello world!'), 'there is a terminator now'
assert deserialize_message(data, WStrings).wstring_value == text
try:
    read = _dynamic.generate_dynamic('a/msg/B', 'wstring text')['a/msg/B'](data)
except NotImplementedError as error:
    print('mcap-ros2-support:', error)
else:
    raise AssertionError(f'mcap-ros2-support reads {read}')
types = get_types_from_msg('wstring text\n', 'a/msg/B')
print('rosbags:', types)
assert types['a/msg/B'][1][0][1] == (Nodetype.NAME, 'a/msg/wstring'), types
PYTHON
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q 'ros-jazzy-rclpy[fastrtps]==7.1.6' ros-jazzy-test-msgs==2.0.3 \
  mcap-ros2-support==0.6.0 rosbags==0.11.9
"$folder/venv/bin/python" "$folder/check.py"
