# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m tests.torture.durability [COMMAND ...]``: the power of a real ext4 is cut; as root.

Each command writes to an ext4 of its own, an image on a loop device, and ends or is killed at a
call to the system. At once EXT4_IOC_SHUTDOWN drops all that ext4 has not written to its device, the
journal in memory, too. The image is mounted again, and compared. ext4 writes its journal every
300 s, so that what is found there was synced.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

_HERE = Path(__file__).parent
_TORTURE = _HERE.parent
sys.path[:0] = [str(_HERE), str(_TORTURE / 'faults'), str(_TORTURE), str(_TORTURE.parent)]

from fault_cases import CASES, Case  # noqa: E402 - after the path
from fault_library import compile_faults  # noqa: E402
from fault_points import RECORD, shown, tree_of  # noqa: E402
from fault_spread import beginning_with, spread  # noqa: E402

from kitti_ros2.batch.manifest import DONE, MANIFEST, read_manifest  # noqa: E402
from kitti_ros2.kitti.append import mend  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    Tree = Mapping[str, bytes | None]

_IMAGE_BYTES = 64 * 2**20
_SHUTDOWN = 2 << 30 | 4 << 16 | ord('X') << 8 | 125  # EXT4_IOC_SHUTDOWN, fs/ext4/ext4.h
_NOTHING_FLUSHED = (2).to_bytes(4, sys.byteorder)  # EXT4_GOING_FLAGS_NOLOGFLUSH
_MOMENTS = 10
_KILLED = -9


class Disk:
    """An ext4 in a file, to be mounted more than once.

    Args:
        folder: An empty folder for the image.
    """

    def __init__(self, folder: Path) -> None:
        self._image, self.place = folder / 'image', folder / 'mounted'
        self.place.mkdir()
        with self._image.open('wb') as file:
            file.truncate(_IMAGE_BYTES)
        _call('mkfs.ext4', '-q', '-F', self._image)

    @contextmanager
    def mounted(self) -> Iterator[Path]:
        """Mount the image; yield its folder."""
        _call('mount', '-o', 'loop,commit=300', self._image, self.place)
        try:
            yield self.place
        finally:
            _call('umount', self.place)

    def cut_power(self) -> None:
        """Drop all that is not on the device; what is mounted only fails from now on."""
        descriptor = os.open(self.place, os.O_RDONLY)
        try:
            fcntl.ioctl(descriptor, _SHUTDOWN, _NOTHING_FLUSHED)
        finally:
            os.close(descriptor)


class Trial:
    """A command, the power of whose disk is cut at some moment.

    Args:
        case: The command.
        folder: An empty folder, not on the disk.
        library: The compiled library of faults.
        more: More options.
    """

    def __init__(self, case: Case, folder: Path, library: Path, more: tuple[str, ...]) -> None:
        self._case, self._folder, self._library, self._more = case, folder, library, more
        (folder / 'source').mkdir()
        self._source = case.prepare(folder / 'source')
        sources = tree_of(folder / 'source')
        self._sources = {name.rpartition('/')[2]: data for name, data in sources.items()}
        log = folder / 'log'
        old, self._new, _, code = self._run(None, FAULT_AT='0', FAULT_LOG=str(log))
        assert code in {0, 1}, code
        self._old = old
        self.calls = log.stat().st_size

    def _run(self, cut: int | None, **faults: str) -> tuple[Tree, Tree, Tree, int]:
        """Run to the end (None, 0) or to a call; cut the power unless None.

        Returns:
            The output before, after the run, and after the power was cut; the exit code.
        """
        with tempfile.TemporaryDirectory(dir=self._folder) as name:
            disk = Disk(Path(name))
            with disk.mounted() as place:
                if self._case.before:
                    assert self._command(self._case.before, place, {}) in {0, 1}
                    os.sync()
                old = shown(tree_of(place))
                code = self._command((*self._case.words, *self._more), place, faults)
                new = shown(tree_of(place)) if not cut else {}
                if cut is not None:
                    disk.cut_power()
            with disk.mounted() as place:
                return old, new, self._found(place), code

    def _found(self, place: Path) -> Tree:
        """What is on the disk; the next run undoes an append that was cut off before all else."""
        if '--append' in self._case.words:
            mend(place / 'out')
        found = shown(tree_of(place))
        if RECORD in found:
            extracted = json.loads((place / RECORD).read_bytes()).values()
            absent = [name for names in extracted for name in names if f'out/{name}' not in found]
            assert not absent, f'recorded as extracted, but absent: {absent}'
        if (place / 'out' / MANIFEST).exists():
            records, _ = read_manifest(place / 'out')
            for record in records:
                made = [name for name in found if name.startswith(f'out/{record.name}')]
                assert record.state != DONE or made, f'{record.name} is done, but absent'
        return found

    def _command(self, words: tuple[str, ...], place: Path, faults: dict[str, str]) -> int:
        given = {'source': self._source, 'out': place / 'out'}
        environment: dict[str, Any] = {**os.environ, 'OPENBLAS_NUM_THREADS': '1'}
        if faults:
            environment |= {'LD_PRELOAD': self._library, 'FAULT_PATH': f'{place}/', **faults}
        command = [sys.executable, '-m', 'kitti_ros2', *(word.format(**given) for word in words)]
        return subprocess.run(
            command, env=environment, stderr=subprocess.DEVNULL, check=False
        ).returncode

    def at_the_end(self) -> Iterator[str]:
        """Cut the power right after the command; yield what is wrong."""
        _, new, found, code = self._run(0)
        if code not in {0, 1}:
            yield f'exit code {code}'
        if found != new:
            bad = [name for name in {**new, **found} if new.get(name, b'') != found.get(name, b'?')]
            yield f'after exit code {code}: not there, or not whole: {sorted(bad)[:5]}'

    def at_call(self, call: int) -> Iterator[str]:
        """Kill the command at a call, and cut the power; yield what is wrong."""
        _, _, found, code = self._run(call, FAULT_AT=str(call), FAULT_DO='self')
        if code != _KILLED:
            yield f'call {call}: exit code {code}'
        if self._case.gradual:
            whole = {**self._sources, **self._new}
            bad = [
                name for name, data in found.items()
                if name != RECORD
                and whole.get(name, whole.get(name.rpartition('/')[2], b'?')) != data
            ]  # fmt: skip
        else:
            bad = [] if found in (self._old, self._new) else sorted(found)
        if bad:
            yield f'call {call}: neither old nor whole: {bad[:5]}'


def _call(*words: str | Path) -> None:
    subprocess.run(words, check=True)


def main() -> int:
    """Print the number of moments of each command, and what is wrong."""
    parser = argparse.ArgumentParser(prog='python -m tests.torture.durability', description=__doc__)
    parser.add_argument('commands', nargs='*', metavar='COMMAND', help=', '.join(CASES))
    parser.add_argument('--moments', type=int, default=_MOMENTS, help='during each command')
    parser.add_argument('--no-fsync', action='store_true', help='what is lost without')
    given = parser.parse_args()
    if os.geteuid():
        parser.error('mounting needs root')
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # unmounts
    names = beginning_with(given.commands, CASES)
    findings = 0
    with tempfile.TemporaryDirectory() as folder:
        library = compile_faults(Path(folder))
        for number, name in enumerate(names):
            work = Path(folder) / f'{number}'
            work.mkdir()
            trial = Trial(CASES[name], work, library, ('--no-fsync',) if given.no_fsync else ())
            moments = spread(trial.calls, given.moments)
            found = [*trial.at_the_end(), *(f for m in moments for f in trial.at_call(m))]
            print(f'{name}: {1 + len(moments)} moments, {len(found)} findings', flush=True)
            for finding in found:
                print(f'  {finding}', flush=True)
            findings += len(found)
    return min(findings, 1)


if __name__ == '__main__':
    sys.exit(main())
