# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: bags that to-bag wrote, or that say so: their files, the numbers of their frames."""

from __future__ import annotations

import warnings
from contextlib import closing, suppress
from functools import partial
from shutil import rmtree

from kitti_ros2.api.conversions import to_kitti
from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.bags.reader import bag_stamps, read_lead_ns, summarize_bag
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.streams import Stream
from kitti_ros2.options.read import ValidateOptions
from kitti_ros2.own_bags.numbering import number_bag
from kitti_ros2.own_bags.recording import open_own_recording
from kitti_ros2.own_bags.source_files import read_source_files
from kitti_ros2.validation.bag_checks import check_bag
from kitti_ros2.validation.rule import FindingTally
from kitti_ros2.validation.validate import rules_by_id

from .own_bag_inputs import odd_bags, own_bags
from .target import Target, place, stored


def _restore(data: bytes) -> None:
    path = stored('restore.mcap', data)
    rmtree(place('restored'), ignore_errors=True)  # what is in it may be no data set
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # what is lost
        to_kitti(path, place('restored'), overwrite=True, fsync=False)
        with suppress(KittiRos2Error):
            to_kitti(path, place('restored'), overwrite=True, fsync=False, start='1')


def _numbers(data: bytes) -> None:
    """Number the messages of a bag, as info, play and report do."""
    path = stored('numbered.mcap', data)
    with OpenBag(path) as bag:
        log_ns = bag_stamps(bag)
        counts = {topic: len(stamps) for topic, stamps in log_ns.items()}
        source_files, _ = read_source_files(bag, counts)
        numbered = number_bag(bag, log_ns)
        if numbered is not None:
            _ = numbered.frames, numbered.clock
            for topic, stamps in log_ns.items():
                numbered.frames_at(stamps, {topic})
        if source_files is not None and Stream.SCAN in source_files.folders:
            source_files.turns()
        read_lead_ns(bag)
        _ = summarize_bag(bag).message_count


def _recording(data: bytes) -> None:
    """Read each sample of a bag, as info, view and the evaluations do."""
    path = stored('recording.mcap', data)
    with OpenBag(path) as bag:
        recording = open_own_recording(bag, survey_bags([bag]))
        if recording is None:
            return
        with closing(recording):
            for stream, index in recording.streams.items():
                for number in index.numbers.tolist()[:3]:
                    for read in (recording.calibration, partial(recording.read, stream)):
                        with suppress(KittiRos2Error):
                            read(number)
                if stream is Stream.POSE:
                    dict(recording.readable_poses(index.numbers.tolist()[:3], stream))


def _checked(data: bytes) -> None:
    path = stored('checked.mcap', data)
    check_bag(path, ValidateOptions(), FindingTally(rules_by_id(bags=True)), lambda *_: None)


def _to_check() -> list[bytes]:
    return [*own_bags(), *odd_bags()[-14:], b'', b'no bag']


_MODULES = ('own_bags/source_files.py', 'own_bags/missing_files.py', 'own_bags/numbering.py')
_WORDS = (b'files', b'numbers', b'training/', b'../', b'\n', b'[[0, 1]]', b'null')

TARGETS = (
    Target('restore', _restore, lambda: [*own_bags(), *odd_bags()],
           (*_MODULES, 'own_bags/restore.py', 'own_bags/compact_scans.py'), _WORDS, short=10),
    Target('own_numbers', _numbers, lambda: [*own_bags(), *odd_bags()],
           (*_MODULES, 'bags/reader.py'), _WORDS, short=10),
    Target('own_recording', _recording, lambda: [*own_bags(), *odd_bags()],
           (*_MODULES, 'own_bags/recording.py'), _WORDS, short=10),
    Target('check_bag', _checked, _to_check, ('validation/bag_checks.py',), short=5),
)  # fmt: skip
"""All of them."""
