# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The containers of bags: their names, and how their files are named, begin and are compressed.

A new container gets its entry here; bags/bag_files.py opens its reader, and bags/segments.py its
writer.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Container:
    """A file format of bags.

    Attributes:
        title: Its name for people.
        suffix: Of its files.
        magic: The first bytes of its files.
        globs: File names that belong to a bag in a directory.
        side_suffixes: Of files that its library may leave beside.
        in_file: Whether a bag can be written to a single file of that suffix.
        in_rosbag2: Whether rosbag2 supports it: a directory then has a metadata.yaml.
        encoding: Of the messages in it: cdr or ros1.
        compressions: Name of each to its levels; None for one without levels.
        compresses_messages: Whether it is messages that are compressed (rosbag2's message mode).
        stamp_limit_ns: The first log time that it cannot hold.
    """

    title: str
    suffix: str
    magic: bytes
    globs: tuple[str, ...]
    compressions: dict[str, range | None]
    stamp_limit_ns: int
    side_suffixes: tuple[str, ...] = ()
    in_file: bool = True
    in_rosbag2: bool = True
    encoding: str = 'cdr'
    compresses_messages: bool = False


# By the name that options and metadata.yaml give it.
CONTAINERS = {
    'mcap': Container(
        title='MCAP',
        suffix='.mcap',
        magic=b'\x89MCAP0\r\n',
        globs=('*.mcap', '*.mcap.zstd'),
        compressions={'none': None, 'lz4': range(17), 'zstd': range(1, 23)},
        stamp_limit_ns=2**63,
    ),
    'sqlite3': Container(
        title='SQLite',
        suffix='.db3',
        magic=b'SQLite format 3\0',
        globs=('*.db3', '*.db3.zstd'),
        compressions={'none': None, 'zstd': range(1, 23)},
        stamp_limit_ns=2**63,
        side_suffixes=('.db3-shm', '.db3-wal'),
        in_file=False,
        compresses_messages=True,
    ),
    'ros1': Container(
        title='ROS 1',
        suffix='.bag',
        magic=b'#ROSBAG V',
        globs=('*.bag', '*.bag.active'),
        compressions={'none': None, 'lz4': None, 'bz2': None},
        stamp_limit_ns=2**32 * 10**9,
        in_rosbag2=False,
        encoding='ros1',
    ),
}

# As messages and help texts list them.
ANY_BAG = 'an MCAP file, a rosbag2 directory or a ROS 1 .bag'
FILE_NAMES = ', '.join(f'NAME{each.suffix}' for each in CONTAINERS.values() if each.in_file)


def container_of(suffix: str) -> str | None:
    """Return the name of the container that is written to single files of a suffix, if any."""
    for name, container in CONTAINERS.items():
        if container.in_file and container.suffix == suffix:
            return name
    return None
