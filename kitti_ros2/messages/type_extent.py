# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How much a message type holds at least: definitions of a few lines may hold 2^60 fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype

if TYPE_CHECKING:
    from collections.abc import Mapping

_MOST_FIELDS = 1_000_000
_MOST_LEVELS = 100


def check_extent(msgtype: str, fielddefs: Mapping[str, Any]) -> None:
    """Check that a type can be read: code for it visits each field, and recurses by levels.

    Sequences may be empty; arrays are not.

    Args:
        msgtype: Its full name.
        fielddefs: Definitions as rosbags has them. Types that are missing count nothing.

    Raises:
        ValueError: It holds too many fields, or itself.
    """
    _fields_of(msgtype, fielddefs, {}, ())


def _fields_of(
    msgtype: str, fielddefs: Mapping[str, Any], known: dict[str, int], above: tuple[str, ...]
) -> int:
    if msgtype in known:
        return known[msgtype]
    if msgtype in above or len(above) > _MOST_LEVELS:
        raise ValueError(f'{(*above, msgtype)[0]} holds types that hold themselves, or too deeply')
    count = 0
    for _, (kind, rest) in fielddefs.get(msgtype, ((), ()))[1]:
        length, element, inner = 1, kind, rest
        if kind in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
            (element, inner), size = rest
            length = size if kind is Nodetype.ARRAY else 1
        fields = 1
        if element is Nodetype.NAME:
            fields += length * _fields_of(inner, fielddefs, known, (*above, msgtype))
        count += fields
        if count > _MOST_FIELDS:
            raise ValueError(f'{msgtype} holds more than {_MOST_FIELDS} fields')
    known[msgtype] = count
    return count
