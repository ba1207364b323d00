# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's archives by name: downloaded in parallel, resumed, verified, extracted."""

from __future__ import annotations

import errno
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING

from ..files.threads import Threads
from ..model.errors import KittiRos2Error, OutputError, UsageError
from ..model.losses import Loss
from ..model.stamps import NS_PER_S
from ..options.dataset_tables import make_download_options
from .catalogue import KITTI_URL
from .checksums import read_checksums
from .errors import BadArchiveError, StoppedError
from .extract import ExtractedArchive, extract_all
from .finished import FinishedArchives
from .license import require_license
from .locking import locked_folder, removed_if_empty
from .meter import CancelledError, Meter
from .selection import RawKinds, select
from .sizes import archive_sizes, needed_bytes
from .sources import DownloadError, make_source
from .transfer import Backoff, Transfer
from .verification import is_complete, require_archive, require_space

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from os import PathLike

    from typing_extensions import Unpack

    from ..files.threads import ThreadTask
    from ..options.fetching import DownloadOptions, ExtractOptions
    from .catalogue import CatalogueEntry
    from .keywords import DownloadKeywords
    from .meter import Progress
    from .sources import ArchiveSource

    AnyPath = str | PathLike[str]

ARCHIVES = 'archives'
"""Folder of the archives, in the folder that is downloaded into."""


@dataclass(frozen=True)
class DownloadReport:
    """What was downloaded.

    Attributes:
        root: The folder that was downloaded into; each benchmark has a folder in it.
        downloaded: Names of the archives that were downloaded.
        existing: Names of those that were there before.
        folders: The folders of the benchmarks.
        extracted: What was extracted of each archive.
        losses: Archives and files that were skipped.
        notes: Non-fatal remarks.
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
        options: Those of `kitti-ros2 download --help`, with underscores and the same defaults.

    Returns:
        What was downloaded, extracted and skipped.

    Raises:
        KittiRos2Error: A word or an option is invalid, the terms are not accepted, the disk is
            full, or the only archive cannot be downloaded.

    Examples:
        >>> from kitti_ros2 import datasets
        >>> datasets.download('object calib', 'kitti', accept_license=True)  # doctest: +SKIP
        DownloadReport(...)
    """
    words = what.split() if isinstance(what, str) else list(what)
    chosen, extraction = make_download_options(options)
    entries = select_entries(words, chosen)
    shown = progress or _show_nothing
    return download_all(entries, Path(root), chosen, extraction, (shown, _show_nothing))


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
        options: Those of the download.
        extraction: Those of extracting.
        progress: Called with the bytes done and those of all: of the transfers, and of the archive
            that is being extracted.
    """
    if root.is_file():
        raise UsageError(f'{root}: is a file; give the folder to download into')
    require_license(accepted=options.accept_license)
    base_url = (options.base_url or KITTI_URL).rstrip('/')
    checksums = {each.name: each.sha256 for each in entries if each.sha256}
    if options.checksums is not None:
        checksums |= read_checksums(options.checksums)
    with removed_if_empty(root / ARCHIVES, root), ExitStack() as stack:
        source = make_source(base_url, options.timeout_ns / NS_PER_S)
        stack.callback(source.close)
        stack.enter_context(locked_folder(root / ARCHIVES))
        run = _Download(root, options, extraction, progress)
        pending = run.leave_out_finished(entries)
        sizes = archive_sizes(pending, source, base_url)
        present = sum(each.stat().st_size for each in (root / ARCHIVES).iterdir())
        needed = needed_bytes(sizes.values(), present, options)
        require_space(root, needed, 'select less')
        run.fetch(pending, source, base_url, sizes, checksums if options.verify else {})
    return run.report(entries)


class _Download:
    """A download with what was done so far."""

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
        """Return the archives that were not extracted before."""
        again = self._options.archives_only or self._extraction.overwrite
        pending = [each for each in entries if again or each.name not in self._finished]
        self._existing = [each.name for each in entries if each not in pending]
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
        backoff = Backoff(self._options.retries, sleep=meter.cancelled.wait)

        def fetch_one(entry: CatalogueEntry) -> bool:
            target = self._folder / entry.name
            transfer = Transfer(
                target,
                entry.urls(base_url),
                source,
                backoff,
                lambda count, size: meter.advance(entry.name, count, size),
                fsync=self._extraction.fsync,
            )
            if is_complete(target, checksums.get(entry.name, '')):
                transfer.drop()  # what a run that was killed left of it
                meter.advance(entry.name, target.stat().st_size, target.stat().st_size)
                return False
            transfer.run(checksums.get(entry.name, ''))
            require_archive(target)
            return True

        ended: SimpleQueue[ThreadTask[bool]] = SimpleQueue()
        with Threads(self._options.jobs, 'download') as threads:
            tasks = {threads.submit(partial(fetch_one, each), ended): each for each in entries}
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
        """Return what was done.

        Raises:
            KittiRos2Error: The only archive could not be downloaded.
        """
        if self._errors and len(entries) == 1:
            raise self._errors[0]
        folders = dict.fromkeys(self._root / each.benchmark for each in entries)
        return DownloadReport(
            self._root,
            tuple(self._downloaded),
            tuple(self._existing),
            tuple(folder for folder in folders if folder.is_dir()),
            tuple(self._extracted),
            tuple(self._losses),
            tuple(self._notes),
        )
