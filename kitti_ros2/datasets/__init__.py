# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI data sets as a whole: get, check, describe and cut them.

Each name is imported when it is used first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.lazy_names import lazy_names

if TYPE_CHECKING:  # of what these modules hold, the names in __all__ are public
    from ..validation.rule import *
    from ..validation.validate import validate as validate
    from .cropping import *
    from .downloading import *
    from .extracting import *
    from .set_statistics import *
    from .splitting import *

_MODULES: dict[str, str] = {
    'SetStatistics': 'datasets.set_statistics',
    'SplitReport': 'datasets.splitting',
    'ValidationFinding': 'validation.rule',
    'ValidationReport': 'validation.rule',
    'crop': 'datasets.cropping',
    'download': 'datasets.downloading',
    'extract': 'datasets.extracting',
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


if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(__name__, _MODULES)


def __dir__() -> list[str]:
    return __all__
