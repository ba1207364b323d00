# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of a package that are imported when they are used first: the command line needs none."""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # as in kitti_ros2/__init__.py
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def lazy_names(package: str, modules: Mapping[str, str]) -> Callable[[str], object]:
    """Return the __getattr__ of a package (PEP 562).

    Args:
        package: Its name.
        modules: By public name the module that has it, relative to kitti_ros2.
    """

    def load(name: str) -> object:
        from importlib import import_module  # noqa: PLC0415

        if name not in modules:
            message = f'module {package!r} has no attribute {name!r}'
            raise AttributeError(message)
        attribute = getattr(import_module(f'kitti_ros2.{modules[name]}'), name)
        setattr(sys.modules[package], name, attribute)
        return attribute

    return load
