# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a recording that is cut, and their places in the new data set."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.hard_links import walk_files
from ..kitti import names
from ..kitti.recording_tree import tree_of
from ..kitti.store import STORE
from ..model.streams import Stream
from ..options.crop import EmptyLabels

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path, PurePosixPath

    from ..kitti.recording import KittiRecording
    from ..options.crop import CropOptions

    Placed = tuple[Path, PurePosixPath]


class CropPaths:
    """The files of a recording, each with its place below the root of the new data set.

    Attributes:
        numbers: File numbers of the scans.
        tops: The files and folders that contain all of its files.
        single_files: Places of files outside of the recording's folders, which recordings share.
        scan_folder: Place of the cut scans.
        in_place: Whether these replace the scans, instead of lying beside them.
        labelled: Numbers of the frames whose empty labels are dropped.
        track_labels: The label file of the whole recording, if empty labels are dropped in it.
        notes: Remarks.
    """

    def __init__(self, recording: KittiRecording, options: CropOptions) -> None:
        self._recording = recording
        self._tree = tree = tree_of(recording)
        self.numbers: list[int] = tree.scans.numbers.tolist()
        self.tops = frozenset(path for path, _ in tree.parts)
        self.single_files = frozenset(place for path, place in tree.parts if path.is_file())
        own = tree.scan_root.name
        folder = options.folder or own
        self.in_place = folder == own
        self._scan_root = tree.place / folder
        below = tree.scans.folder.relative_to(tree.scan_root)
        self.scan_folder = self._scan_root / below.as_posix()
        self._replaced = None if self.in_place else tree.scan_root.with_name(folder)
        index = recording.streams.get(Stream.LABELS)
        drop = options.empty_labels is EmptyLabels.DROP and index is not None
        labels: list[int] = index.numbers.tolist() if drop and index is not None else []
        self.labelled = frozenset(labels).intersection(self.numbers)
        common = Stream.LABELS in recording.layout.traits.line_streams
        self.track_labels = recording.path(Stream.LABELS, 0) if common and self.labelled else None
        self.notes = self._find_notes()

    def scan(self, number: int) -> Placed:
        """Return a scan, and the place of the cut one."""
        path = self._tree.scans.path(number)
        return path, self.scan_folder / path.name

    def point_labels(self, number: int) -> list[Placed]:
        """Return the files with labels for the points of a scan; they need not exist."""
        if not self.in_place:
            return []
        name = f'{self._tree.scans.stem(number)}{names.LABEL}'
        return [self._placed(folder / name) for folder in self._tree.point_labels]

    def frame_labels(self, number: int) -> Placed | None:
        """Return the label file of a frame alone, if its empty labels are dropped."""
        if self.track_labels is not None or number not in self.labelled:
            return None
        return self._placed(self._recording.path(Stream.LABELS, number))

    def tracks(self) -> Placed | None:
        """Return the label file of the whole recording, if empty labels are dropped in it."""
        return None if self.track_labels is None else self._placed(self.track_labels)

    def others(self, failed: Callable[[OSError], None]) -> Iterator[Placed]:
        """Yield all other files; those are unchanged.

        Args:
            failed: Called with the error of a folder that cannot be listed.
        """
        made = self._made()
        for top, _ in self._tree.parts:
            if self._replaced in top.parents:
                continue
            for path in walk_files(top, lambda each: each == self._replaced, failed):
                if path not in made:
                    yield self._placed(path)
        if not self.in_place:
            yield from self._beside_scans()

    def _beside_scans(self) -> Iterator[Placed]:
        """Yield the files beside the folder of scans, such as time stamps, for the cut scans."""
        root = self._tree.scan_root
        if root.parent in (top for top, _ in self._tree.parts) and root != self._tree.scans.folder:
            for name in STORE.names(root):
                if (root / name).is_file():
                    yield root / name, self._scan_root / name

    def _made(self) -> set[Path]:
        """Return the files that are cut or rewritten."""
        made = {self.scan(number)[0] for number in self.numbers} if self.in_place else set()
        for number in self.numbers:
            made.update(path for path, _ in self.point_labels(number))
            labels = self.frame_labels(number)
            made.update([labels[0]] if labels else [])
        return made | ({self.track_labels} if self.track_labels is not None else set())

    def _placed(self, path: Path) -> Placed:
        return path, self._tree.place_of(path)

    def _find_notes(self) -> list[str]:
        tree = self._tree
        if not self.numbers:
            return [f'{tree.scans.folder}: no scans; the other files are unchanged']
        known = {self._replaced, tree.scan_root}
        beside = [tree.scan_root.with_name(name) for name in STORE.names(tree.scan_root.parent)]
        notes = [
            f'{path}: unchanged, since only {tree.scan_root.name} is cut'
            for path in beside
            if path.name.startswith(names.SCANS) and path not in known
        ]
        if not self.in_place and tree.point_labels:
            listed = ', '.join(folder.name for folder in tree.point_labels)
            notes.append(f'{tree.place}: {listed} unchanged, with the scans in {names.SCANS}')
        return notes
