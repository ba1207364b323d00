# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags recorded with `ros2 bag record -a`: the clock and the state of the player are in them."""

from __future__ import annotations

import pytest

from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import (
    BagProgram,
    open_program,
    reserved_by_node,
    reserved_by_viewers,
)

from builders import convert_recording  # isort: skip
from recorded import (  # isort: skip
    AHEAD_NS,
    CLOCK,
    CLOCKS,
    OTHER,
    STATES,
    serialized_clock,
    write_recorded,
)


@pytest.fixture(scope='module')
def recorded(recordings, tmp_path_factory):
    """A drive's bag, and what a recorder adds to it."""
    folder = tmp_path_factory.mktemp('recorded')
    convert_recording(recordings[Layout.RAW], folder / 'o.mcap')
    write_recorded(folder / 'o.mcap', folder / 'recorded.mcap')
    return folder / 'recorded.mcap'


def played(path, name='/kitti_player', **values):
    settings = make_play_settings(values)
    return open_program(path, settings, reserved_by_node(name, settings))


def names(program):
    return {outlet.topic for outlet in program.channels}


def test_without_a_player_everything_is_there(recorded):
    assert {CLOCK, *STATES, OTHER} <= names(BagProgram(recorded, SelectionOptions()))


def test_clock_and_state_are_the_players_own(recorded):
    program = played(recorded)
    assert not {CLOCK, *STATES} & names(program)
    assert OTHER in names(program)
    (note,) = (note for note in program.notes() if CLOCK in note)
    assert f'/clock is left out, {CLOCKS} messages: the player publishes its own' in note
    assert note.endswith('--clock 0 plays those of the bag')
    for state in STATES:
        (note,) = (note for note in program.notes() if f' {state} ' in note)
        assert '1 messages' in note
    assert program.losses == ()


def test_without_a_clock_of_its_own_the_bags_is_played(recorded):
    program = played(recorded, clock=0)
    (index,) = (n for n, outlet in enumerate(program.channels) if outlet.topic == CLOCK)
    found = [
        message.data
        for place in range(len(program.stamps_ns))
        for message in program.fetch(place, ())[0]
        if message.channel == index
    ]
    first = int(played(recorded, topics=('/kitti/source/files',)).stamps_ns[0])
    assert len(found) == CLOCKS
    assert found[0] == serialized_clock(first + AHEAD_NS)
    assert not [note for note in program.notes() if CLOCK in note]


def test_the_moments_stamps_go_without_a_clock(recorded):
    program = played(recorded, stamps='now', clock=0)
    assert CLOCK not in names(program)
    assert any('/clock is left out' in note for note in program.notes())


def test_a_node_of_another_name_has_another_state(recorded):
    program = played(recorded, '/battery')
    assert not {*STATES, OTHER} & names(program)
    assert any(f' {OTHER} ' in note for note in program.notes())


def test_viewers_are_served_one_state(recorded):
    settings = make_play_settings({})
    program = open_program(recorded, settings, reserved_by_viewers)
    assert not {*STATES} & names(program)
    assert {CLOCK, OTHER} <= names(program)


def test_nothing_but_the_players_own_is_wrong_usage(recorded):
    with pytest.raises(UsageError, match='--clock 0 plays those of the bag'):
        played(recorded, topics=('/clock',))
