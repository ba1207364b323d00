# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An object set is continued wholly or not at all, by killed processes and full disks too."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import sys
from collections.abc import Callable
from enum import Enum
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from kitti_ros2.cli import main
from kitti_ros2.files.staging import staged
from kitti_ros2.kitti.append import appended, mend, next_number
from kitti_ros2.kitti.object_set import COMMITTED, FOLDER, JOURNAL, find_journal, parse_journal
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.store import STORE
from kitti_ros2.model.errors import (
    BadFileError,
    KittiRos2Error,
    NotDurableError,
    OutputError,
    OutputExistsError,
    UsageError,
)
from kitti_ros2.model.streams import Stream

OLD = (3, 7)  # with a hole, and not from 0
NEW = (8, 9)
POINT = np.float32([4, 2, -1, 0.5]).tobytes()
STREAMS = ('velodyne/{:06d}.bin', 'calib/{:06d}.txt')
APPENDED = (*STREAMS, 'image_3/{:06d}.png')


def write_old(out: Path) -> None:
    """A set of somebody's, with an unusual list and no end of line at the end of another."""
    for number in OLD:
        for name in STREAMS:
            path = out / 'training' / name.format(number)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(b'\0' * 16 if path.suffix == '.bin' else f'old {number}\n'.encode())
    (out / 'ImageSets').mkdir()
    (out / 'ImageSets/train.txt').write_text('000003\n000007')
    (out / 'ImageSets/mini.txt').write_text('000007\n')


def build(stage: Path, first: int) -> None:
    """What a run writes: frames, and all four lists."""
    numbers = (first, first + 1)
    for number in numbers:
        for name in APPENDED:
            path = stage / 'training' / name.format(number)
            STORE.write(path, POINT if path.suffix == '.bin' else f'new {number}\n'.encode())
    listed = ''.join(f'{number:06d}\n' for number in numbers)
    for name, text in {'train': listed, 'trainval': listed, 'val': '', 'test': ''}.items():
        STORE.write_text(stage / f'ImageSets/{name}.txt', text)


def append(out: Path) -> tuple[str, ...]:
    with appended(out, 'training') as place:
        build(place.stage, place.first)
    return place.notes


def tree(out: Path) -> dict[str, bytes | None]:
    """Every file and folder with its content, hidden ones too."""
    return {
        path.relative_to(out).as_posix(): path.read_bytes() if path.is_file() else None
        for path in out.rglob('*')
    }


def visible(out: Path) -> dict[str, bytes | None]:
    return {name: content for name, content in tree(out).items() if not name.startswith(FOLDER)}


@pytest.fixture
def made(tmp_path):
    """A set before, and copies of it after one append and after two."""
    trees = [tmp_path / name / 'set' for name in ('before', 'once', 'twice')]
    write_old(trees[0])
    for earlier, later in pairwise(trees):
        shutil.copytree(earlier, later)
        append(later)
    return trees


def test_frames_are_appended_and_the_lists_continued(made):
    before, once, _ = made
    assert next_number(before, 'training') == NEW[0]
    assert (once / 'ImageSets/train.txt').read_text() == '000003\n000007\n000008\n000009\n'
    assert (once / 'ImageSets/trainval.txt').read_text() == '000008\n000009\n'
    assert (once / 'ImageSets/mini.txt').read_text() == '000007\n'
    assert (once / 'training/image_3/000009.png').is_file()
    assert {name for name in tree(once) if name.startswith('.')} == set()
    assert {name: tree(once)[name] for name in tree(before) if 'train.txt' not in name} == {
        name: content for name, content in tree(before).items() if 'train.txt' not in name
    }


Condition = Callable[[], bool]


class Full(Enum):
    """What a full disk refuses from some call on: new directory entries, or every rename too."""

    NO_NEW_ENTRY = 'no new entry'
    NO_RENAME = 'no rename'


class Fault:
    """Counts the calls that reach the file system; at one of them, or when it is time, it acts.

    Python reports each call before it is made, whoever makes it (sys.addaudithook); writing has no
    such report, so the store's own call is wrapped, and a write that fails has written a half.
    """

    EVENTS = frozenset(
        {'open', 'os.mkdir', 'os.rename', 'os.remove', 'os.rmdir', 'os.scandir', 'os.listdir'}
        | {'fcntl.flock', 'shutil.rmtree'}
    )
    GROWING = frozenset({'os.mkdir', 'os.rename', 'write'})

    def __init__(self, root: Path, at: int, full: Full | None, is_time: Condition) -> None:
        self._root, self._at, self._full, self._is_time = str(root), at, full, is_time
        self._calls = 0
        self.active = True

    def install(self) -> None:
        sys.addaudithook(self.on_call)
        write = os.pwritev

        def pwritev(file, buffers, *rest):
            if self._is_due('write'):
                write(file, [b''.join(buffers)[: sum(map(len, buffers)) // 2]], *rest)
                self._fail()
            return write(file, buffers, *rest)

        os.pwritev = pwritev

    def on_call(self, event, args) -> None:
        if not self.active or event not in self.EVENTS:
            return
        place = args[0]
        if isinstance(place, (str, os.PathLike)) and not str(place).startswith(self._root):
            return
        kind = event
        if event == 'open' and isinstance(args[2], int) and args[2] & os.O_CREAT:
            kind = 'write'
        if self._full == Full.NO_NEW_ENTRY and event == 'os.rename' and Path(args[1]).exists():
            return
        if self._is_due(kind):
            self._fail()

    def _is_due(self, kind: str) -> bool:
        if self._full and kind not in self.GROWING:
            return False
        self._calls += 1
        if self._is_time():
            return True
        return self._calls > self._at if self._full else self._calls == self._at + 1

    def _fail(self) -> None:
        if self._full:  # and stays so: undoing must not need room
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os._exit(9)


COMPLETE, KILLED, REPORTED, NOT_UNDONE = 0, 9, 4, 5


def in_child(
    root: Path, at: int, run, full: Full | None = None, is_time: Condition = lambda: False
) -> int:
    """Run in a process of its own, that is killed at a call, or whose disk is full from there."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    code = 1
    try:
        fault = Fault(root, at, full, is_time)
        fault.install()
        run()
        code = COMPLETE
    except OutputError as error:
        code = REPORTED if 'disk is full' in str(error) else 1
    except KittiRos2Error as error:
        code = NOT_UNDONE if 'undoes it before it begins' in str(error) else 1
    finally:
        os._exit(code)


def assert_lists_name_whole_frames(out: Path) -> None:
    """What loaders of others rely on: they read the lists, and open what these name."""
    for path in (out / 'ImageSets').glob('*.txt'):
        for name in path.read_text().split():
            wanted = STREAMS if int(name) in OLD else APPENDED
            assert all((out / 'training' / each.format(int(name))).is_file() for each in wanted)


def assert_readers_see(out: Path, numbers: tuple[int, ...]) -> None:
    """Our own reader takes the frames of before or of after, and the lists that go with them."""
    recording = open_recording(out)
    for stream in (Stream.SCAN, Stream.CALIBRATION):
        assert tuple(recording.streams[stream].numbers.tolist()) == numbers
    texts = {file.name: file.text for file in recording.describe().files}
    listed = {int(word) for name, text in texts.items() for word in text.split()}
    assert listed == set(numbers)
    if numbers == OLD:
        assert texts['ImageSets/train.txt'] == '000003\n000007'
        assert set(texts) == {'ImageSets/train.txt', 'ImageSets/mini.txt'}


def interrupted(before: Path, out: Path, last_moved: str) -> None:
    """Kill an append at its first call after it has moved a file."""
    shutil.copytree(before, out)

    def size(path: Path) -> int | None:
        return path.stat().st_size if path.exists() else None

    earlier = size(out / last_moved)
    code = in_child(
        out, sys.maxsize, lambda: append(out), is_time=lambda: size(out / last_moved) != earlier
    )
    assert code == KILLED
    assert tree(out).get(last_moved) != tree(before).get(last_moved)


def test_what_was_done_about_an_interrupted_append_is_said(made, tmp_path, capsys):
    before, once, _ = made
    out = tmp_path / 'out'
    interrupted(before, out, 'training/velodyne/000008.bin')
    assert main(['info', str(out)]) == 1
    said = capsys.readouterr()
    assert 'frames 8 are of an append that is not complete' in said.err
    assert main(['to-bag', str(out), str(tmp_path / 'o.mcap'), '-q']) == 1
    assert 'to-kitti --append removes them' in capsys.readouterr().err
    [note] = append(out)
    assert 'an append that was interrupted has been undone, and frames 8-9 removed again' in note
    assert tree(out) == tree(once)


def test_a_second_append_at_the_same_time_is_refused(made):
    out = made[0]
    with appended(out, 'training') as place:
        build(place.stage, place.first)
        for second in (append, mend):
            code = in_child(out, sys.maxsize, lambda run=second: refused(run, out))
            assert code == COMPLETE
    assert tree(out) == tree(made[1])
    folder = os.open(out, os.O_RDONLY)
    fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(folder)


def refused(run, out):
    with pytest.raises(OutputError, match='another run is writing this'):
        run(out)


def test_a_failure_while_building_leaves_the_set_as_it_was(made):
    out = made[0]
    before = tree(out)

    def fail():
        with appended(out, 'training') as place:
            build(place.stage, place.first)
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert tree(out) == before


@pytest.mark.parametrize(
    'linked',
    [
        'training',
        'training/velodyne',
        'training/calib/000003.txt',
        'ImageSets',
        'ImageSets/train.txt',
    ],
)
def test_links_are_not_followed(made, tmp_path, linked):
    out = made[0]
    elsewhere = tmp_path / 'elsewhere'
    (out / linked).rename(elsewhere)
    (out / linked).symlink_to(elsewhere)
    before = tree(tmp_path)
    with pytest.raises(UsageError, match='is a symbolic link') as caught:
        append(out)
    assert str(caught.value).startswith(f'{out / linked}: ')
    assert tree(tmp_path) == before


def test_a_link_to_the_set_is_refused(made, tmp_path):
    link = tmp_path / 'link'
    link.symlink_to(made[0])
    with pytest.raises(OutputExistsError, match='give the path it points to'):
        append(link)


def test_a_link_in_an_interrupted_set_is_not_followed_either(made, tmp_path):
    out = made[0]
    foreign = tmp_path / 'foreign'
    foreign.mkdir()
    (foreign / '000008.bin').write_text('kept')
    (out / 'training/velodyne').rename(tmp_path / 'velodyne')
    (out / 'training/velodyne').symlink_to(foreign)
    (out / FOLDER / 'content').mkdir(parents=True)
    (out / FOLDER / JOURNAL).write_text(
        json.dumps(
            {
                'version': 1,
                'split': 'training',
                'files': ['training/velodyne/000008.bin'],
                'lists': [],
                'folders': [],
            }
        )
    )
    with pytest.raises(UsageError, match='is a symbolic link'):
        mend(out)
    assert (foreign / '000008.bin').read_text() == 'kept'


@pytest.mark.parametrize(
    'text',
    [
        '',
        '[]',
        '{"version": 2}',
        '{"version": 1, "split": "..", "files": [], "lists": [], "folders": []}',
        '{"version": 1, "split": "training", "files": ["/etc/passwd"], "lists": [], "folders": []}',
        '{"version":1, "split":"training", "files":["training/../x"], "lists":[], "folders":[]}',
        '{"version": 1, "split": "training", "files": [7], "lists": [], "folders": []}',
        '[' * 100_000,
    ],
)
def test_a_journal_that_is_none_is_refused_and_named(made, text, capsys):
    out = made[0]
    with pytest.raises(BadFileError, match='expected the journal of an append'):
        parse_journal(text, 'j')
    (out / FOLDER).mkdir()
    (out / FOLDER / JOURNAL).write_text(text)
    before = tree(out)
    with pytest.raises(BadFileError):
        append(out)
    assert tree(out) == before
    assert main(['info', str(out)]) == 1
    assert 'journal.json: ' in capsys.readouterr().err


def test_a_folder_that_is_not_ours_is_left_alone(made):
    out = made[0]
    (out / FOLDER).mkdir()
    (out / FOLDER / 'holiday.jpg').touch()
    with pytest.raises(OutputExistsError, match=r'it holds holiday\.jpg; move it away'):
        append(out)
    assert (out / FOLDER / 'holiday.jpg').exists()


def test_a_frame_is_never_replaced(made):
    out = made[0]

    def clash():
        with appended(out, 'training') as place:
            build(place.stage, place.first)
            (out / 'training/velodyne/000009.bin').write_text('somebody else')

    with pytest.raises(OutputExistsError, match='another program wrote it'):
        clash()
    (out / 'training/velodyne/000009.bin').unlink()
    assert visible(out) == tree(out)
    assert next_number(out, 'training') == NEW[0]


def test_undoing_that_fails_is_said(made, monkeypatch):
    """Never by itself: here, a folder of the set is taken away meanwhile."""
    out = made[0]
    rename = Path.rename

    def break_down(path, target):
        if Path(target).name == 'trainval.txt':
            (out / 'training/calib').rename(out / 'aside')
            (out / 'training/calib').symlink_to(out / 'aside')
            raise OSError(errno.EIO, 'gone')
        return rename(path, target)

    monkeypatch.setattr(Path, 'rename', break_down)
    with pytest.raises(KittiRos2Error):
        append(out)
    assert find_journal(out) is not None


@pytest.mark.parametrize('exists', [False, True])
def test_appending_to_nothing_begins_at_0(tmp_path, exists):
    out = tmp_path / 'out'
    if exists:
        out.mkdir()
    append(out)
    assert sorted(path.name for path in (out / 'training/velodyne').iterdir()) == [
        '000000.bin',
        '000001.bin',
    ]
    with pytest.raises(OutputExistsError), staged(out):
        pass


def test_what_is_no_object_set_is_not_appended_to(tmp_path):
    (tmp_path / 'out/holiday').mkdir(parents=True)
    (tmp_path / 'file').write_text('kept')
    with pytest.raises(UsageError, match='no object set'):
        append(tmp_path / 'out')
    with pytest.raises(OutputExistsError, match='no folder'):
        append(tmp_path / 'file')
    assert sorted(tree(tmp_path)) == ['file', 'out', 'out/holiday']


def test_frames_whose_commit_is_not_confirmed_are_in_the_set(made, monkeypatch):
    out = made[0]
    first = next_number(out, 'training')

    def refuse(folders):
        if (out / FOLDER / COMMITTED).exists() and [*folders] == [out / FOLDER]:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr('kitti_ros2.kitti.append.sync_folders', refuse)
    with pytest.raises(NotDurableError, match='is complete, but the disk does not confirm'):
        append(out)
    assert next_number(out, 'training') == first + 2
    assert not (out / FOLDER).exists()


@pytest.mark.parametrize('error', [MemoryError(), OSError(errno.EIO, os.strerror(errno.EIO))])
def test_what_cannot_be_cleared_after_a_commit_is_left_to_the_next_run(made, monkeypatch, error):
    out = made[0]
    first = next_number(out, 'training')

    def refuse(*_):
        raise error

    with monkeypatch.context() as broken:
        broken.setattr('kitti_ros2.kitti.append.parse_journal', refuse)
        append(out)
    assert next_number(out, 'training') == first + 2
    assert (out / FOLDER / COMMITTED).exists()
    assert 'had been complete' in mend(out)[0]
    assert visible(out) == tree(out)
