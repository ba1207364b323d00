# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Faults at calls spread over each command; `python -m tests.torture.faults --all`: every call."""

from __future__ import annotations

import pytest
from fault_cases import CASES, FAULTS
from fault_library import compile_faults, compiler_of_faults
from fault_points import Bench
from fault_spread import call_at, spread
from fork_server import ForkServer

FOUND = [
    ('download', 'short writes', 0.0),
    ('to-bag mcap', 'EIO from then on', 0.4),
    ('to-bag mcap', 'SIGTERM at a read', 1.0),
    ('to-bag mcap', 'no memory', 0.6),
    ('to-kitti --append', 'SIGTERM', 0.85),
    ('to-kitti --append', 'SIGKILL', 0.75),
    ('to-kitti --append', 'full disk', 0.75),
    ('to-kitti --append', 'full disk', 0.857),
    ('download', 'SIGKILL', 0.065),
    ('download', 'EIO once', 0.285),
    ('download', 'full disk', 0.09),
    ('download', 'EIO of a read', 0.595),
    ('to-bag mcap', 'EIO of a read', 0.585),
    ('to-bag mcap', 'EIO of a read', 0.685),
    ('to-bag mcap', 'vanishing file', 0.655),
    ('to-kitti odometry', 'EIO of a read', 0.05),
    ('to-kitti odometry', 'EIO of a read', 0.07),
]
"""Commands, faults and parts of a run at which something was found once."""


@pytest.fixture(scope='module')
def library(tmp_path_factory):
    if compiler_of_faults() is None:
        pytest.skip('needs Linux and a C compiler')
    return compile_faults(tmp_path_factory.mktemp('faults'))


@pytest.mark.parametrize('name', CASES)
def test_a_command_survives(name, library, tmp_path):
    """One call of each fault; those of another command are at other parts of the run."""
    row = [*CASES].index(name)
    with ForkServer(library, tmp_path) as server:
        bench = Bench(name, CASES[name], server, tmp_path / 'work')
        points = [
            (fault, call_at(bench.calls(FAULTS[fault]), (row * 5 + column * 7) % 17 / 17))
            for column, fault in enumerate(FAULTS)
        ]
        points += [
            (fault, call_at(bench.calls(FAULTS[fault]), part))
            for command, fault, part in FOUND if command == name
        ]  # fmt: skip
        findings = [
            str(each) for fault, call in points for each in bench.check(fault, FAULTS[fault], call)
        ]
    assert not findings, '\n'.join(findings)


def test_calls_are_spread():
    assert spread(3, 8) == [1, 2, 3]
    assert spread(100, 4) == [13, 38, 63, 88]
    assert spread(5, None) == [1, 2, 3, 4, 5]
    assert call_at(10, 0.0) == 1
    assert call_at(10, 1.0) == 10
