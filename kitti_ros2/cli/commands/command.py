# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A sub-command: help with options in groups and examples, several values after one option."""

from __future__ import annotations

import re
from itertools import islice
from typing import TYPE_CHECKING, Any

from typer.core import TyperCommand

from ...model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_NUMBER = re.compile(r'-\.?\d')
_SPECIAL = re.compile(r'[^\w ,.:()/*-]')
_EXAMPLES = '\n\nExamples:\n'
_LISTS = (
    '{lists} takes all words up to the next option or --. Give {arguments} before it, after --, or'
    ' as its last words.'
)
OPEN_LIST = 'kitti_ros2.open_list'
"""Key of a context's meta: the option whose list of values the last word belongs to."""


def complete_open_list(ctx: Any, incomplete: str) -> list[str]:  # noqa: ANN401 - typer's context
    """Complete a word that stands where an argument may, but belongs to a list of values."""
    option = ctx.meta.get(OPEN_LIST)
    if option is None:
        return []
    return [each.value for each in option.shell_complete(ctx, incomplete)]


class Command(TyperCommand):
    """A command whose help is its docstring: a summary, an explanation, and Examples:."""

    def __init__(self, *args: Any, **rest: Any) -> None:  # noqa: ANN401 - those of the base class
        super().__init__(*args, **rest)
        text, _, examples = (self.help or '').partition(_EXAMPLES)
        self.help: str = text
        self.examples = examples

    def get_short_help_str(self, limit: int = 45) -> str:  # noqa: ARG002 - click's form
        """Return the first line, whole."""
        return self.help.partition('\n')[0]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401, ARG002 - click's form
        """Return the words of the usage line: arguments as help texts write them."""
        names = [each.metavar if each.required else f'[{each.metavar}]' for each in self._arguments]
        return ['[OPTIONS]', *names]

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write the help as plain text, in old versions of typer too."""
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        self.format_options(ctx, formatter)
        self.format_epilog(ctx, formatter)

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write arguments and options, by group; those without a group last."""
        rows = [(each.metavar, each.help or '') for each in self._arguments]
        if rows:
            with formatter.section('Arguments'):
                formatter.write_dl(rows)
        groups: dict[str, list[tuple[str, str]]] = {}
        for each in self.get_params(ctx):
            record = each.get_help_record(ctx)
            if each.param_type_name == 'option' and record is not None:
                groups.setdefault(getattr(each, 'rich_help_panel', None) or '', []).append(record)
        others = groups.pop('', [])
        for title, records in (*groups.items(), ('Options', others)):
            with formatter.section(title):
                formatter.write_dl(records)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write the rule of options with several values, and the examples as they are."""
        lists = [each.metavar for each in self._lists(ctx).values()]
        if lists:
            formatter.write_paragraph()
            names = ' and '.join(each.metavar for each in self._arguments)
            formatter.write_text(_LISTS.format(lists=lists[0], arguments=names))
        if self.examples:
            formatter.write_paragraph()
            formatter.write(f'Examples:\n{self.examples}\n')

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - as above
        """Parse, after repeating options with several values before each of them."""
        valued = {
            flag
            for each in self.get_params(ctx)
            if not getattr(each, 'is_flag', True)
            for flag in each.opts
        }
        words = _GivenWords(args, self._lists(ctx), valued)
        if ctx.resilient_parsing:  # for a completion
            ctx.meta[OPEN_LIST] = words.open_list
            args = words.spread()
            if args and args[-1] in valued:
                args.pop()  # an option without its value would hide the arguments
        else:
            words.place_arguments([each.metavar for each in self._arguments])
            args = words.spread()
        parsed: list[str] = super().parse_args(ctx, args)
        return parsed

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:  # noqa: ANN401 - as above
        """Complete a value of a list, or an option; its help without what shells interpret."""
        option = ctx.meta.get(OPEN_LIST)
        if option is not None and not incomplete.startswith('-'):
            found: list[Any] = option.shell_complete(ctx, incomplete)
            return found
        found = super().shell_complete(ctx, incomplete)
        for each in found:
            each.help = _SPECIAL.sub('', (each.help or '').partition(' [default')[0])
        return found

    @property
    def _arguments(self) -> list[Any]:
        return [each for each in self.params if each.param_type_name == 'argument']

    def _lists(self, ctx: Any) -> dict[str, Any]:  # noqa: ANN401 - as above
        """Return the options with several values, by spelling."""
        params = [each for each in self.get_params(ctx) if getattr(each, 'multiple', False)]
        return {flag: each for each in params for flag in each.opts}


class _GivenWords:
    """The words after a command, in parts: a list option with its values, any other word or option.

    Args:
        words: The words.
        lists: Spellings of the options with several values.
        valued: Spellings of all options with a value.
    """

    def __init__(self, words: Sequence[str], lists: Mapping[str, Any], valued: set[str]) -> None:
        self._lists = lists
        self._parts: list[list[str]] = []
        self._arguments = 0
        rest = iter(words)
        for word in rest:
            if word == '--':
                self._parts.append([word, *rest])
                self._arguments += len(self._parts[-1]) - 1
            elif word.startswith('-') and word != '-' and not self._is_number(word):
                self._parts.append([word])
                if word in valued and word not in lists:
                    self._parts[-1] += islice(rest, 1)
            elif self.open_list is not None:
                self._parts[-1].append(word)
            else:
                self._parts.append([word])
                self._arguments += 1

    def _is_number(self, word: str) -> bool:
        """Whether a word is a negative number in a list."""
        return self.open_list is not None and _NUMBER.match(word) is not None

    @property
    def open_list(self) -> Any:  # noqa: ANN401 - an option of typer's copy of click
        """The list option whose values the words end with."""
        return self._lists.get(self._parts[-1][0]) if self._parts else None

    def place_arguments(self, names: Sequence[str]) -> None:
        """Take missing arguments from the end of a list, if it is clear that they are there.

        Raises:
            UsageError: It is not: some arguments are given, or several lists may hold them. Or a
                list has no values.
        """
        for part in self._parts:
            if part[0] in self._lists and len(part) == 1:
                raise UsageError(f"Option '{part[0]}' requires an argument")
        missing = len(names) - self._arguments
        long = [part for part in self._parts if part[0] in self._lists and len(part) > 2]
        if missing <= 0 or not long:
            return
        part, *others = long
        if self._arguments or others or len(part) < missing + 2:
            raise UsageError(
                f'{part[0]} takes {" ".join(part[1:])}; give {" ".join(names)} before it,'
                f' or after --'
            )
        place = self._parts.index(part) + 1
        self._parts[place:place] = [[word] for word in part[-missing:]]
        del part[-missing:]

    def spread(self) -> list[str]:
        """Return all words, with each list option repeated before each of its values."""
        found = []
        for first, *values in self._parts:
            if first in self._lists and values:
                found += [word for value in values for word in (first, value)]
            else:
                found += [first, *values]
        return found
