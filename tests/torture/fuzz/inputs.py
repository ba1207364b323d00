# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Valid inputs: the files of small synthetic recordings, bags made of them, and KITTI's own."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.own_bags.to_bag import ExportOptions, convert
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from .target import place

if TYPE_CHECKING:
    from collections.abc import Sequence

SHARED = Path(__file__).resolve().parents[4] / 'shared'
"""Real files, beside the repository; absent on a user's machine."""
TINY = SyntheticOptions(frames=2, image_size=(32, 16), lidar_columns=16, extract=True)
_LARGEST = 40_000


@cache
def recording(layout: Layout) -> Path:
    """A recording of two frames with few points and pixels."""
    options = TINY if layout is Layout.RAW else SyntheticOptions(2, 0, (32, 16), 16)
    return write_synthetic(place(layout.value), layout, options)


def files(pattern: str, *layouts: Layout, most: int = 3) -> list[bytes]:
    """The contents of files of the recordings whose paths fit a pattern."""
    found = []
    for layout in layouts or tuple(Layout):
        root = recording(layout)
        root = root.parent if layout is Layout.RAW else root
        found += sorted(root.rglob(pattern))[:most]
    return [path.read_bytes() for path in found]


def samples(*patterns: str, most: int = 2, lines: int = 40) -> list[bytes]:
    """The beginnings of real files, none on a machine without them."""
    found = [path for each in patterns for path in sorted(SHARED.glob(each))[:most]]
    texts = (path.read_bytes() for path in found)
    return [b''.join(text.splitlines(keepends=True)[:lines])[:_LARGEST] for text in texts]


def found(*patterns: str) -> list[bytes]:
    """Inputs that broke something once, none on a machine without them."""
    paths = [path for each in patterns for path in sorted(SHARED.glob(f'found/{each}'))]
    return [path.read_bytes() for path in paths]


@cache
def own_bag(name: str, layout: Layout = Layout.OBJECT, compression: str = 'none') -> Path:
    """A bag that to-bag writes of a small recording."""
    storage = {'.mcap': 'mcap', '.bag': 'ros1'}.get(Path(name).suffix, 'sqlite3')
    options = ExportOptions(
        MessageOptions(),
        SelectionOptions(topics=('/kitti/*', '/tf*')),
        BagOptions(storage=storage, compression=compression, overwrite=True),
    )
    out = place(f'bags/{layout.value}_{compression}_{name}')
    convert(open_recording(recording(layout)), out, options)
    return out


def bag_bytes(name: str, *layouts: Layout, compression: str = 'none') -> list[bytes]:
    """The files of own bags."""
    made = [own_bag(name, layout, compression) for layout in layouts or (Layout.OBJECT,)]
    paths = [next(iter(path.glob('*.db3'))) if path.is_dir() else path for path in made]
    return [path.read_bytes() for path in paths]


def joined(parts: Sequence[bytes]) -> bytes:
    """Several files as one input; see parted."""
    return SEPARATOR.join(parts)


SEPARATOR = b'\n\x1e\n'
"""Between the files of an input that has several."""


def parted(data: bytes, count: int) -> list[bytes]:
    """The files of an input, empty where there are fewer."""
    parts = data.split(SEPARATOR, count - 1)
    return [*parts, *[b''] * (count - len(parts))]
