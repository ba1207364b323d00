# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks share: arguments, a clock, fresh outputs, a line of the report."""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_ASIDE = itertools.count()
COMMAND = (sys.executable, '-m', 'kitti_ros2')


def make_parser(description: str | None) -> argparse.ArgumentParser:
    """The command line of a benchmark, without arguments."""
    return argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawTextHelpFormatter
    )


@contextmanager
def parse_in_folder(
    parser: argparse.ArgumentParser, meaning: str | None = None
) -> Iterator[tuple[argparse.Namespace, Path]]:
    """Parse the arguments, --dir among them; yield them with a temporary folder there.

    Args:
        parser: Has the other arguments.
        meaning: Help of --dir.
    """
    parser.add_argument('--dir', type=Path, help=meaning)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.dir) as name:
        yield given, Path(name)


def seconds(work: Callable[[], object]) -> float:
    """How long work takes."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def tree_bytes(folder: Path) -> int:
    """Size of all files below a folder, or of a file."""
    if folder.is_file():
        return folder.stat().st_size
    return sum(path.stat().st_size for path in folder.rglob('*') if path.is_file())


def fresh(path: Path) -> Path:
    """A path with nothing at it; a folder there is moved aside, its files emptied.

    They are not removed: ext4 steps around the inodes of files that were just removed one by one,
    which would be a fifth of the time of whatever writes the next folder.
    """
    if path.is_symlink() or not path.is_dir():
        path.unlink(missing_ok=True)
        return path
    aside = path.rename(path.with_name(f'{path.name}.{next(_ASIDE)}'))
    for folder, _, names in os.walk(aside):
        for file in (Path(folder, name) for name in names):
            if not file.is_symlink():  # what a copied link leads to is the user's
                os.truncate(file, 0)
    return path


def report(name: str, value: float, bound: str, note: str = '') -> None:
    """One line, a row of a table in Markdown as well."""
    print(f'| {name:<46} | {value:8.2f} | {bound:<10} | {note} |', flush=True)
