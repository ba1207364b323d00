# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI -> bag, over every layout and container, and with bad files in between."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.files.image_files import decode_png
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import stamp_ns_of
from kitti_ros2.messages.scan import decode_scan
from kitti_ros2.messages.source_texts import decode_text, decode_texts
from kitti_ros2.model.errors import KittiRos2Error, OutputExistsError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import Images, MessageOptions, Preset
from kitti_ros2.options.read import Bound, SelectionOptions

from builders import SMALL, convert_recording as run  # isort: skip
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

CONTAINERS = {'mcap': 'out.mcap', 'directory': 'out', 'sqlite3': 'out', 'ros1': 'out.bag'}
STORAGES = {'mcap': 'mcap', 'directory': 'mcap', 'sqlite3': 'sqlite3', 'ros1': 'ros1'}
POINTS = '/kitti/velo/points'


def read(out: Path) -> dict[str, list]:
    """(stamp, message) by topic."""
    found: dict[str, list] = {}
    with open_messages(out) as messages:
        for item in messages:
            message = messages.typestore.deserialize_cdr(item.data, item.msgtype)
            found.setdefault(item.topic, []).append((item.stamp_ns, message))
    return found


@pytest.fixture(scope='module')
def written(tmp_path_factory):
    """A function that gives the report of a recording's bag, written once in each container."""

    @cache
    def write(path: Path, container: str):
        out = tmp_path_factory.mktemp('bags') / CONTAINERS[container]
        return run(path, out, storage=STORAGES[container])

    return write


def image_of(recording, index):
    return 'image_raw' if index in recording.layout.traits.raw_cameras else 'image_rect'


@pytest.mark.one_in(3)
@pytest.mark.parametrize('container', CONTAINERS)
def test_counts_equal_file_counts(recording_path, written, container):
    recording = open_recording(recording_path)
    report = written(recording_path, container)
    assert not report.losses
    found = read(report.path)
    assert {topic: len(items) for topic, items in found.items()} == {
        topic: count for topic, count in report.counts.items() if count
    }
    files = {stream: len(index) for stream, index in recording.streams.items()}
    expected = {POINTS: Stream.SCAN, '/kitti/oxts/imu': Stream.OXTS, '/tf': Stream.POSE}
    expected |= {
        f'/kitti/camera_{name}/{topic}': Stream(f'image_{index}')
        for index, name in recording.cameras.items()
        for topic in ('camera_info', f'{image_of(recording, index)}/compressed')
    }
    for topic, stream in expected.items():
        assert report.counts.get(topic, 0) == files.get(stream, 0), topic


@pytest.mark.one_in(3)
@pytest.mark.parametrize('container', CONTAINERS)
def test_payloads_are_the_files_own_bytes(recording_path, written, container):
    recording = open_recording(recording_path)
    found = read(written(recording_path, container).path)
    scans = recording.streams[Stream.SCAN]
    for number, stamp, (log_ns, message) in zip(
        scans.numbers.tolist(), scans.stamps_ns.tolist(), found[POINTS], strict=True
    ):
        assert message.data.tobytes() == recording.path(Stream.SCAN, number).read_bytes()
        assert log_ns == stamp == stamp_ns_of(message.header)
    for index, name in recording.cameras.items():
        stream = Stream(f'image_{index}')
        paths = [recording.path(stream, n) for n in recording.streams[stream].numbers.tolist()]
        images = found[f'/kitti/camera_{name}/{image_of(recording, index)}/compressed']
        size = recording.calibration(0).cameras[index].size or SMALL.image_size
        infos = found[f'/kitti/camera_{name}/camera_info']
        for path, (log_ns, image), (_, info) in zip(paths, images, infos, strict=True):
            assert image.data.tobytes() == path.read_bytes()
            assert image.header == info.header
            assert log_ns == stamp_ns_of(image.header)
            assert (info.width, info.height) == size
            assert index in recording.layout.traits.raw_cameras or size == SMALL.image_size


def test_text_files_travel_verbatim(recording_path, written):
    recording = open_recording(recording_path)
    found = read(written(recording_path, 'mcap').path)
    carried = {}
    for topic in ('/kitti/source/files', '/kitti/source/calibration'):
        for _, message in found.get(topic, []):
            carried |= {file.name: file.text for file in decode_texts(message)}
    for topic in ('/kitti/source/labels', '/kitti/source/oxts'):
        parts: dict[str, str] = {}
        for _, message in found.get(topic, []):
            file = decode_text(message)
            parts[file.name] = parts.get(file.name, '') + file.text
        carried |= parts
    texts = {
        path.relative_to(recording.root).as_posix(): path.read_bytes().decode()
        for path in recording.root.rglob('*')
        if path.suffix in {'.txt', '.xml', '.yaml'}
    }
    assert texts
    assert carried == texts


def test_messages_are_in_order_of_time(recording_path, written):
    with open_messages(written(recording_path, 'mcap').path) as messages:
        stamps = [item.stamp_ns for item in messages]
    assert stamps == sorted(stamps)


@pytest.mark.parametrize('images', list(Images))
def test_images_raw_and_both(recordings, tmp_path, images):
    path = recordings[Layout.RAW]
    recording = open_recording(path)
    found = read(run(path, tmp_path / 'out.mcap', messages=MessageOptions(images=images)).path)
    raw = found.get('/kitti/camera_color_left/image_rect', [])
    assert len(raw) == (0 if images is Images.COMPRESSED else SMALL.frames)
    assert ('/kitti/camera_color_left/image_rect/compressed' in found) == (images is not Images.RAW)
    for number, (_, message) in enumerate(raw):
        pixels = decode_png(recording.read(Stream.IMAGE_2, number))
        assert message.data.tobytes() == pixels.tobytes()
        assert message.encoding == 'bgr8'


def test_static_transforms_are_sent_once_and_again_when_they_change(recordings, tmp_path):
    assert len(read(run(recordings[Layout.RAW], tmp_path / 'raw.mcap').path)['/tf_static']) == 1
    import shutil  # noqa: PLC0415

    own = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], own)
    changed = own / 'training' / 'calib' / '000003.txt'
    words = changed.read_text().split('Tr_velo_to_cam: ')
    first = words[1].split()
    first[3] = '1.0e-01'
    changed.write_text(
        words[0]
        + 'Tr_velo_to_cam: '
        + ' '.join(first[:12])
        + '\nTr_imu_to_velo: '
        + ' '.join(first[13:])
        + '\n'
    )
    found = read(run(own, tmp_path / 'object.mcap').path)
    stamps = [stamp for stamp, _ in found['/tf_static']]
    scans = [stamp for stamp, _ in found[POINTS]]
    assert stamps == [scans[0], scans[3], scans[4]]
    assert len(found['/kitti/source/calibration']) == SMALL.frames


def test_latched_topics_are_transient_local(recordings, tmp_path):
    out = run(recordings[Layout.RAW], tmp_path / 'out').path
    with AnyReader([out]) as reader:
        latched = {
            connection.topic
            for connection in reader.connections
            if connection.ext.offered_qos_profiles[0].durability.name == 'TRANSIENT_LOCAL'
        }
    assert latched == {
        '/tf_static', '/kitti/ground_truth/path', '/kitti/source/recording',
        '/kitti/source/files', '/kitti/source/calibration',
    }  # fmt: skip


def test_topics_and_streams_select(recordings, tmp_path):
    selection = SelectionOptions(topics=('/kitti/oxts/*', '/tf'))
    report = run(recordings[Layout.RAW], tmp_path / 'out.mcap', selection=selection)
    assert set(report.counts) == {'/kitti/oxts/imu', '/kitti/oxts/fix', '/kitti/oxts/vel', '/tf'}
    selection = SelectionOptions(streams=('scan',), start=Bound(frame=2))
    report = run(recordings[Layout.RAW], tmp_path / 'two.mcap', selection=selection)
    assert report.counts == {POINTS: 3, '/kitti/source/sweep': 3}


def test_kitti2bag_names(recordings, tmp_path):
    options = MessageOptions(preset=Preset.KITTI2BAG)
    found = read(run(recordings[Layout.RAW], tmp_path / 'out.mcap', messages=options).path)
    assert {'/kitti/velo/pointcloud', '/kitti/oxts/gps/fix', '/kitti/oxts/gps/vel'} <= set(found)
    assert '/kitti/camera_gray_left/image_raw/compressed' in found
    [(_, tf), *_] = found['/tf']
    assert tf.transforms[0].header.frame_id == 'world'
    [(_, static)] = found['/tf_static']
    children = {t.child_frame_id: t.transform.translation.x for t in static.transforms}
    assert 'camera_color_right' in children
    assert children['imu_link'] == -1.405


@pytest.mark.one_in(3)
@pytest.mark.parametrize('preset', list(Preset))
@pytest.mark.parametrize('layout', list(Layout))
def test_image_topics_of_each_layout(recordings, tmp_path, layout, preset):
    """kitti2bag 1.5: image_raw of raw drives, image_rect of odometry; it knows no other layout."""
    options = MessageOptions(preset=preset, images=Images.BOTH)
    report = run(recordings[layout], tmp_path / 'out.mcap', messages=options)
    raw = (layout, preset) == (Layout.RAW, Preset.KITTI2BAG)
    image = 'image_raw' if raw else 'image_rect'
    found = {topic for topic, count in report.counts.items() if count and '/camera_' in topic}
    found = {topic for topic in found if not topic.endswith('camera_info')}
    traits = layout.traits
    names = {f'/kitti/camera_{traits.camera_names[index]}/{image}' for index in traits.cameras}
    names |= {
        f'/kitti/camera_{traits.camera_names[index]}/image_raw' for index in traits.raw_cameras
    }
    assert found == names | {f'{name}/compressed' for name in names}


def test_what_ultralytics_ros_subscribes_to(recordings, tmp_path):
    """The topics of its launch/kitti_tracker_with_cloud.launch.xml."""
    options = MessageOptions(preset=Preset.KITTI2BAG, images=Images.RAW)
    found = read(run(recordings[Layout.RAW], tmp_path / 'out.mcap', messages=options).path)
    wanted = {
        '/kitti/camera_color_left/image_raw',
        '/kitti/camera_color_left/camera_info',
        '/kitti/velo/pointcloud',
    }
    assert wanted <= set(found)


def test_tf_can_be_left_to_a_slam_stack(recordings, tmp_path):
    options = MessageOptions(publish_tf=False)
    report = run(recordings[Layout.RAW], tmp_path / 'out.mcap', messages=options)
    assert '/tf' not in report.counts
    assert report.counts['/kitti/ground_truth/odometry'] == SMALL.frames


def test_a_gap_costs_its_messages_and_shifts_nothing(drive, tmp_path):
    whole = read(run(drive, tmp_path / 'whole.mcap').path)
    (drive / 'velodyne_points' / 'data' / '0000000002.bin').unlink()
    report = run(drive, tmp_path / 'gapped.mcap')
    gapped = read(report.path)
    for topic in (POINTS, '/kitti/source/sweep'):
        del whole[topic][2]
    assert {t: [s for s, _ in items] for t, items in gapped.items()} == {
        t: [s for s, _ in items] for t, items in whole.items()
    }
    assert [(loss.stream, loss.count) for loss in report.losses] == [('scan', 1)]


IMAGE = 'image_02/data/0000000001.png'
SCAN = 'velodyne_points/data/0000000001.bin'
PACKET = 'oxts/data/0000000001.txt'
IMAGE_TOPICS = {
    '/kitti/camera_color_left/camera_info',
    '/kitti/camera_color_left/image_rect/compressed',
}
PACKET_TOPICS = {
    '/kitti/oxts/imu', '/kitti/oxts/fix', '/kitti/oxts/vel', '/kitti/source/oxts', '/tf',
    '/kitti/ground_truth/odometry',
}  # fmt: skip


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('name', 'edit', 'said', 'topics'),
    [
        (SCAN, lambda d: d[:-3], 'cut inside a point', {POINTS, '/kitti/source/sweep'}),
        (SCAN, lambda _: b'', 'empty', {POINTS, '/kitti/source/sweep'}),
        (IMAGE, lambda d: d[:-9], 'the PNG is cut',
         IMAGE_TOPICS),
        (IMAGE, lambda _: b'', 'empty',
         IMAGE_TOPICS),
        (PACKET, lambda d: b' '.join(d.split()[:29]), '29 values', PACKET_TOPICS),
        (PACKET, lambda d: d.replace(b'.', b'x', 1), 'no number', PACKET_TOPICS),
        (PACKET, lambda _: b'\xff\xfe', 'no text', PACKET_TOPICS),
    ],
)  # fmt: skip
def test_a_bad_file_costs_its_own_messages(drive, tmp_path, name, edit, said, topics):
    whole = run(drive, tmp_path / 'whole.mcap')
    path = drive / name
    path.write_bytes(edit(path.read_bytes()))
    report = run(drive, tmp_path / 'out.mcap')
    assert {loss.stream for loss in report.losses} == topics
    assert all(said in loss.message and str(path) in loss.message for loss in report.losses)
    lost = Counter(topics)
    assert Counter(whole.counts) - Counter(report.counts) == lost
    with pytest.raises(KittiRos2Error, match='--strict'):
        run(drive, tmp_path / 'strict.mcap', strict=True)
    assert not list(tmp_path.glob('*strict*'))


def test_an_unreadable_file_is_named(drive, tmp_path):
    path = drive / IMAGE
    path.unlink()
    path.mkdir()
    report = run(drive, tmp_path / 'out.mcap')
    assert str(path) in report.losses[0].message


def test_points_that_are_not_finite_are_kept(drive, tmp_path):
    path = drive / SCAN
    points = np.fromfile(path, np.float32)
    points[5] = np.nan
    points[6] = np.inf
    path.write_bytes(points.tobytes())
    report = run(drive, tmp_path / 'out.mcap')
    assert not report.losses
    dense = [message.is_dense for _, message in read(report.path)[POINTS]]
    assert dense == [True, False, True, True, True]
    assert decode_scan(read(report.path)[POINTS][1][1]).points.tobytes() == points.tobytes()


@pytest.mark.parametrize(
    ('name', 'edit', 'lost'),
    [
        ('calib_cam_to_cam.txt', lambda t: t.replace('P_rect_02', 'P_gone_02'),
         {'/kitti/camera_color_left/camera_info'}),
        ('calib_cam_to_cam.txt', lambda t: t[: t.index('P_rect_03') + 40],
         {'/kitti/camera_color_right/camera_info'}),
        ('calib_velo_to_cam.txt', lambda t: t.replace('e-', 'x', 1), {'calibration'}),
        ('calib_imu_to_velo.txt', lambda t: t[: len(t) // 2], {'calibration'}),
        ('calib_cam_to_cam.txt', lambda _: None,
         {'calibration', *(f'/kitti/camera_{c}/camera_info' for c in
                           ('gray_left', 'gray_right', 'color_left', 'color_right'))}),
    ],
)  # fmt: skip
def test_bad_calibration_costs_its_own_messages(drive, tmp_path, name, edit, lost):
    path = drive.parent / name
    text = edit(path.read_text())
    if text is None:
        path.unlink()
    else:
        path.write_text(text)
    report = run(drive, tmp_path / 'out.mcap')
    assert {loss.stream for loss in report.losses} == lost
    assert all(str(path) in loss.message for loss in report.losses)
    assert report.counts[POINTS] == SMALL.frames
    assert report.counts['/kitti/camera_color_left/image_rect/compressed'] == SMALL.frames


def test_splits_hold_everything(recordings, tmp_path):
    report = run(recordings[Layout.RAW], tmp_path / 'out', split_duration_ns=200_000_000)
    assert len(list(report.path.glob('*.mcap'))) > 1
    found = read(report.path)
    assert {topic: len(items) for topic, items in found.items()} == {
        topic: count for topic, count in report.counts.items() if count
    }


def test_an_existing_bag_is_kept(recordings, tmp_path):
    run(recordings[Layout.RAW], tmp_path / 'out.mcap')
    before = (tmp_path / 'out.mcap').read_bytes()
    with pytest.raises(OutputExistsError, match='--overwrite'):
        run(recordings[Layout.RAW], tmp_path / 'out.mcap')
    assert (tmp_path / 'out.mcap').read_bytes() == before


def test_the_same_recording_gives_the_same_bag(recordings, tmp_path):
    for name in ('one', 'two'):
        (tmp_path / name).mkdir()
        run(
            recordings[Layout.RAW],
            tmp_path / name / 'out.mcap',
            messages=MessageOptions(images=Images.BOTH),
        )
    one, two = ((tmp_path / name / 'out.mcap').read_bytes() for name in ('one', 'two'))
    assert one == two
