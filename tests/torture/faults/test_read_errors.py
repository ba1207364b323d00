# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A read that fails once, anywhere: exit code 0 means that the bag is as without it."""

from __future__ import annotations

import errno
from dataclasses import replace
from itertools import count

import pytest

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.kitti.store import FileStore
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import MarkerOptions, MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program
from kitti_ros2.synthetic import write_synthetic

from builders import SMALL, convert_recording  # isort: skip

TINY = replace(SMALL, image_size=(62, 19), lidar_columns=20)
CASES = {
    f'{layout.value}{frames}': (layout, frames)
    for layout in Layout
    for frames in (2, 1)  # what cannot be read of a single frame, no other frame stands in for
}
TRAILS = MessageOptions(markers=MarkerOptions(trails=True))


@pytest.fixture(scope='module', params=CASES.values(), ids=CASES.keys())
def tiny(request, tmp_path_factory):
    layout, frames = request.param
    folder = tmp_path_factory.mktemp('tiny') / 'x'
    return write_synthetic(folder, layout, replace(TINY, frames=frames))


class Disk:
    """A disk that fails at one read or listing, and only at that."""

    def __init__(self, monkeypatch) -> None:
        self.fails_at = -1
        self.calls: list[str] = []
        for name in ('read', 'names', 'read_ends'):
            monkeypatch.setattr(FileStore, name, self._wrapped(getattr(FileStore, name)))

    def _wrapped(self, call):
        def wrapped(store, path, *rest):
            self.calls.append(str(path))
            if len(self.calls) - 1 == self.fails_at:
                raise OSError(errno.EIO, 'Input/output error', str(path))
            return call(store, path, *rest)

        return wrapped

    def fail_at(self, call: int) -> None:
        self.fails_at, self.calls = call, []

    def failed(self) -> str | None:
        """The path that could not be read."""
        return self.calls[self.fails_at] if self.fails_at < len(self.calls) else None


@pytest.fixture
def disk(monkeypatch):
    return Disk(monkeypatch)


def run(path, out, messages=TRAILS, **selection):
    report = convert_recording(path, out, messages, SelectionOptions(**selection))
    content = out.read_bytes()
    out.unlink()
    return content, report.losses


# What is left out must not be what names the error; images alone take their frame's calibration.
SELECTIONS = {
    'all': {},
    'poses': {'topics': ('/tf', '/kitti/ground_truth/odometry')},
    'path': {'topics': ('/kitti/ground_truth/path',)},
    'markers': {'topics': ('/kitti/labels/markers',)},
    'images': {'topics': ('*/compressed',)},
    'no calibration': {'streams': ('scan', 'pose', 'labels', 'path')},
}


@pytest.mark.parametrize('selection', list(SELECTIONS))
def test_a_read_that_fails_once_is_named_or_changes_nothing(tiny, disk, tmp_path, selection):
    chosen = SELECTIONS[selection]
    try:
        sound, losses = run(tiny, tmp_path / 'o.mcap', **chosen)
    except KittiRos2Error:
        pytest.skip('the layout has no such topic')
    assert losses == ()
    silent, refusals = [], []
    for call in count():
        disk.fail_at(call)
        try:
            found, losses = run(tiny, tmp_path / 'o.mcap', **chosen)
        except (KittiRos2Error, OSError) as error:
            refusals.append((disk.failed(), str(error)))
            continue
        failed = disk.failed()
        if failed is None:
            break
        if not losses and found != sound:
            silent.append((call, failed))
        assert not losses or any(failed in loss.text() for loss in losses), (failed, losses)
        assert not any('[Errno' in loss.text() for loss in losses)
    assert call > 5
    assert silent == []
    assert all(failed in said for failed, said in refusals)


def test_strict_stops_at_it_and_leaves_nothing(tiny, disk, tmp_path, capsys):
    words = ['to-bag', str(tiny), str(tmp_path / 'o.mcap'), '-q', '--trails', '--strict']
    for call in count(step=5):
        disk.fail_at(call)
        code = main(words)
        if disk.failed() is None:
            break
        if code == 2:
            assert disk.failed() in capsys.readouterr().err
            assert list(tmp_path.iterdir()) == []
        else:
            (tmp_path / 'o.mcap').unlink()


def test_playing_names_it_too(tiny, disk):
    settings = make_play_settings({'trails': True, 'images': 'compressed'})

    def play():
        program = open_program(tiny, settings)
        every = range(len(program.channels))
        fetched = [program.fetch(index, every) for index in range(len(program.stamps_ns))]
        return [due for due, _ in fetched], [*program.losses, *(m for _, ms in fetched for m in ms)]

    sound, losses = play()
    assert losses == []
    for call in count():
        disk.fail_at(call)
        try:
            found, losses = play()
        except (KittiRos2Error, OSError):
            continue
        if disk.failed() is None:
            break
        assert losses or found == sound, (call, disk.failed())


def break_packet(drive, number):
    path = drive / 'oxts' / 'data' / f'{number:010d}.txt'
    path.write_text('49.0 8.4\n')
    return path


def origin(out):
    with open_messages(out, ['/kitti/ground_truth/odometry']) as messages:
        item = next(iter(messages))
    place = deserialize(item.data, item.msgtype).pose.pose.position
    return place.x, place.y


@pytest.mark.parametrize('start', [None, '2'])
def test_an_origin_that_is_another_packet_s_is_named(drive, tmp_path, capsys, start):
    """Also where the packet itself is not asked for, and nobody else would miss it."""
    path = break_packet(drive, 0)
    words = ['to-bag', str(drive), str(tmp_path / 'o.mcap'), '-q']
    assert main([*words, '--start', start] if start else words) == 1
    said = capsys.readouterr().err
    assert f'{path}:1: 2 values; expected the 30 numbers of an oxts packet' in said
    assert 'map begins at frame 1 instead' in said


def test_info_names_a_calibration_that_cannot_be_read(tiny, disk, capsys):
    disk.fail_at(-1)
    assert main(['info', str(tiny)]) == 0
    calls = [index for index, path in enumerate(disk.calls) if '/calib' in path and '.txt' in path]
    assert calls
    for call in calls:
        disk.fail_at(call)
        assert main(['info', str(tiny)]) == 1
        assert disk.failed() in capsys.readouterr().err
    assert tiny.is_dir()
