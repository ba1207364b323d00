# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An .rrd file of a program.

The SDK's own file writer does not say why it fails, and then may wait for ever. So it writes to a
named pipe, and what comes out of that is written here.
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
    """Show all messages of a program in a new file.

    Args:
        program: Not closed.
        path: The file.
        progress: As show has it.

    Raises:
        OSError: The file cannot be written; it is incomplete.
    """
    writer = _PipeToFile(path)

    def tell(done: int, size_bytes: int) -> None:
        writer.check()
        progress(done, size_bytes)

    # Not beside the file: FAT and many network shares have no pipes.
    folder = Path(tempfile.mkdtemp(prefix='kitti_ros2_'))
    pipe = folder / 'rrd'
    try:
        os.mkfifo(pipe)
        # Somebody must read before the SDK opens the pipe, or that waits.
        source = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
        stream = make_recording(program)
        stream.save(pipe)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    os.set_blocking(source, True)
    with suppress(AttributeError, OSError):  # Linux, and no more than an ordinary user may have
        fcntl.fcntl(source, fcntl.F_SETPIPE_SZ, _BLOCK_BYTES)
    writer.begin(source)
    try:
        report = show(program, stream, tell)
        stream.flush()
    finally:
        stream.disconnect()
        writer.end()
    writer.check()
    return report


class _PipeToFile:
    """A thread that writes to a file what it reads; when it cannot, it reads on all the same."""

    def __init__(self, path: Path) -> None:
        self._file = path.open('wb', buffering=0)
        self._error: OSError | None = None

    def begin(self, source: int) -> None:
        self._thread = threading.Thread(target=self._run, args=(source,), name='rrd-file')
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
