# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types, parsed from short texts and from the files in definitions/."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore
from rosbags.typesys.stores import empty

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosbags.interfaces import Msgdef
    from rosbags.interfaces.typing import (
        BaseDesc,
        Basename,
        ConstValue,
        FieldDesc,
        NameDesc,
        Typesdict,
    )

_FOLDER = Path(__file__).with_name('definitions')
_TYPE = '\nMSG: '
"""Precedes each type in a file, as in the definitions that bags contain."""


class LazyTypes(Typestore):
    """A typestore that makes the Python classes of some types when one of them is needed.

    Making classes takes longer than reading definitions, and serialised messages need none.

    Args:
        types: Definitions whose classes are made at once.
        lazy: Definitions whose classes are made when a message is encoded or decoded by them.
    """

    def __init__(self, types: Typesdict, lazy: Typesdict) -> None:
        super().__init__(empty)
        self.register(types)
        self._lazy = lazy
        self.fielddefs.update(lazy)

    def get_msgdef(self, typename: str) -> Msgdef[Any]:
        """Return the code of a type; see Typestore."""
        if typename in self._lazy and typename not in self.types:
            made = Typestore()
            made.register(self._lazy)
            self.types.update(made.types)
        return super().get_msgdef(typename)


def read_definitions() -> Typesdict:
    """Read the types in definitions/."""
    texts = {}
    for path in sorted(_FOLDER.glob('*.txt')):
        for block in path.read_text('utf-8').split(_TYPE)[1:]:
            name, *lines = block.strip().splitlines()
            texts[name.replace('/', '/msg/')] = '|'.join(lines)
    return parse_definitions(texts)


def parse_definitions(texts: Mapping[str, str]) -> Typesdict:
    """Parse definitions by full name: the lines of a .msg file, separated by |."""
    types: Typesdict = {}
    for msgtype, text in texts.items():
        constants: list[tuple[str, Basename, ConstValue]] = []
        fields: list[tuple[str, FieldDesc]] = []
        for line in text.split('|'):
            kind, name = line.split(' ')
            name, equals, value = name.partition('=')
            if equals:
                constants.append((name, cast('Basename', kind), int(value)))
            else:
                fields.append((name, _parse_type(kind)))
        types[msgtype] = (constants, fields)
    return types


def _parse_type(word: str) -> FieldDesc:
    """The type of a field, as rosbags describes it: float64, std_msgs/Header, uint8[], int32[9]."""
    element, bracket, length = word.rstrip(']').partition('[')
    package, slash, name = element.rpartition('/')
    one: BaseDesc | NameDesc
    if slash:
        one = (Nodetype.NAME, f'{package}/msg/{name}')
    else:
        one = (Nodetype.BASE, (cast('Basename', name), 0))
    if not bracket:
        return one
    return (Nodetype.ARRAY if length else Nodetype.SEQUENCE, (one, int(length or 0)))
