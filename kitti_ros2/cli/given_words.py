# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The words after a command, before they are parsed: lists of values, OUT, former names."""

from __future__ import annotations

import re
from itertools import islice
from typing import TYPE_CHECKING, Any

from ..model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence


_NUMBER = re.compile(r'-\.?\d')
OUT_FLAGS = ('--out', '-o')

# Former names of options, accepted for one release, with a note.

_FORMER = {
    'report': {'--results': '--predictions'},
    'detection': {'--frames': '--frame-list'},
    'demo': {'--frames': '--count'},
    'stacks': {'--config': '--drive'},
    'stats': {'--points': '--count-points'},
    'view': {'--range': '--extent'},
}
"""Names of today by the former one, by the last word of the command."""
_FORMER_ANYWHERE = {'--raw': '--raw-drives'}


def rename(
    words: Sequence[str], command: str, flags: Collection[str], valued: Collection[str]
) -> tuple[list[str], list[str]]:
    """Return the words with the names of today, and a note for each that was another.

    Args:
        words: The words after the command.
        command: Its last word.
        flags: Spellings of its options.
        valued: Those with one value, which is kept as it is.
    """
    former = {**_FORMER_ANYWHERE, **_FORMER.get(command, {})}
    renamed: list[str] = []
    notes = []
    rest = iter(words)
    for word in rest:
        name, equals, value = word.partition('=')
        today = former.get(name, name)
        if today != name and today in flags:
            notes.append(f'{name} is {today} now; the next release does not take {name}')
            name = today
        renamed.append(name + equals + value)
        if word == '--':
            renamed += rest
        elif name in valued and not equals:
            renamed += islice(rest, 1)
    return renamed, notes


def out_last(words: Sequence[str]) -> list[str]:
    """Return the words with the value of -o as their last argument, for a command without -o."""
    rest = iter(words)
    kept: list[str] = []
    outs: list[str] = []
    for word in rest:
        name, equals, value = word.partition('=')
        if word == '--':
            kept += [word, *rest]
        elif word.startswith('-o') and word != '-o' and not equals:
            outs.append(word[2:])
        elif name not in OUT_FLAGS:
            kept.append(word)
        else:
            outs += [value] if equals else [*islice(rest, 1)]
    return [*kept, *(['--'] if outs and '--' not in kept else []), *outs]


# Lists of values after one option.


class GivenWords:
    """The words after a command, in parts: list options with their values, other words.

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

    def take_arguments(self, names: Sequence[str]) -> None:
        """Take missing arguments from the end of a list, if it is clear that they are there.

        Raises:
            UsageError: It is not clear, because some arguments are given or several lists may
                hold them; or a list has no values.
        """
        if [''] in self._parts:
            raise UsageError("an argument is empty, ''; is a variable of the shell not set?")
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
        index = self._parts.index(part) + 1
        self._parts[index:index] = [[word] for word in part[-missing:]]
        del part[-missing:]

    def option_of_out(self, flag: str, count: int) -> None:
        """Give the argument after the first few to the option of OUT, unless that is given.

        Args:
            flag: The option.
            count: Number of arguments that the command has.
        """
        given = any(part[0].partition('=')[0] in OUT_FLAGS for part in self._parts)
        if given or self._arguments != count + 1:
            return
        last = next(part for part in reversed(self._parts) if self._is_argument(part))
        self._parts.insert(0, [flag, last.pop()])
        self._parts = [part for part in self._parts if part]

    @staticmethod
    def _is_argument(part: Sequence[str]) -> bool:
        """Whether a part is an argument, or the arguments after --."""
        return len(part) > 1 if part[0] == '--' else part[0] == '-' or not part[0].startswith('-')

    def spread(self) -> list[str]:
        """Return all words, with each list option repeated before each of its values."""
        words = []
        for first, *values in self._parts:
            if first in self._lists and values:
                words += [word for value in values for word in (first, value)]
            else:
                words += [first, *values]
        return words
