# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The profiles of publishers, and rosbag2's file of overrides."""

import pytest

from kitti_ros2.model.errors import UsageError

pytest.importorskip('rclpy', reason='needs rclpy')

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from kitti_ros2.player.outlets import load_overrides, make_profile

EVERYTHING = """
/points:
  history: keep_all
  depth: 0
  reliability: best_effort
  durability: transient_local
  deadline: {sec: 1, nsec: 500000000}
  lifespan: {sec: 0, nsec: 0}
  liveliness: manual_by_topic
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: true
/image:
  reliability: BEST_EFFORT
"""


def load(tmp_path, text):
    path = tmp_path / 'qos.yaml'
    path.write_text(text)
    return load_overrides(path)


def refusal(tmp_path, text):
    """The one line in which a file is refused; it names the file."""
    with pytest.raises(UsageError) as refused:
        load(tmp_path, text)
    message = str(refused.value)
    assert message.startswith(str(tmp_path / 'qos.yaml'))
    assert '\n' not in message
    return message


def test_sensor_streams_are_reliable_and_volatile():
    assert make_profile(False, 7, None) == QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=7,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def test_latched_topics_are_transient_local():
    profile = make_profile(True, 1, None)
    assert profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert profile.reliability is ReliabilityPolicy.RELIABLE
    assert (profile.history, profile.depth) == (HistoryPolicy.KEEP_LAST, 1)


def test_every_policy_can_be_overridden(tmp_path):
    overrides = load(tmp_path, EVERYTHING)
    assert make_profile(False, 7, overrides['/points']) == QoSProfile(
        history=HistoryPolicy.KEEP_ALL,
        depth=0,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        deadline=Duration(nanoseconds=1_500_000_000),
        lifespan=Duration(),
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(nanoseconds=2**63 - 1),
        avoid_ros_namespace_conventions=True,
    )


def test_what_a_file_leaves_open_stays(tmp_path):
    override = load(tmp_path, EVERYTHING)['/image']
    profile = make_profile(True, 3, override)
    assert profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert (profile.history, profile.depth) == (HistoryPolicy.KEEP_LAST, 3)


@pytest.mark.parametrize('policy', ['history', 'reliability', 'durability', 'liveliness'])
def test_a_policy_can_be_left_to_the_middleware(tmp_path, policy):
    override = load(tmp_path, f'/a: {{{policy}: system_default}}')['/a']
    assert getattr(make_profile(False, 1, override), policy).name == 'SYSTEM_DEFAULT'


@pytest.mark.parametrize(
    ('policy', 'expected'),
    [
        ('history: keep', 'keep_last, keep_all'),
        ('reliability: [reliable]', 'reliable, best_effort, system_default'),
        ('durability: 1', 'volatile, transient_local, system_default'),
        ('liveliness: manual_by_node', 'automatic, manual_by_topic, system_default'),
        ('liveliness: ', 'automatic, manual_by_topic, system_default'),
        ('depth: -1', 'a whole number from 0'),
        ('depth: 1.5', 'a whole number from 0'),
        ('depth: true', 'a whole number from 0'),
        ('depth: 3000000000', 'to 2147483647'),
        ('deadline: 5', '{sec: SECONDS, nsec: NANOSECONDS}'),
        ('deadline: []', '{sec: SECONDS, nsec: NANOSECONDS}'),
        ('deadline: {sec: 2}', '{sec: SECONDS, nsec: NANOSECONDS}'),
        ('deadline: {sec: 2, nanosec: 0}', '{sec: SECONDS, nsec: NANOSECONDS}'),
        ('lifespan: {sec: -1, nsec: 0}', 'whole numbers from 0'),
        ('lifespan: {sec: 0.5, nsec: 0}', 'whole numbers from 0'),
        ('liveliness_lease_duration: {sec: 9999999999, nsec: 0}', 'at most 9223372036854775807'),
        ('avoid_ros_namespace_conventions: 1', 'true or false'),
        ('reliable: true', 'known are history, depth, reliability, durability, liveliness'),
    ],
)
def test_what_cannot_be_is_refused_with_what_can(tmp_path, policy, expected):
    message = refusal(tmp_path, f'/a:\n  {policy}\n')
    assert ': /a: ' in message
    assert policy.split(':')[0] in message
    assert expected in message


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('', 'no mapping of topics'),
        ('- /a', 'no mapping of topics'),
        ('points: {depth: 5}', "'points' is no topic; names begin with /"),
        ('5: {depth: 5}', "'5' is no topic; names begin with /"),
        ('/a: 5', '/a: expected policies such as "depth: 5"'),
        ('/a:', '/a: expected policies such as "depth: 5"'),
        ('/a: {depth: 5', 'qos.yaml:1: no YAML'),
        ('/a:\n  depth: 5\n depth', 'qos.yaml:3: no YAML'),
        ('/a: 2011-13-45', 'no YAML'),
        ('/a: !!python/object/apply:os.getpid []', 'no YAML'),
    ],
)
def test_what_is_no_such_file_is_refused(tmp_path, text, expected):
    assert expected in refusal(tmp_path, text)


def test_a_file_that_is_no_text_or_not_there_is_refused(tmp_path):
    path = tmp_path / 'qos.yaml'
    with pytest.raises(UsageError, match='No such file'):
        load_overrides(path)
    path.write_bytes(b'\xff\xfe\xff')
    with pytest.raises(UsageError, match='no YAML'):
        load_overrides(path)
