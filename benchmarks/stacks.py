#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drift of installed odometry stacks on bags of to-bag --for STACK, with and without deskewing.

    pip install kiss-icp==1.3.0 genz-icp==0.3.2 rko_lio==0.4.0
    python benchmarks/stacks.py [STACK ...] [--frames N] [--columns N] [--seed N] [--dir DIR]

The drive is synthetic: 15 m/s, bends of 30 degrees/s, points measured while the scanner turns, with
0.02 m of noise, an Imu at 100 Hz, and a standing start, which GenZ-ICP and RKO-LIO need. Each stack
reads its bag with its own command; only its parameter deskew differs between its two runs.

Drift is KITTI's translation error of segments in % (kitti_ros2/evaluation/trajectories.py),
against the true poses at one moment of each turn: that of the stack's own deskewed poses. Poses
without deskewing belong to no single moment. Their drift is shown for the same moment, and for the
moment of the turn that gives the least.

GenZ-ICP takes times as parts of the turn. Its node scales them (ros/ros2/Utils.hpp,
NormalizeTimestamps), the reader of its Python package 0.3.2 does not (tools/point_cloud2.py,
read_point_cloud). Here they are scaled as in its node; --unscaled leaves them as they are.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from yardsticks import COMMAND, make_parser

from kitti_ros2.evaluation.trajectories import segment_errors
from kitti_ros2.kitti.find import make_writer
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.stack_names import IMU, SCAN
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions
from kitti_ros2.synthetic.drive import DATE, extract_of, write_extract
from kitti_ros2.synthetic.scene import CAR_T_VELO

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Mapping, Sequence

    from kitti_ros2.model.geometry import Float64Array

LIMIT_PERCENT = 1.0
RATIO = 2.0
PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Moments of a turn, as parts of it."""


@dataclass(frozen=True)
class Program:
    """An installed stack.

    Attributes:
        distribution: Its name on PyPI.
        part: The moment of its deskewed poses, as a part of the turn. KISS-ICP moves points to the
            end (PRBonn/kiss-icp@0082c43 cpp/kiss_icp/core/Preprocessing.cpp:78), and so does
            RKO-LIO (PRBonn/rko_lio@011a275 rko_lio/core/lio.cpp deskew_scan), which also writes
            that stamp; GenZ-ICP moves them to the middle (cpp/genz_icp/core/Deskew.cpp
            mid_pose_timestamp).
        settings: The text of its parameter file, with a place for the value of deskew.
        run: Runs it on a bag, in a folder with that file, config.yaml; returns (N, 4, 4) poses of
            the scanner.
    """

    distribution: str
    part: float
    settings: str
    run: Callable[[Path, Path], Float64Array]


@dataclass(frozen=True)
class Drift:
    """Drift of a stack in %.

    Attributes:
        on: With deskewing.
        off: Without, at the same moment of the turn.
        least_off: Without, at the moment that gives the least.
        least_part: That moment, as a part of the turn.
    """

    on: float
    off: float
    least_off: float
    least_part: float

    @property
    def is_within(self) -> bool:
        """Whether deskewing gives little drift, and much less than none."""
        return self.on < LIMIT_PERCENT and self.off >= RATIO * self.on


def make_street(frames: int = 200, columns: int = 1000, seed: int = 0) -> SyntheticDrive:
    """Return the drive."""
    return SyntheticDrive(
        SyntheticOptions(
            frames=frames,
            seed=seed,
            lidar_columns=columns,
            range_noise_m=0.02,
            speed=15.0,
            turn_rate=30.0,
            rest=1.0,
            swept=True,
            extract=True,
        )
    )


def write_drive(root: Path, street: SyntheticDrive) -> Path:
    """Write scans, packets and the unsynchronised drive; return the synchronised drive's folder."""
    name = Layout.RAW.traits.default_name.format(date=DATE, kind='sync')
    with make_writer(Layout.RAW, root, name) as writer:
        writer.write_calibration(0, street.calibration)
        for frame in range(len(street)):
            writer.write_scan(frame, street.stamps(frame).scan, street.scan(frame))
            writer.write_oxts(frame, street.packet_stamp(frame), street.packet(frame))
    write_extract(root, street)
    return root / DATE / name


def write_bag(drive: Path, stack: str, bag: Path) -> Path:
    """Convert the drive for a stack, with the Imu of the unsynchronised drive."""
    words = ('to-bag', str(drive), str(bag), '--for', stack, '-q')
    _call([*COMMAND, *words, '--imu-from', str(extract_of(drive))])
    return bag


def measure(program: Program, street: SyntheticDrive, bag: Path, folder: Path) -> Drift:
    """Run a stack twice, and compare its poses with the true ones."""
    truths = [_true_poses(street, part) for part in PARTS]
    drifts = []
    for deskew in ('true', 'false'):
        place = folder / deskew
        place.mkdir(parents=True)
        (place / 'config.yaml').write_text(program.settings % deskew, 'utf-8')
        poses = program.run(bag, place)
        drifts.append([_drift(poses, truth) for truth in truths])
    on, off = drifts
    own, least = PARTS.index(program.part), int(np.argmin(off))
    return Drift(on[own], off[own], off[least], PARTS[least])


def _true_poses(street: SyntheticDrive, part: float) -> Float64Array:
    """Return (N, 4, 4) poses of the scanner at a part of each turn."""
    stamps = [street.stamps(frame) for frame in range(len(street))]
    moments = [each.scan_start + round(part * (each.scan_end - each.scan_start)) for each in stamps]
    return np.array(
        [(street.motion_at(moment).street_T_car @ CAR_T_VELO).matrix() for moment in moments]
    )


def _drift(poses: Float64Array, truth: Float64Array) -> float:
    if len(poses) != len(truth):
        raise SystemExit(f'{len(poses)} poses of {len(truth)} scans')
    errors = segment_errors(np.arange(len(truth)), truth, poses, np.ones(len(truth), np.bool_))
    if errors.t_err_percent is None:
        raise SystemExit('the drive is shorter than 100 m; pass more --frames')
    return errors.t_err_percent


_GENZ_SCALED = """
from genz_icp.genz_icp import GenZICP
from genz_icp.tools.cmd import run

register = GenZICP.register_frame

def scaled(self, points, times):
    return register(self, points, (times - times.min()) / (times.max() - times.min()))

GenZICP.register_frame = scaled
run()
"""


def _run_pipeline(name: str, command: Sequence[str], bag: Path, folder: Path) -> Float64Array:
    """Run KISS-ICP, or GenZ-ICP, whose command is the same."""
    words = [str(bag), '--topic', SCAN, '--config', str(folder / 'config.yaml')]
    _call([*command, *words], {f'{name}_out_dir': str(folder)})
    poses: Float64Array = np.load(folder / 'latest' / f'{bag.name}_poses.npy')
    return poses


def _run_rko_lio(bag: Path, folder: Path) -> Float64Array:
    words = [str(bag), '--imu', IMU, '--lidar', SCAN, '--config', str(folder / 'config.yaml')]
    _call([_script('rko_lio'), *words, '-o', str(folder), '-n', 'run'])
    rows = np.loadtxt(folder / 'run_0' / 'run_0_tum.txt')
    return np.array([Transform.from_quaternion(row[4:], row[1:4]).matrix() for row in rows])


def _script(name: str) -> str:
    return str(Path(sysconfig.get_path('scripts'), name))


_KISS_ICP = partial(_run_pipeline, 'kiss_icp', [_script('kiss_icp_pipeline')])
_GENZ_ICP = partial(_run_pipeline, 'genz_icp', [sys.executable, '-c', _GENZ_SCALED])
_GENZ_ICP_UNSCALED = partial(_run_pipeline, 'genz_icp', [_script('genz_icp_pipeline')])
PROGRAMS = {
    'kiss-icp': Program('kiss-icp', 1.0, 'data: {deskew: %s}', _KISS_ICP),
    'genz-icp': Program('genz-icp', 0.5, 'data: {deskew: %s}', _GENZ_ICP),
    'rko_lio': Program('rko_lio', 1.0, 'deskew: %s', _run_rko_lio),
}


def _call(command: list[str], environment: dict[str, str] | None = None) -> None:
    done = subprocess.run(
        command,
        env={**os.environ, **(environment or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f'{" ".join(command[:3])} failed:\n{done.stdout[-2000:]}')


def version_of(program: Program) -> str | None:
    """Return the installed version; None if there is none."""
    try:
        return metadata.version(program.distribution)
    except metadata.PackageNotFoundError:
        return None


def _parse() -> argparse.Namespace:
    parser = make_parser(__doc__)
    parser.add_argument('stacks', nargs='*', metavar='STACK', help=', '.join(PROGRAMS))
    parser.add_argument('--frames', type=int, default=200)
    parser.add_argument('--columns', type=int, default=1000, help='firings of a turn')
    parser.add_argument('--seed', type=int, default=0, help='of the street')
    parser.add_argument('--unscaled', action='store_true', help="GenZ-ICP's own reader of times")
    parser.add_argument('--dir', type=Path, help='where to write')
    given = parser.parse_args()
    unknown = [name for name in given.stacks if name not in PROGRAMS]
    if unknown:
        parser.error(f'no such stack: {", ".join(unknown)}; choose from {", ".join(PROGRAMS)}')
    return given


def main() -> None:
    """Measure."""
    given = _parse()
    programs = {name: PROGRAMS[name] for name in given.stacks or PROGRAMS}
    if given.unscaled and 'genz-icp' in programs:
        programs['genz-icp'] = replace(PROGRAMS['genz-icp'], run=_GENZ_ICP_UNSCALED)
    failed = [stack for stack, program in programs.items() if version_of(program) is None]
    for stack in failed:
        print(f'{stack} is not installed: pip install {programs.pop(stack).distribution}')
    if programs:
        street = make_street(given.frames, given.columns, given.seed)
        failed += _print_table(programs, street, given.dir)
    if failed:
        limits = f'drift under {LIMIT_PERCENT} %, and {RATIO:.0f} times less than without deskewing'
        raise SystemExit(f'not shown for {", ".join(failed)}: {limits}')


def _print_table(
    programs: Mapping[str, Program], street: SyntheticDrive, place: Path | None
) -> list[str]:
    """Print a row for each stack; return those beyond the limits."""
    beyond = []
    with tempfile.TemporaryDirectory(dir=place) as name:
        folder = Path(name)
        drive = write_drive(folder, street)
        print('drift in % of the way      deskew on  off   ratio   least off (part)  ratio')
        for stack, program in programs.items():
            bag = write_bag(drive, stack, folder / f'{stack}_bag')
            found = measure(program, street, bag, folder / stack)
            print(
                f'{stack:<10} {version_of(program):<8} turn {program.part:.2f}'
                f'{found.on:11.2f}{found.off:6.2f}{found.off / found.on:7.1f}'
                f'{found.least_off:10.2f} ({found.least_part:.2f})'
                f'{found.least_off / found.on:9.1f}',
                flush=True,
            )
            if not found.is_within:
                beyond.append(stack)
    return beyond


if __name__ == '__main__':
    main()
