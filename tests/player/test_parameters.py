# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options from a command line or YAML as ROS parameters, and what ROS shows of them."""

import pytest

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.node import (
    _LIVE,
    _OF_SOURCE,
    PARAMETERS,
    declare,
    descriptor,
    given,
    read_decimally,
    to_parameters,
)


@pytest.mark.parametrize(
    ('name', 'word', 'value'),
    [
        ('delay', '1.5s', 1.5),
        ('delay', '3', 3.0),
        ('period', 0.1, 0.1),
        ('rate', 2, 2.0),
        ('step', '2', 2),
        ('read_ahead', '0010', 10),
        ('streams', 'scan, oxts', ['scan', 'oxts']),
        ('topics', ['/a', '/b'], ['/a', '/b']),
        ('base_to_imu', [1.0, 2.0, 3.5], '1.0,2.0,3.5'),
        ('sequence', '0007', '0007'),
        ('loop', 0, 0),
        ('wait_for', 2, 2),
        ('lossless', True, True),
    ],
)
def test_a_value_gets_the_declared_type_and_means_the_same(name, word, value):
    made = to_parameters({name: word})[0].value
    assert made == value
    assert type(made) is type(value)
    assert make_play_settings(given({name: made})) == make_play_settings({name: word})


def test_true_is_no_number():
    assert make_play_settings(given({'loop': True})).playback.loop == 0
    with pytest.raises(UsageError, match='rate takes a number, not True'):
        make_play_settings(given({'rate': True}))


def test_parameters_are_described_with_their_ranges():
    described = {each.name: descriptor(each) for each in PARAMETERS}
    assert all(each.description for each in described.values())
    rate = described['rate']
    assert not rate.read_only
    assert rate.floating_point_range[0].to_value == 100.0
    assert described['step'].integer_range[0].to_value == 10_000
    assert described['period'].read_only
    layouts = 'raw or object or odometry or tracking or kitti360'
    words = f'Layout of the KITTI folder: {layouts}; empty: detected'
    assert described['layout'].description == words


def test_an_integer_is_accepted_where_a_number_is_meant():
    numbers = {parameter.name for parameter in PARAMETERS if isinstance(parameter.default, float)}
    assert {'rate', 'delay', 'marker_alpha'} <= numbers
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        given_values = [Parameter(name, value=1) for name in numbers]
        node = Node('numbers', context=context, parameter_overrides=given_values)
        values = declare(node)
        assert {values[name] for name in numbers} == {1}
        settings = make_play_settings(given(values))
        assert (settings.playback.rate, settings.playback.clock_hz) == (1.0, 1.0)
        assert settings.playback.delay_ns == 10**9
    finally:
        rclpy.shutdown(context=context)


@pytest.mark.parametrize(
    ('word', 'name', 'value'),
    [
        ('sequence:=0004', 'sequence', '0004'),
        ('start:=0000000010', 'start', '0000000010'),
        ('kitti_player:end:=0008', 'end', '0008'),
        ('end:=0.5s', 'end', '0.5s'),
        ('sequence:=4', 'sequence', 4),
        ('epoch:=0', 'epoch', '0'),
        ('epoch:=2011', 'epoch', '2011'),
        ('predictions:=0010', 'predictions', '0010'),
        ('wait_for:=02', 'wait_for', '02'),
        ('read_ahead:=0010', 'read_ahead', 10),
        ('loop:=010', 'loop', 10),
        ('rate:=2', 'rate', 2),
        ('rate:=010', 'rate', 10),
        ('rate:=0.5', 'rate', 0.5),
        ('delay:=0', 'delay', 0),
        ('lossless:=true', 'lossless', True),
        ('sequence:="0010"', 'sequence', '0010'),
    ],
)
def test_numbers_of_ros_arguments_are_decimal_and_texts_stay_texts(word, name, value):
    context = rclpy.Context()
    rclpy.init(context=context, args=read_decimally(['--ros-args', '-p', word]))
    try:
        declared = declare(Node('kitti_player', context=context))[name]
        assert (declared, type(declared)) == (value, type(value))
    finally:
        rclpy.shutdown(context=context)


def test_other_ros_arguments_are_left_as_they_are():
    words = ['--ros-args', '-r', 'start:=0010', '-p', 'others:=0010', '-p', 'streams:=[scan]', '--']
    assert read_decimally(words) == words


def test_the_player_applies_every_parameter_that_may_change():
    live = {each.name for each in PARAMETERS if each.live}
    assert live == {*_LIVE, *_OF_SOURCE, 'position', 'burst'}
