# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The state of a player as a message."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.messages.cdr import deserialize, join, serialize
from kitti_ros2.model.bag_formats import DIAGNOSTICS
from kitti_ros2.player.playback import PlaybackState
from kitti_ros2.player.session import OK, WARN, Counts, encode_diagnostics, encode_state

WORDS = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=9)


@given(st.integers(0, 2**31 * 10**9 - 1), st.sampled_from([OK, WARN]), WORDS, WORDS,
       st.dictionaries(WORDS, WORDS, max_size=4))  # fmt: skip
def test_diagnostics_are_what_the_typestore_makes_of_them(stamp_ns, level, name, message, values):
    data = encode_diagnostics(
        stamp_ns, level=level, name=name, message=message, hardware_id='drive', values=values
    )
    decoded = deserialize(data, DIAGNOSTICS)
    assert join(serialize(decoded)) == data
    (status,) = decoded.status
    assert (status.level, status.name, status.message) == (level, name, message)
    assert {each.key: each.value for each in status.values} == values
    header = decoded.header.stamp
    assert header.sec * 10**9 + header.nanosec == stamp_ns


@pytest.mark.parametrize(
    ('waiting', 'paused', 'doing'),
    [
        (True, False, 'waiting for subscribers'),
        (True, True, 'paused'),
        (False, False, 'playing'),
    ],
)
def test_a_state_says_what_it_does(waiting, paused, doing):
    state = PlaybackState(
        12, 10**18, 0, 1.0, paused=paused, finished=False, round=1, waiting=waiting
    )
    (status,) = deserialize(encode_state('/p', 'drive', state, Counts()), DIAGNOSTICS).status
    assert status.message == f'{doing}, frame 12'


def test_a_state_says_what_is_missing():
    state = PlaybackState(12, 10**18, 10**9, 0.5, paused=True, finished=False, round=1)
    for failures, level, end in ((0, OK, ''), (3, WARN, '; 3 messages could not be made')):
        data = encode_state('/p', 'drive', state, Counts(7, failures, 1_500_000))
        (status,) = deserialize(data, DIAGNOSTICS).status
        assert (status.level, status.message) == (level, 'paused, frame 12' + end)
        values = {each.key: each.value for each in status.values}
        assert values['rate'] == '0.5'
        assert values['late_ms'] == '1.5'
