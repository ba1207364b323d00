# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a disk may hold after a power cut, rebuilt from a record of what a process did.

The rules are those of POSIX, not of one file system, and harsher than any in use:

- A file has the content of its last fsync, and nothing else, if it was not written since.
- A file that was never synced may be empty, full of zeros, cut off, or whole; one that was
  changed after its last fsync may have any blocks of its old and new content.
- An entry of a folder (a new name, a rename, a removal) is certain after an fsync of that folder.
  Of the others any may be on the disk, whatever their order. A rename is atomic.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path
    from random import Random

_BLOCK = 4096
_UNKNOWN_BYTES = 3 * _BLOCK


class Entry(NamedTuple):
    """A name in a folder is given to an object; None: it is removed."""

    folder: int
    name: str
    target: int | None


@dataclass
class Change:
    """An atomic change of entries; certain once its first entry's folder is synced."""

    moment: int
    entries: Sequence[Entry]


@dataclass
class Content:
    """The history of a file: moments of writing, and of syncing with the content."""

    written: list[int] = field(default_factory=list)
    synced: list[tuple[int, bytes]] = field(default_factory=list)


class Record:
    """What a process did below a folder.

    Args:
        root: The folder as it is before the process runs: all of it is on the disk.

    Attributes:
        moments: Number of things done; a power cut may come after each, from 0 on.
    """

    def __init__(self, root: Path) -> None:
        self.moments = 0
        self._ids = count()
        self._by_inode: dict[int, int] = {}
        self._live: dict[int, dict[str, int]] = defaultdict(dict)
        self._contents: dict[int, Content] = {}
        self._changes: list[Change] = []
        self._synced: dict[int, list[int]] = defaultdict(list)
        self._root = self._enter(root)
        self._first = {folder: dict(names) for folder, names in self._live.items()}

    def _enter(self, path: Path) -> int:
        known = self._by_inode.get(path.stat().st_ino)
        if known is not None:
            return known
        found = self._by_inode[path.stat().st_ino] = next(self._ids)
        if path.is_dir():
            self._live[found].update({each.name: self._enter(each) for each in path.iterdir()})
        else:
            self._contents[found] = Content(synced=[(-1, path.read_bytes())])
        return found

    def read(self, log: Path, copies: Path) -> None:
        """Read the log and the copies that recorder.c wrote."""
        for line in log.read_text().splitlines():
            kind, *fields = line.split('\t')
            getattr(self, f'_read_{kind.lower()}')(
                *fields, **{'copies': copies} if kind == 'F' else {}
            )
            self.moments += 1

    def _change(self, *entries: Entry) -> None:
        self._changes.append(Change(self.moments, entries))
        for folder, name, target in entries:
            if target is None:
                self._live[folder].pop(name, None)
            else:
                self._live[folder][name] = target

    def _folder(self, inode: str) -> int:
        return self._by_inode[int(inode)]

    def _read_c(self, folder: str, name: str, inode: str, kind: str) -> None:
        created = self._by_inode[int(inode)] = next(self._ids)
        if kind == 'f':
            self._contents[created] = Content(written=[self.moments])
        self._change(Entry(self._folder(folder), name, created))

    def _read_l(self, folder: str, name: str, inode: str) -> None:
        linked = self._by_inode.get(int(inode))
        if linked is None:  # a file outside of the root, which nothing is known of
            linked = self._by_inode[int(inode)] = next(self._ids)
            self._contents[linked] = Content(written=[self.moments])
        self._change(Entry(self._folder(folder), name, linked))

    def _read_u(self, folder: str, name: str) -> None:
        self._change(Entry(self._folder(folder), name, None))

    def _read_r(self, folder: str, name: str, to_folder: str, to_name: str) -> None:
        old, new = self._folder(folder), self._folder(to_folder)
        target = self._live[old][name]
        self._change(Entry(new, to_name, target), Entry(old, name, None))

    def _read_x(self, folder: str, name: str, to_folder: str, to_name: str) -> None:
        old, new = self._folder(folder), self._folder(to_folder)
        one, other = self._live[old][name], self._live[new][to_name]
        self._change(Entry(new, to_name, one), Entry(old, name, other))

    def _read_w(self, inode: str) -> None:
        self._contents[self._by_inode[int(inode)]].written.append(self.moments)

    def _read_f(self, inode: str, copy: str, *, copies: Path) -> None:
        synced = self._by_inode[int(inode)]
        if copy:
            self._contents[synced].synced.append((self.moments, (copies / copy).read_bytes()))
        else:
            self._synced[synced].append(self.moments)

    def rebuild(self, out: Path, moment: int, random: Random) -> None:
        """Write a folder as a disk may hold it when the power is cut after so many things done."""
        tree = defaultdict(dict, {folder: dict(names) for folder, names in self._first.items()})
        for change in self._changes:
            if change.moment >= moment:
                break
            certain = any(
                change.moment < each < moment for each in self._synced[change.entries[0].folder]
            )
            if certain or random.random() < 0.5:
                for folder, name, target in change.entries:
                    if target is None:
                        tree[folder].pop(name, None)
                    else:
                        tree[folder][name] = target
        self._write(out, self._root, tree, moment, random, ())

    def _write(
        self,
        out: Path,
        item: int,
        tree: Mapping[int, Mapping[str, int]],
        moment: int,
        random: Random,
        above: tuple[int, ...],
    ) -> None:
        content = self._contents.get(item)
        if content is not None:
            out.write_bytes(_content_at(content, moment, random))
            return
        out.mkdir()
        for name, target in tree.get(item, {}).items():
            if target not in above:
                self._write(out / name, target, tree, moment, random, (*above, item))


def _content_at(content: Content, moment: int, random: Random) -> bytes:
    before = [each for each in content.synced if each[0] < moment]
    after = [data for at, data in content.synced if at >= moment]
    last, old = before[-1] if before else (-1, None)
    if old is not None and not any(last < each < moment for each in content.written):
        return old
    new = after[0] if after else None
    if old is None:
        size = _UNKNOWN_BYTES if new is None else len(new)
        some = [b'', bytes(size), *([] if new is None else [new, new[: size // 2]])]
        return random.choice(some)
    return random.choice([old, old if new is None else _mixed(old, new, random)])


def _mixed(old: bytes, new: bytes, random: Random) -> bytes:
    size = random.choice([len(old), len(new)])
    sources = (old.ljust(size, b'\0'), new.ljust(size, b'\0'))
    return b''.join(
        random.choice(sources)[start : min(start + _BLOCK, size)]
        for start in range(0, size, _BLOCK)
    )
