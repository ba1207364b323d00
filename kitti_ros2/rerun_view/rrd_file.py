# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the .rrd file of a program.

The SDK's own file writer does not report errors and may then block forever. So it writes to a named
pipe, and a thread here writes the file.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from .show import make_recording, show

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..player.program import Program
    from .show import ShowReport

_BLOCK_BYTES = 1 << 20


def write_file(program: Program, path: Path, progress: Callable[[int, int], None]) -> ShowReport:
    """Write all messages of a program to a new file.

    Args:
        program: The program; it is not closed.
        path: The file.
        progress: See show.

    Raises:
        OSError: The file cannot be written; it remains incomplete.
    """
    writer = _PipeToFile(path)

    def checked_progress(done: int, size_bytes: int) -> None:
        writer.check()
        progress(done, size_bytes)

    # Not beside the file: FAT and many network shares have no pipes.
    folder = Path(tempfile.mkdtemp(prefix='kitti_ros2_'))
    pipe = folder / 'rrd'
    try:
        os.mkfifo(pipe)
        # A reader must exist before the SDK opens the pipe, or opening blocks.
        source = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
        stream = make_recording(program)
        stream.save(pipe)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    os.set_blocking(source, True)
    with suppress(AttributeError, OSError):  # only on Linux, and within the limit for users
        fcntl.fcntl(source, fcntl.F_SETPIPE_SZ, _BLOCK_BYTES)
    writer.begin(source)
    try:
        report = show(program, stream, checked_progress)
        stream.flush()
    finally:
        stream.disconnect()
        writer.end()
    writer.check()
    return report


class _PipeToFile:
    """A thread that copies a pipe to a file; after an error it keeps reading."""

    def __init__(self, path: Path) -> None:
        self._file = path.open('wb', buffering=0)
        self._error: OSError | None = None

    def begin(self, source: int) -> None:
        # A daemon: a signal while it starts must not keep the process from its end.
        self._thread = threading.Thread(
            target=self._run, args=(source,), name='rrd-file', daemon=True
        )
        self._thread.start()

    def check(self) -> None:
        if self._error is not None:
            raise self._error

    def end(self) -> None:
        """Wait until the other end of the pipe is closed and all is written."""
        self._thread.join()

    def _run(self, source: int) -> None:
        with os.fdopen(source, 'rb', buffering=0) as pipe:
            while block := pipe.read(_BLOCK_BYTES):
                self._write(block)
        try:
            self._file.close()
        except OSError as error:
            self._error = self._error or error

    def _write(self, block: bytes) -> None:
        rest = memoryview(block)
        try:
            while rest and self._error is None:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._error = error
