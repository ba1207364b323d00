# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of type definitions, whose parser is slow on some texts that no program writes.

rosbags parses 200 kB of .msg text in a second, and 600 numbers of IDL; each pair of parentheses in
a constant of IDL takes 70 times as long as without, each sequence in a sequence twice as long. An
annotation takes as long as seven numbers, and rosidl writes one for each comment: PX4's
VehicleCommand has 150 constants, most with a comment.
"""

from __future__ import annotations

import re

_MOST_CHARACTERS = 100_000
_MOST_WITH_COMMENTS = 1_000_000
_MOST_IDL_CHARACTERS = 30_000
_MOST_EXPRESSIONS = 300
_DEEPEST = 4

# What is not closed ends with the text: to look for its end again from each quote is quadratic.
_TEXT_OR_COMMENT = re.compile(r'("(?:\\.|[^"\\])*(?:"|\\?\Z))|//[^\n]*|/\*.*?(?:\*/|\Z)', re.DOTALL)
_ANNOTATION = re.compile(r'@\s*([\w:]+)\s*\([^()]*\)')
_VALUE = 'value'
"""The one annotation that rosbags uses: the number of an enumerator."""
_KEPT_TEXT = re.compile(r'"t(\d+)"')
_EXPRESSION = re.compile(r'@\s*[\w:]+\s*\(|(?<!\w)\d|[-+*/%|&^~]|<<|>>')
_LARGE_SHIFT = re.compile(r'<<(?!\s*\d{1,2}\s*[];|&^])')
_BRACKETS = re.compile(r'<<|[<>;]')


def shortened(text: str) -> str:
    """Return a text of messages without its blank lines and lines of comments.

    Raises:
        ValueError: It is too long.
    """
    _check_length(len(text), _MOST_WITH_COMMENTS)
    lines = [line for line in text.splitlines() if line.strip() and line.strip()[0] != '#']
    found = '\n'.join(lines)
    _check_length(len(found), _MOST_CHARACTERS)
    return found


def shortened_idl(text: str) -> str:
    """Return a text of IDL without its comments and the annotations that do not matter.

    Raises:
        ValueError: It is too long, has too many expressions, nests them, or shifts by a number of
            more than two digits, whose result may have a billion.
    """
    _check_length(len(text), _MOST_WITH_COMMENTS)
    texts: list[str] = []

    def without_comment(found: re.Match[str]) -> str:
        if not found[1]:
            return ' '
        texts.append(found[1])
        return f'"t{len(texts) - 1}"'

    plain = _TEXT_OR_COMMENT.sub(without_comment, text)
    plain = _ANNOTATION.sub(lambda found: found[0] if found[1] == _VALUE else ' ', plain)
    _check_idl(plain)
    return _KEPT_TEXT.sub(lambda found: texts[int(found[1])], plain)


def _check_idl(plain: str) -> None:
    """Check that a text of IDL without comments can be parsed in a bounded time.

    Raises:
        ValueError: It is too long, has too many expressions, or nests them.
    """
    _check_length(len(' '.join(plain.split())), _MOST_IDL_CHARACTERS)
    count = sum(1 for _ in _EXPRESSION.finditer(plain))
    if count > _MOST_EXPRESSIONS:
        raise ValueError(f'{count} numbers and annotations; at most {_MOST_EXPRESSIONS} are read')
    if '(' in _ANNOTATION.sub('', plain):
        raise ValueError('an expression in parentheses, which is not read')
    if _LARGE_SHIFT.search(plain):
        raise ValueError('a shift by more than a number of two digits, which is not read')
    depth = 0
    for found in _BRACKETS.findall(plain):
        depth = {'<': depth + 1, '>': max(depth - 1, 0), ';': 0}.get(found, depth)
        if depth > _DEEPEST:
            raise ValueError('sequences that are nested too deeply')


def _check_length(length: int, most: int) -> None:
    if length > most:
        raise ValueError(f'{length} characters; at most {most} are read')
