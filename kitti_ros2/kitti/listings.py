# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Listings of folders, read once while a recording is looked for and opened."""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

S = TypeVar('S')

_KEPT: ContextVar[dict[Path, list[str]] | None] = ContextVar('listings', default=None)


@contextmanager
def listings_kept() -> Iterator[None]:
    """List each folder once within this context, or within the outermost one.

    The detection of a layout asks for the names in a folder once for each layout, and the reader
    once more. What changes on the disk meanwhile is not noticed.
    """
    if _KEPT.get() is not None:
        yield
        return
    token = _KEPT.set({})
    try:
        yield
    finally:
        _KEPT.reset(token)


def kept(names: Callable[[S, Path], list[str]]) -> Callable[[S, Path], list[str]]:
    """Wrap the method that lists a folder, for listings_kept."""

    @wraps(names)
    def listed(store: S, folder: Path) -> list[str]:
        known = _KEPT.get()
        if known is None:
            return names(store, folder)
        if folder not in known:
            known[folder] = names(store, folder)
        return known[folder].copy()

    return listed
