# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Declaration of an option, once, on the field of the options object that it fills; and parsers.

The command line, YAML files, ROS parameters and the reference's tables take it from there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from ..files.remote import as_path
from ..model.classes import LeastOverlaps
from ..model.errors import UsageError, did_you_mean, not_one_of, shown
from ..model.streams import NS_PER_S, ScanColumns, parse_seconds, parse_stamp

if TYPE_CHECKING:
    from fractions import Fraction


# Parsers of one value from a command line, a YAML file or a ROS parameter.
#
# Each function takes the option's name and the value, and raises UsageError if it is invalid.

Parser: TypeAlias = Callable[[str, object], Any]
E = TypeVar('E', bound=Enum)
P = TypeVar('P', bound=Parser)

_WHOLE = re.compile(r'-?\d{1,100}', re.ASCII)
_BEYOND = 10**100


_ACCEPTED: dict[Parser, tuple[Any, str, str]] = {}
_ONE_WORD = str, '', 'str'


def accepts(
    kind: Any = str,  # noqa: ANN401 - a type
    placeholder: str = '',
    keyword: str = '',
) -> Callable[[P], P]:
    """Declare the type that a parser takes, if it is not one word.

    Args:
        kind: On the command line: bool for a flag, list[str] for several words, or the type of
            the word.
        placeholder: Stands for the value in help texts.
        keyword: Type of the keyword in Python, as in keywords.py; that of the word unless given.
    """

    def keep(parse: P) -> P:
        _ACCEPTED[parse] = kind, placeholder, keyword or kind.__name__
        return parse

    return keep


def parse_text(name: str, value: object) -> str:
    """Parse a word; a whole number becomes its text."""
    if isinstance(value, (str, int)) and not isinstance(value, bool):
        return str(value)
    raise UsageError(f'{name} takes a word, not {shown(value)}')


@accepts(list[str], 'NAME...', keyword='OneOrMore')
def parse_texts(name: str, value: object) -> tuple[str, ...]:
    """Parse a list of words, or words separated by commas or spaces."""
    items = value if isinstance(value, (list, tuple)) else [value]
    return tuple(
        word for item in items for word in parse_text(name, item).replace(',', ' ').split()
    )


@accepts(bool)
def parse_flag(name: str, value: object) -> bool:
    """Parse true or false."""
    if isinstance(value, bool):
        return value
    raise UsageError(f'{name} takes true or false, not {shown(value)}')


@accepts(int, 'N')
def parse_integer(name: str, value: object) -> int:
    """Parse a whole number."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) < _BEYOND:
        return value
    if isinstance(value, str) and _WHOLE.fullmatch(value):
        return int(value)
    raise UsageError(f'{name} takes a whole number, not {shown(value)}')


@accepts(float, 'X')
def parse_number(name: str, value: object) -> float:
    """Parse a number."""
    if isinstance(value, float):
        return value
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) < _BEYOND:
        return float(value)
    if isinstance(value, str) and value.removeprefix('-').isdecimal():
        return float(value)
    raise UsageError(f'{name} takes a number, not {shown(value)}')


def parse_rounds(name: str, value: object) -> int:
    """Parse a number of rounds; true is endless, false is once."""
    if isinstance(value, bool):
        return 0 if value else 1
    return parse_integer(name, value)


@accepts(Path, 'PATH', keyword='AnyPath')
def parse_path(name: str, value: object) -> Path:
    """Parse a path or a URL."""
    return value if isinstance(value, Path) else as_path(parse_text(name, value))


@accepts(keyword='OneOrMore')
def parse_columns(name: str, value: object) -> ScanColumns:
    """Parse the columns of scans, as a text or a list of words."""
    return ScanColumns.parse(' '.join(parse_texts(name, value)))


@accepts(list[str], keyword='AnyPath | Sequence[AnyPath]')
def parse_paths(name: str, value: object) -> tuple[Path, ...]:
    """Parse a path or a list of paths, which may contain blanks and commas."""
    items = value if isinstance(value, (list, tuple)) else [value]
    return tuple(parse_path(name, item) for item in items)


def parse_choice(kind: type[E]) -> Callable[[str, object], E]:
    """Return a parser of the values of an enum."""

    def parse(name: str, value: object) -> E:
        words = [member.value for member in kind]
        if value not in words:
            raise not_one_of(name, value, words)
        return kind(value)

    return parse


# Parsers of quantities: sizes, times, lengths in metres, shares.

_SIZE = re.compile(r'(\d{1,100}(?:\.\d{1,100})?)\s*([kMGT]?)(i?)B?', re.ASCII)
_LEAST_SPLIT_BYTES = 1_000_000
# An exponent of many digits would take all memory as a fraction.
_WHOLE_PERCENT = 100
_SHARE = re.compile(r'\d{0,50}\.?\d{0,50}(?:[eE][-+]?\d{1,2})?|\d{1,50}/\d{1,50}', re.ASCII)
_IMAGE_SIZE = re.compile(r'(\d{1,5})[xX,](\d{1,5})', re.ASCII)
_POWERS = {'': 0, 'k': 1, 'M': 2, 'G': 3, 'T': 4}


def parse_bytes(text: str) -> int:
    """Parse a size such as 2GB, 500 MB or 1GiB to bytes.

    Raises:
        ValueError: The text is not a size.
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise ValueError(text)
    return int(float(match[1]) * (1024 if match[3] else 1000) ** _POWERS[match[2]])


@accepts(keyword='int | str')
def parse_size(name: str, value: object) -> int:
    """Parse a size such as 2GB."""
    try:
        return parse_bytes(parse_text(name, value))
    except ValueError:
        raise UsageError(f'{name} takes a size such as 2GB, not {shown(value)}') from None


@accepts(keyword='int | str')
def parse_split_size(name: str, value: object) -> int:
    """Parse the size of one file of a bag, such as 2GB; below 1MB the unit is likely missing."""
    size = parse_size(name, value)
    if size < _LEAST_SPLIT_BYTES:
        raise UsageError(
            f'{name} {value} is less than 1MB; give a size with its unit, such as 500MB or 2GB'
        )
    return size


@accepts(str, 'SECONDS', keyword='float | str')
def parse_seconds_ns(name: str, value: object) -> int:
    """Parse seconds such as 60s to nanoseconds."""
    try:
        return parse_seconds(str(value).removesuffix('s'))
    except ValueError:
        raise UsageError(f'{name} takes seconds such as 60s, not {shown(value)}') from None


def parse_epoch(name: str, value: object) -> int:
    """Parse a UTC time to nanoseconds since 1970."""
    try:
        return parse_stamp(str(value).removesuffix('+00:00'))
    except ValueError:
        raise UsageError(
            f"{name} takes a UTC time such as '2011-09-26 00:00:00', not {shown(value)}"
        ) from None


@accepts(keyword='str | Sequence[float]')
def parse_position(name: str, value: object) -> tuple[float, ...]:
    """Parse numbers in metres, such as x, y and z."""
    items = value if isinstance(value, (list, tuple)) else str(value).replace(',', ' ').split()
    try:
        return tuple(float(item) for item in items)
    except (TypeError, ValueError, OverflowError):
        raise UsageError(
            f'{name} takes three numbers x,y,z in metres, not {shown(value)}'
        ) from None


@accepts(keyword='str | Sequence[float]')
def parse_four_numbers(name: str, value: object) -> tuple[float, ...]:
    """Parse four numbers in metres: from and to forward, from and to to the left."""
    try:
        words = value if isinstance(value, (list, tuple)) else str(value).split(',')
        back, front, right, left = (float(word) for word in words)
    except (ValueError, TypeError, OverflowError):
        raise UsageError(
            f'{name} takes four numbers in metres, from and to forward, from and to to the left,'
            f" such as '-10,60,-25,25', not {shown(value)}"
        ) from None
    return back, front, right, left


@accepts(list[str], keyword='str | Sequence[float] | Sequence[Sequence[float]]')
def parse_boxes(name: str, value: object) -> tuple[tuple[float, ...], ...]:
    """Parse boxes, six numbers in metres each: xmin ymin zmin xmax ymax zmax, and the next box."""
    try:
        numbers = [float(str(word)) for word in _flat(value)]
    except ValueError:
        numbers = []
    if len(numbers) % 6 or (value and not numbers):
        given = ' '.join(map(str, _flat(value)))
        raise UsageError(
            f'{name} takes six numbers in metres for each box, xmin ymin zmin xmax ymax zmax,'
            f' such as 0 -40 -3 70.4 40 1, not {shown(given)}'
        )
    return tuple(tuple(numbers[index : index + 6]) for index in range(0, len(numbers), 6))


def _flat(value: object) -> list[object]:
    """Return the items of nested lists; texts are split at blanks and commas."""
    if isinstance(value, str):
        return [*value.replace(',', ' ').split()]
    if isinstance(value, (list, tuple)):
        return [item for part in value for item in _flat(part)]
    return [value]


@accepts(keyword='str | Sequence[float | None]')
def parse_span(name: str, value: object) -> tuple[float, float]:
    """Parse the lowest and the highest value, MIN:MAX; an end that is left out is infinite."""
    try:
        words = value if isinstance(value, (list, tuple)) else str(value).split(':')
        low, high = (None if word in (None, '') else float(word) for word in words)
    except (ValueError, TypeError, OverflowError):
        low, high = None, None
    if low is None and high is None:
        raise UsageError(
            f'{name} takes MIN:MAX in metres, such as 0.5:80 or :80, not {shown(value)}'
        )
    return -math.inf if low is None else low, math.inf if high is None else high


@accepts(keyword='str | Sequence[int]')
def parse_image_size(name: str, value: object) -> tuple[int, int]:
    """Parse the width and the height of images in pixels, such as 1242x375."""
    text = 'x'.join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
    match = _IMAGE_SIZE.fullmatch(text)
    if match is None or not (int(match[1]) and int(match[2])):
        raise UsageError(
            f'{name} takes WIDTHxHEIGHT in pixels, such as 1242x375, not {shown(value)}'
        )
    return int(match[1]), int(match[2])


@accepts(list[str], keyword='str | Sequence[float | str]')
def parse_shares(name: str, value: object) -> tuple[Fraction, ...]:
    """Parse shares of a whole, such as 0.8 0.2, 1/3 2/3, or percent that add up to 100."""
    from fractions import Fraction  # noqa: PLC0415 - for one command

    if value == ():
        return ()
    items = value if isinstance(value, (list, tuple)) else [value]
    words = [word for item in items for word in str(item).replace(',', ' ').split()]
    try:
        shares = tuple(Fraction(word) for word in words if _SHARE.fullmatch(word))
    except (ValueError, ZeroDivisionError):
        shares = ()
    if sum(shares) == _WHOLE_PERCENT:
        shares = tuple(share / _WHOLE_PERCENT for share in shares)
    if not shares or len(shares) < len(words) or not all(0 < share <= 1 for share in shares):
        given = ' '.join(words)
        raise UsageError(f'{name} takes shares above 0, such as 0.8 0.2, not {shown(given)}')
    return shares


# Parsers of lists of classes, each with a class, a label or an overlap.


@accepts(list[str], keyword='OneOrMore | Mapping[str, str]')
def parse_class_map(name: str, value: object) -> tuple[tuple[str, str], ...]:
    """Parse classes of results with KITTI's, such as car=Car 3=Pedestrian, or a mapping.

    The last = divides a pair; with nothing after it the class is left out.
    """
    return _parse_pairs(name, value, 'NAME=CLASS, such as car=Car 3=Pedestrian')


@accepts(list[str], keyword='OneOrMore | Mapping[str, str]')
def parse_labels(name: str, value: object) -> tuple[tuple[str, str], ...]:
    """Parse KITTI's classes with labels of Autoware, such as Van=TRUCK Tram=BUS, or a mapping."""
    return _parse_pairs(name, value, 'CLASS=LABEL, such as Van=TRUCK Tram=BUS')


def _parse_pairs(name: str, value: object, form: str) -> tuple[tuple[str, str], ...]:
    """Parse pairs divided by the last =; nothing may have two partners."""
    if isinstance(value, Mapping):
        pairs = [(str(key), target) for key, target in value.items()]
    else:
        items = value if isinstance(value, (list, tuple)) else [value]
        pairs = [
            item if isinstance(item, tuple) else str(item).rpartition('=')[::2] for item in items
        ]
    for key, target in pairs:
        if not key or not isinstance(target, str) or any(map(str.isspace, target)):
            given = f'{key}={target}' if key else target
            raise UsageError(f'{name} takes {form}, not {given}')
        if dict(pairs)[key] != target:
            raise UsageError(f'{name}: {key} is given twice, as {target} and {dict(pairs)[key]}')
    return tuple(pairs)


@accepts(list[str], keyword='OneOrMore | Mapping[str, float | None]')
def parse_class_overlaps(name: str, value: object) -> tuple[tuple[str, float | None], ...]:
    """Parse class names, each alone or with an overlap, such as car truck=0.5, or a mapping."""
    if isinstance(value, dict):
        value = [
            word if overlap is None else f'{word}={overlap}' for word, overlap in value.items()
        ]
    pairs = [word.partition('=') for word in parse_texts(name, value)]
    try:
        return tuple(
            (word.lower(), float(overlap) if equals else None) for word, equals, overlap in pairs
        )
    except ValueError:
        given = ' '.join(map(''.join, pairs))
        raise UsageError(
            f'{name} takes names such as car or truck=0.5, not {shown(given)}'
        ) from None


@accepts(list[str], keyword='float | str | Sequence[str]')
def parse_least_overlaps(name: str, value: object) -> LeastOverlaps:
    """Parse an IoU of all classes, such as 0.5, and those of some, such as Car=0.7."""
    items = value if isinstance(value, (list, tuple)) else [value]
    words = [word for item in items for word in str(item).replace(',', ' ').split()]
    overlaps: dict[str, float] = {}
    for word in words:
        class_name, _, number = word.rpartition('=')
        try:
            overlaps[class_name.lower()] = float(number)
        except ValueError:
            overlaps[class_name.lower()] = math.nan
    valid = all(0 <= overlap < 1 for overlap in overlaps.values())
    if not (words and valid and len(overlaps) == len(words)):
        raise UsageError(
            f'{name} takes an IoU of at least 0 and below 1, such as 0.5, or of a class, such as'
            f' Car=0.5, not {shown(" ".join(words))}'
        )
    others = overlaps.pop('', None)
    return LeastOverlaps(tuple(sorted(overlaps.items())), others)


# Declaration of an option: a field of the options object that it fills.

T = TypeVar('T')

_METADATA = 'option'


@dataclass(frozen=True)
class Option:
    """One option.

    Attributes:
        field: Name of the field that it fills.
        default: Default of the field.
        meaning: One line of help, without the default.
        parse: Parser of a value.
        name: Name in YAML and ROS; the command line has dashes for underscores.
        unset: Text for help instead of the default, which is then None or ().
        bounds: Lowest and highest value of the ROS parameter; see check_bounds for other values.
        flags: Further spellings on the command line; one with two dashes replaces --name.
        live: Whether the ROS parameter may change while the node runs.
        any_type: Whether the ROS parameter takes values of other types, such as 12 for '12'.
        group: Heading of the option in help texts; that of its dataclass unless declared.
        choices: All values, for an option that takes one of a few words.
        metavar: Placeholder of the value in help texts, where the parser's is too general.
        keyword: Its name in Python, where that is another.
        common: Whether --help of a command with many options shows it; --help-all shows all.
        config_only: Whether its place is the file of --config: too exotic for a command line.
    """

    field: str
    default: Any
    meaning: str
    parse: Parser
    name: str
    unset: str = ''
    bounds: tuple[float, float] | None = None
    flags: tuple[str, ...] = ()
    live: bool = False
    any_type: bool = False
    group: str = ''
    choices: tuple[str, ...] = ()
    metavar: str = ''
    keyword: str = ''
    common: bool = False
    config_only: bool = False

    def plain(self, value: Any) -> Any:  # noqa: ANN401 - of the type that the option has
        """Return a field's value as users write it: seconds for ns, a word for a choice."""
        if self.parse is parse_seconds_ns and value is not None:
            return value / NS_PER_S
        return value.value if isinstance(value, Enum) else value

    @property
    def flag(self) -> str:
        """Its spelling on the command line."""
        own = next((flag for flag in self.flags if flag.startswith('--')), '')
        return own or f'--{self.name.replace("_", "-")}'

    @property
    def kind(self) -> Any:  # noqa: ANN401 - a type
        """Type of the value on the command line."""
        return _ACCEPTED.get(self.parse, _ONE_WORD)[0]

    @property
    def placeholder(self) -> str:
        """Placeholder of the value in help texts; empty for a flag, and for a plain word."""
        if self.choices and not self.metavar:
            return f'[{"|".join(self.choices)}]'
        return self.metavar or _ACCEPTED.get(self.parse, _ONE_WORD)[1]

    @property
    def keyword_type(self) -> str:
        """Type of the keyword of the library."""
        written = _ACCEPTED.get(self.parse, _ONE_WORD)[2]
        return f'{written} | None' if self.default is None else written

    @property
    def default_text(self) -> str:
        """Readable text of the default."""
        value = self.plain(self.default)
        if self.unset:
            return self.unset
        if isinstance(value, bool):
            return 'on' if value else 'off'
        return f'{value:g}' if isinstance(value, float) else str(value)


def option(default: T, meaning: str, parse: Parser, **rest: Any) -> T:  # noqa: ANN401 - attributes
    """Return a dataclass field that is an option; the rest are attributes of Option."""
    return field(
        default=default, metadata={_METADATA: {'meaning': meaning, 'parse': parse, **rest}}
    )


def choice(default: T, meaning: str, kind: type[Enum], **rest: Any) -> T:  # noqa: ANN401 - as above
    """Return a dataclass field that is an option with the values of an enum."""
    words = tuple(member.value for member in kind)
    return option(default, meaning, parse_choice(kind), choices=words, **rest)


def options_of(kind: type) -> tuple[Option, ...]:
    """Return the options that are declared on the fields of a dataclass, in their order.

    The attribute group of the class is the group of its options.
    """
    group = getattr(kind, 'group', '')
    return tuple(
        Option(
            field=attribute.name,
            default=attribute.default,
            **{'name': attribute.name, 'group': group} | attribute.metadata[_METADATA],
        )
        for attribute in fields(kind)
        if _METADATA in attribute.metadata
    )


def check_bounds(options: object, *names: str) -> None:
    """Check the values of options that are declared with bounds.

    Raises:
        UsageError: A value is out of range.
    """
    for opt in options_of(type(options)):
        if opt.bounds and opt.name in names:
            value, (low, high) = opt.plain(getattr(options, opt.field)), opt.bounds
            if not low <= value <= high:
                raise UsageError(
                    f'{opt.name} {value:g} is not within {low:g} to {high:g}: {opt.meaning}'
                )


def values_for(kind: type, parsed: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by field of a dataclass, from values by name of option."""
    return {opt.field: parsed[opt.name] for opt in options_of(kind) if opt.name in parsed}


def make_options(kind: type[T], parsed: Mapping[str, Any], **others: Any) -> T:  # noqa: ANN401 - fields
    """Make an object of options.

    Args:
        kind: Its dataclass.
        parsed: Values by name of option; those of other dataclasses are ignored.
        others: Values of fields that are not in `parsed`.

    Raises:
        UsageError: A value is out of range, or excludes another.
    """
    return kind(**values_for(kind, parsed), **others)


_OTHER_NAMES = {'for': 'stack'}  # --for: the word is a keyword of Python


def check_names(values: Iterable[str], names: Collection[str], prefix: str = '') -> None:
    """Check the names of options.

    Raises:
        UsageError: A name is unknown.
    """
    for name in sorted(set(values) - set(names)):
        other = _OTHER_NAMES.get(name)
        close = f'; did you mean {other}?' if other in names else did_you_mean(name, names)
        hint = close or f'; known are {", ".join(names)}'
        raise UsageError(f'{prefix}unknown option {name!r}{hint}')


def parse_values(values: Mapping[str, object], options: tuple[Option, ...]) -> dict[str, Any]:
    """Parse values by name; None is not given.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsers = {opt.name: opt.parse for opt in options}
    check_names(values, parsers)
    return {name: parsers[name](name, value) for name, value in values.items() if value is not None}


# The option of all commands with large outputs about the disk.


def fsync_option(**rest: Any) -> bool:  # noqa: ANN401 - attributes of Option
    """Return the field of an options object: whether a finished output outlasts a power cut."""
    return option(
        True, 'Wait until the output is on the disk, safe from a power cut', parse_flag, **rest
    )
