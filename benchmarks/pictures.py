#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How fast pictures are drawn, beside decoding the image that they are drawn on.

    python benchmarks/pictures.py SRC [--repeat N] [--threads N]

SRC is a KITTI folder or a bag with colour images and scans. The ratios are of medians, and what is
compared takes turns, so that a busy moment meets all of them.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import cv2

from kitti_ros2.files.processes import keep_freed_memory
from kitti_ros2.options.outputs import PictureOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.panel import MODES
from kitti_ros2.pictures.recording_frames import open_frames

from yardsticks import make_parser, report, seconds  # isort: skip

if TYPE_CHECKING:
    from kitti_ros2.pictures.recording_frames import RecordingFrames

OPTIONS = PictureOptions()
BOUNDS = {'panel': '<= 4', 'perspective': '<= 2'}
PANELS = 24
"""Panels of one timed run with threads."""


def measure_modes(source: RecordingFrames, repeat: int) -> None:
    """Drawing alone, on one core, against decoding the frame's image on one core."""
    cv2.setNumThreads(1)
    number = int(source.numbers[len(source.numbers) // 2])
    frame = source.frame(number)
    image = next(iter(frame.images.values())) if 2 not in frame.images else frame.images[2]
    png = cv2.imencode('.png', image)[1]
    times: dict[str, list[float]] = {'decode': [], **{name: [] for name in MODES}}
    for _ in range(repeat):
        times['decode'].append(seconds(lambda: cv2.imdecode(png, cv2.IMREAD_COLOR)))
        for name, mode in MODES.items():
            times[name].append(seconds(lambda mode=mode: mode.draw(frame, OPTIONS)))  # type: ignore[misc]
    decode = median(times['decode'])
    for name in MODES:
        spent = median(times[name])
        bound = BOUNDS.get(name, '<= 1.5')
        report(f'{name} / decoding one image', spent / decode, bound, f'{1e3 * spent:.1f} ms')


def measure_panels(source: RecordingFrames, repeat: int, threads: int) -> None:
    """Panels from files, reading included, with one thread and with several.

    Bare decoding, which leaves the interpreter's lock alone, shows what several threads can give on
    this machine at this moment.
    """
    numbers = [int(source.numbers[place % len(source.numbers)]) for place in range(PANELS)]
    streams = MODES['panel'].streams(source.cameras, OPTIONS)
    png = cv2.imencode('.png', next(iter(source.frame(numbers[0], streams).images.values())))[1]

    def panel(number: int) -> object:
        return MODES['panel'].draw(source.frame(number, streams), OPTIONS)

    def decode(_: int) -> object:
        return cv2.imdecode(png, cv2.IMREAD_COLOR)

    rates: dict[tuple[str, int], list[float]] = {}
    for _ in range(repeat):
        for work in (panel, decode):
            for count in (1, threads):
                with ThreadPoolExecutor(count) as pool:
                    spent = seconds(lambda pool=pool, work=work: list(pool.map(work, numbers)))  # type: ignore[misc]
                rates.setdefault((work.__name__, count), []).append(PANELS / spent)
    most = median(rates['panel', threads])
    report(f'panels/s, {threads} threads', most, '>= 15', 'reading and decoding included')
    gain = most / median(rates['panel', 1])
    ideal = median(rates['decode', threads]) / median(rates['decode', 1])
    note = f'{gain:.2f} and {ideal:.2f}'
    report(f'gain of {threads} threads / that of decoding', gain / ideal, '>= 0.75', note)


def main() -> None:
    """Measure what the command line asks for."""
    parser = make_parser(__doc__)
    parser.add_argument('src', type=Path)
    parser.add_argument('--repeat', type=int, default=7)
    parser.add_argument('--threads', type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    keep_freed_memory()  # as the command does
    source = open_frames(arguments.src, ReadOptions())
    measure_modes(source, arguments.repeat)
    measure_panels(source, arguments.repeat, arguments.threads)


if __name__ == '__main__':
    main()
