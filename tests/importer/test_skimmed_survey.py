# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A survey finds the same in a database whose large messages it does not keep."""

from __future__ import annotations

import pytest

from kitti_ros2.bags.reader import BagMessages
from kitti_ros2.cli import main
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

COMPARED = (
    *('name', 'msgtype', 'log_ns', 'header_ns', 'frame_ids', 'failures', 'failure', 'headless'),
    *('size_bytes', 'markers_ns', 'forward_ns', 'classes', 'spans_ns', 'positions', 'moves'),
)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp('skimmed')
    drive = write_synthetic(
        folder, Layout.RAW, SyntheticOptions(frames=24, image_size=(310, 94), lidar_columns=200)
    )
    words = ('--storage', 'sqlite3', '--images', 'raw', '--start', '3')
    assert main(['to-bag', str(drive), str(folder / 'bag'), '-q', *words]) == 0
    return folder / 'bag'


def test_a_survey_that_skims_finds_the_same(bag, monkeypatch):
    asked = []
    skim = BagMessages.skim
    monkeypatch.setattr(BagMessages, 'skim', lambda *given: asked.append(given) or skim(*given))
    skimmed = survey_bags([bag])
    assert asked
    monkeypatch.setattr(BagMessages, 'skim', lambda *_: None)
    whole = survey_bags([bag])
    assert skimmed.topics.keys() == whole.topics.keys()
    for name, topic in whole.topics.items():
        other = skimmed.topics[name]
        places = [[at for at, _ in each.contents] for each in (other, topic)]
        assert places[0] == places[1]
        assert [getattr(other, each) for each in COMPARED] == [
            getattr(topic, each) for each in COMPARED
        ]
        assert [str(sample) for sample in other.samples] == [
            str(sample) for sample in topic.samples
        ]
    assert skimmed.losses == whole.losses
    assert skimmed.notes == whole.notes
