# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types, of short texts and the files in definitions/; what is in them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype

from .plain_definitions import parse_plain

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosbags.interfaces.typing import Typesdict

_FOLDER = Path(__file__).with_name('definitions')
_TYPE = '\nMSG: '
"""Precedes each type in a file, as in the definitions that bags contain."""


def closure(types: Typesdict, msgtype: str) -> Iterator[str]:
    """Yield a type and those in it, each once, including undefined ones."""
    waiting, seen = [msgtype], {msgtype}
    while waiting:
        name = waiting.pop()
        yield name
        for _, description in types[name][1] if name in types else ():
            nested = nested_type(description)
            if nested is not None and nested not in seen:
                seen.add(nested)
                waiting.append(nested)


def nested_type(description: Any) -> str | None:  # noqa: ANN401 - as rosbags has it
    """Return the message type of a field or its elements; None for numbers and strings."""
    kind, content = description
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return nested_type(content[0])
    return content if kind == Nodetype.NAME else None


def read_definitions() -> Typesdict:
    """Read the types in definitions/."""
    texts = {}
    for path in sorted(_FOLDER.glob('*.txt')):
        for block in path.read_text('utf-8').split(_TYPE)[1:]:
            name, _, lines = block.strip().partition('\n')
            texts[name] = lines
    return parse_definitions(texts)


def parse_definitions(texts: Mapping[str, str]) -> Typesdict:
    """Parse plain definitions by name: the lines of a .msg file, also separated by |."""
    types: Typesdict = {}
    for msgtype, text in texts.items():
        found = parse_plain(msgtype, text.replace('|', '\n'))
        if found is None:
            raise ValueError(f'{msgtype} has a line that is not plain')
        types.update(found)
    return types
