# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs commands in this process; their own lines on stderr are kept apart from all others."""

from __future__ import annotations

import io
import logging
import os
import sys
import tempfile
import warnings
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from kitti_ros2.cli import main

if TYPE_CHECKING:
    from collections.abc import Iterator

_HIDDEN = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)
"""Warnings that Python shows to developers only."""
_INNARDS = ('internal error', 'Traceback', 'Exception ignored', 'Error:')


class Said(NamedTuple):
    """The exit code of a command and its output on stderr.

    Attributes:
        code: Exit code.
        own: What the command wrote.
        foreign: What libraries and Python wrote beside it: warnings, logs, errors of C.
    """

    code: int
    own: str
    foreign: str

    def unexpected(self) -> list[str]:
        """The lines that no user should see."""
        own = [line for line in self.own.splitlines() if any(word in line for word in _INNARDS)]
        return [line for line in self.foreign.splitlines() if line.strip()] + own


def run_apart(*words: object) -> Said:
    """Run a command of kitti-ros2."""
    own = io.StringIO()
    with tempfile.TemporaryFile(buffering=0) as foreign, _redirected(foreign.fileno()):
        streams = sys.stdout, sys.stderr
        sys.stdout, sys.stderr = io.StringIO(), own
        try:
            code = main([str(word) for word in words])
        finally:
            sys.stdout, sys.stderr = streams
        foreign.seek(0)
        return Said(code, own.getvalue(), foreign.read().decode(errors='replace'))


@contextmanager
def _redirected(file: int) -> Iterator[None]:
    """Let all but sys.stderr write to a file: descriptor 2, warnings, logs, ignored exceptions."""
    text = os.fdopen(os.dup(file), 'w', buffering=1)
    held = os.dup(2)
    kept = logging.lastResort, sys.unraisablehook

    def show(message, category, filename, lineno, _file=None, _line=None) -> None:
        if not issubclass(category, _HIDDEN):
            text.write(warnings.formatwarning(message, category, filename, lineno))

    sys.stderr.flush()
    os.dup2(file, 2)
    logging.lastResort = logging.StreamHandler(text)
    sys.unraisablehook = lambda ignored: text.write(f'Exception ignored: {ignored}\n')
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('always')
            warnings.showwarning = show
            yield
    finally:
        logging.lastResort, sys.unraisablehook = kept
        os.dup2(held, 2)
        os.close(held)
        text.close()
