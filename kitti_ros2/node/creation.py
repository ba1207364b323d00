# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Creates a node; if the middleware fails, its own message becomes the error."""

from __future__ import annotations

import errno
import re
from typing import TYPE_CHECKING, TypeVar

from ..model.errors import UsageError
from ..model.text import one_line
from .held_stderr import TOO_MANY, held_stderr, lacks_files
from .installed import middleware
from .middleware import settings_variable

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

T = TypeVar('T')

# Cyclone DDS: seconds, domain, thread. Fast DDS: time, category; and the function at the end.
_CYCLONE_LINE = re.compile(r'\d+\.\d+ \[\w*\]\s+[^:]*: ')
_FAST_LINE = re.compile(r'\d{4}-\d\d-\d\d [\d:.]+ \[\S+ \w+\] ')
_FAST_END = re.compile(r' -> Function \w+$')
_COLOUR = re.compile(r'\x1b\[[\d;]*m')


def create_node(create: Callable[[], T]) -> T:
    """Create a node; some middleware reads its settings then, and reports errors on stderr.

    Args:
        create: Creates the node.

    Raises:
        UsageError: The middleware fails; with its own message and the variable of its settings.
    """
    with held_stderr() as written:
        try:
            return create()
        except RuntimeError as error:  # those of rclpy, and of the C++ below it
            raise UsageError(_refusal(written(), str(error))) from error
        except OSError as error:  # of a module that is imported late
            if error.errno != errno.EMFILE:
                raise
            raise UsageError(_refusal(written(), TOO_MANY)) from error


def _refusal(lines: Sequence[str], error: str) -> str:
    """Format one line: the middleware, its reason, and the variable of its settings."""
    if lacks_files(error):
        return f'{middleware()} cannot create the node: {TOO_MANY}'
    text = f'{middleware()} cannot create the node: {_last_message(lines) or one_line(error)}'
    variable = settings_variable()
    return f'{text}; check {variable}' if variable else text


def _last_message(lines: Sequence[str]) -> str:
    """Return the last message of the middleware, without time and thread; empty if none.

    Lines of rcl and rmw only report that it failed.
    """
    reason = ''
    for line in lines:
        plain = _FAST_END.sub('', _COLOUR.sub('', line))
        for beginning in (_CYCLONE_LINE, _FAST_LINE):
            if found := beginning.match(plain):
                reason = plain[found.end() :].strip()
    return reason
