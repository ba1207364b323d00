# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 report --all: a page for each recording and bag, and an index."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..bags.search import is_bag_name
from ..batch.collection import Collection
from ..batch.folders import common_folder, find_roots
from ..batch.report_unit import run_report_unit
from ..batch.source_units import find_source_units
from ..files.replacing import KEEP_ALL_BUT_PAGES
from ..files.staging import staged_file
from ..model.errors import UsageError
from ..options.table import make_settings
from ..report.index import IndexEntry, make_index
from .collection import Combined, need_folder, refuse_sequence, run_collection
from .page_output import ENDINGS, open_page
from .text import format_path, say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..batch.folders import FolderSearch
    from ..batch.manifest import UnitRecord
    from ..batch.units import WorkUnit
    from ..options.batch import BatchOptions

_SUFFIX = '.html'
_INDEX = 'index'


def run_report_collection(
    src: Path,
    out: Path,
    given: Mapping[str, object],
    batch: BatchOptions,
    *,
    results: Path | None,
    quiet: bool,
    show: bool,
) -> int:
    """Write a page for each unit of a collection, and an index of them.

    Args:
        src: A root, a glob or a list.
        out: The folder of pages.
        given: The options of a unit by name, with overwrite.
        batch: How the collection is run.
        results: As given; not for a collection.
        quiet: Print only losses.
        show: Whether to open the index in the browser.

    Returns:
        The exit code.

    Raises:
        UsageError: An option is not for a collection.
    """
    read = make_settings({n: v for n, v in given.items() if n != 'overwrite'}).read
    refuse_sequence(read)
    if results is not None:
        raise UsageError(f'{results}: --results scores one recording; leave out --all')
    folder = need_folder(out, ENDINGS)
    roots = find_roots(src, is_bag_name)
    index = folder / f'{_INDEX}{_SUFFIX}'

    def find(search: FolderSearch) -> list[WorkUnit]:
        units = find_source_units(roots, read.layout, search)
        taken = [unit.source for unit in units if unit.name == _INDEX]
        if taken:
            raise UsageError(f'{taken[0]}: its page would be {index}, that of all; rename it')
        return units

    def combine(done: Sequence[tuple[UnitRecord, Path]]) -> _Index:
        entries = [
            IndexEntry(each.name, path.relative_to(folder), each.counts.get('frames', 0), each.bad)
            for each, path in done
        ]
        with staged_file(index, KEEP_ALL_BUT_PAGES) as path:
            path.write_bytes(make_index(str(common_folder(roots)), entries).encode())
        return _Index(index)

    collection = Collection('report', folder, _SUFFIX, given, batch, run_report_unit)
    code = run_collection(collection, find, quiet=quiet, combine=combine)
    if show:
        open_page(index)
    return code


class _Index(Combined):
    """The index of the pages."""

    def __init__(self, page: Path) -> None:
        self._page = page

    def show(self) -> None:
        """Print its path."""
        say(format_path(self._page))
