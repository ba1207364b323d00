# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A command opens every file of a recording once, and lists every folder once; or says why not."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import pytest

from kitti_ros2.model.streams import Layout

if TYPE_CHECKING:
    from pathlib import Path

AUDITED = """
import os, sys
from kitti_ros2.cli import main

log = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY | os.O_APPEND)  # forks write there, too

def note(event, args):
    if event in ('open', 'os.listdir', 'os.scandir') and not isinstance(args[0], (int, type(None))):
        os.write(log, f'{event}\\t{os.fspath(args[0])}\\n'.encode())

sys.addaudithook(note)
sys.exit(main(sys.argv[2:]))
"""
NUMBERED = {'.png', '.bin'}


class Reads(NamedTuple):
    """How often each file below a folder was opened, and each folder listed."""

    files: Counter[str]
    folders: Counter[str]

    def of_data(self) -> Counter[str]:
        """Those of images and scans."""
        suffixes = tuple(NUMBERED)
        return Counter({path: n for path, n in self.files.items() if path.endswith(suffixes)})


@pytest.fixture
def reads(tmp_path):
    """A function that runs a command and returns its reads below a folder."""

    def run(folder: Path, *words: object) -> Reads:
        log = tmp_path / 'reads.log'
        command = [sys.executable, '-c', AUDITED, log, *words]
        subprocess.run([str(each) for each in command], check=True, capture_output=True)
        found = Reads(Counter(), Counter())
        for line in log.read_text().splitlines():
            event, _, path = line.partition('\t')
            if path.startswith(str(folder)):
                (found.files if event == 'open' else found.folders)[path] += 1
        return found

    return run


def data_files(folder: Path) -> set[str]:
    return {str(path) for path in folder.rglob('*') if path.suffix in NUMBERED}


def repeated(counts: Counter[str], most: int = 1) -> dict[str, int]:
    """What was done more often; the first scan is opened once more, to check its columns."""
    return {
        path: count for path, count in counts.items() if count > most + path.endswith('000000.bin')
    }


@pytest.mark.one_in(3)
@pytest.mark.parametrize('images', ['compressed', 'both'])
def test_to_bag(recording_path, reads, tmp_path, images):
    words = ('to-bag', recording_path, tmp_path / 'o.mcap', '-q', '--images', images)
    found = reads(recording_path, *words)
    assert found.of_data().keys() == data_files(recording_path)
    # Threads may ask for the size of a camera's images before its first one is decoded, and two at
    # once for the calibration of a frame.
    asked = {path for path in found.files if path.endswith('000000.png') or '/calib/' in path}
    assert repeated(found.files).keys() <= (asked if images == 'both' else set())
    assert not repeated(found.files, 2)
    assert repeated(found.folders) == {str(recording_path): 2}  # it may be a bag


def test_to_bag_on_processes(recording_path, reads, tmp_path):
    words = ('to-bag', recording_path, tmp_path / 'o.mcap', '-q', '--jobs', '2')
    found = reads(recording_path, *words)
    assert found.of_data().keys() == data_files(recording_path)
    # Each process needs the size of a camera's images; packets are needed for the path as well;
    # the samples of a frame may be in two runs.
    data = {path: n for path, n in found.of_data().items() if not path.endswith('000000.png')}
    assert not repeated(Counter(data))
    assert not repeated(found.files, 2)
    assert repeated(found.folders) == {str(recording_path): 2}  # it may be a bag


@pytest.mark.one_in(3)
@pytest.mark.parametrize('command', ['info', 'validate'])
def test_reports(recording_path, reads, command):
    found = reads(recording_path, command, recording_path)
    assert found.files
    assert not repeated(found.files)
    # It may be a bag: then it holds metadata.yaml.
    most = 2 if command == 'info' or recording_path.name != 'object' else 3
    assert not repeated(found.folders, most)
    below = {path: n for path, n in found.folders.items() if path != str(recording_path)}
    if recording_path.name != 'object':  # a set has rules of its own for the lists of its files
        assert not repeated(Counter(below))


def test_a_collection(recordings, reads, tmp_path):
    """The fingerprint has names from one listing, sizes and times from another."""
    drive = recordings[Layout.RAW]
    root = drive.parent.parent
    words = ('to-bag', root, tmp_path / 'bags', '--all', '--jobs', '1', '-q')
    found = reads(root, *words)
    assert found.of_data().keys() == data_files(root)
    assert not repeated(found.of_data())
    assert not repeated(found.files, 2)
    assert not repeated(found.folders, 3)


def test_the_path_of_a_long_drive_reads_its_packets_once(make_drive, reads, tmp_path):
    drive = make_drive(80)
    words = ('to-bag', drive, tmp_path / 'o.mcap', '-q', '--streams', 'oxts', 'pose', 'path')
    found = reads(drive, *words)
    assert sum('/oxts/data/' in path for path in found.files) == 80
    assert not repeated(found.files)
