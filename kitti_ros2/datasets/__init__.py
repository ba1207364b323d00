# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI data sets as a whole: get, check, describe and cut them.

Each name is imported when it is used first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..validation.results import ValidationFinding, ValidationReport
    from ..validation.validate import validate

_MODULES: dict[str, str] = {
    'validate': 'validation.validate',
    'ValidationFinding': 'validation.results',
    'ValidationReport': 'validation.results',
}

__all__: list[str] = [
    'ValidationFinding',
    'ValidationReport',
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
