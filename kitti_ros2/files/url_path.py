# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The names of a URL's path, with the interface of pathlib; nothing is asked of the store."""

from __future__ import annotations

import re
import sys
from pathlib import Path, PosixPath, PurePath, PurePosixPath
from typing import TYPE_CHECKING

from ..model.errors import UsageError

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from typing_extensions import Self

URL = re.compile(r'([A-Za-z][A-Za-z0-9+.-]*)://(.*)', re.DOTALL)
"""Scheme and rest of a URL."""


class LocalPathError(UsageError, TypeError):
    """A URL was given where only a local path is possible."""

    def __init__(self, path: UrlPath) -> None:
        self.path = str(path)
        super().__init__(f'{path}: a URL is not possible here; give a path of this machine')


class UrlPath(PosixPath):
    """A path whose text is its URL, such as s3://bucket/folder/name.

    The root is `s3://`. A parameter after `?` in http URLs, such as the signature of a signed URL,
    is sent but never shown.

    Args:
        url: With a scheme; `/` separates names.
        segments: More names.

    Attributes:
        scheme: In small letters, such as s3.
        names: From the root down.
        parameters: The text behind `?` in http URLs.

    Raises:
        UsageError: The URL contains a password.
    """

    scheme: str
    names: tuple[str, ...]
    parameters: str

    # Python 3.12 and later parse in __init__, earlier ones in __new__; neither is asked to parse
    # more than the local path '/', so nothing depends on how they keep the parts.

    def __new__(cls, url: str | PurePath, *segments: str | PurePath) -> Self:
        """Parse the URL."""
        whole = url.whole if isinstance(url, UrlPath) else str(url)
        match = URL.fullmatch(whole)
        if match is None:
            raise UsageError(f'{whole}: is no URL; expected SCHEME://FOLDER/NAME')
        scheme, rest, parameters = match[1].lower(), match[2], ''
        if scheme in {'http', 'https'}:
            rest, _, parameters = rest.partition('#')[0].partition('?')
        user, at, host = rest.partition('/')[0].rpartition('@')
        if at and ':' in user:
            raise UsageError(
                f'{scheme}://***@{host}: passwords in URLs are not accepted; set them in the'
                f' environment or in the configuration of fsspec'
            )
        names = [name for text in (rest, *segments) for name in _split(str(text))]
        return cls._made(scheme, names, '' if segments else parameters)

    def __init__(self, url: str | PurePath, *segments: str | PurePath) -> None:  # noqa: ARG002
        if sys.version_info >= (3, 12):
            super().__init__('/')

    @property
    def _raw_paths(self) -> list[str]:
        """The text that pathlib reads of the path: Path(url) fails instead of becoming local."""
        raise LocalPathError(self)

    @_raw_paths.setter
    def _raw_paths(self, _: object) -> None:
        pass

    _parts = _raw_paths  # before Python 3.12

    drive = ''
    root = '/'
    anchor = '/'

    @classmethod
    def _made(cls, scheme: str, names: Sequence[str], parameters: str = '') -> Self:
        self = super().__new__(cls, '/')
        if sys.version_info >= (3, 12):
            PosixPath.__init__(self, '/')
        self.scheme, self.names, self.parameters = scheme, tuple(names), parameters
        return self

    def with_segments(self, *segments: str | PurePath) -> Path:
        """Return the path of joined segments."""
        if segments and isinstance(segments[0], UrlPath):
            return segments[0].joinpath(*segments[1:])
        return Path(*segments)

    @property
    def whole(self) -> str:
        """The URL with its parameters, as it is sent."""
        return f'{self}?{self.parameters}' if self.parameters else str(self)

    def __str__(self) -> str:
        return f'{self.scheme}://{"/".join(self.names)}'

    as_posix = as_uri = __str__

    def __repr__(self) -> str:
        return f'{type(self).__name__}({str(self)!r})'

    def __fspath__(self) -> str:
        raise LocalPathError(self)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.whole,)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, UrlPath):
            return self.whole == other.whole
        return False if isinstance(other, PurePath) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.whole)

    def __lt__(self, other: PurePath) -> bool:
        return str(self) < str(other)

    def __le__(self, other: PurePath) -> bool:
        return str(self) <= str(other)

    def __gt__(self, other: PurePath) -> bool:
        return str(self) > str(other)

    def __ge__(self, other: PurePath) -> bool:
        return str(self) >= str(other)

    @property
    def parts(self) -> tuple[str, ...]:
        """The root, such as s3://, and the names below it."""
        return f'{self.scheme}://', *self.names

    @property
    def name(self) -> str:
        """The last name; empty for the root."""
        return self.names[-1] if self.names else ''

    @property
    def parent(self) -> Self:
        """The folder; the root's is the root."""
        return self._made(self.scheme, self.names[:-1])

    @property
    def parents(self) -> Sequence[Self]:
        """The folders from the nearest to the root."""
        counts = reversed(range(len(self.names)))
        return tuple(self._made(self.scheme, self.names[:count]) for count in counts)

    def __truediv__(self, key: str | os.PathLike[str]) -> Self:
        return self.joinpath(key)

    def __rtruediv__(self, key: str | os.PathLike[str]) -> Self:
        return self  # which is absolute

    def joinpath(self, *segments: str | os.PathLike[str]) -> Self:
        """Return a path below; a URL among the segments replaces it, as absolute ones in Path.

        Raises:
            UsageError: A segment is an absolute path of this machine.
        """
        path = self
        for segment in segments:
            if isinstance(segment, type(self)):
                path = segment
            elif (text := str(segment)).startswith('/'):
                raise UsageError(f'{path}: cannot be joined with the local path {text}')
            else:
                path = self._made(path.scheme, (*path.names, *_split(text)))
        return path

    def with_name(self, name: str) -> Self:
        """Return the path with another last name.

        Raises:
            ValueError: It is none.
        """
        if not self.names or _split(name) != [name]:
            raise ValueError(f'{self} cannot be renamed to {name!r}')
        return self._made(self.scheme, (*self.names[:-1], name))

    def with_stem(self, stem: str) -> Self:
        """Return the path with another last name and the same suffix."""
        return self.with_name(stem + self.suffix)

    def with_suffix(self, suffix: str) -> Self:
        """Return the path with another suffix."""
        return self.with_name(self.stem + suffix)

    def relative_to(  # type: ignore[override]
        self, other: str | os.PathLike[str], *more: str | os.PathLike[str], walk_up: bool = False
    ) -> Path:
        """Return the relative path from a folder of the same store; it is a plain Path.

        Raises:
            ValueError: The path is not below the folder.
        """
        folder = other if isinstance(other, UrlPath) else None
        if folder is None and URL.fullmatch(str(other)):
            folder = UrlPath(str(other))
        if folder is None or walk_up:
            raise ValueError(f'{str(self)!r} is not in the subpath of {str(other)!r}')
        folder = folder.joinpath(*more)
        if self.parts[: len(folder.parts)] != folder.parts:
            raise ValueError(f'{str(self)!r} is not in the subpath of {str(folder)!r}')
        return Path(*self.names[len(folder.names) :])

    def is_relative_to(self, *other: str | os.PathLike[str]) -> bool:
        """Return whether the path is a folder, or below it."""
        try:
            self.relative_to(*other)
        except ValueError:
            return False
        return True

    def match(self, path_pattern: str, *, case_sensitive: bool | None = None) -> bool:
        """Return whether the names match a relative pattern."""
        del case_sensitive  # they are
        return PurePosixPath(*self.names).match(path_pattern)

    def is_absolute(self) -> bool:
        """Return true."""
        return True

    def absolute(self) -> Self:
        """Return the path itself."""
        return self

    def expanduser(self) -> Self:
        """Return the path itself."""
        return self

    def resolve(self, strict: bool = False) -> Self:  # noqa: ARG002, FBT001, FBT002 - as in Path
        """Return the path without `..`."""
        if '..' not in self.names:
            return self
        names: list[str] = []
        for name in self.names:
            names = names[:-1] if name == '..' else [*names, name]
        return self._made(self.scheme, names)


def _split(text: str) -> list[str]:
    """Return the names of a text."""
    return [name for name in text.split('/') if name not in {'', '.'}]
