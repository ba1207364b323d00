#!/usr/bin/env bash
# pymcap-cli: bag2mcap keeps md5sum and callerid of a ROS 1 connection, and loses latching.
#
# Versions: pymcap-cli 0.34.0, mcap 1.4.0, rosbags 0.11.9, Python 3.11.
#
# Behaviour: a latched connection of a ROS 1 bag (/tf_static, /map) has latching=1 in its header,
# by which rosbag play publishes it as latched. In the MCAP file of bag2mcap the metadata of the
# channel has md5sum and callerid of the same header, and no latching; topics that were latched and
# topics that were not look the same.
#
# Why it surprises: the help says that all message data is preserved, nothing is printed, and the
# two fields beside it are kept. A player of the file has nothing left by which a subscriber that
# comes late would get the static transforms.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_typestore

folder = Path(sys.argv[1])
ros1 = get_typestore(Stores.ROS1_NOETIC)
text = ros1.types['std_msgs/msg/String']('a')
with Writer(folder / 'ros1.bag') as writer:
    for topic, latched in (('/latched', 1), ('/plain', 0)):
        connection = writer.add_connection(
            topic, 'std_msgs/msg/String', typestore=ros1, callerid='/node', latching=latched
        )
        writer.write(connection, 10**9, ros1.serialize_ros1(text, 'std_msgs/msg/String'))
with Reader(folder / 'ros1.bag') as reader:
    before = {connection.topic: connection.ext.latching for connection in reader.connections}
tool = Path(sys.executable).with_name('pymcap-cli')
subprocess.run(
    [tool, '--quiet', 'bag2mcap', folder / 'ros1.bag', '-o', folder / 'out.mcap'], check=True
)
with (folder / 'out.mcap').open('rb') as file:
    channels = make_reader(file).get_summary().channels.values()
    after = {channel.topic: sorted(channel.metadata) for channel in channels}
print('pymcap-cli', version('pymcap-cli'))
print('latching in the bag:', before)
print('metadata in MCAP:', after)
assert before == {'/latched': 1, '/plain': 0}, before
assert after == dict.fromkeys(before, ['callerid', 'md5sum']), after
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pymcap-cli==0.34.0 mcap==1.4.0 rosbags==0.11.9
"$folder/venv/bin/python" "$folder/check.py" "$folder"
