# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tests wait as long as a busy machine needs, and see whether what they waited for came."""

import ast
from pathlib import Path

import pytest

from waiting import PATIENCE_S  # isort: skip

HERE = Path(__file__).parent
WAITS = {'wait', 'wait_for_service', 'join', 'communicate', 'run', 'create_connection'}
RAISE = {'communicate', 'run', 'create_connection'}
"""Of these the ones that raise an exception when the time is over."""


def short(limit):
    """Whether a time limit is a number from 1 up that a busy machine may exceed."""
    value = getattr(limit, 'value', None)
    return isinstance(value, int | float) and 1 <= value < PATIENCE_S


def faults(tree):
    """The lines of waits with a short limit, and of those whose outcome is not looked at."""
    followers = {
        id(statement.value): following
        for node in ast.walk(tree)
        for body in (getattr(node, name, None) for name in ('body', 'orelse', 'finalbody'))
        if body and isinstance(body, list)  # the body of a lambda is none
        for statement, following in zip(body, [*body[1:], ast.Pass()], strict=True)
        if isinstance(statement, ast.Expr)
    }
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute):
            continue
        limits = [each.value for each in call.keywords if each.arg == 'timeout']
        limits += call.args if call.func.attr in WAITS - RAISE and len(call.args) == 1 else []
        if call.func.attr not in WAITS or not limits:
            continue
        if any(map(short, limits)):
            yield f'{call.lineno}: a time limit under {PATIENCE_S:g} s'
        elif call.func.attr not in RAISE and id(call) in followers:
            alive = f'assert not {ast.unparse(call.func.value)}.is_alive()'
            if ast.unparse(followers[id(call)]) != alive:
                yield f'{call.lineno}: nobody looks whether it came'


def test_every_wait_has_patience_and_is_looked_at():
    found = [
        f'{path.relative_to(HERE)}:{fault}'
        for path in HERE.rglob('*.py')
        if path.parent.name != 'soak'  # a program for hours, ended by the clock
        for fault in faults(ast.parse(path.read_text(encoding='utf-8')))
    ]
    assert found == []


@pytest.mark.parametrize(
    ('code', 'count'),
    [
        ('event.wait(PATIENCE_S)', 1),
        ('assert event.wait(PATIENCE_S)', 0),
        ('assert event.wait(10)', 1),
        ('event.wait()', 0),
        ('thread.join(PATIENCE_S)', 1),
        ('thread.join(PATIENCE_S)\nassert not thread.is_alive()', 0),
        ('process.communicate(timeout=30)', 1),
        ('process.communicate(timeout=PATIENCE_S)', 0),
    ],
)
def test_faults_are_found(code, count):
    assert len([*faults(ast.parse(code))]) == count
