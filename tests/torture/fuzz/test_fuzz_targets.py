# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Mutated inputs are read, or refused by an error of ours, at a bounded cost: a short run.

The long one is python -m tests.torture.fuzz.
"""

from __future__ import annotations

import gc

import pytest
from fuzz.known import NAMES, known
from fuzz.lines import Lines
from fuzz.loop import fuzz, run_input
from fuzz.target import Target
from fuzz.targets import TARGETS

from kitti_ros2.bags.stored_messages import parse_definition
from kitti_ros2.model.errors import KittiRos2Error


@pytest.mark.parametrize('name', sorted(TARGETS))
def test_mutated_inputs_are_read_or_refused(name):
    target = TARGETS[name]
    outcome = fuzz(target, seed=1, executions=target.short)
    found = '\n'.join(f'{each.data[:200]!r}\n{each.text}' for each in outcome.findings.values())
    assert not outcome.findings, found
    assert outcome.executions >= target.short


@pytest.mark.parametrize('name', NAMES)
def test_what_broke_it_once_is_read_or_refused(name):
    for data in known(name):
        assert not run_input(TARGETS[name], data)


def _planted(data: bytes) -> None:
    if b'7' in data:
        raise KeyError
    if not data:
        raise KittiRos2Error


def _greedy(data: bytes) -> None:
    if b'7' in data:
        bytes(range(256)) * 2_000_000


def _slow(data: bytes) -> None:
    while b'7' in data:
        pass


@pytest.mark.parametrize(
    ('run', 'key'), [(_planted, 'KeyError'), (_greedy, 'TooLargeError'), (_slow, 'TooSlowError')]
)
def test_the_fuzzer_finds_and_minimises_a_planted_fault(run, key):
    target = Target('planted', run, lambda: [b'1 2 3 4\n' * 5], is_text=True)
    data = b'1 2 3\n' * 20 + b'7'
    assert run_input(target, data) == key
    if run is _planted:
        outcome = fuzz(target, seed=3, executions=3000)
        (finding,) = outcome.findings.values()
        assert finding.data == b'7'
        assert outcome.refused


def test_an_input_that_is_slow_once_is_no_finding():
    runs: list[bytes] = []

    def slow_once(data: bytes) -> None:
        runs.append(data)
        if len(runs) == 1:
            _slow(data)

    assert not run_input(Target('planted', slow_once, list), b'7')
    assert len(runs) == 2


def test_an_input_that_is_slow_does_not_hide_in_a_cache():
    hits: list[int] = []

    def slow(data: bytes) -> None:
        parse_definition('a/msg/B', 'float64 x', 'ros2msg')
        hits.append(parse_definition.cache_info().hits)
        _slow(data)

    gc.freeze()  # as a player does: the collector knows nothing of these objects any more
    try:
        assert run_input(Target('planted', slow, list), b'7') == 'TooSlowError'
    finally:
        gc.unfreeze()
    assert hits[1:] == [0, 0]


def test_the_same_seed_gives_the_same_inputs():
    taken: list[list[bytes]] = [[], []]
    for inputs in taken:
        target = Target('planted', inputs.append, lambda: [b'a 1\nb 2\n', b'c'], is_text=True)
        fuzz(target, seed=5, executions=200)
    assert taken[0] == taken[1]
    assert len(set(taken[0])) > 100


def test_new_lines_are_seen_once():
    lines = Lines(['kitti/text_file.py'])
    for seen in (True, False):
        lines.new = False
        with lines.recorded():
            TARGETS['oxts'].run(b'1 2 3\n')
        assert lines.new is seen
    lines.release()
