# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Declaration of an option, once, on the field of the options object that it fills.

The command line, YAML files, ROS parameters and the reference's tables take it from there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any, TypeAlias, TypeVar

from ..model.errors import UsageError
from ..model.spelling import did_you_mean
from ..model.stamps import NS_PER_S
from .parsers import parse_choice
from .quantity_parsers import parse_seconds_ns

Parser: TypeAlias = Callable[[str, object], Any]
T = TypeVar('T')

_METADATA = 'option'


@dataclass(frozen=True)
class Option:
    """One option.

    Attributes:
        field: Name of the field that it fills.
        default: Default of the field.
        meaning: One line of help, without the default.
        parse: Parser of a value; see parsers.py.
        name: Name in YAML and ROS; the command line has dashes for underscores.
        unset: Text for help if the default depends on something else, such as another option.
        bounds: Lowest and highest value of the ROS parameter; see check_bounds for other values.
        flags: Further spellings on the command line; one with two dashes replaces --name.
        live: Whether the ROS parameter may change while the node runs.
        any_type: Whether the ROS parameter takes values of other types, such as 12 for '12'.
        group: Heading of the option in help texts; that of its dataclass unless declared.
        choices: All values, for an option that takes one of a few words.
        metavar: Placeholder of the value in help texts, where the parser's is too general.
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

    def plain(self, value: Any) -> Any:  # noqa: ANN401 - of the type that the option has
        """Return a field's value as users write it: seconds for ns, a word for a choice."""
        if self.parse is parse_seconds_ns and value is not None:
            return value / NS_PER_S
        return value.value if isinstance(value, Enum) else value

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
    words = tuple(each.value for each in kind)
    return option(default, meaning, parse_choice(kind), choices=words, **rest)


def options_of(kind: type) -> tuple[Option, ...]:
    """Return the options that are declared on the fields of a dataclass, in their order.

    The attribute group of the class is the group of its options.
    """
    group = getattr(kind, 'group', '')
    return tuple(
        Option(
            field=each.name,
            default=each.default,
            **{'name': each.name, 'group': group} | each.metadata[_METADATA],
        )
        for each in fields(kind)
        if _METADATA in each.metadata
    )


def check_bounds(options: object, *names: str) -> None:
    """Check the values of options that are declared with bounds.

    Raises:
        UsageError: A value is out of range.
    """
    for each in options_of(type(options)):
        if each.bounds and each.name in names:
            value, (low, high) = each.plain(getattr(options, each.field)), each.bounds
            if not low <= value <= high:
                raise UsageError(
                    f'{each.name} {value:g} is not within {low:g} to {high:g}: {each.meaning}'
                )


def values_for(kind: type, parsed: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by field of a dataclass, from values by name of option."""
    return {each.field: parsed[each.name] for each in options_of(kind) if each.name in parsed}


def make_options(kind: type[T], parsed: Mapping[str, Any], **others: Any) -> T:  # noqa: ANN401 - fields
    """Make an object of options.

    Args:
        kind: Its dataclass.
        parsed: Values by name of option; those of other dataclasses are passed over.
        others: Values of fields that are not in `parsed`.

    Raises:
        UsageError: A value is out of range, or excludes another.
    """
    return kind(**values_for(kind, parsed), **others)


_OTHER_NAMES = {'for': 'stack'}  # --for: the word is a keyword of Python


def check_names(values: Iterable[str], known: Collection[str], where: str = '') -> None:
    """Check the names of options.

    Raises:
        UsageError: A name is unknown.
    """
    for name in sorted(set(values) - set(known)):
        other = _OTHER_NAMES.get(name)
        close = f'; did you mean {other}?' if other in known else did_you_mean(name, known)
        hint = close or f'; known are {", ".join(known)}'
        raise UsageError(f'{where}unknown option {name!r}{hint}')


def parse_values(values: Mapping[str, object], options: tuple[Option, ...]) -> dict[str, Any]:
    """Parse values by name; None is not given.

    Raises:
        UsageError: A name is unknown, or a value is invalid.
    """
    parsers = {each.name: each.parse for each in options}
    check_names(values, parsers)
    return {name: parsers[name](name, value) for name, value in values.items() if value is not None}
