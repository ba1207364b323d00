# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: several bags as one recording, and folders of files that may be bags."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from pathlib import Path
from shutil import rmtree

from kitti_ros2.bags.locate import is_bag, looks_like_bag
from kitti_ros2.bags.reader import BagMessages, open_messages
from kitti_ros2.bags.recover import recover
from kitti_ros2.model.errors import KittiRos2Error

from .bag_targets import (
    COMMON,
    HELLO,
    IMAGE,
    RECORD_WORDS,
    metadata_texts,
    read_bag,
    small,
)
from .database_inputs import with_log, without_log
from .inputs import bag_bytes
from .target import Target, place, stored

from stored_messages import make_mcap  # isort: skip

_MOST_NAMES = 6


def _several(data: bytes) -> None:
    """Read two bags as one recording, and as recover copies them."""
    first, second = without_log(data)
    paths = stored('several/a.mcap', first), stored('several/b.mcap', second)
    for as_stored, converted in ((True, ()), (True, ('ros1', 'json', 'protobuf')), (False, ())):
        with (
            suppress(KittiRos2Error),
            BagMessages(paths, as_stored=as_stored, converted=converted) as messages,
        ):
            for message in messages:
                bytes(message.data[:4])
    with suppress(KittiRos2Error), open_messages(paths, {'/t', '/i'}) as messages:
        list(messages)
    with suppress(KittiRos2Error):
        recover(paths[1], paths[1], overwrite=True)
    for name in ('several', 'several.bag', 'several.mcap'):
        recover(paths[1], place(f'recovered/{name}'), overwrite=True)


def _pairs() -> list[bytes]:
    """Two bags each: alike, of another type, of definitions that differ, unknown or damaged."""
    plain = make_mcap([HELLO])
    other = plain.replace(b'std_msgs/msg/String', b'std_msgs/msg/Strinh')
    texts = (b'string data', b'int64 data\n', b'x/Y datum_', b'string 1\n')
    defined = [plain.replace(texts[0], text.ljust(len(texts[0]))) for text in texts[1:]]
    unknown = plain.replace(b'ros2msg', b'ros9msg')
    bool_ = make_mcap([('/t', 'std_msgs/msg/Bool', 5, b'\0\1\0\0\1'), IMAGE])
    seconds = [plain, other, *defined, unknown, bool_, b'', plain[:-60]]
    return [
        *(with_log(plain, each) for each in seconds),
        *(with_log(each, plain) for each in seconds),
    ]


def _folder(data: bytes) -> None:
    """Read a folder of files with some names, each the beginning of a bag of its kind."""
    folder = place('folder_of_files')
    rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for line in data.decode('utf-8', 'replace').split('\n')[:_MOST_NAMES]:
        name = line.replace('/', '')
        content = metadata_texts()[0] if name == 'metadata.yaml' else small()[0]
        with suppress(OSError, ValueError):  # of names that no file can have
            (folder / name).write_bytes(_kinds().get(Path(name).suffix, content))
    looks_like_bag(folder)
    for path in sorted(folder.iterdir()):
        with suppress(KittiRos2Error):
            is_bag(path)
    read_bag(folder)


@cache
def _kinds() -> dict[str, bytes]:
    """Bags by the suffix of their files, and what is none."""
    return {'.bag': bag_bytes('a.bag')[0], '.db3': bag_bytes('a')[0], '.txt': b'text', '.zstd': b''}


_FOLDERS = (
    *(b'a_0.mcap', b'a.mcap', b'a.mcap\nb.mcap', b'a.mcap\nmetadata.yaml', b'metadata.yaml', b''),
    *(b'a.bag\nb.bag', b'a_0.db3\na_1.db3', b'a.mcap.zstd', b'a_0.mcap\na.bag\nc.txt', b'c.txt'),
)


TARGETS = (
    Target('several', _several, _pairs,
           ('bags/recover.py', 'bags/stored_messages.py', *COMMON), RECORD_WORDS, short=20),
    Target('folder', _folder, lambda: _FOLDERS, ('bags/locate.py',), (b'.mcap', b'.bag', b'_0.'),
           is_text=True, short=30),
)  # fmt: skip
"""All of them."""
