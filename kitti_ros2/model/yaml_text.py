# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""YAML texts of any origin, parsed by libyaml where that parses like PyYAML's own parser."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from typing import TypeAlias

    _Loader: TypeAlias = type[yaml.SafeLoader | yaml.CSafeLoader]

_DEEPEST = 100
# ASCII but tabs and question marks, some of which libyaml takes and PyYAML refuses.
_COMMON = re.compile(rb'[\n -> @-~]*')


def load_yaml(text: str | bytes) -> Any:  # noqa: ANN401 - YAML has values of any type
    """Return the value of a YAML text, the same with and without libyaml.

    Raises:
        yaml.YAMLError: The text is not YAML.
        ValueError: A value, such as a date, is invalid.
        RecursionError: The text is nested too deeply.
    """
    data = text if isinstance(text, bytes) else text.encode('utf-8', 'surrogatepass')
    if _COMMON.fullmatch(data):
        try:
            return yaml.load(text, _FAST_LOADER)  # noqa: S506 - a SafeLoader
        except (yaml.YAMLError, ValueError):
            pass  # PyYAML takes a few texts that libyaml refuses, and names the error
    return yaml.safe_load(text)


def _fast_loader() -> _Loader:
    try:
        from yaml import CSafeLoader  # noqa: PLC0415 - PyYAML may be built without libyaml
    except ImportError:
        return yaml.SafeLoader

    class Loader(CSafeLoader):
        """A loader that stops at a depth, for libyaml's recursion ends in a crash."""

        depth = 0

        def descend_resolver(self, *node: object) -> None:
            self.depth += 1
            if self.depth > _DEEPEST:
                raise yaml.YAMLError('nested too deeply')
            super().descend_resolver(*node)

        def ascend_resolver(self) -> None:
            self.depth -= 1
            super().ascend_resolver()

    return Loader


_FAST_LOADER = _fast_loader()
