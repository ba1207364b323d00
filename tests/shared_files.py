# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files that are made once in a test run, by the first of its processes that needs them."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import write_synthetic

from builders import SMALL  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], Path]) -> Path:
    """Return what make(folder) returned in the first process that asked for the name.

    The others wait for it. What fails is tried again by the next.
    """
    base = factory.getbasetemp()
    root = base.parent if 'PYTEST_XDIST_WORKER' in os.environ else base
    with (root / f'{name}.made').open('a+') as made:
        fcntl.flock(made, fcntl.LOCK_EX)
        made.seek(0)
        if found := made.read():
            return root / found
        folder = root / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        path = make(folder)
        made.write(os.path.relpath(path, root))
        return path


class SyntheticRecordings(Mapping[Layout, 'Path']):
    """The folder to convert, by layout, made when it is needed first."""

    def __init__(self, factory: pytest.TempPathFactory) -> None:
        self._factory = factory
        self._paths: dict[Layout, Path] = {}

    def __getitem__(self, layout: Layout) -> Path:
        if layout not in self._paths:
            self._paths[layout] = made_once(
                self._factory,
                f'synthetic_{layout.value}',
                lambda folder: write_synthetic(folder / layout.value, layout, SMALL),
            )
        return self._paths[layout]

    def __iter__(self) -> Iterator[Layout]:
        return iter(Layout)

    def __len__(self) -> int:
        return len(Layout)
