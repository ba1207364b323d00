# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Where every error becomes one line and an exit code."""

from __future__ import annotations

import errno
import gc
import os
import signal
import sys
from io import TextIOWrapper

from ..model.errors import KittiRos2Error, describe_error
from ..model.text import one_line
from .exit_codes import EXIT_INTERRUPTED, EXIT_OK, EXIT_TERMINATED, EXIT_USAGE

_DEBUG = '--debug'


def main(args: list[str] | None = None) -> int:
    """Run the command line.

    Returns:
        0 when all is well, 1 when something of the data had to be skipped, 2 on wrong usage or
        input that cannot be read at all, 130 after Ctrl-C.
    """
    words = list(sys.argv[1:] if args is None else args)
    debug = _DEBUG in words
    words = [word for word in words if word != _DEBUG]
    if args is None:
        # Imports make a hundred thousand objects and no garbage: looking for it takes a tenth of a
        # second. Each command switches the collector on again, by memory.keep_imports.
        gc.disable()
        # numpy's threads for large matrices, which we have none of, wait busily beside ours.
        os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
        _mend_streams()
        signal.signal(signal.SIGTERM, _terminate)
        if words[:1] == ['play']:
            from .ending import end_by_signal

            # From the first moment on: a player that is told to end has no error.
            ending = end_by_signal()
            code = _run_to_one_line(words, debug=debug)
            ending.leave(code)
            return code
    return _run_to_one_line(words, debug=debug)


def _run_to_one_line(words: list[str], *, debug: bool) -> int:
    """Run; an error becomes a line and an exit code."""
    try:
        return _run_and_flush(words)
    except KeyboardInterrupt:
        _complain('interrupted; nothing unfinished is left behind')
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output went away, as head does; Python would complain once more at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_OK
    except (KittiRos2Error, OSError) as error:
        if debug:
            raise
        _complain(_describe(error))
        return EXIT_USAGE
    except Exception as error:
        if debug:
            raise
        _complain(
            f'internal error, {type(error).__name__}: {error}; run again with {_DEBUG} for the'
            f' traceback, and please report it'
        )
        return EXIT_USAGE


def _run_and_flush(words: list[str]) -> int:
    """Run, and find out here, not at exit, that nobody reads the output any more."""
    code = _run(words)
    sys.stdout.flush()
    return code


def _mend_streams() -> None:
    """Streams that were closed (``>&-``) take everything; what has no encoding is escaped."""
    for name in ('stdout', 'stderr'):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), 'w'))
        elif isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')


def _terminate(*_: object) -> None:
    """End as Ctrl-C does: through the context managers that clean up."""
    sys.exit(EXIT_TERMINATED)


def _run(words: list[str]) -> int:
    from .app import run

    return run(words)


def _describe(error: KittiRos2Error | OSError) -> str:
    if isinstance(error, OSError) and error.filename is None and error.errno == errno.ENOSPC:
        return f'standard output: {error.strerror}'  # only streams have no name
    return describe_error(error)


def _complain(message: str) -> None:
    sys.stderr.write(f'kitti-ros2: {one_line(message)}\n')


def player() -> int:
    """The executable of `ros2 run kitti_ros2 player`: the command play."""
    sys.argv[1:] = ['play', *sys.argv[1:]]
    return main()
