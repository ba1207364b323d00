# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of --for, and the player's messages, meet the demands of each stack."""

from __future__ import annotations

import re

import pytest
from builders import convert_recording
from seen import seen_in_bag, seen_live
from stack_checks import CHECKERS

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.naming import naming_of
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.options.stack_catalogue import STACKS
from kitti_ros2.options.table import make_play_settings, make_settings

ALSO_SEEN = ('/tf*', '*/camera_info', '/kitti/labels/*')
"""Topics beside those that a stack reads: its checks look at them, and viewers show them."""

SOURCE = re.compile(
    r'[\w-]+/[\w.-]+(@[0-9a-f]{7,12})? [\w./-]+(:\d+| [\w:.]+|(?<=\.msg))'
    r'|docs\.foxglove\.dev /docs/[\w/-]+'
)
"""A repository, a file, and a line or symbol; or a page."""


def due(name):
    """The demands that --for alone meets, with their checks; recordings here have 10 Hz."""
    return [(each, CHECKERS[name][each.key]) for each in STACKS[name].demands if not each.of_option]


def seen_by_a_stack(name, options):
    """The topics that a stack sees: other images are not encoded, for speed."""
    inputs = STACKS[name].inputs
    names = [naming_of(options).topic(own) for own in inputs]
    images = [each.replace('image_rect', 'image_r*') for each in names]
    compressed = ['*_color_left/*'] if name == 'foxglove' else []
    return SelectionOptions(topics=(*images, *compressed, *ALSO_SEEN))


def faults_of(name, seen):
    """The faults by demand, each with its place in the source of the stack."""
    found = {f'{each.key} ({each.source})': check(seen) for each, check in due(name)}
    return {key: faults for key, faults in found.items() if faults}


@pytest.fixture(scope='module')
def bags(recordings, tmp_path_factory):
    """A function that returns the bag of a stack."""
    folder, made = tmp_path_factory.mktemp('bags'), {}

    def make(name):
        if name not in made:
            settings = make_settings({'stack': name})
            made[name] = folder / name
            selection = seen_by_a_stack(name, settings.messages)
            source = recordings[Layout.RAW]
            convert_recording(source, made[name], settings.messages, selection, read=settings.read)
        return made[name]

    return make


def test_every_demand_has_a_check():
    assert list(CHECKERS) == list(STACKS)
    for name, stack in STACKS.items():
        keys = [each.key for each in stack.demands]
        assert list(CHECKERS[name]) == keys
        assert len(set(keys)) == len(keys)


def test_every_demand_names_its_place():
    for stack in STACKS.values():
        for each in stack.demands:
            assert SOURCE.fullmatch(each.source), each.source


@pytest.mark.one_in(3)
@pytest.mark.parametrize('name', STACKS)
def test_a_bag_meets_the_demands(name, bags):
    assert faults_of(name, seen_in_bag(bags(name))) == {}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('name', STACKS)
def test_the_player_meets_the_demands(name, recordings):
    settings = make_play_settings({'stack': name})
    recording = open_recording(recordings[Layout.RAW], settings.read)
    selection = seen_by_a_stack(name, settings.messages)
    assert faults_of(name, seen_live(recording, settings.messages, selection)) == {}


@pytest.fixture(scope='module')
def plain(recordings):
    """What the player publishes without --for."""
    settings = make_settings({})
    recording = open_recording(recordings[Layout.RAW], settings.read)
    return seen_live(recording, settings.messages, SelectionOptions())


@pytest.mark.parametrize('name', STACKS)
def test_without_for_a_demand_is_not_met(name, plain):
    met = []
    for _, check in due(name):
        try:
            met.append(not check(plain))
        except (KeyError, ValueError):  # a topic has another name, a field is not there
            met.append(False)
    assert all(met) is (name == 'vision_msgs')


def test_a_second_parent_is_a_fault(plain):
    check = CHECKERS['lio-sam']['one-parent']
    assert check(plain) == ["base_link below ['map', 'odom']"]
