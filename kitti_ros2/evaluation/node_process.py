# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The process of a node under test, in a process group of its own."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from ..model.errors import KittiRos2Error, UsageError, describe_error
from ..model.text import one_line

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

_STOPS = ((signal.SIGINT, 8.0), (signal.SIGTERM, 4.0), (signal.SIGKILL, 2.0))
"""How a node is stopped, each signal with the seconds until the next one."""
_SHELL = re.compile(r'^\s*(source|export|cd|\.|\w+=\S*)\s|[;&|<>]')
_SHELL_HINT = '; no shell interprets it: for what a shell does, give "bash -c \'...\'"'
_NO_SIGNAL = 0  # only checks whether there is a process
_LOOK_EVERY_S = 0.02
_LAST_OUTPUT_S = 0.5


class StackError(KittiRos2Error):
    """The stack under test does not start, or gives no answer."""


class NodeProcess:
    """A command that runs until it is stopped; as a context manager it is stopped at the end.

    Args:
        command: Its words as for a shell; no shell interprets it.
        show: Called with each line of its output, from another thread.

    Raises:
        UsageError: The command is invalid, or cannot be started.
    """

    def __init__(self, command: str, show: Callable[[bytes], object]) -> None:
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise UsageError(f'--node {command!r} cannot be split into words: {error}') from None
        if not words:
            raise UsageError('--node is empty; give the command that starts the node')
        try:
            self._process = subprocess.Popen(  # noqa: S603 - the user's own command
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={'PYTHONUNBUFFERED': '1', **os.environ},
            )
        except OSError as error:
            hint = _SHELL_HINT if _SHELL.search(command) else ''
            raise UsageError(f'--node cannot be started: {describe_error(error)}{hint}') from None
        self._show = show
        self._last_line = b''
        self._reader = threading.Thread(target=self._read, name='node-output', daemon=True)
        self._reader.start()
        self.killed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def ended(self) -> str:
        """Return how it ended and the last line of its output; empty while it runs."""
        code = self._process.poll()
        if code is None:
            return ''
        self._reader.join(_LAST_OUTPUT_S)  # other processes of the group may keep the pipe open
        how = f'exit code {code}' if code >= 0 else f'killed by {signal.Signals(-code).name}'
        said = one_line(self._last_line.decode(errors='replace').strip())
        return f'{how}; its last line: {said}' if said else how

    def stop(self) -> None:
        """Stop all processes of the group: SIGINT, then SIGTERM, then SIGKILL."""
        try:
            for number, seconds in _STOPS:
                self.killed = self._signal(number) and number is signal.SIGKILL
                if self._is_gone_within(seconds):
                    break
        except (KeyboardInterrupt, SystemExit):  # a second Ctrl-C or SIGTERM
            self._signal(signal.SIGKILL)
            raise
        self._reader.join(_LAST_OUTPUT_S)

    def _is_gone_within(self, seconds: float) -> bool:
        end = time.monotonic() + seconds
        while self._signal(_NO_SIGNAL):
            if time.monotonic() > end:
                return False
            time.sleep(_LOOK_EVERY_S)
        return True

    def _signal(self, number: int) -> bool:
        """Send a signal to the group; return whether it has a process."""
        self._process.poll()  # a process that has ended counts until its code is read
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)
            return True
        return False

    def _read(self) -> None:
        assert self._process.stdout is not None  # noqa: S101 - PIPE
        with self._process.stdout as output:
            for line in output:
                self._last_line = line if line.strip() else self._last_line
                with suppress(OSError):  # a node blocks if nobody reads its output
                    self._show(line)
