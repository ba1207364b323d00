# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What ``python -m tests.torture.growth`` does; its times are no test, but memory is."""

import subprocess
import sys
import tracemalloc
from contextlib import closing
from pathlib import Path

import pytest
from larger_bags import KINDS, write_larger
from larger_sets import enlarge, kinds_of, write_small
from longer_drives import write_bag, write_drive
from marks import MOST_GROWTH_MB, judge, judge_peaks
from peaks import PeakCase

import kitti_ros2
from kitti_ros2 import datasets
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.evaluation.odometry import score_odometry
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.evaluation import OdometryOptions
from kitti_ros2.options.read import ReadOptions, SelectionOptions
from kitti_ros2.pictures.recording_frames import open_frames
from kitti_ros2.player.bag_program import BagProgram
from kitti_ros2.report.gather import gather

ROOT = Path(__file__).resolve().parents[3]


def growth(*words):
    return subprocess.run(
        [sys.executable, '-m', 'tests.torture.growth', *words], cwd=ROOT, capture_output=True,
        text=True, timeout=300, check=False,
    )  # fmt: skip


@pytest.mark.parametrize('kind', KINDS, ids=lambda kind: kind.__name__)
def test_a_larger_bag_holds_more(tmp_path, kind):
    held = []
    for count in (3, 300):
        path = write_larger(tmp_path / f'{count}', kind(count))
        with open_messages(path) as messages:
            held.append(sum(len(each.data) + len(each.topic) for each in messages))
    assert held[1] >= held[0] + 297


@pytest.mark.parametrize('layout', Layout)
def test_a_larger_set_has_more_in_each_file(tmp_path, layout):
    write_small(layout, tmp_path / 'set')
    kinds = kinds_of(tmp_path)
    assert kinds
    for name, paths in kinds.items():
        before = paths[0].read_bytes()
        enlarge(paths[0], 5)
        after = paths[0].read_bytes()
        if paths[0].suffix == '.txt':
            *lines, last = before.splitlines()
            assert after.splitlines() == [*lines, *[last] * 5], name
        else:
            assert after == 5 * before, name


@pytest.mark.parametrize(
    ('first_s', 'second_s', 'size', 'mark'),
    [
        (1.0, 2.0, 10**6, ''), (1.0, 3.9, 3 * 10**6, '*'), (0.1, 0.5, 0, ''), (0.0, 0.6, 0, '*'),
        (1.0, 2.1, 10**6, '!'), (0.3, 2.1, 10**6, '*!'),
    ],
)  # fmt: skip
def test_marks(first_s, second_s, size, mark):
    assert judge(first_s, second_s, size) == mark


def test_a_line_names_the_case_and_each_command():
    done = growth('--shrink', '100000', 'object: calib')
    assert done.stderr == ''
    assert done.stdout.startswith('object: calib/*.txt x 1, ')
    parts = [part.split()[0] for part in done.stdout.split(': ')[2].split('; ')]
    assert parts == ['info', 'validate', 'report', 'stats', 'view', 'to-bag', 'crop']
    assert '?' not in done.stdout


def test_an_unknown_kind_is_refused():
    done = growth('nothing of this name')
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.endswith('no such kind; see --list\n')


def test_a_line_of_memory_names_each_command(monkeypatch):
    monkeypatch.setattr('peaks._COMMANDS', {'folder': ('info IN', 'API', 'recover IN OUT')})
    line = PeakCase('memory: folder', 'folder').measure(shrink=50)
    assert line.startswith('memory: folder x 2, MB: info ')
    parts = [part.split() for part in line.split(': ')[2].split('; ')]
    names, peaks = [part[0] for part in parts], [part[-1] for part in parts]
    assert names == ['info', 'API', 'recover']
    assert [peak.endswith('?') for peak in peaks] == [False, False, True]
    assert all(10 < float(peak.rstrip('?')) < 500 for peak in peaks)


@pytest.mark.parametrize(('second', 'mark'), [(40.0, ''), (119.9, ''), (120.1, '*')])
def test_marks_of_memory(second, mark):
    assert judge_peaks(100.0, second) == mark


ODOMETRY = '/kitti/ground_truth/odometry'


def score(path, folder):
    truth = ODOMETRY if folder.name.startswith('foreign') else None
    score_odometry(path, path, ReadOptions(), OdometryOptions(topic=ODOMETRY, gt_topic=truth))


def look(path, _):
    with closing(open_frames(path, ReadOptions())) as source:
        wanted = frozenset({*source.streams, 'path'})
        for number in source.numbers[[0, -1]].tolist():
            assert source.frame(number, wanted).points is not None


def play(path, _):
    with closing(BagProgram(path, SelectionOptions())) as program:
        every = range(len(program.channels))
        for index in range(len(program.stamps_ns)):
            assert program.fetch(index, every)[0]


def convert(path, folder):
    layout = 'raw' if folder.name.startswith('foreign') else None
    kitti_ros2.to_kitti(path, folder / f'set_{path.parent.name}', layout=layout)


COMMANDS = {
    'report': lambda path, _: gather(path, ReadOptions()),
    'stats': lambda path, _: datasets.statistics(path),
    'view': look,
    'eval odometry': score,
    'trajectory': lambda path, _: kitti_ros2.open(path).trajectory(),
    'to-kitti': convert,
    'play': play,
}
FEW, MANY = 30, 90  # the first fills what is read ahead


@pytest.fixture(scope='module')
def drives(tmp_path_factory):
    folder = tmp_path_factory.mktemp('drives')
    found = [write_drive(folder / str(count), count) for count in (FEW, MANY)]
    few, many = (sum(path.stat().st_size for path in each.rglob('*.*')) / 2**20 for each in found)
    assert many - few > 1.5 * MOST_GROWTH_MB  # else a bag held in memory could not be told
    return found


# The rows of the others have their own bytes: see tests/bags/test_bag_reader.py.
@pytest.mark.parametrize('container', ['mcap', 'zstd', 'foreign mcap'])
def test_memory_does_not_grow_with_the_frames_of_a_bag(tmp_path, drives, container):
    folder = tmp_path / container
    bags = [write_bag(folder / f'{n}', drive, container) for n, drive in enumerate(drives)]
    grown = {}
    for name, command in COMMANDS.items():
        peaks = []
        for bag in bags:
            tracemalloc.start()
            command(bag, folder)
            peaks.append(tracemalloc.get_traced_memory()[1] / 2**20)
            tracemalloc.stop()
        grown[name] = peaks[1] - peaks[0]
    assert {name: mb for name, mb in grown.items() if mb > MOST_GROWTH_MB} == {}
