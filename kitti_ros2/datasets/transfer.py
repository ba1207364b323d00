# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The download of one archive: resumed after a break, verified, complete or absent.

An incomplete file is NAME.part; NAME.part.json has its URL, size and validator (ETag or date). A
part is continued only if the server has the same file.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..files.local_files import WritingOut, replace_file
from ..files.remote_requests import retry_wait_s
from ..model.errors import BadFileError, MissingPathError, OutputError, format_bytes, naming
from .archive_formats import CHUNK_BYTES, BadArchiveError, open_archive
from .download_sources import (
    BrokenTransferError,
    ChangedFileError,
    DownloadError,
    MissingArchiveError,
    without_password,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from typing import IO

    from .download_sources import ArchiveSource, Opened


# Files of SHA-256 checksums, one for each line: 64 hexadecimal digits, then the file's name.

_LINE = re.compile(r'([0-9A-Fa-f]{64})\s+\*?(\S.*)')


def read_checksums(path: Path) -> dict[str, str]:
    """Read the checksums in a file, by the last part of each name.

    Raises:
        MissingPathError: There is no such file.
        BadFileError: A line is invalid.
    """
    if not path.is_file():
        raise MissingPathError(path)
    checksums = {}
    with naming(path):
        text = path.read_text('utf-8', errors='replace')
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith('#'):
            continue
        match = _LINE.fullmatch(line.strip())
        if match is None:
            raise BadFileError(path, 'no checksum', '64 hexadecimal digits and a name', line=number)
        checksums[PurePosixPath(match[2]).name] = match[1].lower()
    return checksums


# Checks of downloaded files, and of the space for them.


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    digest = hashlib.sha256()
    with naming(path), path.open('rb') as file:
        while chunk := file.read(CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()


def is_complete(path: Path, sha256: str) -> bool:
    """Return whether an archive was downloaded before.

    Args:
        path: The archive.
        sha256: Its checksum; empty if it is not known.
    """
    if not path.is_file() or (sha256 and sha256_of(path) != sha256):
        return False
    try:
        with open_archive(path):
            return True
    except BadArchiveError:
        return False


def require_archive(path: Path) -> None:
    """Check that a downloaded file is an archive, else remove it.

    Raises:
        DownloadError: It is none, as with a server that declares too small a size.
    """
    try:
        with open_archive(path):
            pass
    except BadArchiveError as error:
        path.unlink(missing_ok=True)
        reason = str(error).partition('; ')[0]
        raise DownloadError(f'{reason}, as the server has it; it was removed') from error


def require_space(folder: Path, needed: float, remedy: str) -> None:
    """Check the free space of a disk.

    Args:
        folder: A folder on the disk.
        needed: Required bytes.
        remedy: Advice for the error message.

    Raises:
        OutputError: The space is too small.
    """
    free = shutil.disk_usage(folder).free
    if needed > free:
        reason = f'needs about {format_bytes(needed)}, and {format_bytes(free)} are free'
        raise OutputError(folder, reason, f'make room, or {remedy}')


_FIRST_WAIT_S = 0.5


@dataclass(frozen=True)
class _Journal:
    """The URL, size and validator of a part."""

    url: str = ''
    size: int | None = None
    validator: str = ''


class Transfer:
    """The download of one archive.

    Args:
        target: The file.
        urls: Possible URLs, tried in this order.
        source: Opens the URLs.
        retries: Attempts without progress after which the download fails.
        sleep: Waits for some seconds.
        advance: Called with the bytes of each chunk, negative for dropped ones, and with the size
            of the file once known.
        fsync: True makes the complete file outlast a power cut.
    """

    def __init__(
        self,
        target: Path,
        urls: Sequence[str],
        source: ArchiveSource,
        retries: int,
        sleep: Callable[[float], object],
        advance: Callable[[int, int | None], None],
        *,
        fsync: bool = True,
    ) -> None:
        self.target = target
        self._urls = urls
        self._source = source
        self._retries = retries
        self._sleep = sleep
        self._advance = advance
        self._counted = 0
        self._fsync = fsync
        self._part = target.with_name(f'{target.name}.part')
        self._log = target.with_name(f'{target.name}.part.json')

    def run(self, sha256: str = '') -> None:
        """Download the archive.

        Raises:
            MissingArchiveError: No URL has it.
            DownloadError: It cannot be downloaded, or has another checksum.
            OSError: The disk refuses.
        """
        for number, url in enumerate(self._urls, 1):
            try:
                self._fetch(url)
                break
            except MissingArchiveError:
                if number == len(self._urls):
                    raise
        if sha256 and sha256_of(self._part) != sha256:
            self.drop()
            raise DownloadError(
                f'{without_password(url)}: has another SHA-256 than {sha256}, and was removed; it'
                f' is damaged, or was replaced (--no-verify takes it as it is)'
            )
        replace_file(self._part, self.target, fsync=self._fsync)
        self._log.unlink(missing_ok=True)

    def drop(self) -> None:
        """Remove the downloaded part."""
        self._part.unlink(missing_ok=True)
        self._log.unlink(missing_ok=True)

    def _fetch(self, url: str) -> None:
        """Download to the part, with new attempts as long as they make progress."""
        journal = self._resumable(url)
        done = furthest = self._part.stat().st_size if journal.validator else 0
        failures = 0
        while True:
            self._count(done, journal.size)
            try:
                with self._source.open(url, done, journal.validator) as opened:
                    self._receive(url, opened, done, journal)
            except BrokenTransferError as error:
                if isinstance(error, ChangedFileError):
                    self.drop()
                reached = self._part.stat().st_size if self._part.exists() else 0
                failures = 0 if reached > furthest else failures + 1
                furthest = max(furthest, reached)
                if failures > self._retries:
                    what = f'broke off at {format_bytes(reached)}' if reached else 'cannot be read'
                    then = ' to go on from there' if reached else ''
                    raise DownloadError(
                        f'{without_password(url)}: {what} ({error}); run it again{then}'
                    ) from error
                journal = self._resumable(url)
                done = reached if journal.validator else 0
                self._sleep(max(retry_wait_s(max(failures, 1), _FIRST_WAIT_S), error.wait_s))
            else:
                return

    def _receive(self, url: str, opened: Opened, done: int, journal: _Journal) -> None:
        """Append the chunks of a source to the part.

        Raises:
            BrokenTransferError: It sends less than declared, or another file.
        """
        changed = opened.validator not in {'', journal.validator}
        if opened.start and (changed or opened.start != done):
            raise ChangedFileError('the file has changed')
        done = opened.start
        validator = opened.validator or (journal.validator if done else '')
        journal = _Journal(without_password(url), opened.size, validator)
        self._count(done, opened.size)
        with self._part.open('r+b' if done else 'wb') as file:
            file.seek(done)
            self._log.write_text(json.dumps(asdict(journal)), encoding='utf-8')
            done = self._write(file, opened, done)
        if opened.size is not None and done != opened.size:
            raise BrokenTransferError(
                f'{format_bytes(done)} of {format_bytes(opened.size)} were sent'
            )

    def _write(self, file: IO[bytes], opened: Opened, done: int) -> int:
        writing_out = WritingOut(self._part)
        try:
            for chunk in opened.chunks:
                file.write(chunk)
                done += len(chunk)
                writing_out.advance(len(chunk))
                self._count(done)
        finally:
            writing_out.close()
            done = done if opened.size is None else min(done, opened.size)
            file.truncate(done)
        return done

    def _count(self, done: int, size: int | None = None) -> None:
        """Report the bytes of the part, and the size of the file if known."""
        change, self._counted = done - self._counted, done
        self._advance(change, size)

    def _resumable(self, url: str) -> _Journal:
        """Return the journal of the part; an empty one if it cannot be continued."""
        with suppress(OSError, ValueError, TypeError):
            journal = _Journal(**json.loads(self._log.read_text('utf-8')))
            if journal.url == without_password(url) and journal.validator and self._part.is_file():
                return journal
        return _Journal()
