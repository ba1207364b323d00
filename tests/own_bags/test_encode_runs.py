# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One recording encoded on several processes: the bag, the losses and the notes of one process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from kitti_ros2.cli import main
from kitti_ros2.files.processes import SharedSlots
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import KittiRos2Error, UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.options.table import split_batch_options
from kitti_ros2.own_bags import to_bag
from kitti_ros2.own_bags.encode import Encoder
from kitti_ros2.own_bags.schedule import make_schedule
from kitti_ros2.own_bags.to_bag import RunEncoder

from builders import convert_recording, files_of  # isort: skip
from waiting import PATIENCE_S  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

BAGS = {
    'mcap': ('out.mcap', {}),
    'mcap zstd': ('out.mcap', {'compression': 'zstd'}),
    'mcap by size': ('out', {'compression': 'lz4', 'split_size': 1_000_000}),
    'mcap by time': ('out', {'split_duration_ns': 200_000_000}),
    'sqlite3': ('out', {'storage': 'sqlite3'}),
    'sqlite3 zstd': ('out', {'storage': 'sqlite3', 'compression': 'zstd'}),
    'ros1': ('out.bag', {'storage': 'ros1'}),
    'ros1 by size': ('out', {'storage': 'ros1', 'split_size': 1_000_000}),
}


@pytest.fixture(autouse=True)
def forks(monkeypatch):
    """The starts of processes; they are started although a test runner may have threads."""
    started = []
    before = set(multiprocessing.active_children())
    forked = to_bag.forked
    monkeypatch.setattr(to_bag, 'forked', lambda *given: (started.append(given), forked(*given))[1])
    monkeypatch.setattr(to_bag, 'can_fork', lambda: True)
    yield started
    assert set(multiprocessing.active_children()) <= before


def same_for_any_number_of_jobs(source: Path, folder: Path, name: str, *args, **options):
    """Convert on one process and on several, compare, and return the report."""
    reports, found = [], []
    for jobs in (1, 2, 3):
        out = folder / str(jobs) / name
        out.parent.mkdir()
        reports.append(convert_recording(source, out, *args, jobs=jobs, **options))
        found.append(files_of(out.parent))
    assert found[0]
    assert found[1:] == found[:-1]
    plain = [replace(each, path=folder) for each in reports]
    assert plain[1:] == plain[:-1]
    return reports[0]


@pytest.mark.one_in(3)
@pytest.mark.parametrize('images', list(Images))
def test_every_layout(recording_path, tmp_path, images, forks):
    messages = MessageOptions(images=images)
    same_for_any_number_of_jobs(recording_path, tmp_path, 'out.mcap', messages)
    assert [given[2] for given in forks] == [2, 3]


@pytest.mark.one_in(3)
@pytest.mark.parametrize('case', BAGS)
def test_every_container(recordings, tmp_path, case):
    name, options = BAGS[case]
    same_for_any_number_of_jobs(recordings[Layout.RAW], tmp_path, name, **options)


def test_holes_and_damaged_files_are_the_same_losses(drive, tmp_path):
    scans, images = drive / 'velodyne_points/data', drive / 'image_02/data'
    (scans / '0000000002.bin').unlink()
    (scans / '0000000003.bin').write_bytes(b'not of 16 bytes')
    (images / '0000000001.png').write_bytes(b'no PNG')
    (drive / 'oxts/data/0000000000.txt').write_text('no numbers')
    messages = MessageOptions(images=Images.BOTH)
    report = same_for_any_number_of_jobs(drive, tmp_path, 'out.mcap', messages)
    texts = ' '.join(loss.text() for loss in report.losses)
    assert '0000000003.bin' in texts
    assert '0000000001.png' in texts
    assert 'map begins at frame 1' in texts


def test_remarks_of_workers_become_notes(recordings, tmp_path):
    path = recordings[Layout.ODOMETRY]
    assert same_for_any_number_of_jobs(path, tmp_path, 'out.mcap').notes


def test_with_strict_the_same_loss_stops(drive, tmp_path):
    (drive / 'image_02/data/0000000001.png').write_bytes(b'no PNG')
    errors = []
    for jobs in (1, 2):
        with pytest.raises(KittiRos2Error) as error:
            convert_recording(drive, tmp_path / 'out.mcap', strict=True, jobs=jobs)
        errors.append(str(error.value))
    assert errors[0] == errors[1]
    assert not list(tmp_path.glob('*out*'))


def test_a_run_that_does_not_fit_into_shared_memory(recordings, tmp_path, monkeypatch):
    monkeypatch.setattr(to_bag, '_SLOT_BYTES', 100_000)
    messages = MessageOptions(images=Images.BOTH)
    same_for_any_number_of_jobs(recordings[Layout.RAW], tmp_path, 'out.mcap', messages)


def test_a_run_is_pickled_and_its_large_buffers_are_not(recordings, monkeypatch):
    monkeypatch.setattr(to_bag, 'limit_to_one_thread', lambda: None)  # this is no worker
    recording = open_recording(recordings[Layout.RAW])
    schedule = make_schedule(recording, SelectionOptions())
    encoder = Encoder(recording, schedule, MessageOptions(), SelectionOptions())
    run = RunEncoder(encoder, recording, schedule)
    slots = SharedSlots(1 << 24)
    packed = slots.pack(run(0), lambda: pytest.fail('no slot is free'))
    assert len(packed.pickled) < 40_000 < packed.ends[-1]
    taken = slots.take(packed)
    slots.close()
    expected = [encoder.encode(entry) for entry in schedule.part(0, len(taken.outcomes))]
    joined = [[message.data for message in messages] for messages, _ in taken.outcomes]
    assert joined == [[message.data for message in messages] for messages, _ in expected]


@pytest.fixture
def on_third_sample(monkeypatch):
    """A function that sets what a worker does at the third sample that it encodes."""
    parent, encode, calls = os.getpid(), Encoder.encode, []

    def set_act(act):
        def encode_or_act(self, entry, active=None):
            calls.append(entry)
            if os.getpid() != parent and len(calls) == 3:
                act(parent)
            return encode(self, entry, active)

        monkeypatch.setattr(Encoder, 'encode', encode_or_act)

    return set_act


def test_a_killed_worker_is_one_line_and_leaves_nothing(
    recordings, tmp_path, capsys, on_third_sample
):
    on_third_sample(lambda _: os.kill(os.getpid(), signal.SIGKILL))
    out = tmp_path / 'out.mcap'
    assert main(['to-bag', str(recordings[Layout.RAW]), str(out), '-q', '--jobs', '2']) == 2
    error = 'kitti-ros2: a worker process was killed by signal 9; is there enough memory?\n'
    assert capsys.readouterr().err == error
    assert not list(tmp_path.iterdir())


INTERRUPTED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run with &
from kitti_ros2.own_bags.encode import Encoder
parent, encode, calls = os.getpid(), Encoder.encode, []

def encode_or_interrupt(self, entry, active=None):
    calls.append(entry)
    if os.getpid() != parent and len(calls) == 1:  # so that all the rest is still to be done
        os.kill(os.getpid(), signal.SIGINT)  # as a terminal does; a worker ignores it
        try:
            os.close(os.open(sys.argv[1], os.O_CREAT | os.O_EXCL))  # by one worker only
        except FileExistsError:
            pass
        else:
            os.kill(parent, signal.SIGINT)
    return encode(self, entry, active)

Encoder.encode = encode_or_interrupt
from kitti_ros2.cli import main
sys.exit(main(sys.argv[2:]))
"""


def test_an_interrupt_is_one_line_and_leaves_nothing(recordings, tmp_path):
    """In a process of its own: threads of a test runner would take the signal."""
    out = tmp_path / 'bags' / 'out'
    out.parent.mkdir()
    words = [str(recordings[Layout.RAW]), str(out), '-q', '--storage', 'sqlite3', '--jobs', '3']
    run = subprocess.run(
        [sys.executable, '-c', INTERRUPTED, str(tmp_path / 'interrupted'), 'to-bag', *words],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert run.returncode == 130, run.stderr
    (line,) = run.stderr.splitlines()
    assert line.startswith('kitti-ros2: interrupted')
    assert not list(out.parent.iterdir())


def test_a_program_with_threads_converts_without_processes(
    recordings, tmp_path, monkeypatch, forks
):
    monkeypatch.setattr(to_bag, 'can_fork', lambda: False)
    assert convert_recording(recordings[Layout.RAW], tmp_path / 'out.mcap', jobs=4).counts
    assert not forks


@pytest.mark.parametrize('jobs', ['0', '257'])
def test_a_number_of_jobs_out_of_range(recordings, tmp_path, jobs, capsys):
    words = ['to-bag', str(recordings[Layout.RAW]), str(tmp_path / 'o.mcap'), '--jobs', jobs]
    assert main(words) == 2
    assert f'--jobs {jobs} is out of range; expected 1 to 256' in capsys.readouterr().err


def test_jobs_alone_are_for_commands_that_encode():
    assert split_batch_options({'jobs': 3}, jobs_alone=True)[0].jobs == 3
    with pytest.raises(UsageError, match='--jobs is for whole collections; give --all too'):
        split_batch_options({'jobs': 3})
