# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The YAML text that goes into bags is read back as what it was made from."""

from __future__ import annotations

import yaml
from bag_samples import CHANNELS, jazzy
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag2.metadata import parse_qos
from ruamel.yaml import YAML

from kitti_ros2.bags.file_writer import (
    Tally,
    bag_information,
    information_text,
    metadata_yaml,
    qos_text,
)
from kitti_ros2.options.outputs import BagOptions

texts = st.text(st.characters(exclude_categories=['Cs']), max_size=12)
words = st.sampled_from(
    ['yes', 'No', 'null', '~', '1e5', '0x1', '12:30:00', '-', 'a: b', '<<', '.']
)
scalars = st.one_of(texts, words, st.booleans(), st.none(), st.integers(-(2**62), 2**63))
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts | words, inner, max_size=3),
    max_leaves=12,
)


@given(st.dictionaries(texts | words, values, max_size=4))
def test_two_parsers_agree_with_the_text(value):
    text = information_text(value)
    assert yaml.safe_load(text) == value
    assert YAML(typ='safe', pure=True).load(text) == value


def test_qos_text_is_a_list_of_one_profile():
    for channel in CHANNELS:
        (parsed,) = parse_qos(qos_text(channel))
        (loaded,) = yaml.safe_load(qos_text(channel))
        assert loaded['history'] == parsed.history.value == 1
        assert loaded['durability'] == (1 if channel.latched else 2)
        assert loaded['depth'] == parsed.depth == channel.depth
        # What rmw takes for "none": a deadline of 0 s would be one that is always missed.
        assert loaded['deadline'] == {'sec': 9223372036, 'nsec': 854775807}


def test_files_before_a_late_channel_count_nothing_for_it():
    files = {'a_0.mcap': Tally([2], 5, 7), 'a_1.mcap': Tally([1, 4], 8, 20)}
    information = bag_information(BagOptions(), jazzy(), CHANNELS[:2], files, {})
    assert information['duration'] == {'nanoseconds': 15}
    loaded = yaml.safe_load(metadata_yaml(information))['rosbag2_bagfile_information']
    assert [each['message_count'] for each in loaded['topics_with_message_count']] == [3, 4]
    topics = list(information['topics_with_message_count'])
    assert loaded == {**information, 'topics_with_message_count': topics}
    assert loaded == yaml.safe_load(information_text(information))


def test_a_bag_without_topics_lists_none():
    loaded = yaml.safe_load(metadata_yaml(bag_information(BagOptions(), jazzy(), [], {}, {})))
    assert loaded['rosbag2_bagfile_information']['topics_with_message_count'] == []
