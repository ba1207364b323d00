# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One fault at one call of a command: what it leaves, what it says, and what the next run makes."""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING

from kitti_ros2.batch.manifest import MANIFEST
from kitti_ros2.kitti.object_set import FOLDER, JOURNAL

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from fault_cases import Case, Fault
    from fork_server import ForkServer, Run

    Tree = Mapping[str, bytes | None]

_NEVER_SAID = re.compile(
    r'Traceback|internal error|Exception ignored|Warning|Error\b.*Error\b|Errno', re.IGNORECASE
)
_NOTHING_LEFT = ('nothing was left behind', 'no incomplete output is left behind')
_TOKEN = re.compile(r'(?<=content-)[0-9a-f]{8}')
RECORD = 'out/archives/extracted.json'
_JOURNAL = f'out/{FOLDER}/{JOURNAL}'  # the next run undoes what it lists
_KILLED = -9
_TERMINATED = 143
_REFUSED = 2
_LOSSES = 1


@dataclass(frozen=True)
class Finding:
    """Something that a fault point should not do.

    Attributes:
        case: The command.
        fault: What went wrong.
        call: At which call.
        what: What was found.
    """

    case: str
    fault: str
    call: int
    what: str

    def __str__(self) -> str:
        """Return the finding as a line."""
        return f'{self.case}, {self.fault} at call {self.call}: {self.what}'


def tree_of(folder: Path) -> dict[str, bytes | None]:
    """The files and folders below a folder with their content, hidden ones too."""
    found: dict[str, bytes | None] = {}
    for place, folders, files in os.walk(folder):
        start = f'{place}/'.removeprefix(f'{folder}/')
        found |= {f'{start}{name}': None for name in folders}
        for name in files:
            with open(f'{place}/{name}', 'rb') as file:  # noqa: PTH123 - thousands of files
                found[f'{start}{name}'] = file.read()
    return dict(sorted(found.items()))


def _is_shown(name: str) -> bool:
    parts = name.split('/')
    return not any(part.startswith('.') or part.endswith(('.part', '.part.json')) for part in parts)


def shown(tree: Tree) -> dict[str, bytes | None]:
    """Leave out hidden files, downloads in progress and the manifest, which records times.

    The record of archives has them in the order in which they were extracted.
    """
    found = {
        name: data
        for name, data in tree.items()
        if _is_shown(name) and not name.rpartition('/')[2].startswith(MANIFEST)
    }
    if record := found.get(RECORD):
        found[RECORD] = b' '.join(sorted(record.replace(b',', b'').split()))
    return found


def hidden(tree: Tree) -> list[str]:
    """Return what a user should not find: names that are hidden or in progress."""
    return [name for name in tree if not _is_shown(name)]


class Bench:
    """A command with its source, and what undisturbed runs of it make.

    Args:
        name: The command's name.
        case: The command.
        server: Runs it.
        work: An empty folder; its path occurs in no other file's.
    """

    def __init__(self, name: str, case: Case, server: ForkServer, work: Path) -> None:
        self.name = name
        self._case = case
        self._server = server
        self._work = work
        self._kept = work.with_name(f'{work.name}-kept')
        self._tmp, self._out = work / 'tmp', work / 'place'
        (work / 'source').mkdir(parents=True)
        self._source = case.prepare(work / 'source')
        self._sources = tree_of(work / 'source')
        self._known: dict[object, list[str]] = {}
        self._empty()
        self._kept.mkdir()
        self._learn()
        if case.before:
            assert self._run_clean(case.before).code == 0
        shutil.copytree(self._out, self._kept / 'before')
        self._before = tree_of(self._out)
        first = self._run_clean()
        assert first.code in {0, _LOSSES}, first
        self._code, self._after = first.code, tree_of(self._out)
        second = self._run_clean(case.words)
        self._again_code, self._again = second.code, tree_of(self._out)
        assert self._sources == tree_of(work / 'source')

    def calls(self, fault: Fault) -> int:
        """Return how many calls of an undisturbed run a fault may strike."""
        self._reset()
        calls = self._run(self._case.words, fault, 0).calls
        assert calls is not None
        return calls

    def check(self, fault_name: str, fault: Fault, call: int) -> Iterator[Finding]:
        """Let a call fail; yield what is wrong with the end of the run, and of the next."""
        self._reset()
        run = self._run(self._case.words, fault, call)
        left = tree_of(self._out)
        found = [*self._check_end(run, left, fault), *self._check_next(left, run, fault)]
        if found:
            end = f'(exit code {run.code}, it says: {run.complaints.strip() or "nothing"})'
            yield Finding(self.name, fault_name, call, f'{"; ".join(found)} {end}')

    def _check_end(self, run: Run, left: Tree, fault: Fault) -> Iterator[str]:
        yield from self._check_source(fault)
        if run.code is None:
            yield 'it does not end'
        elif run.code == _KILLED:
            if fault.do != 'self':
                yield 'it was killed'
        elif run.code not in {0, _LOSSES, _REFUSED, _TERMINATED}:
            yield f'exit code {run.code}'
        yield from self._check_words(run, left)
        if _JOURNAL in left:
            yield from self._check_half_appended(run, shown(left))
        else:
            yield from self._check_left(run, shown(left), fault)
        # A fault that lets removing or undoing fail leaves something; what is said is checked.
        is_orderly = run.code in {_LOSSES, _REFUSED, _TERMINATED} and not fault.hits_removing
        if is_orderly and _JOURNAL not in left and not self._case.gradual and self._leftovers(left):
            yield f'it leaves {self._leftovers(left)}'

    def _check_words(self, run: Run, left: Tree) -> Iterator[str]:
        lines = run.complaints.splitlines()
        if _NEVER_SAID.search(run.complaints):
            yield 'no such words'
        if run.code == _REFUSED and (
            not lines or not lines[-1].startswith('kitti-ros2: ') or len(lines) > 1
        ):
            yield f'{len(lines)} lines'
        if run.code == _REFUSED and len(lines) == 1 and re.search(r': *$', lines[0]):
            yield 'an empty reason'
        if run.code == _LOSSES and not lines:
            yield 'losses are not listed'
        if run.code == 0 and lines:
            yield 'complaints of a success'
        if any(words in run.complaints for words in _NOTHING_LEFT) and (
            self._leftovers(left) or (shown(left) != shown(self._before) and not self._case.gradual)
        ):
            yield f'something was left behind: {self._leftovers(left)}'

    def _check_left(self, run: Run, left: Tree, fault: Fault) -> Iterator[str]:
        before, after = shown(self._before), shown(self._after)
        if self._case.gradual:
            changed = fault.is_of_sources or run.code == _LOSSES
            sources = {name.rpartition('/')[2]: data for name, data in self._sources.items()}
            whole = {**sources, **after}
            bad = [
                name for name, data in left.items()
                if name != RECORD and not (changed and name not in after)
                and whole.get(name, whole.get(name.rpartition('/')[2], b'?')) != data
            ]  # fmt: skip
            if bad and not changed:
                yield f'files that are not as they should be: {bad}'
            if run.code == 0 and left != after and not changed:
                yield 'a success that is incomplete'
        elif run.code == 0 and not fault.is_of_sources:
            if left != after or self._code != 0:
                yield 'a success that is incomplete'
        elif run.code == _LOSSES and fault.calls == 'change':
            if left != after or self._code != _LOSSES:
                yield 'a fault of the output cost data'
        elif run.code not in {0, _LOSSES} and left not in (before, after):
            yield f'an output that is neither old nor complete: {[*left][:5]}'

    def _check_half_appended(self, run: Run, left: Tree) -> Iterator[str]:
        """Some new frames are in their places: whole ones, and no list names one that is not."""
        before, after = shown(self._before), shown(self._after)
        if before.keys() - left.keys():
            yield f'files of before are gone: {[*before.keys() - left.keys()][:5]}'
        known = {name: [tree.get(name, b'?') for tree in (before, after)] for name in left}
        if any(data not in known[name] for name, data in left.items()):
            yield 'files that are neither old nor whole'
        is_listed = any(left[name] != before[name] for name in before if name in left)
        if is_listed and after.keys() - left.keys():
            yield f'listed, but absent: {[*after.keys() - left.keys()][:5]}'
        if run.code != _KILLED and 'undoes it' not in run.complaints:
            yield 'that frames are to be removed is not said'

    def _check_source(self, fault: Fault) -> Iterator[str]:
        if not fault.is_of_sources and tree_of(self._work / 'source') != self._sources:
            yield 'the source has changed'

    def _check_next(self, left: Tree, run: Run, fault: Fault) -> Iterator[str]:
        """Run again without faults; all is as if nothing had happened."""
        self._restore_source()
        differs = shown(left) not in (shown(self._before), shown(self._after))
        if differs and (fault.is_of_sources or (run.code == _LOSSES and not self._case.gradual)):
            return  # by what is listed as lost
        is_done = shown(left) == shown(self._after) != shown(self._before)
        if is_done and not self._case.gradual and _JOURNAL not in left:
            code, expected = self._again_code, self._again
        else:
            code, expected = self._code, self._after
        yield from self._run_next(left, code, expected)

    def _run_next(self, left: Tree, code: int | None, expected: Tree) -> list[str]:
        """Run again, unless it was done from the very same state before."""
        state = code, *((_TOKEN.sub('', name), data) for name, data in left.items())
        if any(MANIFEST in name for name in left) or any(self._tmp.iterdir()):
            return [*self._check_again(code, expected)]
        if state not in self._known:
            self._known[state] = [*self._check_again(code, expected)]
        return self._known[state]

    def _check_again(self, code: int | None, expected: Tree) -> Iterator[str]:
        again = self._run_clean((*self._case.words, *self._case.retry))
        now = tree_of(self._out)
        if again.code != code:
            yield f'run again: exit code {again.code}, not {code}: {again.complaints.strip()}'
        if shown(now) != shown(expected):
            names = [n for n in {**now, **expected} if now.get(n, 0) != expected.get(n, 0)]
            yield f'run again: another output: {[n for n in names if MANIFEST not in n][:5]}'
        if leftovers := self._leftovers(now):
            yield f'run again: leaves {leftovers}'

    def _learn(self) -> None:
        """Prepare the server, with a copy of the source."""
        copy = self._kept / 'source'
        shutil.copytree(self._work / 'source', copy)
        source = copy / self._source.relative_to(self._work / 'source')
        (self._kept / 'learned').mkdir()
        words = self._case.words
        given = {'source': source, 'out': self._kept / 'learned' / 'out'}
        self._server.learn([word.format(**given) for word in words], self._tmp)

    def _leftovers(self, tree: Tree) -> list[str]:
        return [*hidden(tree), *(f'TMPDIR/{each.name}' for each in self._tmp.iterdir())]

    def _words(self, words: tuple[str, ...]) -> list[str]:
        given = {'source': self._source, 'out': self._out / 'out'}
        return [word.format(**given) for word in words]

    def _run(self, words: tuple[str, ...], fault: Fault, call: int) -> Run:
        return self._server.run(self._words(words), fault.variables(self._work, call), self._tmp)

    def _run_clean(self, words: tuple[str, ...] | None = None) -> Run:
        return self._server.run(self._words(words or self._case.words), {}, self._tmp)

    def _empty(self) -> None:
        for folder in (self._out, self._tmp):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()

    def _reset(self) -> None:
        self._empty()
        if self._before:
            shutil.copytree(self._kept / 'before', self._out, dirs_exist_ok=True)
        self._restore_source()

    def _restore_source(self) -> None:
        now = tree_of(self._work / 'source')
        for name, data in self._sources.items():
            if data is not None and now.get(name) != data:
                (self._work / 'source' / name).write_bytes(data)
