# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Error boundary: every error becomes one line and an exit code."""

from __future__ import annotations

import errno
import gc
import math
import os
import signal
import sys
import time
import warnings
from io import TextIOWrapper
from typing import TYPE_CHECKING

from ..model.errors import (
    KeptInterruptError,
    KittiRos2Error,
    UnsynchronisedError,
    describe_error,
    interruption_of,
    notes_of,
    one_line,
)
from .exits import EXIT_INTERRUPTED, EXIT_LOSSES, EXIT_OK, EXIT_TERMINATED, EXIT_USAGE

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TextIO

_DEBUG = '--debug'
_CLEANING_S = 3.0
_ABSENT = ('no such file or folder', os.strerror(errno.ENOENT))


def main(args: list[str] | None = None) -> int:
    """Run the command line.

    Returns:
        0 on success, 1 when some data was skipped, 2 on invalid usage or unreadable input, 130
        after Ctrl-C.
    """
    words = list(sys.argv[1:] if args is None else args)
    debug = _DEBUG in words
    words = [word for word in words if word != _DEBUG]
    if args is None:
        # Imports create a hundred thousand objects and no garbage: collecting takes a tenth of a
        # second. Each command enables the collector again, by freeze_imports.
        gc.disable()
        # numpy's threads for large matrices, which are not used here, busy-wait.
        os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
        _replace_closed_streams()
        if not (debug or sys.warnoptions):
            warnings.simplefilter('ignore')  # they are for developers
        signal.signal(signal.SIGTERM, _end)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup
            signal.signal(signal.SIGHUP, _end)
        if words[:1] == ['play']:
            from .exits import end_by_signal

            # From the start: a player that is stopped by a signal exits without an error.
            ending = end_by_signal()
            code = _run_to_one_line(words, debug=debug)
            ending.leave(code)
            gc.freeze()  # as below
            return code
        code = _run_to_one_line(words, debug=debug, interruptible=True)
        gc.freeze()  # the last collection of the interpreter takes a tenth of a second
        _on_interrupt(lambda *_: os._exit(code))  # there is nothing left to interrupt
        return code
    return _run_to_one_line(words, debug=debug)


def _run_to_one_line(words: list[str], *, debug: bool, interruptible: bool = False) -> int:
    """Run, and turn an error into a line and an exit code."""
    try:
        return _run_and_flush(words, interruptible=interruptible)
    except KeyboardInterrupt:
        _print_error('interrupted; no incomplete output is left behind')
        return EXIT_INTERRUPTED
    except SystemExit as error:
        if notes_of(error):
            _print_error(f'terminated; {"; ".join(notes_of(error))}')
        raise
    except BrokenPipeError:
        # The reader of the pipe closed it, as head does; Python would report it again at exit.
        _discard(sys.stdout)
        return EXIT_OK
    except (KittiRos2Error, OSError) as error:
        if debug:
            raise
        _print_error(_describe(error, words))
        _flush_or_discard(sys.stdout)
        return _code_of(error)
    except Exception as error:
        if debug:
            raise
        _print_error(_describe_unexpected(error))
        return EXIT_USAGE


def _discard(stream: TextIO) -> None:
    """Redirect a standard stream to /dev/null, with its buffered text."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _flush_or_discard(stream: TextIO) -> None:
    """Flush now: Python would fail to write at exit, and change the exit code."""
    try:
        stream.flush()
    except OSError:
        _discard(stream)


def _describe_unexpected(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return 'not enough memory; close other programs, or lower --jobs if you gave it'
    return (
        f'internal error, {type(error).__name__}: {error}; run again with {_DEBUG} for the'
        f' traceback, and please report it'
    )


def _code_of(error: Exception) -> int:
    if isinstance(error, KeptInterruptError):
        return EXIT_INTERRUPTED
    return EXIT_LOSSES if isinstance(error, UnsynchronisedError) else EXIT_USAGE


def _run_and_flush(words: list[str], *, interruptible: bool) -> int:
    """Run and flush, to detect a closed pipe here and not at exit.

    Args:
        words: The command line.
        interruptible: Whether Ctrl-C raises KeyboardInterrupt as soon as there may be something to
            clean up; before that __main__ handles it.
    """
    from .app import run

    if interruptible:
        _on_interrupt(_end)
    try:
        code = run(words)
    except SystemExit as error:
        if isinstance(error.__context__, BrokenPipeError):  # typer and rich make it exit code 1
            raise error.__context__ from None
        raise
    except RuntimeError as error:
        if interruption := interruption_of(error):
            raise interruption from None
        raise
    sys.stdout.flush()
    return code


def _on_interrupt(handler: Callable[..., object]) -> None:
    """Handle Ctrl-C, unless it is ignored, as it is by background jobs of a shell."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, handler)


def _replace_closed_streams() -> None:
    """Replace closed streams (``>&-``) by /dev/null; escape characters without an encoding."""
    for name in ('stdout', 'stderr'):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), 'w'))
        elif isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')


class _End:
    """Handler of signals that end a command through its context managers, which clean up.

    A second signal soon after the first is ignored, so that the cleaning finishes; later ones are
    handled again, because it may hang.
    """

    def __init__(self) -> None:
        self._last_s = -math.inf

    def __call__(self, number: int, _: object) -> None:
        now_s = time.monotonic()
        if now_s - self._last_s < _CLEANING_S:
            return
        self._last_s = now_s
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        sys.exit(EXIT_TERMINATED)


_end = _End()


def _describe(error: KittiRos2Error | OSError, words: list[str]) -> str:
    if isinstance(error, KittiRos2Error) and error.remedies:
        from .app import format_remedies

        commands = format_remedies(error.remedies, words)
        text = str(error)
        separator = ' ' if text.endswith('?') else ': '
        return f'{text}{separator}{commands}' if commands else text
    if isinstance(error, OSError) and error.filename is None:
        if error.errno == errno.ENOSPC:
            return f'standard output: {error.strerror}'  # only standard streams have no file name
        if error.errno == errno.ENOENT and not _has_working_directory():
            return 'the working directory was deleted; change to one that exists'
    text = describe_error(error)
    path, _, reason = text.rpartition(': ')
    if path in words and reason in _ABSENT:
        from .app import missing_path

        return missing_path(path, words)
    name, takes, rest = text.partition(' takes ')
    option = f'--{name.replace("_", "-")}'
    given = any(word.partition('=')[0] == option for word in words)
    return f'{option}{takes}{rest}' if given else text


def _has_working_directory() -> bool:
    try:
        os.getcwd()  # noqa: PTH109 - Path is not imported yet
    except OSError:
        return False
    return True


def _print_error(message: str) -> None:
    try:
        sys.stderr.write(f'kitti-ros2: {one_line(message)}\n')
        sys.stderr.flush()
    except OSError:  # a full disk: nothing can be printed, and the exit code stays
        _discard(sys.stderr)


def player() -> int:
    """Run the command play, as `ros2 run kitti_ros2 player`."""
    sys.argv[1:] = ['play', *sys.argv[1:]]
    return main()
