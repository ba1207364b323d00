# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages as bags store them: the definitions of their types, and their conversion to CDR."""

from __future__ import annotations

import json
import re
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from keyword import iskeyword
from typing import TYPE_CHECKING, Any

from rosbags.typesys import get_types_from_idl, get_types_from_msg

from ..messages.foxglove_fields import Fields, JsonFields
from ..messages.ros_types import TYPESTORE
from ..messages.ros_versions import jazzy_types
from ..messages.type_definitions import (
    LazyClasses,
    LazyTypestore,
    check_extent,
    closure,
    lazy_typestore,
    parse_plain,
    with_wide_names,
    with_wide_strings,
    without_wide_fields,
)
from ..messages.type_descriptions import defined_hash
from ..model.bag_formats import HEADER, LARGE_TYPES, ZSTD_MAGIC
from ..model.errors import KittiRos2Error, MissingDataError
from .container_file import MessageStart, StoredChannel
from .decompression import decompress_message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path
    from typing import TypeAlias

    from rosbags.interfaces.typing import Constdefs, Fielddefs, Typesdict
    from rosbags.typesys.store import Typestore

    from ..messages.foxglove import Translation
    from .container_file import Problems
    from .decompression import Buffer


# Limits of type definitions, whose parser is slow on some texts that no program writes.
#
# rosbags parses 200 kB of .msg text in a second, and 600 numbers of IDL; each pair of parentheses
# in a constant of IDL takes 70 times as long as without, each sequence in a sequence twice as long.
# An annotation takes as long as seven numbers, and rosidl writes one for each comment: PX4's
# VehicleCommand has 150 constants, most with a comment.

_MOST_CHARACTERS = 100_000
_MOST_WITH_COMMENTS = 1_000_000
_MOST_IDL_CHARACTERS = 30_000
_MOST_EXPRESSIONS = 300
_DEEPEST = 4

# Unclosed texts end with the input: a search for their end from each quote is quadratic.
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
    short = '\n'.join(lines)
    _check_length(len(short), _MOST_CHARACTERS)
    return short


def shortened_idl(text: str) -> str:
    """Return a text of IDL without its comments and the annotations that do not matter.

    Raises:
        ValueError: It is too long, has too many expressions, nests them, or shifts by a number of
            more than two digits, whose result may have a billion.
    """
    _check_length(len(text), _MOST_WITH_COMMENTS)
    texts: list[str] = []

    def without_comment(match: re.Match[str]) -> str:
        if not match[1]:
            return ' '
        texts.append(match[1])
        return f'"t{len(texts) - 1}"'

    plain = _TEXT_OR_COMMENT.sub(without_comment, text)
    plain = _ANNOTATION.sub(lambda match: match[0] if match[1] == _VALUE else ' ', plain)
    _check_idl(plain)
    return _KEPT_TEXT.sub(lambda match: texts[int(match[1])], plain)


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
    for bracket in _BRACKETS.findall(plain):
        depth = {'<': depth + 1, '>': max(depth - 1, 0), ';': 0}.get(bracket, depth)
        if depth > _DEEPEST:
            raise ValueError('sequences that are nested too deeply')


def _check_length(length: int, most: int) -> None:
    if length > most:
        raise ValueError(f'{length} characters; at most {most} are read')


# Typestores of the types of bags, which share the classes and functions that are made of them.


class SharingTypestore(LazyTypestore):
    """A typestore with the types of another and the functions made for them.

    Types that are registered in one of them are not in the other.
    """

    def __init__(self, typestore: Typestore) -> None:
        super().__init__()
        self.types = typestore.types
        self.fielddefs.update(typestore.fielddefs)
        self.cache = typestore.cache

    def register(self, typs: Typesdict) -> None:
        """Register types in this store alone."""
        self.cache = dict(self.cache)
        self.types = LazyClasses(self.types, self.fielddefs)
        super().register(typs)


class OriginalTexts(SharingTypestore):
    """A typestore that returns the original definition texts, empty ones for unknown types."""

    def __init__(self, typestore: Typestore, texts: Mapping[str, str]) -> None:
        super().__init__(typestore)
        self._texts = texts

    def generate_msgdef(self, typename: str, ros_version: int = 1) -> tuple[str, str]:
        """Return the text of a definition, and its md5 sum for ROS 1."""
        if ros_version == 2 and typename in self._texts:
            return self._texts[typename], ''
        if typename not in self.fielddefs:
            return '', ''
        text, md5sum = super().generate_msgdef(typename, ros_version)
        return (with_wide_names(text) if ros_version == 2 else text), md5sum

    def hash_rihs01(self, typ: str) -> str:
        """Return the hash of a type, empty if it has none."""
        try:
            return defined_hash(typ, self)
        except MissingDataError:
            return ''


def typestore_of(types: Typesdict) -> Typestore:
    """Make a store of types; stores of the same types share their classes and functions.

    Making these takes longer than reading a small bag, and the bags of a collection mostly have the
    same types.
    """
    return SharingTypestore(
        _shared(
            tuple(
                (name, tuple(constants), tuple(fields))
                for name, (constants, fields) in types.items()
            )
        )
    )


@lru_cache(maxsize=8)
def _shared(types: tuple[tuple[str, tuple[Any, ...], tuple[Any, ...]], ...]) -> Typestore:
    own = {name: (list(constants), list(fields)) for name, constants, fields in types}
    return lazy_typestore(own)


# One typestore of the message types as the bags define them.

_LONGEST_REASON = 80
_CONSTANT = re.compile(r'^[ \t]*\w+[ \t]+\w+[ \t]*=.*$', re.MULTILINE)
_IDL_DIVIDER = '=' * 80 + '\n'


class Definitions:
    """The types of channels, collected from all bags.

    A definition that differs from an earlier one of the same bag is noted and ignored; a channel
    whose types another bag defines differently cannot be read together with that bag. Types that no
    bag defines are those of ROS 2 Jazzy.
    """

    def __init__(self, problems: Problems) -> None:
        self._problems = problems
        self._types: Typesdict = {}
        self._origins: dict[str, Path] = {}
        self._unread: dict[str, str] = {}
        self._seen: dict[tuple[Path, tuple[str, str, str]], str] = {}
        self._respelled: set[str] = set()

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

    def complete(self, msgtypes: Iterable[str]) -> dict[str, str]:
        """Add the types of ROS 2 Jazzy that some types need; returns why others are undefined."""
        return {
            name: self._unread.get(name)
            or f'neither the bag nor ROS 2 Jazzy defines {name or "a type without a name"}'
            for name in sorted(set(msgtypes))
            if not _complete(self._types, name)
        }

    def check_extent(self, msgtype: str) -> None:
        """Check that code may visit each field of a type: see messages.type_definitions.

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
        jazzy = jazzy_types()
        for name in own:
            if name in jazzy and jazzy[name][1] != self._types[name][1]:
                raise ValueError(f'{self._origins[name]} defines {name} otherwise than ROS 2 Jazzy')

    def typestore(self) -> Typestore:
        """Make the store of all types; those of bags with the same types share their classes."""
        return typestore_of(self._types)

    def with_original_texts(self, typestore: Typestore) -> Typestore:
        """Return a store whose definition texts are those of the bags, if they are of ROS 2.

        Texts with other names of fields than ROS 2 has, such as D of CameraInfo, are left out.
        """
        texts = {
            msgtype: text
            for _, (msgtype, text, encoding) in sorted(self._seen)
            if encoding == 'ros2msg' and text not in self._respelled
        }
        return OriginalTexts(typestore, texts)

    def _enter(self, bag: Path, file: Path, key: tuple[str, str, str]) -> str:
        try:
            parsed = parse_definition(*key)
            _check_names(parsed)
        except Exception as error:  # noqa: BLE001 - a parser of any text may raise anything
            reason = ' '.join(str(error).split())[:_LONGEST_REASON]
            self._unread[key[0]] = f'the definition of {key[0]} cannot be read ({reason})'
            self._problems.note(f'{file}: {self._unread[key[0]]}')
            return ''
        types = {name: _ros2_spelled(name, definition) for name, definition in parsed.items()}
        if types != parsed and key[2] != 'ros1msg':
            names = ', '.join(
                name for name, definition in types.items() if definition != parsed[name]
            )
            self._respelled.add(key[1])
            text = f'spells fields of {names} otherwise than ROS 2 (capital letters)'
            self._problems.note(f'{file}: {text}; they are read all the same')
        for name, (_, fields) in types.items():
            if name in self._types and self._types[name][1] != fields:
                if self._origins[name] != bag:
                    return f'{name} is defined otherwise than in {self._origins[name]}'
                text = f'defines {name} in two ways; messages are read by the first'
                self._problems.note(f'{file}: {text}')
        for name, definition in types.items():
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
        return _ros2_like(_parse_ros1(msgtype, text))
    if encoding not in {'ros2idl', 'omgidl'}:
        raise ValueError(f'unknown encoding {encoding!r}')
    types: Typesdict = {}
    for part in shortened_idl(text).split(_IDL_DIVIDER):
        head, newline, rest = part.partition('\n')
        body = rest if newline and head.startswith('IDL: ') else part
        if body.strip():
            types.update(get_types_from_idl(body))
    return with_wide_strings(types) if 'wstring' in text else types


def _parse_ros1(msgtype: str, text: str) -> Typesdict:
    try:
        return _parse_messages(msgtype, text)
    except Exception:  # noqa: BLE001 - a parser of any text may raise anything
        # ROS 1 has constants that ROS 2 has not: in small letters, and any text.
        return _parse_messages(msgtype, _CONSTANT.sub('', text))


def _parse_messages(msgtype: str, text: str) -> Typesdict:
    short = shortened(text)
    is_wide = 'wstring' in short
    if is_wide:
        short = without_wide_fields(short)
    types = parse_plain(msgtype, short)
    if types is None:
        # Without a line break at its end, rosbags refuses a text whose last type has no fields.
        types = get_types_from_msg(f'{short}\n', msgtype)
    return with_wide_strings(types) if is_wide else types


def _check_names(types: Typesdict) -> None:
    """Check that names can become Python classes and their fields.

    Raises:
        ValueError: A name is not an identifier, or is there twice, also as Python spells it; or a
            constant is beyond its type, so that Python cannot spell it.
    """
    for name, (constants, fields) in types.items():
        inner = [str(member[0]) for member in (*constants, *fields)]
        if len({f'{word}_' if iskeyword(word) else word for word in inner}) < len(inner):
            raise ValueError(f'{name} has a name twice')
        for constant, _, value in constants:
            if isinstance(value, (int, float)) and not -(2**63) <= value < 2**64:
                raise ValueError(f'{constant} is beyond what its type holds')
        for word in (*name.split('/'), *inner):
            if not word.isidentifier():
                raise ValueError(f'{word!r} is no name')


def _ros2_like(types: Typesdict) -> Typesdict:
    """Convert the types of a ROS 1 bag to ROS 2: a Header without seq."""
    definitions = dict(types)
    if HEADER in definitions:
        constants, fields = definitions[HEADER]
        definitions[HEADER] = (constants, [member for member in fields if member[0] != 'seq'])
    return definitions


def _ros2_spelled(
    name: str, definition: tuple[Constdefs, Fielddefs]
) -> tuple[Constdefs, Fielddefs]:
    """Return a definition with the field names of ROS 2 where only their case differs.

    ROS 1 has D, K, R and P in CameraInfo; rosbags-convert keeps these names in ROS 2 bags.
    """
    constants, fields = definition
    letters = [field.lower() for field, _ in fields]
    expected = {
        field.lower(): field
        for field, _ in TYPESTORE.fielddefs.get(name, ([], []))[1]
        if letters.count(field.lower()) == 1
    }
    return constants, [(expected.get(field.lower(), field), kind) for field, kind in fields]


def _complete(types: Typesdict, msgtype: str) -> bool:
    """Add the types that a type needs and no bag defines; False if one is not in Jazzy either."""
    missing = [name for name in closure(types, msgtype) if name not in types]
    if not missing:
        return True
    # Loading all types of ROS 2 takes as long as reading a gigabyte; the common ones are at hand.
    for load in (_common, jazzy_types):
        available = {**load(), **types}
        needed = list(closure(available, msgtype))
        if all(name in available for name in needed):
            types.update({name: available[name] for name in needed})
            return True
    return False


def _common() -> Typesdict:
    return TYPESTORE.fielddefs


# Messages of ROS 1 as CDR.


def ros1_to_cdr(typestore: Typestore, data: Buffer, msgtype: str) -> memoryview:
    """Convert a message of ROS 1 to CDR.

    Args:
        typestore: Has its type.
        data: The message as stored.
        msgtype: The name of its type.

    Raises:
        Exception: The message is damaged; the generated code may raise anything.
    """
    bounded = copy(typestore)
    # The code for items that are messages reads past the end, as often as a damaged length states.
    bounded.max_sequence_length = max(len(data), 1)
    return bounded.ros1_to_cdr(data, msgtype)


# Channels with Foxglove's schemas or compressed clouds, which appear as channels of ROS messages.
#
# A channel of foxglove.PointCloud in protobuf or JSON, of foxglove_msgs/PointCloud or of
# point_cloud_interfaces/CompressedPointCloud2 appears as sensor_msgs/msg/PointCloud2 with CDR;
# everything that reads bags sees ROS messages only.

if TYPE_CHECKING:
    EncodeFields: TypeAlias = Callable[[Fields, int], bytes]
    Translate: TypeAlias = Callable[[Buffer, int], bytes]

_PACKAGES = (
    'foxglove.',
    'foxglove_msgs/msg/',
    'foxglove_msgs/',
    'point_cloud_interfaces/msg/',
    'point_cloud_interfaces/',
)
_ROS1_HEADER = 16  # bytes of a Header in ROS 1 up to its frame_id, the last four its length
_ROS = frozenset({'cdr', 'ros1'})
_ENCODINGS = _ROS | {'protobuf', 'json'}


@lru_cache
def _translations(*, for_copy: bool = False) -> Mapping[str, Translation]:
    """Return the translations to ROS messages by schema, for readers or for another bag."""
    from ..messages.compressed_clouds import OF_CLOUDS  # noqa: PLC0415 - as below
    from ..messages.foxglove import OF_COPIES, TRANSLATIONS  # noqa: PLC0415 - few bags have them

    return {**TRANSLATIONS, **OF_CLOUDS, **(OF_COPIES if for_copy else {})}


class MissingLibraryError(KittiRos2Error):
    """A library that reads an encoding is not installed."""


@dataclass(frozen=True)
class TranslatedChannel(StoredChannel):
    """A channel that has a translation, as it appears: as ROS messages in CDR.

    Attributes:
        original: As stored in the file.
        for_copy: Whether its messages are written to another bag.
    """

    original: StoredChannel = field(kw_only=True)
    for_copy: bool = field(default=False, kw_only=True)

    @property
    def is_ros(self) -> bool:
        """True if its stored messages are of a ROS type, which the bag defines."""
        return self.original.encoding in _ROS


def ros_channel(channel: StoredChannel, *, for_copy: bool = False) -> StoredChannel:
    """Return a channel as it appears to readers, or as it is written to another bag."""
    schema = _schema_of(channel)
    translation = _translations(for_copy=for_copy).get(schema) if schema else None
    if translation is None or channel.encoding not in _ENCODINGS:
        return channel
    if channel.encoding in _ROS and channel.msgtype == translation.msgtype:
        return channel
    return TranslatedChannel(
        channel.topic,
        translation.msgtype,
        'cdr',
        original=channel,
        for_copy=for_copy,
        latched=channel.latched,
        depth=channel.depth,
        profiles=channel.profiles,
    )


def stored_channel(channel: StoredChannel) -> StoredChannel:
    """Return a channel as stored in its file: the inverse of ros_channel."""
    return channel.original if isinstance(channel, TranslatedChannel) else channel


def defining_channel(channel: StoredChannel) -> StoredChannel:
    """Return the channel whose definition describes ROS types."""
    return (
        channel.original if isinstance(channel, TranslatedChannel) and channel.is_ros else channel
    )


def types_of(channel: StoredChannel) -> tuple[str, ...]:
    """Return the ROS types that messages of a channel are decoded by, stored and converted."""
    return tuple(dict.fromkeys((defining_channel(channel).msgtype, channel.msgtype)))


def may_be_lossy(channel: StoredChannel) -> bool:
    """Return whether messages of a channel may have lost something before they were stored."""
    return isinstance(channel, TranslatedChannel) and _schema_of(channel.original).startswith(
        'CompressedPointCloud'
    )


def why_unread(channel: StoredChannel) -> str:
    """Return why a channel that is neither in CDR nor of ROS 1 is not read."""
    encoding = channel.encoding or 'in an encoding that is not named'
    text = f'{channel.topic} is {encoding}, which is not read'
    schema = _schema_of(channel)
    if not schema:
        return text
    hint = ''
    if channel.encoding in _ENCODINGS:
        text = f'{channel.topic} is {channel.msgtype} in {channel.encoding}, which is not read'
    elif schema in _translations():
        hint = 'write it in protobuf or JSON'
    return f'{text}: {hint}' if hint else text


def translator(
    channel: TranslatedChannel, typestore: Callable[[], Typestore], note: Callable[[str], None]
) -> Translate:
    """Return the function that converts a stored message and its log time (ns) to CDR.

    Args:
        channel: The channel.
        typestore: Returns the types of the bag, for messages of ROS.
        note: Takes what a message had lost before it was stored.

    Raises:
        MissingLibraryError: The library that reads protobuf is not installed.
        ValueError: The channel's schema is damaged.
    """
    from ..messages.foxglove import translate  # noqa: PLC0415 - as above

    translation = _translations(for_copy=channel.for_copy)[_schema_of(channel.original)]

    def encode(fields: Fields, log_ns: int) -> bytes:
        cdr = translate(translation, fields, log_ns)
        for loss in translation.earlier_losses(fields):
            note(f'{channel.topic} is {loss}')
        return cdr

    if channel.original.encoding == 'json':
        return _from_json(encode)
    if channel.original.encoding == 'protobuf':
        return _from_protobuf(channel.original, encode)
    return _from_ros(channel.original, encode, typestore)


def _schema_of(channel: StoredChannel) -> str:
    """Return the name of a schema without its package, empty for packages without a translation."""
    for package in _PACKAGES:
        if channel.msgtype.startswith(package):
            return channel.msgtype[len(package) :]
    return ''


def _from_json(encode: EncodeFields) -> Translate:
    def convert(data: Buffer, log_ns: int) -> bytes:
        try:
            message = json.loads(bytes(data))
        except RecursionError as error:
            raise ValueError('its JSON is nested too deeply') from error
        except ValueError as error:  # offsets in the text differ between messages
            raise ValueError('it is no JSON') from error
        return encode(JsonFields(message), log_ns)

    return convert


def _from_protobuf(channel: StoredChannel, encode: EncodeFields) -> Translate:
    try:
        from mcap.records import Schema  # noqa: PLC0415 - as below
        from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415 - optional, and 30 ms
    except ImportError as error:
        raise MissingLibraryError(
            f'{channel.topic} is {channel.msgtype} in protobuf, which needs mcap-protobuf-support;'
            " run pip install 'kitti_ros2[foxglove]'"
        ) from error
    schema = Schema(
        id=1, name=channel.msgtype, encoding=channel.definition_encoding, data=channel.schema
    )
    try:
        decode = DecoderFactory().decoder_for(channel.encoding, schema)
    except Exception as error:  # the library and protobuf raise errors of many classes
        reason = ' '.join(str(error).split())
        raise ValueError(f'its schema is damaged ({reason})') from error
    if decode is None:
        raise ValueError(f'its schema is in {channel.definition_encoding or "no encoding"}')

    def convert(data: Buffer, log_ns: int) -> bytes:
        try:
            message: Any = decode(bytes(data))
        except Exception as error:
            raise ValueError('it is no protobuf message of its schema') from error
        return encode(Fields(message), log_ns)

    return convert


def _from_ros(
    channel: StoredChannel, encode: EncodeFields, typestore: Callable[[], Typestore]
) -> Translate:
    def convert(data: Buffer, log_ns: int) -> bytes:
        store = typestore()
        if channel.encoding == 'ros1':
            data = ros1_to_cdr(store, data, channel.msgtype)
        return encode(Fields(store.deserialize_cdr(data, channel.msgtype)), log_ns)

    return convert


# Conversion of stored messages to CDR: those of ROS 1, compressed and translated ones.

READ = frozenset({'cdr', 'ros1'})
"""Encodings of channels that are read."""


def has_starts(channel: StoredChannel) -> bool:
    """Return whether the first bytes of large messages of a channel can be read alone.

    They are CDR as stored, or of ROS 1 and begin with a Header, which is then the start.
    """
    if isinstance(channel, TranslatedChannel):
        return False
    return channel.encoding == 'cdr' or (
        channel.encoding == 'ros1' and channel.msgtype in LARGE_TYPES
    )


class CdrConverter:
    """Converts messages of channels to CDR.

    Args:
        typestore: Returns the types as the bags define them.
        note: Takes notes on channels that are found with their messages.
        converts_ros1: Whether messages of ROS 1 are converted; else they stay as they are.
    """

    def __init__(
        self,
        typestore: Callable[[], Typestore],
        note: Callable[[str], None],
        *,
        converts_ros1: bool,
    ) -> None:
        self._typestore = typestore
        self._note = note
        self._converts_ros1 = converts_ros1
        self._translators: dict[StoredChannel, Translate] = {}

    def prepare(self, channel: StoredChannel, definitions: Definitions) -> None:
        """Make what the messages of a channel are converted with.

        Raises:
            MissingLibraryError: The library that reads them is not installed.
            ValueError: The definition of the channel is damaged, or its messages become a type that
                a bag defines otherwise.
        """
        if isinstance(channel, TranslatedChannel):
            definitions.check_known(channel.msgtype)
            self._translators[channel] = translator(channel, self._typestore, self._note)
        elif channel.encoding == 'ros1' and self._converts_ros1:
            definitions.check_extent(channel.msgtype)

    def __call__(self, channel: StoredChannel, stored: Buffer, log_ns: int) -> Buffer:
        """Convert a message.

        Args:
            channel: Its channel, prepared.
            stored: The message as stored.
            log_ns: Its log time, nanoseconds.

        Raises:
            Exception: It cannot be converted.
        """
        # The first bytes distinguish a CDR message from one that rosbag2 compressed.
        data = decompress_message(stored) if stored[:4] == ZSTD_MAGIC else stored
        if channel in self._translators:
            return self._translators[channel](data, log_ns)
        if channel.encoding == 'ros1' and self._converts_ros1:
            if isinstance(stored, MessageStart):
                header = stored[: _ROS1_HEADER + int.from_bytes(stored[12:_ROS1_HEADER], 'little')]
                converted = ros1_to_cdr(self._typestore(), header, HEADER)
                return MessageStart.of(converted, stored.size)
            return ros1_to_cdr(self._typestore(), stored, channel.msgtype)
        return stored if channel.encoding == 'ros1' else data
