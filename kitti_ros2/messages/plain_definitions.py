# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types that consist of plain lines, as nearly all do.

rosbags reads every text that ROS does, at 0.25 MB/s; these are read ten times as fast.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, cast

from rosbags.interfaces import Nodetype

if TYPE_CHECKING:
    from rosbags.interfaces.typing import (
        BaseDesc,
        Basename,
        Constdefs,
        Fielddefs,
        FieldDesc,
        NameDesc,
        Typesdict,
    )

_INTEGERS = {'byte', 'char'} | {f'{sign}int{n}' for sign in ('', 'u') for n in (8, 16, 32, 64)}
_BASES = {'bool', 'float32', 'float64', 'string', *_INTEGERS}
_WITHOUT_PACKAGE = {
    'Header': 'std_msgs/msg/Header',
    'time': 'builtin_interfaces/msg/Time',
    'duration': 'builtin_interfaces/msg/Duration',
}
_DIVIDER = '\n' + '=' * 80 + '\nMSG: '
_HEAD = re.compile(r'([A-Za-z0-9_]+)/(?:(msg|action)/)?([A-Za-z0-9_]+)[ \t]*')
_LINE = re.compile(
    r'[ \t]*([A-Za-z][A-Za-z0-9_/]*)'
    r'(\[(?:(<=)?([1-9][0-9]{0,9}))?\])?'
    r'[ \t]+([A-Za-z][A-Za-z0-9_]*)'
    r'(?:[ \t]*=[ \t]*(0|-?[1-9][0-9]{0,18}))?[ \t]*(?:#.*)?'
)
_CONSTANT = re.compile(r'[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*')
_MESSAGE = re.compile(r'(?:[a-z][a-z0-9]*(?:_[a-z0-9]+)*/)*[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*')


def parse_plain(msgtype: str, text: str) -> Typesdict | None:
    """Parse fields without defaults and constants that are decimal integers.

    Args:
        msgtype: The first type.
        text: In the format of .msg, without empty lines and lines of comments; the definitions of
            other types follow as in rosbag2.

    Returns:
        What get_types_from_msg of rosbags returns; None if there is anything else in the text.
    """
    types: Typesdict = {}
    for block in f'{msgtype}\n{text}'.rstrip('\n').split(_DIVIDER):
        first, *lines = block.split('\n')
        head = _HEAD.fullmatch(first)
        if head is None or head[1] in {'msg', 'action'}:
            return None
        package = f'{head[1]}/{head[2] or "msg"}'
        constants: Constdefs = []
        fields: Fielddefs = []
        for line in lines:
            if not _enter(line, package, constants, fields):
                return None
        types[f'{package}/{head[3]}'] = (constants, fields)
    return types


def _enter(line: str, package: str, constants: Constdefs, fields: Fielddefs) -> bool:
    """Enter what a line defines; return whether it is plain."""
    found = _LINE.fullmatch(line)
    if found is None:
        return False
    kind, brackets, bound, length, name, value = found.groups()
    if value is not None:
        if kind not in _INTEGERS or brackets or not _CONSTANT.fullmatch(name):
            return False
        constants.append((name, cast('Basename', kind), int(value)))
        return True
    one: BaseDesc | NameDesc
    if kind in _BASES:
        one = (Nodetype.BASE, (cast('Basename', kind), 0))
    elif _MESSAGE.fullmatch(kind):
        one = (Nodetype.NAME, _full_name(kind, package))
    else:
        return False
    described: FieldDesc = one
    if brackets:
        size = int(length or 0)
        is_array = size and not bound
        described = (Nodetype.ARRAY, (one, size)) if is_array else (Nodetype.SEQUENCE, (one, size))
    fields.append((name, described))
    return True


def _full_name(name: str, package: str) -> str:
    name = _WITHOUT_PACKAGE.get(name, name)
    other, slash, own = name.rpartition('/')
    if not slash:
        return f'{package}/{name}'
    return name if '/msg/' in name or '/action/' in name else f'{other}/msg/{own}'
