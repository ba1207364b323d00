# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI data sets as a whole: get, check, describe and cut them.

Each name is imported when it is used first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..fetch.download import download
    from ..fetch.extract import extract
    from ..validation.results import ValidationFinding, ValidationReport
    from ..validation.validate import validate
    from .cropping import crop
    from .set_statistics import SetStatistics, statistics
    from .splitting import SplitReport, split

_MODULES: dict[str, str] = {
    'SetStatistics': 'datasets.set_statistics',
    'SplitReport': 'datasets.splitting',
    'ValidationFinding': 'validation.results',
    'ValidationReport': 'validation.results',
    'crop': 'datasets.cropping',
    'download': 'fetch.download',
    'extract': 'fetch.extract',
    'split': 'datasets.splitting',
    'statistics': 'datasets.set_statistics',
    'validate': 'validation.validate',
}

__all__ = [
    'SetStatistics',
    'SplitReport',
    'ValidationFinding',
    'ValidationReport',
    'crop',
    'download',
    'extract',
    'split',
    'statistics',
    'validate',
]


def __getattr__(name: str) -> object:
    from importlib import import_module  # noqa: PLC0415

    if name not in _MODULES:
        message = f'module {__name__!r} has no attribute {name!r}'
        raise AttributeError(message)
    found = getattr(import_module(f'..{_MODULES[name]}', __name__), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
