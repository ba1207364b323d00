# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The log of Foxglove's SDK: a few lines of it, however much a viewer makes it write.

The SDK logs by Python's logging, a line for each message that it does not understand. A client may
send thousands.
"""

from __future__ import annotations

import logging
import os
from collections import Counter
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

LEVEL_VARIABLE = 'FOXGLOVE_LOG_LEVEL'
"""Of the SDK: who sets it gets all lines of that level."""

_OF_VIEWERS = 'foxglove.websocket'
_MOST = 3
"""Lines about viewers, and about everything else."""


class _FewLines(logging.Handler):
    """Passes the first lines of each kind on.

    Args:
        complain: Called with a line.
    """

    def __init__(self, complain: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._complain = complain
        self._counts: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record on; called by one thread at a time."""
        kind = 'viewers' if record.name.startswith(_OF_VIEWERS) else 'itself'
        self._counts[kind] += 1
        if self._counts[kind] <= _MOST:
            self._complain(f'foxglove-sdk: {record.getMessage()}')
        elif self._counts[kind] == _MOST + 1:
            self._complain(
                f'foxglove-sdk: more lines about {kind} are not shown; {LEVEL_VARIABLE}=warn shows'
                f' all'
            )


@contextmanager
def few_lines(complain: Callable[[str], None]) -> Iterator[None]:
    """Limit what the SDK logs, unless the user has set a level of their own.

    Args:
        complain: Called with a line.
    """
    if LEVEL_VARIABLE in os.environ:
        yield
        return
    handler = _FewLines(complain)
    root = logging.getLogger()
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
