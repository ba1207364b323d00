# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Creates a node; if the middleware fails, its own message becomes the error."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from rclpy.impl.implementation_singleton import rclpy_implementation

from ..model.errors import UsageError
from ..model.text import one_line
from .installed import middleware
from .middleware import settings_variable

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

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
    with _written_to_stderr() as written:
        try:
            return create()
        except rclpy_implementation.RCLError as error:
            raise UsageError(_refusal(written(), str(error))) from error


def _refusal(lines: Sequence[str], error: str) -> str:
    """Format one line: the middleware, its reason, and the variable of its settings."""
    text = f'{middleware()} cannot create the node: {_reason(lines) or one_line(error)}'
    variable = settings_variable()
    return f'{text}; check {variable}' if variable else text


def _reason(lines: Sequence[str]) -> str:
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


@contextmanager
def _written_to_stderr() -> Iterator[Callable[[], list[str]]]:
    """Hold back what libraries write to stderr; write it at the end unless it was read."""
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        held = os.dup(2)
        read = False

        def written() -> list[str]:
            nonlocal read
            read = True
            file.seek(0)
            return file.read().decode(errors='replace').splitlines()

        os.dup2(file.fileno(), 2)
        try:
            yield written
        finally:
            os.dup2(held, 2)
            os.close(held)
            if not read:
                sys.stderr.writelines(f'{line}\n' for line in written())
