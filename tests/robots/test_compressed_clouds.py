# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags with compressed clouds give the sets of the same clouds without compression."""

from __future__ import annotations

import gzip
import sys
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
from kitti_ros2.messages.cdr import make_pose
from kitti_ros2.messages.clouds import read_points
from kitti_ros2.messages.ros_types import TYPESTORE, PointField
from kitti_ros2.model.bag_formats import CLOUD
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.player.bag_program import BagProgram

from builders import files_of  # isort: skip

CLOUDS = '/sensors/ouster/points'
TOPIC = f'{CLOUDS}/compressed'
POINTS = '/kitti/velo/points'
COMPRESSED = TYPESTORE.types['point_cloud_interfaces/msg/CompressedPointCloud2']
TRUTH = foreign.make_truth()


def compressed(cloud, data, name='', **changes):
    """A CompressedPointCloud2 of a PointCloud2."""
    values = {key: getattr(cloud, key) for key in cloud.__dataclass_fields__ if key[0] != '_'}
    values.pop('data')
    octets = np.frombuffer(data, np.uint8)
    return COMPRESSED(**{**values, 'compressed_data': octets, 'format': name, **changes})


def with_cloudini(cloud, name='cloudini', **options):
    names = ('x', 'y', 'z', 'intensity')
    points = np.zeros(cloud.width * cloud.height, [(field, '<f4') for field in names])
    for field, column in zip(names, read_points(cloud, None).T, strict=True):
        points[field] = column
    return compressed(
        cloud,
        Encoder(**options).encode(points, cloud.height),
        name,
        fields=[PointField(field, 4 * place, 7, 1) for place, field in enumerate(names)],
        is_bigendian=False,
        point_step=16,
        row_step=16 * cloud.width,
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
    for actual, expected in zip(scans, plain, strict=True):
        np.testing.assert_array_equal(actual, expected)
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


def with_draco(cloud, encode):
    xyzi = read_points(cloud, None)
    finite = np.isfinite(xyzi).all(axis=1)
    message = with_cloudini(cloud)
    named = {'intensity': xyzi[finite, 3:]}
    data = encode(xyzi[finite, :3], generic_attributes=named, preserve_order=True)
    message.height, message.width = 1, int(finite.sum())
    message.compressed_data, message.format = np.frombuffer(data, np.uint8), 'draco'
    return message


def for_foxglove(cloud, encode):
    message = with_draco(cloud, encode)
    stamp, frame_id = message.header.stamp, message.header.frame_id
    made = TYPESTORE.types['foxglove_msgs/msg/CompressedPointCloud']
    return made(stamp, frame_id, make_pose(Transform.identity()), message.compressed_data, 'draco')


@pytest.mark.parametrize('change', [with_draco, for_foxglove])
def test_clouds_of_draco_give_scans_rounded_as_said(tmp_path, capsys, plain, change):
    encode = pytest.importorskip('DracoPy').encode
    bag = write(tmp_path / 'bag.mcap', partial(change, encode=encode))
    code, scans = scans_of(bag, tmp_path / 'out')
    assert code == 0
    said = f'{TOPIC} is compressed with loss by Draco, which rounded x y z to 14 bits'
    assert said in said_by(capsys)
    for actual, expected in zip(scans, plain, strict=True):
        assert np.abs(actual - expected).max() < np.ptp(expected[:, :3]) / 2**14


def test_a_missing_draco_is_a_loss_that_names_what_to_install(tmp_path, capsys, monkeypatch):
    encode = pytest.importorskip('DracoPy').encode
    bag = write(tmp_path / 'bag.mcap', partial(with_draco, encode=encode))
    monkeypatch.setitem(sys.modules, 'DracoPy', None)
    code, scans = scans_of(bag, tmp_path / 'out')
    assert (code, scans) == (1, [])
    assert "needs DracoPy; run pip install 'kitti_ros2[clouds]'" in said_by(capsys)


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


def retyped(source, target, change):
    """Copy an MCAP file with the clouds of to-bag compressed, on the topic that they have."""
    with source.open('rb') as stream, target.open('wb') as out:
        writer = McapWriter(out)
        writer.start(profile='ros2')
        channels = {}
        for schema, channel, message in make_reader(stream).iter_messages():
            data, msgtype, text = message.data, schema.name, schema.data
            if channel.topic == POINTS:
                msgtype = COMPRESSED.__msgtype__
                cloud = TYPESTORE.deserialize_cdr(data, schema.name)
                data = bytes(TYPESTORE.serialize_cdr(change(cloud), msgtype))
                text = TYPESTORE.generate_msgdef(msgtype, ros_version=2)[0].encode()
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic,
                    channel.message_encoding,
                    writer.register_schema(msgtype, schema.encoding, text),
                    channel.metadata,
                )
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        writer.finish()
    return target


@pytest.fixture(scope='module')
def own_bag(recordings, tmp_path_factory):
    bag = tmp_path_factory.mktemp('own') / 'own.mcap'
    assert main(['to-bag', str(recordings[Layout.OBJECT]), str(bag)]) == 0
    return bag


@pytest.mark.parametrize('kind', ['zstd', 'zlib, gzip as its plugin'])
def test_bags_of_to_bag_give_their_files_after_compression(tmp_path, own_bag, kind):
    bag = retyped(own_bag, tmp_path / 'bag.mcap', FORMATS[kind])
    for source, folder in ((own_bag, 'before'), (bag, 'after')):
        assert main(['to-kitti', str(source), str(tmp_path / folder)]) == 0
    assert files_of(tmp_path / 'after') == files_of(tmp_path / 'before')


def test_a_ros1_bag_of_compressed_clouds_is_no_damaged_one(tmp_path, own_bag):
    compressed_bag = retyped(own_bag, tmp_path / 'bag.mcap', FORMATS['zstd'])
    ros1 = tmp_path / 'bag.bag'
    assert main(['to-bag', str(compressed_bag), str(ros1)]) == 0
    assert main(['validate', str(ros1)]) == 0
    for source, folder in ((own_bag, 'before'), (ros1, 'after')):
        assert main(['to-kitti', str(source), str(tmp_path / folder)]) == 0
    assert files_of(tmp_path / 'after') == files_of(tmp_path / 'before')


def test_bags_of_to_bag_say_that_their_scans_were_rounded(tmp_path, own_bag, capsys):
    rounded = partial(with_cloudini, steps=dict.fromkeys('xyz', 0.01))
    bag = retyped(own_bag, tmp_path / 'bag.mcap', rounded)
    capsys.readouterr()
    loss = f'{POINTS} is compressed with loss by Cloudini, which rounded x y z to 0.01'
    assert main(['to-kitti', str(bag), str(tmp_path / 'out')]) == 1
    assert f"are not KITTI's own: {loss}" in said_by(capsys)
    for command in ('info', 'validate'):
        assert main([command, str(bag)]) == 0
        assert loss in said_by(capsys)
    assert main(['report', str(bag), '-o', str(tmp_path / 'page.html')]) == 0
    assert (tmp_path / 'page.html').read_text().count(loss) == 1
    assert main(['view', str(bag), '-o', str(tmp_path / 'picture.png')]) == 0


@pytest.mark.parametrize('step', [1e-5, 1e-3])
def test_bags_of_to_bag_have_kittis_values_after_a_codec_of_a_millimetre(
    tmp_path, own_bag, capsys, step
):
    """All but signs of zeros: the scans are losses all the same."""
    steps = {**dict.fromkeys('xyz', step), 'intensity': step}
    bag = retyped(own_bag, tmp_path / 'bag.mcap', partial(with_cloudini, steps=steps))
    assert main(['to-kitti', str(own_bag), str(tmp_path / 'before'), '-q']) == 0
    for words, same in (((), True), (('--no-snap',), False)):
        out = tmp_path / f'after{len(words)}'
        assert main(['to-kitti', str(bag), str(out), *words]) == 1
        said = said_by(capsys)
        assert "are not KITTI's own" in said
        assert ('5 of 5 scans are within 0.02 mm of a grid' in said) is same
        scans = [
            np.fromfile(next(out.rglob(file.name)), '<f4').tolist()
            == np.fromfile(file, '<f4').tolist()
            for file in (tmp_path / 'before').rglob('*.bin')
        ]
        assert scans == [same] * 5


def test_the_player_has_the_clouds_as_plain_ones(tmp_path, own_bag):
    rounded = partial(with_cloudini, steps=dict.fromkeys('xyz', 0.01))
    bag = retyped(own_bag, tmp_path / 'bag.mcap', rounded)
    program = BagProgram(bag, SelectionOptions())
    [channel] = [place for place, made in enumerate(program.channels) if made.topic == POINTS]
    assert program.channels[channel].msgtype == CLOUD
    fetched = [program.fetch(index, [channel]) for index in range(len(program.stamps_ns))]
    assert not any(missing for _, missing in fetched)
    clouds = [due[0].data for due, _ in fetched if due and due[0].channel == channel]
    cloud = TYPESTORE.deserialize_cdr(clouds[0], CLOUD)
    steps = read_points(cloud, None)[:, :3] / 0.01
    assert np.abs(steps - np.rint(steps)).max() < 0.01
    assert any('which rounded x y z to 0.01' in note for note in program.notes())
