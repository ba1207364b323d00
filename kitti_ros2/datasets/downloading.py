# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's archives by name: downloaded in parallel, resumed, verified, extracted."""

from __future__ import annotations

import errno
import json
import os
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Lock
from typing import TYPE_CHECKING

from ..files.local_files import replace_file
from ..files.threads import Threads
from ..model.errors import KittiRos2Error, Loss, OutputError, UsageError
from ..model.streams import NS_PER_S
from ..options.datasets import make_download_options
from .archive_formats import BadArchiveError, StoppedError, stopping
from .catalogue import KITTI_URL, RawKinds, select
from .download_sources import BrokenTransferError, DownloadError, make_source
from .extracting import ExtractedArchive, extract_all, locked_folder, removed_if_empty
from .transfer import Transfer, is_complete, read_checksums, require_archive, require_space

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from os import PathLike

    from typing_extensions import Unpack

    from ..files.threads import ThreadTask
    from ..options.datasets import DownloadOptions, ExtractOptions
    from ..options.keywords import DownloadKeywords
    from .catalogue import CatalogueEntry
    from .download_sources import ArchiveSource


# The terms of KITTI's data: shown until they are accepted.

TERMS = (
    "KITTI's data is licensed under CC BY-NC-SA 3.0: name the authors, no commercial use, share"
    ' what you make of it alike. The authors ask you to register at'
    ' https://www.cvlibs.net/datasets/kitti/ before you download. SemanticKITTI has terms of its'
    ' own, see http://www.semantic-kitti.org'
)


def require_license(*, accepted: bool) -> None:
    """Record the acceptance of the terms.

    Args:
        accepted: True if the user accepts them now.

    Raises:
        UsageError: The terms were never accepted.
    """
    path = _path()
    if accepted:
        with suppress(OSError):  # a home without write access: the question is repeated
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f'{TERMS}\nAccepted with --accept-license.\n', encoding='utf-8')
    elif not path.is_file():
        raise UsageError(f'{TERMS}. To accept these terms, once, pass --accept-license')


def _path() -> Path:
    """Return the file of the acceptance (XDG Base Directory Specification)."""
    config_home = os.environ.get('XDG_CONFIG_HOME', '')
    folder = Path(config_home) if config_home.startswith('/') else Path('~/.config').expanduser()
    return folder / 'kitti_ros2' / 'kitti_terms_accepted.txt'


# Progress of parallel transfers, and of the extraction after them.

if TYPE_CHECKING:
    Progress = Callable[[int, int], None]


class CancelledError(Exception):
    """The download was cancelled; raised in the threads of the transfers."""


class Meter:
    """Bytes of all transfers.

    Args:
        sizes: Known sizes of archives by name.
        progress: Called with the bytes done and the bytes of all.
    """

    def __init__(self, sizes: dict[str, int], progress: Progress) -> None:
        self.cancelled = Event()
        self._sizes = sizes
        self._progress = progress
        self._done = 0
        self._lock = Lock()

    def advance(self, name: str, count: int, size: int | None) -> None:
        """Count bytes of a transfer, and store the size of its archive.

        Raises:
            CancelledError: The download was cancelled.
        """
        if self.cancelled.is_set():
            raise CancelledError
        with self._lock:
            self._done += count
            if size is not None:
                self._sizes[name] = size
            self._progress(self._done, max(self._done, sum(self._sizes.values())))


# The record of extracted archives, which are not downloaded again.

_NAME = 'extracted.json'


class FinishedArchives:
    """The completely extracted archives by name, each with some of its files.

    Args:
        root: The folder of the files.
        folder: The folder of the record.
        fsync: True makes it outlast a power cut.
    """

    def __init__(self, root: Path, folder: Path, *, fsync: bool) -> None:
        self._root = root
        self._fsync = fsync
        self._path = folder / _NAME
        self._files: dict[str, list[str]] = {}
        with suppress(OSError, ValueError):
            record = json.loads(self._path.read_text('utf-8'))
            if isinstance(record, dict):
                self._files = {str(name): [*map(str, files)] for name, files in record.items()}

    def __contains__(self, name: str) -> bool:
        """Return whether an archive was extracted, and its files still exist."""
        files = self._files.get(name, [])
        return bool(files) and all((self._root / file).is_file() for file in files)

    def add(self, name: str, files: list[str]) -> None:
        """Record the extraction of an archive.

        Raises:
            StoppedError: The disk refuses.
        """
        self._files[name] = files
        part = self._path.with_name(f'.{_NAME}.part')
        with stopping(self._path):
            part.write_text(json.dumps(self._files, indent=1), encoding='utf-8')
            replace_file(part, self._path, fsync=self._fsync)


# Sizes of archives before the download, and the space that they need.

_CONTENT_RATIO = 1.4
"""Largest ratio of content to archive: 1.33 for a real drive of 120 frames."""


def archive_sizes(
    entries: Sequence[CatalogueEntry], source: ArchiveSource, base_url: str
) -> dict[str, int]:
    """Return the sizes of archives by name: those of the server, else of the catalogue."""
    from_kitti = base_url == KITTI_URL
    sizes = {entry.name: entry.about_bytes or 0 if from_kitti else 0 for entry in entries}
    with suppress(BrokenTransferError):  # the transfers report it
        for entry in entries:
            url_sizes = (source.size(url) for url in entry.urls(base_url))
            sizes[entry.name] = next((size for size in url_sizes if size), sizes[entry.name])
    return sizes


def needed_bytes(sizes: Iterable[int], present: int, options: DownloadOptions) -> float:
    """Return the most bytes that archives and their content need on a disk at a time.

    Args:
        sizes: Sizes of the archives.
        present: Bytes of existing archives, also partial ones.
        options: Options that keep archives, or do not extract them.
    """
    largest = sorted(sizes, reverse=True)
    keeps_archives = options.keep_archives or options.archives_only
    archives = max(sum(largest if keeps_archives else largest[: options.jobs]) - present, 0)
    return archives + (0.0 if options.archives_only else _CONTENT_RATIO * sum(largest))


if TYPE_CHECKING:
    AnyPath = str | PathLike[str]

ARCHIVES = 'archives'
"""Folder of the archives, in the download folder."""


@dataclass(frozen=True)
class DownloadReport:
    """The result of a download.

    Attributes:
        root: The download folder, with a folder for each benchmark.
        downloaded: Names of the downloaded archives.
        existing: Names of archives that existed before.
        folders: The folders of the benchmarks.
        extracted: Result of extracting each archive.
        losses: Skipped archives and files.
        notes: Lines that cost no data.
    """

    root: Path
    downloaded: tuple[str, ...]
    existing: tuple[str, ...]
    folders: tuple[Path, ...]
    extracted: tuple[ExtractedArchive, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def download(
    what: str | Iterable[str],
    root: AnyPath,
    *,
    progress: Progress | None = None,
    **options: Unpack[DownloadKeywords],
) -> DownloadReport:
    """Download KITTI's archives and extract them, as `kitti-ros2 download` does.

    Args:
        what: Words as on the command line, such as 'raw 2011_09_26_drive_0005'.
        root: The folder to download into; each benchmark gets a folder in it.
        progress: Called with the bytes downloaded and the bytes of all archives.
        options: Options of `kitti-ros2 download --help-all`, with underscores, same defaults.

    Returns:
        Downloaded, extracted and skipped archives.

    Raises:
        KittiRos2Error: A word or an option is invalid, the terms are not accepted, the disk is
            full, or the only archive cannot be downloaded.

    Examples:
        >>> from kitti_ros2 import datasets
        >>> datasets.download('object calib', 'kitti', accept_license=True)  # doctest: +SKIP
        DownloadReport(...)
    """
    words = what.split() if isinstance(what, str) else list(what)
    download_options, extraction = make_download_options(options)
    entries = select_entries(words, download_options)
    shown = progress or _show_nothing
    return download_all(entries, Path(root), download_options, extraction, (shown, _show_nothing))


def _show_nothing(_done: int, _total: int) -> None:
    """Show no progress."""


def select_entries(words: Sequence[str], options: DownloadOptions) -> list[CatalogueEntry]:
    """Return the archives that words and options name.

    Raises:
        UsageError: A word is unknown, or nothing is selected.
    """
    kinds = tuple(kind for kind in ('sync', 'extract', 'tracklets') if getattr(options, kind))
    return select(words, RawKinds(kinds, options.categories))


def download_all(
    entries: Sequence[CatalogueEntry],
    root: Path,
    options: DownloadOptions,
    extraction: ExtractOptions,
    progress: tuple[Progress, Progress],
) -> DownloadReport:
    """Download archives into a folder; see download.

    Args:
        entries: The archives.
        root: The folder.
        options: Options of the download.
        extraction: Options of the extraction.
        progress: Called with the bytes done and those of all: of the transfers, then of the
            extraction.
    """
    if root.is_file():
        raise UsageError(f'{root}: is a file; give the folder to download into')
    require_license(accepted=options.accept_license)
    base_url = (options.base_url or KITTI_URL).rstrip('/')
    checksums = {entry.name: entry.sha256 for entry in entries if entry.sha256}
    if options.checksums is not None:
        checksums |= read_checksums(options.checksums)
    with removed_if_empty(root / ARCHIVES, root), ExitStack() as exit_stack:
        source = make_source(base_url, options.timeout_ns / NS_PER_S)
        exit_stack.callback(source.close)
        exit_stack.enter_context(locked_folder(root / ARCHIVES))
        run = _Download(root, options, extraction, progress)
        pending = run.leave_out_finished(entries)
        sizes = archive_sizes(pending, source, base_url)
        present = sum(path.stat().st_size for path in (root / ARCHIVES).iterdir())
        needed = needed_bytes(sizes.values(), present, options)
        require_space(root, needed, 'select less')
        run.fetch(pending, source, base_url, sizes, checksums if options.verify else {})
    return run.report(entries)


class _Download:
    """A download and its results so far."""

    def __init__(
        self,
        root: Path,
        options: DownloadOptions,
        extraction: ExtractOptions,
        progress: tuple[Progress, Progress],
    ) -> None:
        self._root = root
        self._folder = root / ARCHIVES
        self._options = options
        self._extraction = extraction
        self._downloading, self._extracting = progress
        self._finished = FinishedArchives(root, self._folder, fsync=self._extraction.fsync)
        self._downloaded: list[str] = []
        self._existing: list[str] = []
        self._extracted: list[ExtractedArchive] = []
        self._losses: list[Loss] = []
        self._notes: list[str] = []
        self._errors: list[KittiRos2Error] = []

    def leave_out_finished(self, entries: Sequence[CatalogueEntry]) -> list[CatalogueEntry]:
        """Return the archives without those extracted before."""
        again = self._options.archives_only or self._extraction.overwrite
        pending = [entry for entry in entries if again or entry.name not in self._finished]
        self._existing = [entry.name for entry in entries if entry not in pending]
        return pending

    def fetch(
        self,
        entries: Sequence[CatalogueEntry],
        source: ArchiveSource,
        base_url: str,
        sizes: dict[str, int],
        checksums: dict[str, str],
    ) -> None:
        """Download archives, and extract each as soon as it is complete.

        Raises:
            StoppedError: The disk is full.
        """
        meter = Meter(sizes, self._downloading)

        def fetch_one(entry: CatalogueEntry) -> bool:
            target = self._folder / entry.name
            transfer = Transfer(
                target,
                entry.urls(base_url),
                source,
                self._options.retries,
                meter.cancelled.wait,
                lambda count, size: meter.advance(entry.name, count, size),
                fsync=self._extraction.fsync,
            )
            if is_complete(target, checksums.get(entry.name, '')):
                transfer.drop()  # left by a killed run
                meter.advance(entry.name, target.stat().st_size, target.stat().st_size)
                return False
            transfer.run(checksums.get(entry.name, ''))
            require_archive(target)
            return True

        ended: SimpleQueue[ThreadTask[bool]] = SimpleQueue()
        with Threads(self._options.jobs, 'download') as threads:
            tasks = {threads.submit(partial(fetch_one, entry), ended): entry for entry in entries}
            try:
                for _ in entries:
                    task = ended.get()
                    self._finish(tasks[task], task)
            except BaseException:
                meter.cancelled.set()
                source.close()
                raise

    def _finish(self, entry: CatalogueEntry, task: ThreadTask[bool]) -> None:
        """Take the result of a transfer, and extract the archive.

        Raises:
            StoppedError: The disk is full.
        """
        try:
            is_new = task.result()
        except (DownloadError, BadArchiveError) as error:
            self._lose(entry, error)
            return
        except CancelledError:
            return
        except OSError as error:
            full = error.errno in {errno.ENOSPC, errno.EDQUOT}
            reason = 'the disk is full' if full else error.strerror or str(error)
            raise StoppedError(self._folder / entry.name, reason) from error
        (self._downloaded if is_new else self._existing).append(entry.name)
        if not self._options.archives_only:
            self._extract(entry)

    def _extract(self, entry: CatalogueEntry) -> None:
        archive = self._folder / entry.name
        folder = self._root / entry.benchmark
        try:
            report = extract_all([archive], folder, self._extraction, self._extracting)
        except BadArchiveError as error:
            self._lose(entry, error)
            return
        except OutputError as error:
            error.leave('what was downloaded is kept')
            raise
        self._extracted += report.archives
        self._losses += report.losses
        self._notes += report.notes
        if not report.losses:
            [extracted] = report.archives
            ends = [f'{entry.benchmark}/{end}' for end in extracted.ends]
            self._finished.add(entry.name, ends)

    def _lose(self, entry: CatalogueEntry, error: KittiRos2Error) -> None:
        self._errors.append(error)
        self._losses.append(Loss(entry.name, 1, str(error)))

    def report(self, entries: Sequence[CatalogueEntry]) -> DownloadReport:
        """Return the results.

        Raises:
            KittiRos2Error: The only archive could not be downloaded.
        """
        if self._errors and len(entries) == 1:
            raise self._errors[0]
        folders = dict.fromkeys(self._root / entry.benchmark for entry in entries)
        return DownloadReport(
            self._root,
            tuple(self._downloaded),
            tuple(self._existing),
            tuple(folder for folder in folders if folder.is_dir()),
            tuple(self._extracted),
            tuple(self._losses),
            tuple(self._notes),
        )
