# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One typestore of the message types as the bags define them."""

from __future__ import annotations

from functools import lru_cache
from keyword import iskeyword
from typing import TYPE_CHECKING

from rosbags.typesys import (
    Stores,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)

from ..messages.plain_definitions import parse_plain
from ..messages.ros_types import TYPESTORE
from ..messages.type_definitions import closure
from ..messages.type_extent import check_extent
from ..model.msgtypes import HEADER
from .definition_texts import shortened, shortened_idl
from .typestores import OriginalTexts, typestore_of

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from rosbags.interfaces.typing import Constdefs, Fielddefs, FieldDesc, Typesdict
    from rosbags.typesys.store import Typestore

    from .findings import Findings
    from .pieces import StoredChannel

_LONGEST_REASON = 80
_IDL_DIVIDER = '=' * 80 + '\n'


class Definitions:
    """The types of channels, collected from all bags.

    A definition that differs from an earlier one of the same bag is noted and ignored; a channel
    whose types another bag defines differently cannot be read together with that bag. Types that no
    bag defines are those of ROS 2 Jazzy.
    """

    def __init__(self, findings: Findings) -> None:
        self._findings = findings
        self._types: Typesdict = {}
        self._origins: dict[str, Path] = {}
        self._seen: dict[tuple[Path, tuple[str, str, str]], str] = {}

    def add(self, bag: Path, file: Path, channel: StoredChannel) -> str:
        """Enter the definition of a channel.

        Returns:
            Why its messages cannot be read together with those of other bags, empty if they can.
        """
        key = (channel.msgtype, channel.definition, channel.definition_encoding)
        if not channel.definition.strip():
            return ''
        if (bag, key) not in self._seen:
            self._seen[bag, key] = self._enter(bag, file, key)
        return self._seen[bag, key]

    def complete(self, msgtypes: Iterable[str]) -> frozenset[str]:
        """Add the types of ROS 2 Jazzy that some types need; returns those without a definition."""
        return frozenset(name for name in sorted(set(msgtypes)) if not _complete(self._types, name))

    def check_extent(self, msgtype: str) -> None:
        """Check that code may visit each field of a type: see messages.type_extent.

        Raises:
            ValueError: It holds too many, or itself.
        """
        check_extent(msgtype, self._types)

    def check_known(self, msgtype: str) -> None:
        """Check that a type, complete, is that of ROS 2 Jazzy, as which messages are made.

        Raises:
            ValueError: A bag defines it, or a type in it, otherwise.
        """
        own = [name for name in closure(self._types, msgtype) if name in self._origins]
        if not own:
            return
        known = _jazzy()
        for name in own:
            if name in known and known[name][1] != self._types[name][1]:
                raise ValueError(f'{self._origins[name]} defines {name} otherwise than ROS 2 Jazzy')

    def typestore(self) -> Typestore:
        """Make the store of all types; those of bags with the same types share their classes."""
        return typestore_of(self._types)

    def with_original_texts(self, typestore: Typestore) -> Typestore:
        """Return a store whose definition texts are those of the bags, if they are of ROS 2."""
        texts = {
            msgtype: text
            for _, (msgtype, text, encoding) in sorted(self._seen)
            if encoding == 'ros2msg'
        }
        return OriginalTexts(typestore, texts)

    def _enter(self, bag: Path, file: Path, key: tuple[str, str, str]) -> str:
        try:
            found = parse_definition(*key)
            _check_names(found)
        except Exception as error:  # noqa: BLE001 - a parser of any text may raise anything
            reason = ' '.join(str(error).split())[:_LONGEST_REASON]
            self._findings.note(f'{file}: the definition of {key[0]} cannot be read ({reason})')
            return ''
        for name, (_, fields) in found.items():
            if name in self._types and self._types[name][1] != fields:
                if self._origins[name] != bag:
                    return f'{name} is defined otherwise than in {self._origins[name]}'
                text = f'defines {name} in two ways; messages are read by the first'
                self._findings.note(f'{file}: {text}')
        for name, definition in found.items():
            self._types.setdefault(name, definition)
            self._origins.setdefault(name, bag)
        return ''


@lru_cache(maxsize=1024)
def parse_definition(msgtype: str, text: str, encoding: str) -> Typesdict:
    """Parse the types that a text defines, as ROS 2 spells them.

    Args:
        msgtype: The first of them.
        text: Messages, separated as in rosbag2 and ROS 1; or IDL.
        encoding: ros2msg, ros1msg, ros2idl or omgidl.

    Raises:
        ValueError: The encoding is unknown, or the text too long or nested too deeply.
        TypesysError: The text cannot be read.
    """
    if encoding == 'ros2msg':
        return _parse_messages(msgtype, text)
    if encoding == 'ros1msg':
        return _ros2_like(_parse_messages(msgtype, text))
    if encoding not in {'ros2idl', 'omgidl'}:
        raise ValueError(f'unknown encoding {encoding!r}')
    types: Typesdict = {}
    for part in shortened_idl(text).split(_IDL_DIVIDER):
        head, newline, rest = part.partition('\n')
        body = rest if newline and head.startswith('IDL: ') else part
        if body.strip():
            types.update(get_types_from_idl(body))
    return types


def _parse_messages(msgtype: str, text: str) -> Typesdict:
    short = shortened(text)
    found = parse_plain(msgtype, short)
    # Without a line break at its end, rosbags refuses a text whose last type has no fields.
    return get_types_from_msg(f'{short}\n', msgtype) if found is None else found


def _check_names(types: Typesdict) -> None:
    """Check that names can become Python classes and their fields.

    Raises:
        ValueError: A name is not an identifier, or is there twice, also as Python spells it; or a
            constant is beyond its type, so that Python cannot spell it.
    """
    for name, (constants, fields) in types.items():
        inner = [str(each[0]) for each in (*constants, *fields)]
        if len({f'{each}_' if iskeyword(each) else each for each in inner}) < len(inner):
            raise ValueError(f'{name} has a name twice')
        for constant, _, value in constants:
            if isinstance(value, (int, float)) and not -(2**63) <= value < 2**64:
                raise ValueError(f'{constant} is beyond what its type holds')
        for word in (*name.split('/'), *inner):
            if not word.isidentifier():
                raise ValueError(f'{word!r} is no name')


def _ros2_like(types: Typesdict) -> Typesdict:
    """Convert the types of a ROS 1 bag to ROS 2: a Header without seq, names in lower case."""
    definitions = dict(types)
    if HEADER in definitions:
        constants, fields = definitions[HEADER]
        definitions[HEADER] = (constants, [each for each in fields if each[0] != 'seq'])
    for name, known in TYPESTORE.fielddefs.items():
        if name in definitions and _kinds(definitions[name]) == _kinds(known):
            definitions[name] = known
    return definitions


def _kinds(definition: tuple[Constdefs, Fielddefs]) -> list[FieldDesc]:
    """Return the types of a definition's fields, without their names."""
    return [kind for _, kind in definition[1]]


def _complete(types: Typesdict, msgtype: str) -> bool:
    """Add the types that a type needs and no bag defines; False if one is not in Jazzy either."""
    missing = [name for name in closure(types, msgtype) if name not in types]
    if not missing:
        return True
    # Loading all types of ROS 2 takes as long as reading a gigabyte; the common ones are at hand.
    for load in (_common, _jazzy):
        known = {**load(), **types}
        needed = list(closure(known, msgtype))
        if all(name in known for name in needed):
            types.update({name: known[name] for name in needed})
            return True
    return False


def _common() -> Typesdict:
    return TYPESTORE.fielddefs


@lru_cache(maxsize=1)
def _jazzy() -> Typesdict:
    # Loading all types of ROS 2 is slow, and most bags do not need it.
    return {**get_typestore(Stores.ROS2_JAZZY).fielddefs, **TYPESTORE.fielddefs}
