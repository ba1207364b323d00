# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Each rule about bags finds the fault that is planted; a whole bag has no findings."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pytest
from folder_and_bag import make_bag
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.datasets import validate
from kitti_ros2.messages.camera_info import make_transform
from kitti_ros2.messages.cdr import join, make_header, make_quaternion, make_vector3, serialize
from kitti_ros2.messages.ros_types import (
    TYPESTORE,
    CameraInfo,
    CompressedImage,
    ImageMsg,
    Imu,
    PointCloud2,
    PointField,
    RegionOfInterest,
    TFMessage,
)
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.validation.bag_rules import CHECKED_TYPES
from kitti_ros2.validation.validate import FOLDER_RULES, rules_by_id

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 100_000_000
SIZE = (8, 6)
ROUNDS = 12
K = np.array([[5.0, 0, 4], [0, 5, 3], [0, 0, 1]])


class Written(NamedTuple):
    """A message of a bag."""

    topic: str
    stamp_ns: int
    message: object


def camera_info(stamp_ns: int) -> CameraInfo:
    header = make_header(stamp_ns, 'camera')
    p = np.column_stack([K, np.zeros(3)]).ravel()
    roi = RegionOfInterest(0, 0, 0, 0, False)
    width, height = SIZE
    return CameraInfo(
        header, height, width, 'plumb_bob', np.zeros(5), K.ravel(), np.eye(3).ravel(), p, 0, 0, roi
    )


def image(stamp_ns: int) -> ImageMsg:
    width, height = SIZE
    data = np.arange(width * height, dtype=np.uint8)
    return ImageMsg(make_header(stamp_ns, 'camera'), height, width, 'mono8', 0, width, data)


def cloud(stamp_ns: int) -> PointCloud2:
    fields = [PointField(name, 4 * at, PointField.FLOAT32, 1) for at, name in enumerate('xyz')]
    data = np.arange(60, dtype=np.float32).view(np.uint8)
    return PointCloud2(make_header(stamp_ns, 'lidar'), 1, 20, fields, False, 12, 240, data, True)


def imu(stamp_ns: int) -> Imu:
    none = np.zeros(9)
    still, down = make_vector3((0, 0, 0)), make_vector3((0, 0, 9.81))
    turn = make_quaternion(np.array([0.0, 0, 0, 1]))
    return Imu(make_header(stamp_ns, 'imu'), turn, none, still, none, down, none)


def tf(stamp_ns: int, *links: tuple[str, str], x: float = 1.0) -> TFMessage:
    place = Transform.from_translation((x, 0, 0))
    return TFMessage([make_transform(place, stamp_ns, *link) for link in links])


def whole() -> list[Written]:
    """The messages of a bag without faults."""
    links = ('base', 'lidar'), ('base', 'camera'), ('base', 'imu')
    found = [Written('/tf_static', START_NS, tf(START_NS, *links))]
    for number in range(ROUNDS):
        stamp_ns = START_NS + number * PERIOD_NS
        found += [
            Written('/camera/camera_info', stamp_ns, camera_info(stamp_ns)),
            Written('/camera/image', stamp_ns, image(stamp_ns)),
            Written('/points', stamp_ns, cloud(stamp_ns)),
            Written('/imu', stamp_ns, imu(stamp_ns)),
            Written('/tf', stamp_ns, tf(stamp_ns, ('odom', 'base'), x=float(number))),
        ]
    return found


def write(path: Path, messages: list[Written], storage: str = 'mcap', latched: bool = True) -> Path:
    with open_bag(path, BagOptions(storage), TYPESTORE) as writer:
        ids: dict[str, int] = {}
        for topic, stamp_ns, message in messages:
            if topic not in ids:
                static = latched and topic == '/tf_static'
                ids[topic] = writer.add_channel(Channel(topic, message.__msgtype__, latched=static))
            data = message if isinstance(message, bytes) else join(serialize(message))
            writer.write(ids[topic], stamp_ns, [data])
        return writer.path


def changed(topic: str, change: Callable[[object], object], at: int | None = None):
    """The messages with those of a topic changed, or one of them."""

    def plant(messages: list[Written]) -> list[Written]:
        count = -1
        found = []
        for each in messages:
            count += each.topic == topic
            if each.topic == topic and at in (None, count):
                each = each._replace(message=change(each.message))  # noqa: PLW2901
            found.append(each)
        return found

    return plant


def added(topic: str, *messages: object):
    def plant(found: list[Written]) -> list[Written]:
        return found + [Written(topic, START_NS + n, each) for n, each in enumerate(messages)]

    return plant


def stamped(change: Callable[[int], int], at: int | None = None):
    """IMU messages whose header stamps are changed."""

    def restamp(message: Imu) -> Imu:
        stamp = message.header.stamp
        return imu(change(stamp.sec * 10**9 + stamp.nanosec))

    return changed('/imu', restamp, at)


def later(messages: list[Written]) -> list[Written]:
    """A gap of 3 s in one topic."""
    half = START_NS + ROUNDS // 2 * PERIOD_NS
    return [
        each._replace(stamp_ns=each.stamp_ns + 3 * 10**9)
        if each.topic == '/points' and each.stamp_ns >= half
        else each
        for each in messages
    ]


def turned(*xyzw: float):
    message = tf(START_NS, ('base', 'arm'))
    message.transforms[0].transform.rotation = make_quaternion(np.array(xyzw))
    return message


def far_field(message: PointCloud2) -> PointCloud2:
    fields = [*message.fields[:2], replace(message.fields[2], offset=10)]
    return replace(message, fields=fields)


INFO, PICTURE, CLOUD = '/camera/camera_info', '/camera/image', '/points'
FAULTS = (
    ('K and P of zeros', 'camera-uncalibrated',
     changed(INFO, lambda m: replace(m, k=np.zeros(9), p=np.zeros(12)))),
    ('R is no rotation', 'camera-info', changed(INFO, lambda m: replace(m, r=2 * m.r))),
    ('no width', 'camera-info', changed(INFO, lambda m: replace(m, width=0))),
    ('K with NaN', 'camera-info', changed(INFO, lambda m: replace(m, k=m.k * math.nan))),
    ('size of other images', 'camera-size',
     changed(INFO, lambda m: replace(m, width=16, height=12))),
    ('rectified images with R', 'camera-rotation',
     changed(INFO, lambda m: replace(m, r=rotation_from_rpy(0, 0, 0.01).ravel()))),
    ('three coefficients', 'camera-distortion', changed(INFO, lambda m: replace(m, d=m.d[:3]))),
    ('unknown distortion model', 'camera-distortion',
     changed(INFO, lambda m: replace(m, distortion_model='plum_bob'))),
    ('field beyond point_step', 'cloud-layout', changed(CLOUD, far_field)),
    ('cloud without z', 'cloud-layout',
     changed(CLOUD, lambda m: replace(m, fields=m.fields[:2]))),
    ('cloud cut', 'cloud-layout', changed(CLOUD, lambda m: replace(m, data=m.data[:100]), 3)),
    ('image cut', 'image-layout', changed(PICTURE, lambda m: replace(m, data=m.data[:9]), 2)),
    ('JPEG cut', 'image-layout', added('/camera/image/compressed', CompressedImage(
        make_header(START_NS, 'camera'), 'jpeg', np.frombuffer(b'\xff\xd8\xff', np.uint8)))),
    ('quaternion of zeros', 'tf-transform', added('/tf', turned(0, 0, 0, 0))),
    ('quaternion of length 2', 'tf-transform', added('/tf', turned(0, 0, 0, 2))),
    ('quaternion of length 1e200', 'tf-transform', added('/tf', turned(0, 0, 0, 1e200))),
    ('transform with NaN', 'tf-transform',
     added('/tf', tf(START_NS, ('base', 'arm'), x=math.nan))),
    ('frame without a name', 'tf-transform', added('/tf', tf(START_NS, ('base', '')))),
    ('two parents', 'tf-tree', added('/tf_static', tf(START_NS, ('odom', 'lidar')))),
    ('circle', 'tf-tree', added('/tf', tf(START_NS, ('lidar', 'odom')))),
    ('static link of two values', 'tf-changing',
     added('/tf_static', tf(START_NS, ('base', 'lidar'), x=7.0))),
    ('two trees', 'tf-apart', added('/tf_static', tf(START_NS, ('arm', 'hand')))),
    ('unknown frame', 'tf-frame',
     changed('/imu', lambda m: replace(m, header=make_header(START_NS, 'imu_2')), 0)),
    ('header stamps go back', 'header-order', stamped(lambda ns: ns - 10**9, 5)),
    ('header stamps of 0', 'header-zero', stamped(lambda _: 0)),
    ('header stamps of another day', 'header-late', stamped(lambda ns: ns - 86_400 * 10**9)),
    ('header stamps of the future', 'bag-future',
     stamped(lambda _: 2**31 * 10**9 - 1)),
    ('gap', 'bag-gap', later),
    ('truncated message', 'message-decode', changed('/imu', lambda m: join(serialize(m))[:40], 1)),
    ('no messages', 'bag-empty', lambda _: []),
)  # fmt: skip
"""Name, rule, and the change of the messages."""


@pytest.fixture(scope='module')
def bag(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp('bag') / 'whole.mcap', whole())


def rules(path: Path, **options: bool) -> set[str]:
    report = validate(path, **options)
    for each in report.findings:
        assert each.path == path or path in each.path.parents
        assert each.message
    return {each.rule for each in report.findings}


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'ros1'])
def test_a_whole_bag_has_no_findings(tmp_path, storage):
    path = write(tmp_path / {'ros1': 'a.bag'}.get(storage, 'a'), whole(), storage)
    report = validate(path, decode=True)
    assert report.findings == ()
    (source,) = report.sources
    assert (source.path, source.count, source.files) == (path, 1 + 5 * ROUNDS, 1)
    assert validate(path, quick=True).findings == ()


def test_bags_of_to_bag_have_no_findings(recording_path, tmp_path):
    for storage in ('mcap', 'sqlite3', 'ros1'):
        path = make_bag(recording_path, tmp_path / storage, storage)
        assert validate(path).findings == ()


@pytest.mark.parametrize(('name', 'rule', 'plant'), FAULTS, ids=[each[0] for each in FAULTS])
def test_a_fault_is_found(tmp_path, name, rule, plant):  # noqa: ARG001 - the name is the test's
    assert rule in rules(write(tmp_path / 'a.mcap', plant(whole())))


@pytest.fixture(scope='module')
def all_types():
    """The types of ROS 2, of other packages that are read, and of ROS 1's first tf."""
    store = get_typestore(Stores.ROS2_JAZZY)
    of_others = TYPESTORE.fielddefs.keys() - store.fielddefs.keys()
    store.register({name: TYPESTORE.fielddefs[name] for name in of_others})
    transforms = 'geometry_msgs/TransformStamped[] transforms'
    store.register(get_types_from_msg(transforms, 'tf/msg/tfMessage'))
    return store


@pytest.mark.parametrize('msgtype', sorted(CHECKED_TYPES))
def test_a_damaged_length_is_found_in_every_type_that_is_read(tmp_path, all_types, msgtype):
    path = tmp_path / 'a.mcap'
    with open_bag(path, BagOptions(), all_types) as writer:
        channel = writer.add_channel(Channel('/damaged', msgtype))
        writer.write(channel, START_NS, [b'\0\1\0\0' + b'\xff' * 40])
    (found,) = [each for each in validate(path).findings if each.rule == 'message-decode']
    assert found.message.startswith(f'/damaged at {START_NS}: ')


def test_an_unlatched_static_tree(tmp_path):
    path = write(tmp_path / 'a', whole(), latched=False)
    assert rules(path) == {'bag-latched'}


def test_pixels_are_decoded_on_request(tmp_path):
    planted = changed(PICTURE, lambda m: replace(m, encoding='mono9'), 0)(whole())
    path = write(tmp_path / 'a.mcap', planted)
    assert rules(path) == set()
    assert rules(path, decode=True) == {'image-decode'}


@pytest.mark.parametrize('part', [0.3, 0.7, 0.98])
def test_a_truncated_file(bag, tmp_path, part):
    path = tmp_path / 'cut.mcap'
    path.write_bytes(bag.read_bytes()[: int(bag.stat().st_size * part)])
    assert 'bag-damage' in rules(path)
    assert 'bag-damage' in rules(path, quick=True)


def test_a_wrong_checksum(bag, tmp_path):
    data = bytearray(bag.read_bytes())
    data[len(data) // 2] ^= 1
    path = tmp_path / 'flipped.mcap'
    path.write_bytes(data)
    assert 'bag-damage' in rules(path)


def test_metadata_that_disagrees(tmp_path):
    path = write(tmp_path / 'a', whole())
    metadata = path / 'metadata.yaml'
    text = metadata.read_text()
    count = 1 + 5 * ROUNDS
    metadata.write_text(text.replace(f'message_count: {count}\n', 'message_count: 7\n', 1))
    assert rules(path) == {'bag-metadata'}
    for right, wrong in (
        ('name: /imu', 'name: /gps'),
        ('sensor_msgs/msg/Imu', 'std_msgs/msg/String'),
        (f'nanoseconds_since_epoch: {START_NS}', f'nanoseconds_since_epoch: {START_NS - 10**9}'),
    ):
        metadata.write_text(text.replace(right, wrong))
        assert rules(path) == {'bag-metadata'}
    metadata.unlink()
    assert rules(path) == {'bag-folder'}
    metadata.write_text('[')
    assert rules(path) == {'bag-metadata'}


def write_mcap(
    path: Path, schema: tuple[str, str, bytes], encoding: str, profiles: str = ''
) -> Path:
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        name, kind, text = schema
        schema_id = writer.register_schema(name, kind, text)
        metadata = {'offered_qos_profiles': profiles}
        channel = writer.register_channel('/a', encoding, schema_id, metadata)
        writer.add_message(channel, START_NS, b'\0\1\0\0\1\0\0\0\0\0\0\0', START_NS)
        writer.finish()
    return path


def test_types_that_are_unknown(tmp_path):
    json = write_mcap(tmp_path / 'a.mcap', ('A', 'jsonschema', b'{}'), 'json')
    assert rules(json) >= {'bag-schema'}
    unknown = write_mcap(
        tmp_path / 'b.mcap', ('my_msgs/msg/A', 'ros2msg', b'other_msgs/B b'), 'cdr'
    )
    assert rules(unknown) == {'bag-schema'}


def test_a_definition_that_cannot_be_read_is_a_note(tmp_path):
    path = write_mcap(tmp_path / 'a.mcap', ('std_msgs/msg/String', 'ros2msg', b'%%%'), 'cdr')
    assert rules(path) == {'bag-note'}


@pytest.mark.parametrize(('field', 'expected'), [('Data', {'bag-field-names'}), ('data', set())])
def test_a_field_in_other_letters_is_a_warning(tmp_path, field, expected):
    schema = ('std_msgs/msg/String', 'ros2msg', f'string {field}'.encode())
    assert rules(write_mcap(tmp_path / 'a.mcap', schema, 'cdr')) == expected


def qos(**policies: object) -> str:
    usual = {'history': 1, 'reliability': 1, 'durability': 2, 'liveliness': 1}
    return ''.join(
        f'{"-" if number == 0 else " "} {name}: {value}\n'
        for number, (name, value) in enumerate({**usual, **policies}.items())
    )


@pytest.mark.parametrize(
    ('profiles', 'fault'),
    [
        ('', None),
        ('[]', None),
        (qos(), None),
        (qos(history='keep_last', reliability='best_effort', durability='volatile'), None),
        (qos() + qos(history=2), None),
        (qos() + qos(reliability=2), 'publishers differ in reliability'),
        (qos() + qos(reliability='reliable'), None),
        (qos(durability=1) + qos(), 'publishers differ in durability'),
        (qos(durability='latched'), "durability of a publisher is 'latched'"),
        (qos(reliability=9), 'reliability of a publisher is 9'),
        (qos(history='[1, 2]'), 'history of a publisher is [1, 2]'),
        ('- history: 1', 'reliability of a publisher is None'),
        ('history: 1', 'the QoS profiles are no YAML list'),
        ('- 1', 'the QoS profiles are no YAML list'),
        ('- {', 'the QoS profiles are no YAML list'),
        ('[' * 10_000, 'the QoS profiles are no YAML list'),
    ],
)
def test_profiles_of_publishers(tmp_path, profiles, fault):
    schema = ('std_msgs/msg/String', 'ros2msg', b'string data')
    path = write_mcap(tmp_path / 'a.mcap', schema, 'cdr', profiles)
    found = [each.message for each in validate(path).findings if each.rule == 'bag-qos']
    assert found[:1] == ([] if fault is None else [f'/a: {fault}'])


def test_every_rule_has_a_test():
    tested = {rule for _, rule, _ in FAULTS}
    tested |= {
        'bag-latched',
        'bag-qos',
        'image-decode',
        'bag-damage',
        'bag-metadata',
        'bag-folder',
        'bag-schema',
        'bag-field-names',
        'bag-note',
        'video-decode',  # tests/robots/test_video_robot.py
        'video-start',
    }
    assert set(rules_by_id(bags=True)) - {each.id for each in FOLDER_RULES} == tested


def test_a_simulated_clock_is_no_fault(tmp_path):
    offset = START_NS - 5 * 10**9
    planted = [each._replace(stamp_ns=each.stamp_ns - offset) for each in whole()]
    found = rules(write(tmp_path / 'a.mcap', planted))
    assert found == set()
    assert time.time_ns() > START_NS
