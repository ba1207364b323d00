#!/usr/bin/env bash
# rclpy: -p frame:=0007 is the integer 7, 0008 the float 8.0, and 0010 the integer 8.
#
# Versions: the wheels ros-jazzy-rclpy 7.1.6 and ros-kilted-rclpy 9.1.2, Python 3.11.
#
# Behaviour: rcl's parser of parameters (rcl_yaml_param_parser) tries an unquoted value as an integer
# whose base its prefix tells, then as a float. With zeros in front the base is 8: 0007 is 7, 0010 is
# 8. The digits 8 and 9 are no octal digits, so 0008, 0009 and 0018 become floats. A node that declared
# a text refuses them all for their type, one that declared an integer refuses 0008 and takes 0010
# for 8. Only quotes in quotes help: -p 'frame:="0010"'.
#
# Why it surprises: numbers of fixed width are what file names and frames have (KITTI's 0000000010).
# Trials with the first eight all work; YAML 1.2, where 0010 is 10, and the command lines of most
# programs count by tens.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-95} ROS_HOME=$folder
cat >"$folder/check.py" <<'PYTHON'
from importlib.metadata import version

import rclpy

WORDS = ('0007', '0008', '0009', '0010', '0018', '0000000012', '"0010"')
arguments = ['--ros-args']
for number, word in enumerate(WORDS):
    arguments += ['-p', f'frame{number}:={word}']
rclpy.init(args=arguments)
node = rclpy.create_node('check', automatically_declare_parameters_from_overrides=True)
found = [node.get_parameter(f'frame{number}').value for number in range(len(WORDS))]
rclpy.shutdown()
print('rclpy', version('rclpy'), *(f'{word} -> {value!r}' for word, value in zip(WORDS, found)))
expected = [7, 8.0, 9.0, 8, 18.0, 10, '0010']
assert [(type(value), value) for value in found] == [(type(value), value) for value in expected]
PYTHON
for wheel in 'ros-jazzy-rclpy[fastrtps]==7.1.6' 'ros-kilted-rclpy[fastrtps]==9.1.2'; do
  rm -rf "$folder/venv"
  python3 -m venv "$folder/venv"
  "$folder/venv/bin/pip" install -q "$wheel"
  "$folder/venv/bin/python" "$folder/check.py"
done
