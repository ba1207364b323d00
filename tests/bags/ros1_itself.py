# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes bags with ROS 1's own rosbag; for the Python that has it, without kitti_ros2.

ros1_itself.py read BAG               print as JSON all that rosbag reads
ros1_itself.py read BAG COPY          the same, and the same of a copy whose index is made anew
ros1_itself.py write BAG COMPRESSION  write a bag, and print the same of what was written

Debian and Ubuntu: apt-get install python3-rosbag python3-sensor-msgs (their python3 has it then).
"""

import hashlib
import io
import json
import shutil
import sys
from pathlib import Path

import genpy
import rosbag
import roslib.message
from sensor_msgs.msg import Image
from std_msgs.msg import String

IMAGE_BYTES = 1_300_000  # of more than one block of lz4


def read(path):
    """Every message, deserialised by the definition in the bag and serialised again."""
    messages, unlike, loaded = [], [], {}
    with rosbag.Bag(path) as bag:
        information = str(bag)
        for topic, data, stamp in bag.read_messages(raw=True):
            msgtype, payload, md5sum, _, kind = data
            if msgtype not in loaded:
                own = roslib.message.get_message_class(msgtype)
                loaded[msgtype] = kind
                if md5sum != kind._md5sum or (own is not None and own._md5sum != md5sum):
                    unlike.append(msgtype)
            message = kind().deserialize(payload)
            again = io.BytesIO()
            message.serialize(again)
            if again.getvalue() != payload:
                unlike.append(topic)
            messages.append(row(topic, stamp, payload))
        return {
            'messages': sorted(messages),
            'counted': bag.get_message_count(),
            'compression': bag.get_compression_info().compression,
            'unlike': unlike,
            'information': information,
        }


def row(topic, stamp, payload):
    return [topic, stamp.to_nsec(), hashlib.sha256(payload).hexdigest()]


def reindex(path):
    """Lose the index of a bag, and make it anew as `rosbag reindex` does."""
    with Path(path).open('r+b') as file:
        start = file.read(4096)
        where = start.index(b'index_pos=') + len(b'index_pos=')
        end = int.from_bytes(start[where : where + 8], 'little')
        file.seek(where)
        file.write(bytes(8))
        file.truncate(end)
    with rosbag.Bag(path, 'a', allow_unindexed=True) as bag:
        for _ in bag.reindex():
            pass


def write(path, compression):
    """Texts and images on two topics, in several chunks."""
    rows = []
    with rosbag.Bag(path, 'w', compression=compression) as bag:
        for number in range(7):
            stamp = genpy.Time(1_317_042_146, 999_999_990 + number)
            image = Image(height=1, width=IMAGE_BYTES, encoding='mono8', step=IMAGE_BYTES)
            image.header.seq = number
            image.data = bytes(value * number % 251 for value in range(997)) * (
                IMAGE_BYTES // 997 + 1
            )
            image.data = image.data[:IMAGE_BYTES]
            for topic, message in (('/text', String(data='ü' * number)), ('/image', image)):
                payload = io.BytesIO()
                message.serialize(payload)
                bag.write(topic, message, stamp)
                rows.append(row(topic, stamp, payload.getvalue()))
    return {'messages': sorted(rows)}


def main():
    """The job that the arguments name."""
    job, path, *rest = sys.argv[1:]
    if job == 'write':
        found = write(path, *rest)
    elif rest:
        shutil.copyfile(path, rest[0])
        reindex(rest[0])
        found = [read(path), read(rest[0])]
    else:
        found = read(path)
    json.dump(found, sys.stdout)


if __name__ == '__main__':
    main()
