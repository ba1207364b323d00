# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Connections to databases of any origin, which may hold programs in place of tables."""

from __future__ import annotations

import sqlite3
import sys
from typing import Any

_TABLES = ('topics', 'messages', 'message_definitions')
_PERIOD = 100_000  # SQLite's instructions between two looks at the budget
_ALWAYS = 20_000_000  # about a second
_QUERY_BYTES = 1_000_000  # of what is no value of the file, such as a query
_LONGEST = 2**31 - 1
_PER_BYTE = 20  # a row has at least 20 bytes, and takes about 10


class GuardedConnection(sqlite3.Connection):
    """A connection whose queries end after a number of steps in proportion to the file.

    A tree of pages may lead to the same page again and again.
    """

    _left = 0
    _budget = 0

    def guard(self, size: int) -> None:
        """Refuse views and virtual tables where rosbag2 has tables, and bound the queries.

        Args:
            size: Of the file, in bytes.

        Raises:
            ValueError: A table of rosbag2 is none, or computes its columns.
            sqlite3.Error: The database cannot be read.
        """
        self._budget = _ALWAYS + _PER_BYTE * size
        if sys.version_info >= (3, 11):
            # A chain of pages may lead back to itself: no value is longer than the file.
            self.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(size + _QUERY_BYTES, _LONGEST))
        self.set_progress_handler(self._is_spent, _PERIOD)
        self.execute('PRAGMA trusted_schema = OFF')
        kinds = {
            name.lower(): (kind, root)
            for kind, name, root in self.execute('SELECT type, name, rootpage FROM sqlite_master')
            if kind in {'table', 'view'} and isinstance(name, str)
        }
        for name in _TABLES:
            kind, root = kinds.get(name, ('table', 1))
            if kind != 'table' or not root:
                raise ValueError(f'{name} is a {"view" if kind == "view" else "virtual table"}')
            if any(hidden for *_, hidden in self.execute(f'PRAGMA table_xinfo({name})')):
                raise ValueError(f'{name} has columns that are computed')

    def execute(self, sql: str, values: Any = (), /) -> sqlite3.Cursor:  # noqa: ANN401 - as sqlite3
        """Run a query with a budget of its own."""
        self._left = self._budget
        return super().execute(sql, values)

    def _is_spent(self) -> bool:
        self._left -= _PERIOD
        return self._left < 0
