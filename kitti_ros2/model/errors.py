# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The exceptions: each message contains what, where, what was expected, and what to do."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .containers import ANY_BAG
from .text import either, some_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from typing_extensions import Self


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
        each: The words of a shell loop over all recordings of a source: their folders, or with
            by_name the values of --sequence.
        by_name: See each.
    """

    given: Path
    source: Path
    options: tuple[str, ...] = ()
    frame: int | None = None
    command: str = ''
    before: str = ''
    each: str = ''
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

    def __init__(self, path: Path, found: str, layouts: Iterable[str], advice: str = '') -> None:
        self.path = str(path)
        self.explained = bool(advice)
        super().__init__(
            f'{path}: {found}; '
            + (advice or f'expected a KITTI folder of layout {either(list(layouts))}')
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
        remedy: What to do, the end of the message; empty if unknown.
    """

    def __init__(
        self,
        path: Path | str,
        found: str,
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
            f'{where}: {found}; expected {expected}' + (f' ({remedy})' if remedy else '')
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

    def leave(self, left: str) -> None:
        """Change the words about what was left behind."""
        path, reason, remedy = self._parts
        self._left = left
        self.args = (f'{path}: {reason}; {left} ({remedy})',)

    def tell_remains(self, remains: Path) -> None:
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

    def __init__(self, kept: str) -> None:
        super().__init__(f'interrupted; {kept}')


class BadBagError(KittiRos2Error):
    """A path is no readable bag, or a bag does not contain the requested data.

    Args:
        path: What was read.
        found: What is wrong with it.
        expected: What is read instead; empty where what was found says that.
    """

    def __init__(
        self,
        path: Path,
        found: str,
        expected: str = ANY_BAG,
    ) -> None:
        self.path = str(path)
        wanted = f'; expected {expected}' if expected else ''
        super().__init__(f'{path}: {found}{wanted}')


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
