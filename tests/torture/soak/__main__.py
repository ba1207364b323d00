# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A player under load for a long time: what it uses, and how late its messages are.

    python -m tests.torture.soak [--minutes 30] [--rate 10] [--subscribers 8] [--drive FOLDER]

Plays a drive of 120 frames endlessly, with subscribers that come and go, one of them slow, while
services and parameters are called at random, beside a timer and a publisher that do nothing else.
It prints JSON, and a line a minute on stderr; Ctrl-C ends it early with the figures so far.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from .figures import Sample, in_10_000, sample, slope_mb_per_10_min

if TYPE_CHECKING:
    from collections.abc import Sequence

HERE = Path(__file__).resolve().parent
FRAMES = 120
EVERY_S = 1.0
BARE = ('timer', 'publisher')
"""What the machine and the middleware miss by themselves."""


class Samples(NamedTuple):
    """The player and the bare publisher at a moment."""

    player: Sample
    publisher: Sample


class Reporter:
    """A process, and the lines of JSON that it prints or writes to a pipe.

    Attributes:
        script: Its file.
        lines: What they say.
        others: Other lines, such as of Fast DDS, which prints some of its errors.
    """

    def __init__(self, stack: ExitStack, script: str, *words: object, fd: bool = False) -> None:
        self.script = script
        self.lines: list[dict] = []
        self.others: list[str] = []
        self.errors = tempfile.TemporaryFile('w+')  # noqa: SIM115 - read after the end
        reader, writer = os.pipe()
        begin = [sys.executable, str(HERE / script), *([str(writer)] if fd else [])]
        self.process = subprocess.Popen(
            [*begin, *map(str, words)], stdin=subprocess.DEVNULL, stderr=self.errors,
            stdout=subprocess.DEVNULL if fd else writer, pass_fds=[writer], start_new_session=True,
        )  # fmt: skip
        stack.callback(self.end)
        os.close(writer)
        self._source = os.fdopen(reader)
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        for line in self._source:
            try:
                self.lines.append(json.loads(line))
            except ValueError:
                self.others.append(line)

    @property
    def last(self) -> dict:
        """The last line."""
        return self.lines[-1] if self.lines else {}

    def end(self, number: int = signal.SIGTERM) -> int:
        """End the process; its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def said(self) -> list[str]:
        """Its other lines and those on stderr."""
        self.errors.seek(0)
        return self.others + self.errors.read().splitlines()


def make_drive(folder: Path, frames: int) -> Path:
    """The synthetic drive, small in pixels: what is measured is the player."""
    options = SyntheticOptions(frames=frames, image_size=(310, 94), lidar_columns=200)
    return write_synthetic(folder, Layout.RAW, options)


def soak(chosen: argparse.Namespace, stack: ExitStack) -> dict:
    """Run until the end that was chosen; the figures."""
    drive = chosen.drive or make_drive(Path(stack.enter_context(folder())), chosen.frames)
    words = ['play', drive, '--loop', '--rate', chosen.rate, '--quiet', '--no-keyboard']
    player = Reporter(stack, 'watched_player.py', *words, fd=True)
    bare = {each: Reporter(stack, f'bare_{each}.py') for each in BARE}
    speeds = ['slow', *['fast'] * (chosen.subscribers - 1)][: chosen.subscribers]
    visitors = [
        Reporter(stack, 'subscriber.py', seed, chosen.longest, speed)
        for seed, speed in enumerate(speeds)
    ]
    caller = Reporter(stack, 'caller.py', 1, chosen.rate, chosen.calls_every)
    samples: list[Samples] = []
    with suppress(KeyboardInterrupt):  # the figures so far
        watch(chosen, player, bare, [caller, *visitors], samples)
    everyone = [player, *bare.values(), caller, *visitors]
    codes = [(each.script, each.process.poll()) for each in everyone]
    ended = [(script, code) for script, code in codes if code is not None]
    code = player.end(signal.SIGINT)
    figures = report(samples, player, bare, caller, visitors)
    return figures | {'ended_by_themselves': ended, 'exit_code': code}


def folder() -> tempfile.TemporaryDirectory:
    """A folder for the drive."""
    return tempfile.TemporaryDirectory(prefix='soak-')


def watch(
    chosen: argparse.Namespace,
    player: Reporter,
    bare: dict[str, Reporter],
    others: list[Reporter],
    samples: list[Samples],
) -> None:
    """Sample the player until the end, or until a process has ended by itself."""
    start = time.monotonic()
    while all(each.process.poll() is None for each in (player, *bare.values(), *others)):
        now = time.monotonic() - start
        sampled = (player, bare['publisher'])
        samples.append(Samples(*(sample(each.process.pid, now) for each in sampled)))
        if len(samples) % 60 == 0:
            counts = [player.last, *(each.last for each in bare.values())]
            print(f'{now / 60:.0f} min: {samples[-1].player} {counts}', file=sys.stderr, flush=True)
        if chosen.loops:
            enough = (
                player.last.get('frames', 0) >= chosen.loops * chosen.frames
                and len(others[0].lines) >= chosen.loops
                and sum(len(each.lines) for each in others[1:]) >= chosen.loops
                and all(each.lines for each in bare.values())
            )
            if enough:
                break
        elif now >= 60 * chosen.minutes:
            break
        time.sleep(EVERY_S)


def report(
    samples: list[Samples],
    player: Reporter,
    bare: dict[str, Reporter],
    caller: Reporter,
    visitors: list[Reporter],
) -> dict:
    """The figures as plain values."""
    players, publishers = ([*each] for each in zip(*samples, strict=True))
    first, last = players[len(players) // 6], players[-1]
    times = [each.seconds for each in players]
    given_out = [each['in_use_bytes'] for each in player.lines]  # one a second
    others = [*bare.values(), caller, *visitors]
    return {
        'minutes': round(last.seconds / 60, 2),
        'published': player.last.get('published', 0),
        'frames': player.last.get('frames', 0),
        'rss_mb': [round(first.rss_bytes / 1e6, 1), round(last.rss_bytes / 1e6, 1)],
        'in_use_mb': round(given_out[-1] / 1e6, 1),
        **growth('rss', times, [each.rss_bytes for each in players]),
        **growth('private', times, [each.private_bytes for each in players]),
        **growth('in_use', range(len(given_out)), given_out),
        **growth('publisher_rss', times, [each.rss_bytes for each in publishers]),
        'files': [first.files, last.files, max(each.files for each in players)],
        'threads': [first.threads, last.threads, max(each.threads for each in players)],
        **lateness('', player.last),
        **lateness('timer_', bare['timer'].last),
        **lateness('publisher_', bare['publisher'].last),
        'calls': len(caller.lines),
        'unanswered': sum(not each['answered'] for each in caller.lines),
        'first_unanswered': next((each for each in caller.lines if not each['answered']), None),
        'subscribers_gone': sum(len(each.lines) for each in visitors),
        'taken': sum(line['taken'] for each in visitors for line in each.lines),
        'stderr': player.said(),
        'stderr_of_others': [line for each in others for line in each.said()],
    }


def growth(name: str, times: Sequence[float], sizes: Sequence[int]) -> dict:
    """How fast a size grows."""
    return {f'{name}_mb_per_10_min_after_5': slope_mb_per_10_min(times, sizes)}


def lateness(prefix: str, counted: dict) -> dict:
    """How late a process was, by what it has counted."""
    return {
        f'{prefix}late_over_50_ms_in_10_000': in_10_000(
            counted.get('late', 0), counted.get('published', 0)
        ),
        f'{prefix}worst_ms': counted.get('worst_ms'),
    }


def parse(words: list[str] | None = None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(prog='python -m tests.torture.soak', description=__doc__)
    parser.add_argument('--minutes', type=float, default=30.0)
    parser.add_argument('--loops', type=int, help='end after so many rounds, calls and subscribers')
    parser.add_argument('--rate', type=float, default=10.0)
    parser.add_argument('--subscribers', type=int, default=8)
    parser.add_argument('--frames', type=int, default=FRAMES, help='of the synthetic drive')
    parser.add_argument('--drive', type=Path, help='a drive of its own')
    parser.add_argument('--longest', type=float, default=20.0, help='life of a subscriber, s')
    parser.add_argument('--calls-every', type=float, default=2.0, help='mean time of calls, s')
    return parser.parse_args(words)


def main() -> int:
    """Run; 1 if the player ended with an error or wrote to stderr, or another process did."""
    chosen = parse()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', '101')
    with ExitStack() as stack:
        figures = soak(chosen, stack)
    print(json.dumps(figures, indent=2))
    said = figures['stderr'] or figures['stderr_of_others']
    return int(figures['exit_code'] != 0 or bool(said))


if __name__ == '__main__':
    sys.exit(main())
