# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What ``python -m tests.growth`` does; the times that it measures are no test."""

import subprocess
import sys
from pathlib import Path

import pytest
from larger_bags import KINDS, write_larger
from larger_sets import enlarge, kinds_of, write_small
from marks import judge

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.model.layouts import Layout

ROOT = Path(__file__).resolve().parents[2]


def growth(*words):
    return subprocess.run(
        [sys.executable, '-m', 'tests.growth', *words], cwd=ROOT, capture_output=True, text=True,
        timeout=300, check=False,
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
