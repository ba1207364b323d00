# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages to people: exceptions, losses, suggestions for misspelt names, and safe text."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass
from reprlib import Repr
from typing import TYPE_CHECKING

from .bag_formats import ANY_BAG

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt
    from typing_extensions import Self


# Text for people: safe single lines, and quantities with their units.

_LONGEST, _END = 2000, 400  # of a line, and of its end where the middle is left out
_SHORT = Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 200

# Longer words are shown by their beginning and end.
_LONG_WORD = re.compile(r'(\S{120})\S{200,}(\S{60})')


def one_line(text: str) -> str:
    r"""Remove line breaks and control characters from a text.

    Names of topics, frames and types in a bag are arbitrary. What is not printable (control
    characters, marks that change the direction of writing, bytes of file names that are not UTF-8)
    is written as in a Python string, such as \x1b; of very long words and lines the middle is left
    out.
    """
    line = ' '.join(text.split())
    if not line.isprintable():
        line = ''.join(char if char.isprintable() else _escaped(char) for char in line)
    line = _LONG_WORD.sub(r'\1...\2', line)
    return line if len(line) <= _LONGEST else f'{line[: _LONGEST - _END - 3]}...{line[-_END:]}'


def shown(value: object) -> str:
    """Return a value as Python writes it, shortened: those of a YAML file are of any size."""
    return _SHORT.repr(value)


def _escaped(character: str) -> str:
    return character.encode('unicode_escape').decode('ascii')


def format_bytes(count: float) -> str:
    """Format a size such as 434.9 MB."""
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000:
            return f'{count:.0f} {unit}' if unit == 'B' else f'{count:.1f} {unit}'
        count /= 1000
    return f'{count:.1f} TB'


def format_duration(nanoseconds: int) -> str:
    """Format a duration such as 12.4 s or 7 min 30 s."""
    seconds = nanoseconds / 1e9
    if seconds < 120:
        return f'{seconds:.1f} s'
    minutes, rest = divmod(round(seconds), 60)
    return f'{minutes} min {rest} s'


def format_count(count: int, noun: str) -> str:
    """Format a count with its noun, such as 1 message or 2,104 messages."""
    return f'{count:,} {noun}{"" if count == 1 else "s"}'


def either(names: Sequence[str]) -> str:
    """Format a choice, such as a, b or c."""
    return ' or '.join(', '.join(names).rsplit(', ', 1))


def some_of(names: Sequence[str], most: int = 3) -> str:
    """Format the first few of many names, such as a, b, c and 5 more."""
    return ', '.join(names[:most]) + (f' and {len(names) - most} more' if len(names) > most else '')


# The exceptions: each message contains what, where, what was expected, and what to do.

_UNHELD_LOCK = ('release unlocked lock', 'cannot release un-acquired lock')


@dataclass(frozen=True)
class Remedy:
    """A command that does what was meant; the command line prints it after the error.

    Attributes:
        given: The source as it was given.
        source: The source to give instead.
        options: Options to add.
        frame: The frame that was meant, for commands that take one.
        command: The command to call; empty for the one that was called.
        before: A shell command to run first.
        loop: The words of a shell loop over all recordings of a source: their folders, or with
            by_name the values of --sequence.
        by_name: See loop.
    """

    given: Path
    source: Path
    options: tuple[str, ...] = ()
    frame: int | None = None
    command: str = ''
    before: str = ''
    loop: str = ''
    by_name: bool = False


class KittiRos2Error(Exception):
    """Base of every error that a user can cause or fix; one line, shown without a traceback.

    Attributes:
        path: The file or folder that it is about, if any.
        line: The line of the file, from 1, if any.
        remedies: Commands that do what was meant, if known; the message is complete without them.
    """

    path: str | None = None
    line: int | None = None
    remedies: tuple[Remedy, ...] = ()

    def with_remedies(self, *remedies: Remedy) -> Self:
        """Return the error with commands that do what was meant."""
        self.remedies = remedies
        return self

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the message, not the arguments of __init__: worker processes raise errors."""
        return _unpickle, (type(self), self.args), self.__dict__


def _unpickle(kind: type[KittiRos2Error], args: tuple[object, ...]) -> KittiRos2Error:
    error = kind.__new__(kind)
    error.args = args
    return error


class UsageError(KittiRos2Error):
    """Invalid option or argument."""


class UnsynchronisedError(UsageError):
    """The streams of a recording have no time in common: there is no frame."""


class MissingPathError(UsageError, FileNotFoundError):
    """A path of the user does not exist."""

    def __init__(self, path: Path | str) -> None:
        self.path = str(path)
        super().__init__(f'{path}: no such file or folder')


class UnreadableFileError(KittiRos2Error, OSError):
    """The operating system cannot read or write a file."""

    def __init__(self, path: Path | str, error: OSError) -> None:
        self.path = str(path)
        super().__init__(f'{path}: {error.strerror or error}')


class RemoteError(KittiRos2Error):
    """A store cannot be reached, or answers wrongly, after several tries."""

    def __init__(self, path: Path | str, reason: str, remedy: str = '') -> None:
        self.path = str(path)
        super().__init__(f'{path}: {reason}' + (f'; {remedy}' if remedy else ''))


class NotKittiError(UsageError):
    """No recording of a known layout at a path.

    Attributes:
        explained: Whether it is known what the path is instead.
    """

    def __init__(self, path: Path, problem: str, layouts: Iterable[str], remedy: str = '') -> None:
        self.path = str(path)
        self.explained = bool(remedy)
        super().__init__(
            f'{path}: {problem}; '
            + (remedy or f'expected a KITTI folder of layout {either(list(layouts))}')
        )


class MissingSourceError(NotKittiError, FileNotFoundError):
    """The path of a source does not exist."""


class AmbiguousLayoutError(KittiRos2Error):
    """A folder fits more than one layout."""

    def __init__(self, path: Path, layouts: Sequence[str]) -> None:
        self.path = str(path)
        super().__init__(
            f'{path}: fits the layouts {" and ".join(layouts)};'
            f' choose one with --layout {layouts[0]}'
        )


class AmbiguousSequenceError(KittiRos2Error):
    """A folder contains several sequences or drives, and one must be chosen."""

    def __init__(self, path: Path, kind: str, names: Sequence[str]) -> None:
        self.path = str(path)
        super().__init__(
            f'{path}: holds {len(names)} {kind}s ({some_of(names)});'
            f' choose one with --sequence, or take all in turn'
        )


class BadFileError(KittiRos2Error):
    """Invalid content of a file.

    Attributes:
        remedy: The end of the message; empty if unknown.
    """

    def __init__(
        self,
        path: Path | str,
        problem: str,
        expected: str,
        *,
        line: int | None = None,
        remedy: str = '',
    ) -> None:
        self.path = str(path)
        self.line = line
        self.remedy = remedy
        where = f'{path}:{line}' if line is not None else f'{path}'
        super().__init__(
            f'{where}: {problem}; expected {expected}' + (f' ({remedy})' if remedy else '')
        )


class MissingFileError(KittiRos2Error):
    """A required file is missing."""

    def __init__(self, path: Path | str, needed_for: str) -> None:
        self.path = str(path)
        super().__init__(f'{path}: no such file; it is needed for {needed_for}')


class OutputExistsError(KittiRos2Error):
    """The output path exists."""

    def __init__(
        self, path: Path, remedy: str = 'choose another name, or pass --overwrite'
    ) -> None:
        self.path = str(path)
        super().__init__(f'{path}: exists already; {remedy}')


class OutputError(KittiRos2Error):
    """The output cannot be written: permissions, a full disk, a busy writer."""

    def __init__(self, path: Path, reason: str, remedy: str) -> None:
        self.path = str(path)
        self._parts = path, reason, remedy
        self._left = ''
        super().__init__(f'{path}: {reason}; nothing was left behind ({remedy})')

    def leave(self, remains: str) -> None:
        """Change the words about what was left behind."""
        path, reason, remedy = self._parts
        self._left = remains
        self.args = (f'{path}: {reason}; {remains} ({remedy})',)

    def note_remains(self, remains: Path) -> None:
        """Correct the text: a path could not be removed."""
        before = f'{self._left}; ' if self._left else ''
        self.leave(
            f'{before}{remains} was left behind, and the next run that writes there removes it'
        )


class NotDurableError(KittiRos2Error):
    """The output is complete, but the disk cannot confirm that it will outlast a power cut."""

    def __init__(self, path: Path, error: OSError) -> None:
        self.path = str(path)
        super().__init__(
            f'{path}: is complete, but the disk does not confirm its name'
            f' ({error.strerror or error}), so that a power cut may lose it; check the disk'
        )


class KeptInterruptError(KittiRos2Error):
    """Ctrl-C has ended the writing of an output, a part of which is kept."""

    def __init__(self, partial_output: str) -> None:
        super().__init__(f'interrupted; {partial_output}')


class BadBagError(KittiRos2Error):
    """A path is no readable bag, or a bag does not contain the requested data.

    Args:
        path: The path that was read.
        problem: Predicate about the path.
        expected: Supported content; empty if the problem names it.
    """

    def __init__(
        self,
        path: Path,
        problem: str,
        expected: str = ANY_BAG,
    ) -> None:
        self.path = str(path)
        expectation = f'; expected {expected}' if expected else ''
        super().__init__(f'{path}: {problem}{expectation}')


class MissingDataError(KittiRos2Error):
    """Required data is missing."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)


class ClusterError(KittiRos2Error):
    """A cluster cannot be reached, has ended, or its workers cannot run the units."""


class NotABagError(BadBagError):
    """A path that holds nothing of a bag."""


def add_note(error: BaseException, note: str) -> None:
    """Add a sentence to an exception, as BaseException.add_note of Python 3.11 does."""
    error.__dict__.setdefault('__notes__', []).append(note)


def notes_of(error: BaseException) -> tuple[str, ...]:
    """Return the sentences that were added to an exception."""
    return tuple(error.__dict__.get('__notes__', ()))


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let errors of the operating system name a file; those of reading name none."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


def interruption_of(error: Exception) -> BaseException | None:
    """Return the interruption that led to the error of a lock; None for all other errors.

    A signal that arrives while threading.Condition.wait has released its lock, and does not expect
    exceptions yet, leaves the lock released; leaving its context is an error then.
    """
    cause = error.__context__
    is_interruption = isinstance(cause, (KeyboardInterrupt, SystemExit))
    return cause if is_interruption and str(error) in _UNHELD_LOCK else None


def describe_error(error: Exception) -> str:
    """Describe an error; the text begins with the file if it is known."""
    if isinstance(error, OSError) and error.strerror is not None:
        return error.strerror if error.filename is None else f'{error.filename}: {error.strerror}'
    return str(error)


# Suggestions for misspelt names, and the error for a value that is none of several.

_LEAST_RATIO = 0.75
_LEAST_RATIO_SHORT_WORD = 0.66  # one letter of three
_SHORT_WORD = 5
_MARGIN = 0.03
_MOST = 3
_MOST_LISTED = 10
"""Choices beside which a suggestion is still found."""


def close_names(word: str, choices: Iterable[str]) -> list[str]:
    """Return the names that a word is likely to stand for, best first; three at most.

    Close is a name of other case, one that contains the word, and the most similar ones; none if
    more than three are equally similar.
    """
    lower = word.lower()
    names = list(dict.fromkeys(choices))
    same = [name for name in names if name.lower() == lower]
    if same or not lower:
        return same[:_MOST]
    ratios = {name: similarity(word, name) for name in names}
    least = _LEAST_RATIO_SHORT_WORD if len(lower) <= _SHORT_WORD else _LEAST_RATIO
    best = max(ratios.values(), default=0.0)
    if best < least:
        containing = [name for name in names if len(lower) > 2 and lower in name.lower()]
        return containing if len(containing) <= _MOST else []
    close = [name for name in names if ratios[name] >= max(least, best - _MARGIN)]
    return sorted(close, key=lambda name: -ratios[name]) if len(close) <= _MOST else []


def similarity(word: str, name: str) -> float:
    """Return how similar two names are without regard to case, 0 to 1."""
    from difflib import SequenceMatcher  # noqa: PLC0415 - for errors only

    return SequenceMatcher(None, name.lower(), word.lower(), autojunk=False).ratio()


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """Return the question for the end of an error, such as ``; did you mean raw?``, or ''."""
    close = close_names(word, choices)
    return f'; did you mean {either(close)}?' if close else ''


def not_one_of(name: str, value: object, choices: Sequence[str]) -> UsageError:
    """Return the error for a value of an option that is none of its choices."""
    hint = did_you_mean(str(value), choices)
    if hint and len(choices) > _MOST_LISTED:
        return UsageError(f'{name} does not take {value!r}{hint}')
    return UsageError(f'{name} takes {either(choices)}, not {value!r}{hint}')


# Losses: unusable data of the user, and the text form of file numbers.


@dataclass(frozen=True)
class Loss:
    """Unusable data of the user: stream, count and reason.

    Attributes:
        stream: Name of the stream or topic.
        count: Samples or messages.
        message: One line; {} stands for the numbers.
        numbers: File numbers, where they are known.
    """

    stream: str
    count: int
    message: str
    numbers: tuple[int, ...] = ()

    def within(self, lowest: int, highest: int) -> Loss | None:
        """Return the part between two file numbers, both included; all if none are known."""
        return self.among(range(lowest, highest + 1))

    def among(self, numbers: Container[int]) -> Loss | None:
        """Return the part that concerns some file numbers; all if none are known."""
        inside = tuple(number for number in self.numbers if number in numbers)
        if inside == self.numbers:
            return self
        return Loss(self.stream, len(inside), self.message, inside) if inside else None

    def text(self) -> str:
        """Return the message with its numbers."""
        return self.message.replace('{}', format_numbers(self.numbers))


class LossTally:
    """Counts unusable messages by topic and reason."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()
        self._first_ns: dict[tuple[str, str], int] = {}

    def lose(self, topic: str, stamp_ns: int, reason: str) -> None:
        """Count a message."""
        self._counts[topic, reason] += 1
        self._first_ns.setdefault((topic, reason), stamp_ns)

    def losses(self) -> tuple[Loss, ...]:
        """Return the losses, each with the stamp of its first message."""
        return tuple(
            Loss(topic, count, f'{topic} at {self._first_ns[topic, reason]}: {reason}')
            for (topic, reason), count in self._counts.items()
        )


def damage(losses: Mapping[str, int | None], name: str) -> tuple[Loss, ...]:
    """Return the damage of a bag as losses; an unknown number of messages counts as one."""
    return tuple(Loss(name, count or 1, text) for text, count in losses.items())


def merged(*loss_counts: Mapping[str, int | None]) -> dict[str, int | None]:
    """Add up the damage of passes over different topics of a bag; None: unknown count."""
    total: dict[str, int | None] = {}
    for losses in loss_counts:
        for text, count in losses.items():
            count_before = total.get(text, 0)
            total[text] = None if count is None or count_before is None else count_before + count
    return total


def runs_of(numbers: Iterable[int]) -> list[list[int]]:
    """Return [first, last] of each run without a gap of ascending numbers."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return spans


def describe_frames(numbers: Sequence[int] | npt.NDArray[np.int64]) -> str:
    """Describe ascending frame numbers: how many, the first, the last, and whether some miss."""
    count, first, last = len(numbers), int(numbers[0]), int(numbers[-1])
    gaps = ' with gaps' if last - first + 1 != count else ''
    return f'{format_count(count, "frame")}, {first} to {last}{gaps}'


def format_numbers(numbers: Sequence[int], most: int = 6) -> str:
    """Format ascending numbers as ranges, such as ``3, 177-180 and 2 more``."""
    spans = runs_of(numbers)
    texts = [f'{first}' if first == last else f'{first}-{last}' for first, last in spans[:most]]
    rest = sum(last - first + 1 for first, last in spans[most:])
    return ', '.join(texts) + (f' and {rest} more' if rest else '')
