# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The most memory of commands on drives of N and of 4 N frames: it must not grow with N."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from longer_drives import BAGS, write_bag, write_drive
from marks import judge_peaks

if TYPE_CHECKING:
    from collections.abc import Iterator

FRAMES, FACTOR = 100, 4
"""Frames at first, and how many times as many then."""

_API = (
    'import kitti_ros2; recording = kitti_ros2.open({!r}); recording.trajectory();'
    ' sum(len(frame.points) for frame in recording)'
)
_ODOMETRY = 'eval odometry IN IN --topic /kitti/ground_truth/odometry'
_OF_ALL = ('info IN', 'validate IN', 'report IN -o OUT.html', 'stats IN', 'stats IN --count-points',
           'view IN -o OUT.png', 'view IN -o OUT.mp4 --mode bev', 'API')  # fmt: skip
_OF_BAGS = ('to-kitti IN OUT --layout object', 'to-kitti IN OUT --layout raw', 'recover IN OUT')
_COMMANDS = {
    'folder': (*_OF_ALL, 'to-bag IN OUT', 'crop IN OUT --range 0:50'),
    'own': (*_OF_ALL, 'to-kitti IN OUT', *_OF_BAGS, _ODOMETRY),
    'foreign': (*_OF_ALL, *_OF_BAGS, f'{_ODOMETRY} --gt-topic /kitti/ground_truth/odometry'),
}
# Its own memory is counted in that of its child, so it must be small.
_LAUNCHER = (
    'import resource, subprocess, sys; code = subprocess.call(sys.argv[1:],'
    ' stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL);'
    ' print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)'
)
_REFUSED = 2


@dataclass(frozen=True)
class PeakCase:
    """Drives of one container.

    Attributes:
        name: As it is chosen by.
        container: One of BAGS, or folder.
    """

    name: str
    container: str

    @property
    def commands(self) -> tuple[str, ...]:
        """Those that read it."""
        kind = self.container if self.container == 'folder' else 'own'
        return _COMMANDS['foreign' if self.container.startswith('foreign') else kind]

    def measure(self, shrink: int = 1) -> str:
        """Run the commands; a line, with marks."""
        count = max(1, FRAMES // shrink)
        with tempfile.TemporaryDirectory(prefix='growth-') as folder:
            work = Path(folder)
            sources = []
            for frames in (count, FACTOR * count):
                source = write_drive(work / f'drive_{frames}', frames)
                if self.container in BAGS:
                    source = write_bag(work / f'bag_{frames}', source, self.container)
                sources.append(source)
            said = []
            for command in self.commands:
                found = [_run(command, source, work) for source in sources]
                peaks = [peak for _, peak in found]
                name = command.replace(' IN', '').partition(' -o')[0].replace(' OUT', '')
                mark = judge_peaks(*peaks) + '?' * (_REFUSED in {code for code, _ in found})
                said.append(f'{name.partition(" --topic")[0]} {peaks[0]:.0f} {peaks[1]:.0f}{mark}')
        return f'{self.name} x {count:,}, MB: {"; ".join(said)}'


def peak_cases() -> Iterator[PeakCase]:
    """The folder, then the bags."""
    for container in ('folder', *BAGS):
        yield PeakCase(f'memory: {container}', container)


def _run(command: str, source: Path, work: Path) -> tuple[int, float]:
    """Run a command; its exit code, and its most memory, MB. Its output is removed."""
    words = [word.replace('OUT', str(work / 'out')) for word in command.split()]
    words = ['-m', 'kitti_ros2', *(str(source) if word == 'IN' else word for word in words)]
    if command == 'API':
        words = ['-c', _API.format(str(source))]
    done = subprocess.run(
        [sys.executable, '-c', _LAUNCHER, sys.executable, *words],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    for path in work.glob('out*'):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    code, peak_kb = map(int, done.stdout.split())
    return code, peak_kb / 1024
