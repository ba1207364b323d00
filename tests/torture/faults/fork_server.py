# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of the command line in forks of one process that has imported everything.

A run costs a fork and the work, not the 0.3 s of Python and numpy. Started by ForkServer with the
library of faults preloaded, this file reads a request from each line of its input.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import json
import os
import select
import signal
import subprocess
import sys
import threading
import traceback
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from typing_extensions import Self

_ROOT = Path(__file__).parents[3]
_LONGEST_S = 60.0
_TRACEBACK = 99
"""Exit code of a run whose exception left main."""


@dataclass(frozen=True)
class Run:
    """The end of a run.

    Attributes:
        code: Exit code; negative for a signal, None if it did not end within a minute.
        calls: Calls that the library of faults counted; None if the process was killed.
        complaints: Standard error.
    """

    code: int | None
    calls: int | None
    complaints: str


class ForkServer:
    """A process that runs commands in forks, each with the faults that it is given.

    Args:
        library: The compiled library of faults.
        folder: For the standard error of runs, and their TMPDIR and home.
    """

    def __init__(self, library: Path, folder: Path) -> None:
        self._errors = folder / 'errors'
        self._answers = folder / 'answers'
        os.mkfifo(self._answers)
        environment = {
            name: value for name, value in os.environ.items() if not name.startswith('FAULT_')
        }
        self._process = subprocess.Popen(
            [sys.executable, __file__, self._answers, self._errors],
            env={
                **environment,
                'PYTHONPATH': str(_ROOT),
                'LD_PRELOAD': str(library),
                # Threads that wait by spinning slow a fork down up to tenfold on a busy machine.
                'OPENBLAS_NUM_THREADS': '1',
                'XDG_CONFIG_HOME': str(folder / 'config'),
            },
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
        )
        self._replies = self._answers.open()

    def run(self, words: Sequence[str], faults: Mapping[str, object], folder: Path) -> Run:
        """Run a command to its end.

        Args:
            words: Arguments of kitti-ros2.
            faults: Variables of the library, in lower case without FAULT_.
            folder: TMPDIR.
        """
        given = {f'FAULT_{name.upper()}': str(value) for name, value in faults.items()}
        reply = self._ask({'words': [*words], 'faults': {**given, 'TMPDIR': str(folder)}})
        return Run(*reply, self._errors.read_text('utf-8', 'replace'))

    def learn(self, words: Sequence[str], folder: Path) -> None:
        """Run a command in the server, so that runs need not import and prepare what it needs.

        Args:
            words: Arguments of kitti-ros2; other paths than those of runs, as paths may be kept.
            folder: TMPDIR.
        """
        self._ask({'words': [*words], 'faults': {'TMPDIR': str(folder)}, 'learn': True})

    def _ask(self, request: Mapping[str, object]) -> Any:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(request) + '\n')
        self._process.stdin.flush()
        line = self._replies.readline()
        assert line, 'the server of forks has ended'
        return json.loads(line)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        self._replies.close()


def _serve(answers: str, errors: str) -> None:
    """Fork for each request; reply with exit code and calls."""
    with Path(answers).open('w') as replies:
        for line in sys.stdin:
            request = json.loads(line)
            if 'learn' in request:
                _learn(request)
                replies.write('null\n')
                replies.flush()
                continue
            reader, writer = os.pipe()
            child = os.fork()
            if not child:
                os.close(reader)
                _run(request, errors, writer)
            os.close(writer)
            code = _wait(child)
            with open(reader) as pipe:  # noqa: PTH123 - a descriptor
                calls = json.loads(pipe.read() or 'null')
            replies.write(json.dumps([code, calls]) + '\n')
            replies.flush()


def _learn(request: dict[str, Any]) -> None:
    """Run a command here, so that forks have what it imports and prepares."""
    from kitti_ros2.cli import main  # noqa: PLC0415 - the client imports nothing of it

    _compile_once()
    os.environ.update(request['faults'])
    sys.argv[1:] = request['words']
    with contextlib.redirect_stderr(io.StringIO()):
        main()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    left = threading.enumerate()
    assert left == [threading.main_thread()], f'a fork would lack {left}'


def _compile_once() -> None:
    """Keep the compiled code of message types, which rosbags compiles again for each bag."""
    from rosbags.serde import utils  # noqa: PLC0415 - the client imports nothing of it
    from rosbags.typesys import store  # noqa: PLC0415

    compiled = lru_cache(maxsize=None)(lambda text: compile(text, '<string>', 'exec'))
    for module in (utils, store):
        vars(module)['exec'] = lambda text, names: exec(compiled(text), names)


def _run(request: dict[str, Any], errors: str, writer: int) -> None:
    """Run in this fork, and end it."""
    os.setsid()
    os.dup2(os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), 2)
    os.environ.update(request['faults'])
    sys.argv[1:] = request['words']
    from kitti_ros2.cli import main  # noqa: PLC0415 - the client imports nothing of it

    library = ctypes.CDLL(None)
    library.faults_begin()
    try:
        code = main()
    except SystemExit as ending:
        code = ending.code if isinstance(ending.code, int) else _TRACEBACK
    except BaseException:  # noqa: BLE001 - the end of the process
        library.faults_end()
        traceback.print_exc()
        code = _TRACEBACK
    calls = library.faults_end()
    with contextlib.suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    with open(writer, 'w') as pipe:
        pipe.write(json.dumps(calls))
    os._exit(code)


def _wait(child: int) -> int | None:
    """Wait for a fork, and return its exit code; kill it and its workers after a minute."""
    descriptor = os.pidfd_open(child)
    ended, _, _ = select.select([descriptor], [], [], _LONGEST_S)
    os.close(descriptor)
    if not ended:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(status) if ended else None


if __name__ == '__main__':
    _serve(*sys.argv[1:])
