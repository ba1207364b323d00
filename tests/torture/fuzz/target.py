# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A target of the fuzzer: a function that reads bytes of any origin, and what is known of it."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

MEMORY = Path('/dev/shm')
"""A file system in memory, of Linux."""
YAML_WORDS = (
    *(
        b'&a ',
        b'*a',
        b'<<: *a',
        b'!!binary ',
        b'!!set ',
        b'!!python/object:os.system ',
        b'!!float ',
    ),
    *(b'? ', b'- ', b': ', b'{', b'}', b'[', b']', b'|', b'>', b'---\n', b'...\n', b'%YAML 1.1\n'),
    *(
        b'null',
        b'~',
        b'yes',
        b'2011-09-26',
        b'1:30',
        b'.nan',
        b'.inf',
        b'0b11',
        b'"\\x00"',
        b'"\\ud800"',
        b'"\\n"',
    ),
)
"""Words of YAML that mutations insert."""


@dataclass(frozen=True)
class Target:
    """A parser or a reader.

    Attributes:
        name: Its name on the command line.
        run: Reads an input; it may raise KittiRos2Error only, as a command does. Any libFuzzer
            front end can call it.
        seeds: Returns valid inputs.
        modules: Modules of the package whose lines are counted, such as kitti/label_file.py.
        words: Texts that mutations insert.
        is_text: Whether mutations know lines, words and numbers.
        mend: Corrects checksums of an input, so that mutations get past them.
        short: Executions in the run that is part of the tests.
        long: Executions by default.
    """

    name: str
    run: Callable[[bytes], None]
    seeds: Callable[[], Sequence[bytes]]
    modules: tuple[str, ...] = ()
    words: tuple[bytes, ...] = ()
    is_text: bool = False
    mend: Callable[[bytes], bytes] | None = None
    short: int = 300
    long: int = 20_000


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix='fuzz', dir=MEMORY if MEMORY.is_dir() else None)


def place(name: str) -> Path:
    """A path for the input of a target that reads files; removed when the process ends."""
    path = Path(_folder().name) / name
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def stored(name: str, data: bytes) -> Path:
    """The path of a file with an input."""
    path = place(name)
    path.write_bytes(data)
    return path
