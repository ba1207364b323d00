# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags with compressed clouds give the sets of the same clouds without compression."""

from __future__ import annotations

import gzip
import zlib
from functools import partial

import foreign
import numpy as np
import pytest
import zstandard
from cloudini_encoder import Encoder
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter

from kitti_ros2.cli import main
from kitti_ros2.messages.clouds import read_points
from kitti_ros2.messages.ros_types import TYPESTORE, PointField

CLOUDS = '/sensors/ouster/points'
TOPIC = f'{CLOUDS}/compressed'
COMPRESSED = TYPESTORE.types['point_cloud_interfaces/msg/CompressedPointCloud2']
TRUTH = foreign.make_truth()


def compressed(cloud, data, name='', **changes):
    """A CompressedPointCloud2 of a PointCloud2."""
    values = {key: getattr(cloud, key) for key in cloud.__dataclass_fields__ if key[0] != '_'}
    values.pop('data')
    octets = np.frombuffer(data, np.uint8)
    return COMPRESSED(**{**values, 'compressed_data': octets, 'format': name, **changes})


def with_cloudini(cloud, name='cloudini', **options):
    points = np.zeros(cloud.width * cloud.height, [(name, '<f4') for name in 'xyz'])
    xyzi = read_points(cloud, None)
    for column, field in enumerate('xyz'):
        points[field] = xyzi[:, column]
    encoder = Encoder(**options)
    return compressed(
        cloud,
        encoder.encode(points, cloud.height),
        name,
        fields=[PointField(field, 4 * place, 7, 1) for place, field in enumerate('xyz')],
        is_bigendian=False,
        point_step=12,
        row_step=12 * cloud.width,
    )


def with_bytes(cloud, compress, name):
    return compressed(cloud, compress(cloud.data.tobytes()), name)


FORMATS = {
    'zstd': partial(with_bytes, compress=zstandard.ZstdCompressor().compress, name='zstd'),
    'zlib, gzip as its plugin': partial(with_bytes, compress=gzip.compress, name='zlib'),
    'zlib itself': partial(with_bytes, compress=zlib.compress, name='zlib'),
    'format in capitals': partial(with_bytes, compress=gzip.compress, name='ZLIB '),
    'cloudini': partial(with_cloudini, encoding='LOSSLESS'),
    'cloudini, no format as its plugin': partial(with_cloudini, name='', encoding='NONE'),
}


def write(path, change, storage='mcap'):
    """The foreign bag with each cloud changed."""
    clouds = [item for item in foreign.messages(TRUTH) if item[0] == CLOUDS]
    more = [(TOPIC, stamp_ns, change(message), latched) for _, stamp_ns, message, latched in clouds]
    return foreign.write_foreign(path, TRUTH, storage, CLOUDS, more=more)


def scans_of(bag, out):
    code = main(['to-kitti', str(bag), str(out), '--layout', 'object'])
    scans = [path.read_bytes() for path in sorted(out.rglob('velodyne/*.bin'))]
    return code, [np.frombuffer(scan, '<f4').reshape(-1, 4) for scan in scans]


def said_by(capsys):
    out, err = capsys.readouterr()
    return out + err


@pytest.fixture(scope='module')
def plain(tmp_path_factory):
    """The scans of the bag without compression."""
    folder = tmp_path_factory.mktemp('plain')
    _, scans = scans_of(foreign.write_foreign(folder / 'bag.mcap', TRUTH), folder / 'out')
    assert scans
    return scans


@pytest.mark.parametrize('change', FORMATS.values(), ids=FORMATS)
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_scans_are_those_of_plain_clouds(tmp_path, capsys, plain, change, storage):
    bag = write(tmp_path / ('bag.mcap' if storage == 'mcap' else 'bag'), change, storage)
    code, scans = scans_of(bag, tmp_path / 'out')
    assert code == 0
    columns = slice(0, 3 if 'cloudini' in str(change) else 4)  # with x, y and z alone
    for actual, expected in zip(scans, plain, strict=True):
        np.testing.assert_array_equal(actual[:, columns], expected[:, columns])
    assert 'with loss' not in said_by(capsys)
    assert main(['validate', str(bag)]) == 0
    assert '0 errors, 1 warning, 0 notes' in said_by(capsys)  # of its frames


def test_rounded_clouds_are_said_to_be_so(tmp_path, capsys, plain):
    steps = {'x': 0.02, 'y': 0.02, 'z': 0.005}
    bag = write(tmp_path / 'bag.mcap', partial(with_cloudini, steps=steps))
    code, scans = scans_of(bag, tmp_path / 'out')
    assert code == 0
    said = f'{TOPIC} is compressed with loss by Cloudini, which rounded x y to 0.02'
    assert f'{said}; z to 0.005' in said_by(capsys)
    for actual, expected in zip(scans, plain, strict=True):
        half = 0.011, 0.011, 0.003
        assert (np.abs(actual - expected)[:, :3] < half).all()
    assert main(['validate', str(bag)]) == 0
    assert said in said_by(capsys)


def broken(cloud, kind):
    message = FORMATS[kind](cloud)
    message.compressed_data = message.compressed_data[: len(message.compressed_data) // 2]
    return message


def bomb(cloud, compress, name):
    return compressed(cloud, compress(bytes(2**28)), name)


def changed(cloud, kind='cloudini', **changes):
    message = FORMATS[kind](cloud)
    for name, value in changes.items():
        setattr(message, name, value)
    return message


DAMAGES = {
    'zstd cut off': (partial(broken, kind='zstd'), 'cannot be decompressed'),
    'zlib cut off': (partial(broken, kind='zlib itself'), 'cut off'),
    'cloudini cut off': (partial(broken, kind='cloudini'), 'cut off'),
    'rvl': (partial(changed, format='rvl'), "its format is 'rvl'; cloudini, "),
    'no format': (partial(with_bytes, compress=bytes, name=''), 'its format is not named'),
    'another width': (partial(changed, width=7), 'width, height and point_step'),
    'another field': (partial(changed, fields=[]), 'its fields are others'),
    'many points': (partial(changed, width=2**32 - 1, height=2**32 - 1), 'too many'),
    'zstd bomb': (
        partial(bomb, compress=zstandard.ZstdCompressor().compress, name='zstd'),
        'more bytes than',
    ),
    'gzip bomb': (partial(bomb, compress=gzip.compress, name='zlib'), 'too large'),
}


@pytest.mark.parametrize(('change', 'reason'), DAMAGES.values(), ids=DAMAGES)
def test_damaged_clouds_are_named_and_the_rest_is_converted(tmp_path, capsys, change, reason):
    clouds = [item for item in foreign.messages(TRUTH) if item[0] == CLOUDS]
    more = [
        (TOPIC, stamp_ns, (change if place == 4 else FORMATS['zstd'])(message), latched)
        for place, (_, stamp_ns, message, latched) in enumerate(clouds)
    ]
    bag = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, 'mcap', CLOUDS, more=more)
    code, scans = scans_of(bag, tmp_path / 'out')
    said = said_by(capsys)
    assert (code, len(scans)) == (1, len(clouds) - 1)
    assert f'messages of {TOPIC} from {more[4][1]} on cannot be read (' in said
    assert reason in said


def retyped(source, target, topic, change, *, name=None):
    """Copy an MCAP file with the clouds of a topic compressed, as transcoding tools do."""
    with source.open('rb') as stream, target.open('wb') as out:
        writer = McapWriter(out)
        writer.start(profile='ros2')
        channels = {}
        for schema, channel, message in make_reader(stream).iter_messages():
            data = message.data
            msgtype, text = schema.name, schema.data
            if channel.topic == topic:
                cloud = TYPESTORE.deserialize_cdr(data, msgtype)
                msgtype = COMPRESSED.__msgtype__
                data = bytes(TYPESTORE.serialize_cdr(change(cloud), msgtype))
                text = TYPESTORE.generate_msgdef(msgtype, ros_version=2)[0].encode()
            if channel.id not in channels:
                owner = writer.register_schema(msgtype, schema.encoding, text)
                channels[channel.id] = writer.register_channel(
                    name if name and channel.topic == topic else channel.topic,
                    channel.message_encoding,
                    owner,
                    channel.metadata,
                )
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        writer.finish()
    return target
