# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A few frames of a conversion are those of the whole one, and little of the bag is read."""

from __future__ import annotations

import foreign
import numpy as np
import pytest
from builders import OF_OTHERS, files_of

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.kitti_frames import (
    Excerpt,
    Frames,
    choose_frames,
    frame_topics,
    with_indices,
)
from kitti_ros2.importer.set_builder import Target, build
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.samples import NONE
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import Bound, SelectionOptions

OBJECT = ImportOptions(layout=Layout.OBJECT)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp('foreign')
    return foreign.write_foreign(folder / 'bag.mcap', foreign.make_truth())


def frames_of(*samples: list[int]) -> Frames:
    """Frames a second apart, of one stream for each list of samples."""
    stamps_ns = np.arange(len(samples[0])) * 10**9
    streams = (Stream.SCAN, Stream.IMAGE_2, Stream.LABELS)
    found = {stream: np.array(each) for stream, each in zip(streams, samples, strict=False)}
    return Frames(stamps_ns, found, {}, ())


@pytest.mark.parametrize(
    ('samples', 'numbers'),
    [
        ([list(range(9))], [0, 4, 8]),
        ([list(range(10))], [0, 4, 9]),
        ([[0, 1]], [0, 1]),
        ([[0]], [0]),
        ([list(range(7)), [NONE, 0, 1, 2, 3, NONE, NONE]], [1, 3, 4]),
        ([[NONE, 0, 1], [0, NONE, NONE]], [0, 1, 2]),
    ],
    ids=['odd', 'even', 'two', 'one', 'whole ones', 'no whole one'],
)
def test_the_first_the_middle_and_the_last_whole_frame_are_chosen(samples, numbers):
    excerpt = Excerpt(3)
    frames = frames_of(*samples)
    chosen = excerpt.of(frames)
    assert excerpt.numbers.tolist() == numbers
    assert excerpt.total == len(frames)
    assert chosen.stamps_ns.tolist() == frames.stamps_ns[numbers].tolist()
    for stream, places in frames.samples.items():
        assert chosen.samples[stream].tolist() == places[numbers].tolist()


@pytest.mark.parametrize('layout', OF_OTHERS)
def test_its_files_are_those_of_the_whole_conversion(layout, bag, tmp_path):
    options = ImportOptions(layout=layout)
    survey = survey_bags([bag])
    plan = guess([bag], survey, options).plan
    convert_by_plan([bag], plan, survey, tmp_path / 'whole', options)
    (tmp_path / 'part').mkdir()
    excerpt = Excerpt(3)
    build([bag], plan, survey, Target(tmp_path / 'part', excerpt=excerpt), options)
    assert excerpt.numbers.tolist() == [0, 6, 11]
    whole, part = files_of(tmp_path / 'whole'), files_of(tmp_path / 'part')
    compared = 0
    for name, content in part.items():
        folder, _, file = name.rpartition('/')
        stem, _, suffix = file.partition('.')
        if (stem.isdecimal() and len(stem) >= 6 and suffix != 'txt') or '/calib/' in name:
            number = excerpt.numbers[int(stem)] if stem.isdecimal() else 0
            original = f'{folder}/{number:0{len(stem)}d}.{suffix}'
            if suffix == 'txt' and original not in whole:
                original = name
            assert content == whole[original], name
            compared += 1
    assert compared >= 9


def test_what_is_read_is_near_its_frames_and_in_its_place(bag):
    survey = survey_bags([bag])
    plan = guess([bag], survey, OBJECT).plan
    topics = frame_topics(plan)
    excerpt = Excerpt(2)
    chosen = excerpt.of(choose_frames(plan, survey, None))
    with open_messages([bag], set(topics.values())) as messages:
        every = {
            (message.topic, place): bytes(message.data) for place, message in with_indices(messages)
        }
        read = {
            (message.topic, place): bytes(message.data)
            for place, message in excerpt.read(messages, survey, chosen, topics)
        }
    assert read.items() <= every.items()
    assert len(read) < len(every) / 2
    for stream, places in chosen.samples.items():
        assert {(topics[stream], place) for place in places.tolist()} <= read.keys()


def test_a_selection_limits_it(bag, tmp_path):
    survey = survey_bags([bag])
    selection = SelectionOptions(start=Bound(frame=4), end=Bound(frame=8))
    options = ImportOptions(layout=Layout.OBJECT, selection=selection)
    excerpt = Excerpt(3)
    plan = guess([bag], survey, options).plan
    build([bag], plan, survey, Target(tmp_path, excerpt=excerpt), options)
    assert excerpt.total == 5
    stamps, _ = survey.topics['/sensors/ouster/points'].stamps()
    assert excerpt.stamps_ns.tolist() == stamps[[4, 6, 8]].tolist()
