#!/usr/bin/env bash
# pymcap-cli: filter --latch-from-metadata keeps no latched message of bags of Humble and Iron.
#
# Versions: pymcap-cli 0.34.0, mcap 1.4.0, Python 3.11.
#
# Behaviour: a bag has one transient-local topic, a message at 0 s, and one volatile topic, messages
# at 0 s to 9 s. filter --start 5 s --latch-from-metadata is to replay the latched message into the
# output. It does if offered_qos_profiles of the channel says "durability: transient_local"; with
# "durability: 1", the same policy as rosbag2 of Humble and Iron writes it (the number of rmw), the
# topic is absent. The exit code is 0 and nothing is said in either case.
#
# Why it surprises: the option is documented to detect channels with durability=transient_local, and
# the same program reads both forms elsewhere: its table of QoS has the number 1. So /tf_static and
# robot_description are lost by the cut of any bag that Humble recorded. --latch TOPIC keeps them.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer

FOLDER, PROGRAM = Path(sys.argv[1]), Path(sys.executable).with_name('pymcap-cli')
PROFILE = """- history: {history}
  depth: 1
  reliability: {reliability}
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: {liveliness}
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""
WORDS = dict(history='keep_last', reliability='reliable', liveliness='automatic')
NUMBERS = dict(history=1, reliability=1, liveliness=1)
FORMS = {
    'words (version 9 of metadata)': [
        PROFILE.format(**WORDS, durability=each) for each in ('transient_local', 'volatile')
    ],
    'numbers (Humble, Iron)': [PROFILE.format(**NUMBERS, durability=each) for each in (1, 2)],
}
TEXT = b'\0\1\0\0\6\0\0\0hello\0'
SECOND = 10**9


def write(path, latched, volatile):
    with path.open('wb') as target:
        writer = Writer(target)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        ids = [
            writer.register_channel(topic, 'cdr', schema, {'offered_qos_profiles': profiles})
            for topic, profiles in (('/latched', latched), ('/volatile', volatile))
        ]
        writer.add_message(ids[0], 0, TEXT, 0)
        for second in range(10):
            writer.add_message(ids[1], second * SECOND, TEXT, second * SECOND)
        writer.finish()


kept = {}
for form, profiles in FORMS.items():
    source, out = FOLDER / 'source.mcap', FOLDER / 'out.mcap'
    write(source, *profiles)
    out.unlink(missing_ok=True)
    words = 'filter', source, '-o', out, '--start', str(5 * SECOND), '--latch-from-metadata'
    subprocess.run([PROGRAM, *words], check=True, capture_output=True)
    with out.open('rb') as stream:
        topics = [channel.topic for _, channel, _ in make_reader(stream).iter_messages()]
    kept[form] = topics.count('/latched')
    print(f'{form}: {topics.count("/latched")} of 1 latched message kept, '
          f'{topics.count("/volatile")} of 5 others')
print('pymcap-cli', version('pymcap-cli'))
sys.exit(list(kept.values()) != [1, 0])
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pymcap-cli==0.34.0 mcap==1.4.0
"$folder/venv/bin/python" "$folder/check.py" "$folder"
