#!/usr/bin/env bash
# kappe: convert without a configuration makes /tf_static volatile, and leaves other latched topics.
#
# Versions: kappe 0.25.0, mcap 1.6.0, mcap-ros2-support 0.6.0, Python 3.11.
#
# Behaviour: the channels of a rosbag2 MCAP file hold the QoS that publishers offered. kappe convert
# copies it as it is, with transient local for /map. For /tf_static alone it writes the profile anew
# with durability 2, volatile.
#
# Why it surprises: without a configuration nothing is to change, the one topic that every ROS 2
# program takes as latched is the one that loses it, and nothing is printed. ros2 bag play of the
# result offers a volatile /tf_static, which tf2 listeners, who ask for transient local, do not hear.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import yaml
from mcap.reader import make_reader
from mcap_ros2.writer import Writer

LATCHED = '- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n'
TIME = 'int32 sec\nuint32 nanosec\n'
STRING = 'string data\n'
TFS = 'geometry_msgs/TransformStamped[] transforms\n'
RULE = '=' * 80 + '\n'
PARTS = {
    'geometry_msgs/TransformStamped': 'std_msgs/Header header\nstring child_frame_id\n'
    'geometry_msgs/Transform transform\n',
    'std_msgs/Header': 'builtin_interfaces/Time stamp\nstring frame_id\n',
    'builtin_interfaces/Time': TIME,
    'geometry_msgs/Transform': 'geometry_msgs/Vector3 translation\n'
    'geometry_msgs/Quaternion rotation\n',
    'geometry_msgs/Vector3': 'float64 x\nfloat64 y\nfloat64 z\n',
    'geometry_msgs/Quaternion': 'float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n',
}
TFS += ''.join(f'{RULE}MSG: {name}\n{text}' for name, text in PARTS.items())

folder = Path(sys.argv[1])


def durability(path):
    with path.open('rb') as file:
        channels = make_reader(file).get_summary().channels.values()
        texts = {each.topic: each.metadata['offered_qos_profiles'] for each in channels}
    return {topic: yaml.safe_load(text)[0]['durability'] for topic, text in texts.items()}


with (folder / 'in.mcap').open('wb') as file:
    writer = Writer(file)
    schemas = {
        '/tf_static': writer.register_msgdef('tf2_msgs/msg/TFMessage', TFS),
        '/map': writer.register_msgdef('std_msgs/msg/String', STRING),
    }
    for topic, schema in schemas.items():
        # The public writer has no argument for the metadata of a channel.
        channel = writer._writer.register_channel(
            topic, 'cdr', schema.id, {'offered_qos_profiles': LATCHED}
        )
        writer._channel_ids[topic] = channel
    writer.write_message('/tf_static', schemas['/tf_static'], {'transforms': []}, 10**9, 10**9)
    writer.write_message('/map', schemas['/map'], {'data': 'a'}, 10**9, 10**9)
    writer.finish()
before = durability(folder / 'in.mcap')
tool = Path(sys.executable).with_name('kappe')
subprocess.run(
    [tool, '--progress', 'false', 'convert', folder / 'in.mcap', folder / 'out'],
    check=True,
    capture_output=True,
)
after = durability(folder / 'out/in.mcap')
print('kappe', version('kappe'), '(durability 1 is transient local, 2 is volatile)')
print('before:', before)
print('after: ', after)
assert before == {'/tf_static': 1, '/map': 1}, before
assert after == {'/tf_static': 2, '/map': 1}, after
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q kappe==0.25.0 mcap==1.6.0 mcap-ros2-support==0.6.0 pyyaml
"$folder/venv/bin/python" "$folder/check.py" "$folder"
