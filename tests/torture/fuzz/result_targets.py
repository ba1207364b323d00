# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: what the commands that score read."""

from __future__ import annotations

from contextlib import suppress
from shutil import rmtree
from zlib import crc32

import numpy as np

from kitti_ros2.datasets.transfer import read_checksums
from kitti_ros2.evaluation.detection import read_frames
from kitti_ros2.evaluation.track_metrics import ClassMap, read_tracks, read_truth, tracks_of_frames
from kitti_ros2.evaluation.trajectories import read_trajectory
from kitti_ros2.kitti.label_file import ResultFiles
from kitti_ros2.model.bag_formats import DETECTIONS_2D, DETECTIONS_3D, MARKERS
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.evaluation import BagResultsOptions
from kitti_ros2.options.read import ReadOptions

from .bag_targets import RECORD_WORDS
from .inputs import SEPARATOR, files, joined, own_bag, parted, recording, samples
from .target import Target, place, stored

from stored_messages import make_mcap, messages_of  # isort: skip


def _trajectory(data: bytes) -> None:
    found = read_trajectory(stored('poses.txt', data))
    assert len(found.moved(np.eye(4))) == len(found)


def _tracker(data: bytes) -> None:
    path = stored('0000.txt', data)
    for given in ({}, {'Car': 'Van', '*': ''}):
        classes = ClassMap(given)
        read_tracks(path, 100, classes).among({0, 1})
        classes.losses('tracks')
    read_truth(path, 100).among(None)
    files = ResultFiles(path)
    tracks_of_frames({number: files.boxes(number)[0] for number in files.numbers}, path, 100)
    for number in (*files.numbers[:3], 10**6):
        files.read(number)
    files.absent(files.numbers)


def _detections(data: bytes) -> None:
    truth, results = place('truth/000000.txt').parent, place('results/000000.txt').parent
    for folder, text in zip((truth, results), parted(data, 2), strict=True):
        (folder / '000000.txt').write_bytes(text)
    read_frames(truth, results, ReadOptions(), BagResultsOptions())


def _result_bag(data: bytes) -> None:
    """Score the labels of a bag as results of the recording that it was made of."""
    path = stored('results.mcap', data)
    folder = recording(Layout.OBJECT)
    trials = [('/my/boxes', folder), ('/tf_static', folder)]
    if not crc32(data) % _TRUTH_BAGS:
        trials.append((None, own_bag('a.mcap', Layout.TRACKING)))
    for topic, truth in trials:
        options = BagResultsOptions(topic=topic, class_map=(('Car', 'Car'), ('*', '')))
        with suppress(KittiRos2Error):
            read_frames(truth, path, ReadOptions(), options)
    read_frames(folder, path, ReadOptions(), BagResultsOptions())


def _result_folder(data: bytes) -> None:
    """Read a folder of files with some names, each of the same text."""
    names, text = parted(data, 2)
    folder = place('result_folder')
    rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name in names.decode('utf-8', 'replace').split('\n')[:_MOST_NAMES]:
        parts = [part for part in name.split('/') if part not in {'', '.', '..'}][-2:]
        path = folder.joinpath(*parts)
        with suppress(OSError, ValueError):  # of names that no file can have
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(text)
    found = ResultFiles(folder)
    for number in (*found.numbers[:3], 7):
        with suppress(IsADirectoryError):  # of a folder that is named as a file
            found.boxes(number)
        with suppress(KittiRos2Error, IsADirectoryError):
            found.read(number)
    found.absent((0, 7))


def _checksums(data: bytes) -> None:
    read_checksums(stored('SHA256SUMS', data))


def _result_texts() -> list[bytes]:
    labels = files('label_2/*.txt', Layout.OBJECT)
    results = [b''.join(line + b' 0.9\n' for line in each.splitlines()) for each in labels]
    return [joined(pair) for pair in zip(labels, results, strict=True)]


def _result_folders() -> list[bytes]:
    text = b'Car -1 -1 1.5 10 20 30 40 1.5 1.6 4.0 1.0 1.7 20.0 0.3 0.9\n'
    folders = (
        *(b'000000.txt\n000007.txt\n1.txt\nreadme.txt', b'data/000000.txt', b'a/000000.txt\na/b'),
        b'000000.txt/a',
        *(b'calib/000000.txt', b'training/a', b'0000.txt\n0001.txt', b'a.bin', b'', b'a/b\nb'),
    )
    return [joined((names, text)) for names in folders] + [joined((b'000000.txt', b'Car\xff'))]


def _result_bags() -> list[bytes]:
    """Boxes of each type, with the stamps of the frames, and by the clock of a player."""
    clock = ('/clock', 'rosgraph_msgs/msg/Clock', 1, b'\0\1\0\0' + bytes(8))
    made = []
    for layout in (Layout.OBJECT, Layout.TRACKING):
        messages = messages_of(own_bag('a.mcap', layout))
        frames = [each for each in messages if '/tf' in each[0]]
        for kind in (DETECTIONS_2D, DETECTIONS_3D, MARKERS):
            boxes = [('/my/boxes', *each[1:]) for each in messages if each[1] == kind]
            unstamped = [(*each[:3], _unstamped(each[3])) for each in boxes]
            made += [make_mcap([*frames, *boxes]), make_mcap([clock, *boxes])] if boxes else []
            made += [make_mcap([clock, *frames, *each]) for each in (unstamped, boxes[:1]) if boxes]
            late = [(*each[:2], each[2] + 10**15, each[3]) for each in unstamped]
            made += (
                [make_mcap(late), make_mcap([*boxes, ('/other', *boxes[0][1:])])] if boxes else []
            )
    return [*made, make_mcap(messages)]


def _unstamped(data: bytes) -> bytes:
    """A message of boxes whose stamps, also those of its boxes, are all zero."""
    start = 4 if any(data[4:8]) and data[4:8] > b'\xff\0\0\0' else 8
    return data.replace(data[start : start + 8], bytes(8))


def _trajectories() -> list[bytes]:
    poses = files('poses/*.txt', Layout.ODOMETRY)
    tum = b'0.0 1 2 3 0 0 0 1\n0.1 1 2 3 0 0 0 1\n'
    return [
        *poses,
        tum,
        b'# timestamp tx ty tz qx qy qz qw\n' + tum,
        *(b'0 1 0 0 0 0 1 0 0 0 0 1 0\n', b'0.5 1 0 0 0 0 1 0 0 0 0 1 0\n' * 2),
        *(b'1 0 0 0 0 1 0 0 0 0 -1 0\n' * 2, b'1.001 0 0 0 0 1 0 0 0 0 1 0\n' * 2),
        *(b'1,0\n', b'1;0 0\n', b'1 2\n', b'x y\n1 2 3\n', b'\n', b'\0', b'0 1 2 3 0 0 0 2\n'),
    ]


def _tracker_files() -> list[bytes]:
    track = b'0 1 Car 0 0 1.5 10 20 30 40 1.5 1.6 4.0 1.0 1.7 20.0 0.3 0.9\n'
    region = b'0 -1 DontCare -1 -1 -10 10 20 30 40 -1 -1 -1 -1000 -1000 -1000 -10\n'
    texts = (
        *(track, track * 2, region + track, track.replace(b'0 1', b'0 -1', 1)),
        *(
            track.replace(b'0 1', b'200 1', 1),
            track.replace(b'Car', b'Truck'),
            b'Car 0 0\n' + track,
        ),
        *(track[4:], b'', b'x\n', track.replace(b'0 1', b'0 99999999999', 1)),
    )
    real = samples('kitti/tracking/*/label_02/*.txt')
    return [*files('label_02/*.txt'), *texts, *real]


_MOST_NAMES = 8
_TRUTH_BAGS = 4
"""One in so many bags is also scored against a bag, whose survey costs more than all the rest."""
_LABELS = 'kitti/label_file.py'
_TRACKS = ('evaluation/track_metrics.py', _LABELS)
TARGETS = (
    Target('trajectory', _trajectory, _trajectories, ('evaluation/trajectories.py',),
           (b'#', b',', b'0 0 0 0'), is_text=True, long=100_000),
    Target('tracker', _tracker,
           _tracker_files,
           _TRACKS, (b'DontCare', b'Cyclist'), is_text=True, long=100_000),
    Target('detections', _detections, _result_texts,
           ('evaluation/detection.py', 'evaluation/ground_truth.py', _LABELS),
           (SEPARATOR, b'DontCare'), is_text=True, short=100, long=100_000),
    Target('result_folder', _result_folder, _result_folders,
           ('evaluation/ground_truth.py', _LABELS), (SEPARATOR, b'data/'),
           is_text=True, short=100),
    Target('result_bag', _result_bag, _result_bags,
           ('evaluation/detection.py', 'evaluation/bag_results.py',
            'evaluation/track_metrics.py'),
           RECORD_WORDS, short=5),
    Target('checksums', _checksums, lambda: [b'a' * 64 + b'  a.zip\n# b\n' + b'0' * 64 + b' *b\n'],
           ('datasets/transfer.py',), is_text=True, long=100_000),
)  # fmt: skip
"""All of them."""
