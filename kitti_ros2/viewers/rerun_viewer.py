# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rerun's viewer as a separate process, native or in a browser, local only.

The SDK's servers always listen on all interfaces; its command line has an option.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlencode

from ..model.errors import UsageError
from .rerun_show import make_recording, show

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

    from ..player.program import Program
    from ..player.terminal import StopRequest
    from .rerun_show import ShowReport


_HOST = '127.0.0.1'
_GRPC_PORT = 9876
_WEB_PORT = 9090
_PATIENCE_S = 20.0
_POLL_S = 0.05
_FLUSH_S = 1.0
_SAVE = 'use --save to write an .rrd file'
_WEB_OR_SAVE = 'use --web to see it in a browser, or --save to write an .rrd file'


class Viewer:
    """A running viewer.

    Args:
        web: True for a web page, False for a window.

    Attributes:
        url: Address to send data to.
        page: Address of the web page; '' for a window.

    Raises:
        UsageError: The viewer cannot be started.
    """

    def __init__(self, *, web: bool) -> None:
        if not web and not _has_display():
            raise UsageError(f'there is no display for a window; {_WEB_OR_SAVE}')
        port = _free_port(_GRPC_PORT)
        self.url = f'rerun+http://{_HOST}:{port}/proxy'
        self.page = ''
        words = [_executable(), '--bind', _HOST, '--port', str(port)]
        if web:
            web_port = _free_port(_WEB_PORT)
            self.page = f'http://{_HOST}:{web_port}/?{urlencode({"url": self.url})}'
            # The server buffers data that a page has not fetched; by default at most 1 GB.
            words += ['--serve-web', '--web-viewer-port', str(web_port)]
            words += ['--server-memory-limit', '75%']
        else:
            words += ['--expect-data-soon', '--hide-welcome-screen']
        self._web = web
        self._instead = _SAVE if web else _WEB_OR_SAVE
        self._log = tempfile.TemporaryFile('w+')  # noqa: SIM115 - closed by __exit__
        self._process = subprocess.Popen(  # noqa: S603 - Rerun's own executable
            words,
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
            # Ctrl-C ends this process only; the window stays open.
            start_new_session=True,
            env={**os.environ, 'RERUN_APP_ONLY': 'true', 'NO_COLOR': '1'},
        )
        try:
            self._wait_for(port)
        except BaseException:
            self._end()
            self._log.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if self._web or kind is not None:
            self._end()
        self._log.close()

    def check(self) -> None:
        """Check that the viewer is running.

        Raises:
            UsageError: The viewer has ended.
        """
        code = self._process.poll()
        if code == 0:
            raise UsageError('the viewer was closed before everything was shown')
        if code is not None:
            raise UsageError(f'the viewer ended: {self._last_words()}; {self._instead}')

    def show(self, program: Program, progress: Callable[[int, int], None]) -> ShowReport:
        """Show all messages of a program; see show.show for the arguments.

        Raises:
            UsageError: The viewer has ended.
        """
        stream = make_recording(program)
        stream.connect_grpc(self.url)
        # Without a reference the recording would be closed.
        self._stream = stream
        report = show(program, stream, progress)
        while True:
            try:
                stream.flush(timeout_sec=_FLUSH_S)
            except RuntimeError:  # not done yet, or the viewer is gone
                self.check()
            else:
                self.check()
                return report

    def wait(self, stop_request: StopRequest) -> None:
        """Wait until a stop is requested.

        Raises:
            UsageError: The viewer ended before.
        """

        def watch() -> None:
            self._process.wait()
            stop_request.set()

        threading.Thread(target=watch, daemon=True).start()
        stop_request.wait()
        self.check()

    def _wait_for(self, port: int) -> None:
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            self.check()
            try:
                with socket.create_connection((_HOST, port), timeout=_PATIENCE_S):
                    return
            except OSError:
                if time.monotonic() > deadline:
                    raise UsageError(
                        f'the viewer does not listen after {_PATIENCE_S:.0f} s:'
                        f' {self._last_words()}; {self._instead}'
                    ) from None
            time.sleep(_POLL_S)

    def _last_words(self) -> str:
        self._log.seek(0)
        lines = [line.strip() for line in self._log if line.strip()]
        errors = [line for line in lines if 'rror' in line]
        return (errors or lines or ['no output'])[-1]

    def _end(self) -> None:
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
            try:
                self._process.wait(timeout=_PATIENCE_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


def _executable() -> str:
    """Return the viewer of the SDK, independent of PATH."""
    spec = find_spec('rerun_cli')
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for name in ('Rerun.app/Contents/MacOS/Rerun', 'rerun', 'rerun.exe'):
            if (Path(folder) / name).is_file():
                return str(Path(folder) / name)
    raise UsageError(f'rerun-sdk is installed without its viewer; {_SAVE}')


def _has_display() -> bool:
    if not sys.platform.startswith('linux'):
        return True
    return bool(os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY'))


def _free_port(preferred: int) -> int:
    """Return the preferred port, or any free one if it is in use."""
    for port in (preferred, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((_HOST, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise UsageError('there is no free port for the viewer')


# Writes the .rrd file of a program.
#
# The SDK's file writer does not report errors, and may block forever after one. So it writes to a
# named pipe, and a thread here writes the file.

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
        # Opening the pipe blocks without a reader.
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
        # A daemon: a signal while it starts must not block the end of the process.
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
