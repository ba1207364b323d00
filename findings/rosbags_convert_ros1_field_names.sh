#!/usr/bin/env bash
# rosbags-convert: the ROS 2 bag of a ROS 1 bag has CameraInfo with the fields D, K, R and P.
#
# Version: rosbags 0.11.9, Python 3.11.
#
# Behaviour: the converter writes the type sensor_msgs/msg/CameraInfo with the fields that the ROS 1
# bag defines. ROS 1 spells four of them in capitals, ROS 2 in small letters: the bag's definition
# says "float64[9] K", and its hash of the type is not that of ROS 2. The bytes are the same, so
# ros2 bag play, which goes by the name of the type, plays the bag; a reader that goes by the
# definition in the bag, as rosbags' own AnyReader does, gets message.K and no message.k.
#
# Why it surprises: the name of the type is that of ROS 2, the header has lost its seq as ROS 2
# wants it, and the destination is given as a ROS 2 bag: one expects the type of ROS 2. Only
# --dst-typestore ros2_jazzy gives it.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

INFO = 'sensor_msgs/msg/CameraInfo'
folder = Path(sys.argv[1])
ros1 = get_typestore(Stores.ROS1_NOETIC)
types = ros1.types
header = types['std_msgs/msg/Header'](0, types['builtin_interfaces/msg/Time'](1, 0), 'camera')
roi = types['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
k = np.array([700.0, 0, 600, 0, 700, 180, 0, 0, 1])
matrices = np.zeros(5), k, np.eye(3).ravel(), np.zeros(12)
message = types[INFO](header, 375, 1242, 'plumb_bob', *matrices, 0, 0, roi)
with Writer(folder / 'ros1.bag') as writer:
    connection = writer.add_connection('/camera_info', INFO, typestore=ros1)
    writer.write(connection, 10**9, ros1.serialize_ros1(message, INFO))

print('rosbags', version('rosbags'))
expected = get_typestore(Stores.ROS2_JAZZY).hash_rihs01(INFO)
found = []
for name, options in (('default', []), ('jazzy', ['--dst-typestore', 'ros2_jazzy'])):
    command = [Path(sys.executable).with_name('rosbags-convert'), '--src', folder / 'ros1.bag']
    subprocess.run([*command, '--dst', folder / name, *options], check=True)
    with AnyReader([folder / name]) as reader:
        (row,) = reader.messages()
        message = reader.deserialize(row[2], INFO)
        same = reader.connections[0].digest == expected
    found.append((hasattr(message, 'K'), hasattr(message, 'k'), same))
    print(f'{name}: K {found[-1][0]}, k {found[-1][1]}, hash of ROS 2 {same}')
assert found == [(True, False, False), (False, True, True)], found
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q rosbags==0.11.9
"$folder/venv/bin/python" "$folder/check.py" "$folder"
