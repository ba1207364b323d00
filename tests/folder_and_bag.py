# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings with holes in their numbers, and bags of them."""

from __future__ import annotations

import shutil

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.outputs import BagOptions

from builders import convert_recording  # isort: skip

BAGS = {'mcap': 'bag.mcap', 'sqlite3': 'bag', 'ros1': 'bag.bag'}
OBJECT_NUMBERS = (8, 10, 15, 16, 30)
GONE = {
    Layout.RAW: ('velodyne_points/data/*0.bin', 'image_0[0123]/data/*0.png', 'image_02/data/*3.png',
                 'velodyne_points/data/*2.bin'),
    Layout.ODOMETRY: ('sequences/*/velodyne/*2.bin', 'sequences/*/image_2/*0.png'),
    Layout.TRACKING: ('*/velodyne/*/*0.bin', '*/image_0[23]/*/*[0123].png'),
    Layout.OBJECT: ('*/image_2/*16.png',),
    Layout.KITTI_360: ('data_3d_raw/*/*/data/*[02].bin', 'data_2d_raw/*/image_0[01]/*/*0.png',
                       'data_2d_raw/*/image_00/*/*3.png', 'data_2d_raw/*/image_02/*/*2.png',
                       'data_poses/*/oxts/data/*1.txt'),
}  # fmt: skip
"""By layout the files that a recording with holes does not have."""


def make_holes(path, layout, folder):
    """A copy of a recording whose numbers have holes; returns the folder to convert."""
    whole = path.parent if layout is Layout.RAW else path
    copy = folder / whole.name
    shutil.copytree(whole, copy)
    source = copy / path.name if layout is Layout.RAW else copy
    if layout is Layout.OBJECT:
        numbered = sorted(source.glob('*/*/0*.*'), reverse=True)
        for file in numbered:
            number = OBJECT_NUMBERS[int(file.stem)]
            file.rename(file.with_name(f'{number:06d}{file.suffix}'))
    for pattern in GONE[layout]:
        gone = sorted(source.glob(pattern))
        assert gone, pattern
        for file in gone:
            file.unlink()
    return source


def make_bag(source, folder, storage='mcap', selection=None, images=Images.COMPRESSED):
    """The bag of a recording, in a folder of its own."""
    folder.mkdir(exist_ok=True)
    path = folder / BAGS[storage]
    convert_recording(source, path, MessageOptions(images=images), selection, storage=storage)
    return path


def unchanged(message):
    """The bytes of a message."""
    return bytes(message.data)


def rerecord(path, out, late_ns, change=unchanged):
    """The bag as a recorder logs it from a player: later, every message with its own header."""
    with open_messages(path) as messages, open_bag(out, BagOptions(), TYPESTORE) as writer:
        ids = {
            topic: writer.add_channel(
                Channel(topic, msgtype, latched=topic in messages.latched, depth=1)
            )
            for topic, msgtype in messages.channels
        }
        for message in messages:
            writer.write(ids[message.topic], message.stamp_ns + late_ns, [change(message)])
    return out
