#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the pictures of README.md and of these pages from the synthetic recording.

    python docs/make_pictures.py docs

The page of a frame, the street in motion, statistics, the report in a browser, and Rerun in a
browser. What is not installed (Chromium, the extras plot and rerun) is passed over with a word.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from kitti_ros2.cli import main as kitti_ros2
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))
from chromium import Chromium, find_chromium

FRAMES = 60
FRAME = 12
STATISTICS_FRAMES = 20
WIDTH = 1280
QUALITY = 85
COMMAND = 'import sys; from kitti_ros2.cli import main; sys.exit(main())'
REPORT_HEIGHT = 860
RERUN_HEIGHT = 800
STREET_FRAMES = '0:39'
STREET_WIDTH = 880
STREET_FRAME_MS = 100
STREET_QUALITY = 50
RERUN_LOADS_S = 90  # without a GPU


def scaled(picture: np.ndarray, width: int) -> np.ndarray:
    """The picture in another width."""
    height = round(picture.shape[0] * width / picture.shape[1])
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)


def save(picture: np.ndarray, path: Path) -> None:
    """A JPEG as wide as a README."""
    cv2.imwrite(str(path), scaled(picture, WIDTH), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    print(f'{path}: {path.stat().st_size // 1000} kB')


def panel(drive: Path, folder: Path) -> np.ndarray:
    """The page of a frame."""
    out = folder / 'panel.png'
    if kitti_ros2(['view', str(drive), '-o', str(out), '--frame', str(FRAME), '-q']):
        raise SystemExit('view failed')
    return cv2.imread(str(out))


def street(drive: Path, folder: Path, path: Path) -> None:
    """Write an animation: boxes, the scan on the image, and the bird's-eye view."""
    series = {}
    for mode in ('boxes', 'lidar', 'bev'):
        out = folder / mode
        words = ['view', str(drive), '-o', str(out), '--mode', mode, '--frames', STREET_FRAMES]
        if kitti_ros2([*words, '-q']):
            raise SystemExit('view failed')
        series[mode] = [cv2.imread(str(picture)) for picture in sorted(out.iterdir())]
    frames = []
    for boxes, lidar, bev in zip(*series.values(), strict=True):
        left = np.vstack([boxes, lidar])
        width = round(bev.shape[1] * left.shape[0] / bev.shape[0])
        right = cv2.resize(bev, (width, left.shape[0]), interpolation=cv2.INTER_AREA)
        frames.append(scaled(np.hstack([left, right]), STREET_WIDTH))
    animation = cv2.Animation()
    animation.frames = frames
    animation.durations = np.full(len(frames), STREET_FRAME_MS, np.int32)
    cv2.imwriteanimation(str(path), animation, [cv2.IMWRITE_WEBP_QUALITY, STREET_QUALITY])
    print(f'{path}: {path.stat().st_size // 1000} kB')


def statistics(folder: Path) -> np.ndarray | None:
    """The statistics of a tracking sequence; None where the extra is not installed."""
    if find_spec('matplotlib') is None:
        return None
    options = SyntheticOptions(frames=STATISTICS_FRAMES)
    sequence = write_synthetic(folder / 'tracking', Layout.TRACKING, options)
    out = folder / 'stats.png'
    if kitti_ros2(['stats', str(sequence), '--count-points', '-o', str(out), '-q']):
        raise SystemExit('stats failed')
    return cv2.imread(str(out))


def report(drive: Path, folder: Path, program: str) -> np.ndarray:
    """The top of the report, in a browser."""
    out = folder / 'report.html'
    if kitti_ros2(['report', str(drive), '-o', str(out), '-q']):
        raise SystemExit('report failed')
    with Chromium(program, folder / 'profile') as browser:
        browser.open(out, WIDTH, REPORT_HEIGHT)
        return decoded(browser.picture())[:REPORT_HEIGHT]


def decoded(shot: bytes) -> np.ndarray:
    """The pixels of a PNG."""
    return cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR)


def rerun(drive: Path, folder: Path, program: str) -> np.ndarray | None:
    """Rerun's own page, which needs WebGL; None where the extra is not installed."""
    words = [sys.executable, '-c', COMMAND, 'view', str(drive), '--rerun', '--web', '--end', '14']
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        page = server.stdout.readline().strip()
        if not page.startswith('http'):
            return None
        with Chromium(program, folder / 'profile_of_rerun', webgl=True) as browser:
            browser.call(
                'Emulation.setDeviceMetricsOverride',
                width=WIDTH, height=RERUN_HEIGHT, deviceScaleFactor=1, mobile=False,
            )  # fmt: skip
            browser.call('Page.navigate', url=page)
            time.sleep(RERUN_LOADS_S)
            shot = browser.picture()
        server.terminate()
    return decoded(shot)


def main() -> None:
    """Make what can be made."""
    target = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drive = write_synthetic(folder / 'kitti', Layout.RAW, SyntheticOptions(frames=FRAMES))
        save(panel(drive, folder), target / 'panel.jpg')
        street(drive, folder, target / 'street.webp')
        figures = statistics(folder)
        if figures is None:
            print('the extra plot is not installed: stats.jpg is left as it is')
        else:
            save(figures, target / 'stats.jpg')
        program = find_chromium()
        if program is None:
            raise SystemExit('no Chromium: report.jpg and rerun.jpg are left as they are')
        save(report(drive, folder, program), target / 'report.jpg')
        picture = rerun(drive, folder, program)
        if picture is None:
            raise SystemExit('the extra rerun is not installed: rerun.jpg is left as it is')
        save(picture, target / 'rerun.jpg')


if __name__ == '__main__':
    main()
