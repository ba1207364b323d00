# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Notes on a written object set with labels: what stops programs that train on it.

OpenPCDet concatenates the objects of each label file (pcdet/datasets/kitti/kitti_dataset.py,
get_infos); create_data.py of mmdetection3d takes the first frame of each of train, val and test
(tools/dataset_converters/update_infos_to_v2.py).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..kitti import names
from ..kitti.store import STORE

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from .plan import Plan

_LISTS = {'val': '--split 0.8 fills val.txt', 'test': 'a bag converted with --name testing has it'}
"""By list of ImageSets that may be empty, what fills it."""


def set_notes(plan: Plan, folder: Path, files: int, empty: int) -> Iterator[str]:
    """Yield notes on a set; none if it is no object set with labels.

    Args:
        plan: Of the set.
        folder: The one with ImageSets.
        files: Number of label files.
        empty: Number of those without a line.
    """
    if plan.labels is None or not plan.layout.traits.frame_set or not files:
        return
    if empty:
        yield (
            f'{empty} of {files} label files have no line, which stops OpenPCDet: take these frames'
            f' out of ImageSets/train.txt and val.txt'
        )
    paths = {name: folder / names.IMAGE_SETS / f'{name}{names.TXT}' for name in _LISTS}
    lacking = [name for name, path in paths.items() if not STORE.read_text(path).strip()]
    if lacking:
        lists = ' and '.join(f'{name}{names.TXT}' for name in lacking)
        are = 'is empty' if len(lacking) == 1 else 'are empty'
        yield (
            f"ImageSets/{lists} {are}, which stops mmdetection3d's create_data.py:"
            f' {"; ".join(_LISTS[name] for name in lacking)}'
        )
