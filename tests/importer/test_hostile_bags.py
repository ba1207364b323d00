# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is wrong in a bag costs its own message, is named, and spoils nothing else."""

from __future__ import annotations

import os
from dataclasses import replace

import foreign
import numpy as np
import pytest
from mcap.writer import Writer

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.plan import parse_plan
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.text_file import parse_packet
from kitti_ros2.messages.camera_info import make_transform
from kitti_ros2.messages.cdr import join, make_header, serialize
from kitti_ros2.messages.ros_types import TYPESTORE, TFMessage
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.errors import KittiRos2Error, MissingDataError, UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import BagOptions, ImportOptions

TRUTH = foreign.make_truth()
POINTS = '/sensors/ouster/points'
LEFT = '/cam/left/image_raw'
BOXES = '/perception/objects'


def convert(path, out, layout=Layout.OBJECT, change=lambda plan: plan):
    options = ImportOptions(layout=layout)
    survey = survey_bags([path])
    plan = change(guess([path], survey, options).plan)
    return convert_by_plan([path], plan, survey, out, options)


def hostile(tmp_path, topic, place, changed, storage='mcap'):
    """The bag with one message of a topic changed (every one where place is None)."""

    def change(name, index, message):
        wanted = name == topic and place in (None, index)
        return changed(message) if wanted else message

    return foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, storage, change=change)


def cut(message):
    return (join(message if isinstance(message, tuple) else serialize(message))[:60],)


@pytest.mark.parametrize(
    ('topic', 'stream'), [(POINTS, 'scan'), (LEFT, 'image_2'), (BOXES, 'labels')]
)
def test_a_message_that_cannot_be_decoded_costs_itself(topic, stream, tmp_path):
    path = hostile(tmp_path, topic, 6, cut)
    report = convert(path, tmp_path / 'out')
    (loss,) = report.losses
    assert (loss.stream, loss.count) == (topic, 1)
    assert 'cannot be decoded' in loss.text()
    assert '\n' not in loss.text()
    assert report.counts[stream] == foreign.FRAMES - 1
    assert report.counts['calibration'] == foreign.FRAMES


def test_a_frame_that_is_not_whole_is_in_no_list(tmp_path):
    path = hostile(tmp_path, POINTS, 4, cut)
    convert(path, tmp_path / 'out')
    listed = (tmp_path / 'out/ImageSets/trainval.txt').read_text().split()
    assert listed == [f'{number:06d}' for number in range(foreign.FRAMES) if number != 4]


def test_an_image_of_another_size_is_left_out_and_named(tmp_path):
    def shrink(message):
        grey = np.zeros((100, 200), np.uint8)
        data = np.repeat(grey, 3, axis=1).ravel()
        return replace(message, height=100, width=200, step=600, data=data)

    path = hostile(tmp_path, LEFT, 6, shrink)
    report = convert(path, tmp_path / 'out')
    (loss,) = report.losses
    assert 'the image is 200x100; expected 640x360' in loss.text()
    assert report.counts['image_2'] == foreign.FRAMES - 1


@pytest.mark.parametrize(
    ('stamp_ns', 'said'),
    [
        (
            0,
            'header stamps that are 0: 1 of 12 (the first that of message 4)',
        ),
        (10**9, '1 of 12 header stamps is more than a second earlier than one before'),
    ],
)
def test_stamps_of_0_or_far_out_of_order_give_way_to_log_time(stamp_ns, said, tmp_path):
    def restamp(message):
        return replace(message, header=make_header(stamp_ns, message.header.frame_id))

    path = hostile(tmp_path, POINTS, 3, restamp)
    report = convert(path, tmp_path / 'out', Layout.RAW)
    assert any(said in note for note in report.notes)
    stamps = open_recording(tmp_path / 'out').streams[Stream.SCAN].stamps_ns
    off = stamps - np.array([frame.stamp_ns for frame in TRUTH])
    assert ((off >= 0) & (off < 2_000_000)).all()


def test_an_unknown_encoding_is_named_with_the_known_ones(tmp_path):
    path = hostile(tmp_path, LEFT, None, lambda message: replace(message, encoding='hsv8'))
    report = convert(path, tmp_path / 'out')
    (loss,) = report.losses
    assert loss.count == foreign.FRAMES
    assert 'hsv8' in loss.text()
    assert 'mono8' in loss.text()


def test_a_camera_that_was_never_calibrated_is_said_so(tmp_path):
    def forget(message):
        return replace(message, k=np.zeros(9), p=np.zeros(12), r=np.zeros(9), d=np.zeros(0))

    path = hostile(tmp_path, '/cam/left/camera_info', None, forget)
    with pytest.raises(KittiRos2Error, match='not calibrated'):
        convert(path, tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


def test_a_lens_that_raw_has_no_place_for_is_rectified(tmp_path):
    def fisheye(message):
        return replace(message, distortion_model='equidistant', d=np.zeros(4) + 0.01)

    path = hostile(tmp_path, '/cam/left/camera_info', None, fisheye)
    report = convert(path, tmp_path / 'out', Layout.RAW)
    assert report.name.endswith('_sync')
    assert report.losses == ()


def test_a_link_that_moves_does_not_calibrate(tmp_path):
    path = tmp_path / 'bag.mcap'
    links = foreign.links()

    def change(topic, _place, message):
        if topic != '/tf_static':
            return message
        joined = [link for link in links if link[1] != 'os_sensor']
        return TFMessage([make_transform(pose, 1, parent, child) for parent, child, pose in joined])

    foreign.write_foreign(path, TRUTH, change=change)
    with pytest.raises(MissingDataError, match='os_sensor') as caught:
        convert(path, tmp_path / 'out')
    assert 'base_link -> ' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_box_in_an_unknown_frame_costs_its_frames_labels(tmp_path):
    path = tmp_path / 'bag.mcap'

    def change(topic, place, message):
        if topic != BOXES or place != 2:
            return message
        return (join(message).replace(b'os_sensor', b'nowhere_1'),)

    foreign.write_foreign(path, TRUTH, change=change)
    report = convert(path, tmp_path / 'out')
    (loss,) = report.losses
    assert "'nowhere_1'" in loss.text()
    assert report.counts['labels'] == foreign.FRAMES - 1


def test_positions_without_a_fix_leave_their_frames_without_a_packet(tmp_path):
    def lose(message):
        return replace(message, status=replace(message.status, status=-1))

    path = hostile(tmp_path, '/gps/fix', None, lose)

    def name(plan):
        return replace(plan, fix='/gps/fix')

    report = convert(path, tmp_path / 'out', Layout.RAW, name)
    assert 'oxts' not in report.counts
    assert any('no fix' in note for note in report.notes)
    tracking = convert(path, tmp_path / 'tracking', Layout.TRACKING, name)
    assert any('so oxts is left out' in loss.text() for loss in tracking.losses)


def test_tracking_ends_its_packets_where_one_is_lacking(tmp_path):
    """Line n is frame n: none may be left out in between."""

    def lose(message):
        return replace(message, status=replace(message.status, status=-1))

    path = tmp_path / 'bag.mcap'

    def change(topic, place, message):
        return lose(message) if topic == '/gps/fix' and place >= 4 else message

    foreign.write_foreign(path, TRUTH, change=change)
    report = convert(path, tmp_path / 'out', Layout.TRACKING)
    lines = (tmp_path / 'out/training/oxts/0000.txt').read_text().splitlines()
    assert 0 < len(lines) < foreign.FRAMES
    (loss,) = report.losses
    assert (loss.stream, loss.count) == ('/imu/data', foreign.FRAMES - len(lines))
    assert f'oxts ends before frame {len(lines)}' in loss.text()


def test_a_plan_that_names_the_wrong_topic_says_which_there_are(tmp_path):
    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH)

    def wrong(plan):
        return replace(plan, scan=replace(plan.scan, topic='/velodyne'))

    with pytest.raises(UsageError, match=r'/velodyne.*/sensors/ouster/points'):
        convert(path, tmp_path / 'out', change=wrong)


def command(capsys, *words):
    """Exit code and the lines of both streams of kitti-ros2 to-kitti."""
    code = main(['to-kitti', *map(str, words)])
    said = capsys.readouterr()
    assert 'internal error' not in said.err
    return code, said.out.splitlines(), said.err.splitlines()


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('topic', 'layout'),
    [
        (POINTS, 'object'),
        (LEFT, 'object'),
        ('/cam/left/camera_info', 'tracking'),
        (BOXES, 'tracking'),
        ('/imu/data', 'raw'),
        ('/odom', 'odometry'),
    ],
)
def test_a_topic_of_which_nothing_can_be_decoded_is_a_loss(topic, layout, tmp_path, capsys):
    path = hostile(tmp_path, topic, None, cut)
    code, _, (loss, _) = command(capsys, path, tmp_path / 'out', '--layout', layout, '-q')
    assert code == 1
    assert loss.startswith(f'skipped {topic} (')
    assert 'not one of its messages can be read; the first cannot be decoded' in loss
    assert main(['to-kitti', str(path), '--layout', layout, '--plan']) == 0
    assert f'# {topic}: not one of its messages can be read' in capsys.readouterr().out


def test_transforms_that_cannot_be_decoded_are_told_where_they_lack(tmp_path, capsys):
    path = hostile(tmp_path, '/tf_static', None, cut)
    code, _, (line,) = command(capsys, path, tmp_path / 'out', '--layout', 'object', '-q')
    assert code == 2
    assert '/tf_static: not one of its messages can be read' in line


@pytest.mark.parametrize('first', [(b'',), (b'\0\1\0\0',)])
def test_a_message_without_a_header_leaves_the_stamps_of_the_others(first, tmp_path):
    path = hostile(tmp_path, POINTS, 0, lambda _: first)
    report = convert(path, tmp_path / 'out', Layout.RAW)
    assert not any('log time' in note for note in report.notes)
    stamps = open_recording(tmp_path / 'out').streams[Stream.SCAN].stamps_ns
    assert stamps.tolist() == [frame.stamp_ns for frame in TRUTH[1:]]


def test_a_look_that_fails_does_not_hide_the_rest(tmp_path):
    """Topics are told by their first messages: here only the third can be read."""
    cut_up = {0, 1, *range(3, foreign.FRAMES)}

    def change(topic, place, message):
        return cut(message) if topic == POINTS and place in cut_up else message

    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, change=change)
    report = convert(path, tmp_path / 'out')
    assert report.counts['scan'] == 1
    assert sum(loss.count for loss in report.losses) == foreign.FRAMES - 1


def test_a_first_cloud_without_fields_does_not_hide_the_rest(tmp_path):
    path = hostile(tmp_path, POINTS, 0, lambda message: replace(message, fields=[]))
    report = convert(path, tmp_path / 'out')
    assert report.counts['scan'] == foreign.FRAMES - 1


def with_definition(path, topic, text):
    """The bag with a topic's type defined by a text of its own."""
    with open_messages(foreign.write_foreign(path.with_name('plain.mcap'), TRUTH)) as messages:
        store = messages.typestore
        with path.open('wb') as file:
            writer = Writer(file)
            writer.start(profile='ros2')
            channels = {}
            for name, msgtype in messages.channels:
                known = store.generate_msgdef(msgtype, ros_version=2)[0]
                text_of = (text if name == topic else known).encode()
                schema = writer.register_schema(msgtype, 'ros2msg', text_of)
                channels[name] = writer.register_channel(name, 'cdr', schema)
            for message in messages:
                stamp, data = message.stamp_ns, bytes(message.data)
                writer.add_message(channels[message.topic], stamp, data, stamp)
            writer.finish()
    return path


HEADER = f"""std_msgs/Header header
uint32 height
{'=' * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""


@pytest.mark.one_in(3)
@pytest.mark.parametrize('text', [HEADER, 'uint32 width\n', 'std_msgs/Header[] header\n'])
@pytest.mark.parametrize(
    'topic', [POINTS, LEFT, '/cam/right/image_rect/compressed', '/cam/left/camera_info', BOXES]
)
def test_a_type_that_lacks_what_is_read_is_a_loss(topic, text, tmp_path, capsys):
    path = with_definition(tmp_path / 'bag.mcap', topic, text)
    code, _, errors = command(capsys, path, tmp_path / 'out', '--layout', 'object', '-q')
    assert code == 1
    (loss,) = [line for line in errors if line.startswith(f'skipped {topic}')]
    assert 'the bag defines' in loss
    assert 'without' in loss


def test_a_topic_in_another_encoding_is_a_loss_where_it_would_be_used(tmp_path, capsys):
    plain = foreign.write_foreign(tmp_path / 'plain.mcap', TRUTH)
    path = tmp_path / 'bag.mcap'
    with open_messages(plain) as messages, path.open('wb') as file:
        writer = Writer(file)
        writer.start()
        channels = {}
        for name, msgtype in messages.channels:
            encoding = 'json' if name in (POINTS, '/odom') else 'cdr'
            schema = writer.register_schema(msgtype, 'ros2msg', b'')
            channels[name] = writer.register_channel(name, encoding, schema)
        for message in messages:
            stamp, data = message.stamp_ns, bytes(message.data)
            writer.add_message(channels[message.topic], stamp, data, stamp)
        writer.finish()
    code, notes, (loss, _) = command(capsys, path, tmp_path / 'out', '--layout', 'object')
    assert code == 1
    assert loss == f'skipped {POINTS} (12): {path}: {POINTS} is json, which is not read'
    assert f'note: {path}: /odom is json, which is not read' in notes


def test_without_camera_info_labels_are_left_out_and_that_is_said(tmp_path, capsys):
    infos = '/cam/left/camera_info', '/cam/right/camera_info'
    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, 'mcap', *infos)
    code, notes, errors = command(capsys, path, tmp_path / 'out', '--layout', 'object')
    assert (code, errors) == (0, [])
    assert f'note: {BOXES}: left out, for labels need a calibration' in notes


def test_calib_stands_in_for_a_camera_that_was_never_calibrated(tmp_path):
    sound = foreign.write_foreign(tmp_path / 'sound.mcap', TRUTH)
    convert(sound, tmp_path / 'sound')
    path = hostile(
        tmp_path,
        '/cam/left/camera_info',
        None,
        lambda message: replace(message, k=np.zeros(9), p=np.zeros(12)),
    )
    calib = tmp_path / 'sound/training/calib/000000.txt'

    def by_file(plan):
        cameras = {index: replace(camera, rectify=False) for index, camera in plan.cameras.items()}
        return replace(plan, calibration=str(calib), cameras=cameras)

    report = convert(path, tmp_path / 'out', change=by_file)
    assert report.losses == ()
    made = tmp_path / 'out/training/calib/000003.txt'
    assert made.read_text() == calib.read_text()


@pytest.mark.parametrize(('place', 'frame'), [(12, 6), (13, None)])
def test_a_camera_info_that_changes_is_of_its_own_frame(tmp_path, place, frame):
    """The images of this camera come twice as often as frames: that of message 13 has none."""

    def zoom(message):
        return replace(message, k=message.k * 2, p=message.p * 2)

    path = hostile(tmp_path, '/cam/left/camera_info', place, zoom)
    report = convert(path, tmp_path / 'out')
    said = any('each frame has the one valid at its stamp' in note for note in report.notes)
    assert said == (frame is not None)
    lines = [
        (tmp_path / f'out/training/calib/{number:06d}.txt').read_text().splitlines()[2]
        for number in range(foreign.FRAMES)
    ]
    assert [number for number, line in enumerate(lines) if line != lines[0]] == (
        [] if frame is None else [frame]
    )


@pytest.mark.parametrize(
    'change',
    [
        {'distortion_model': 'thin_prism'},
        {'d': np.ones(100)},
        {'width': 100_000, 'height': 1},
        {'width': 30_000, 'height': 30_000},
        {'binning_x': 2**32 - 1},
    ],
)
def test_a_camera_that_cannot_be_rectified_is_one_line_with_its_topic(change, tmp_path, capsys):
    info = '/cam/left/camera_info'
    path = hostile(tmp_path, info, None, lambda message: replace(message, **change))
    code, _, (line,) = command(capsys, path, tmp_path / 'out', '--layout', 'object', '-q')
    assert code == 2
    assert f'kitti-ros2: {info}: ' in line
    assert not (tmp_path / 'out').exists()


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('change', [{'x': 1e300}, {'x': np.nan}, {'x': -4.0}, {'x': 0.0}])
def test_boxes_of_no_possible_size_are_left_out(change, tmp_path):
    kind = 'vision_msgs/msg/Detection3DArray'

    def resize(parts):
        message = TYPESTORE.deserialize_cdr(join(parts), kind)
        for detection in message.detections:
            for name, value in change.items():
                setattr(detection.bbox.size, name, value)
        return (bytes(TYPESTORE.serialize_cdr(message, kind)),)

    report = convert(hostile(tmp_path, BOXES, None, resize), tmp_path / 'out')
    (loss,) = report.losses
    assert (loss.stream, loss.count) == (BOXES, foreign.FRAMES)
    assert loss.text().endswith(
        f'{BOXES}: boxes without a possible size, place or score (NaN, a size of 0 or less, or'
        f' beyond 100 km)'
    )


@pytest.mark.parametrize('name', ['x\ny: evil\nz', '\x1b[31mred', '../../x', '{x}[red]', ''])
def test_a_topic_of_any_name_is_data_and_nothing_more(name, tmp_path, capsys):
    """Neither lines of a plan, nor escape sequences, nor paths."""
    with open_messages(foreign.write_foreign(tmp_path / 'plain.mcap', TRUTH)) as messages:
        path = tmp_path / 'bag.mcap'
        with open_bag(path, BagOptions(), messages.typestore) as writer:
            channels = {
                topic: writer.add_channel(Channel(name if topic == '/odom' else topic, msgtype))
                for topic, msgtype in messages.channels
            }
            for message in messages:
                parts = (cut((bytes(message.data),)) if message.topic == '/odom' else
                         [bytes(message.data)])  # fmt: skip
                writer.write(channels[message.topic], message.stamp_ns, parts)
    code, out, errors = command(capsys, path, tmp_path / 'out', '--layout', 'odometry')
    assert code == 1
    assert len(errors) == 2
    assert all(line.isprintable() for line in (*out, *errors))
    assert main(['to-kitti', str(path), '--layout', 'odometry', '--plan']) == 0
    text = capsys.readouterr().out
    assert parse_plan(text, tmp_path).layout is Layout.ODOMETRY
    assert sorted(file.name for file in tmp_path.iterdir()) == ['bag.mcap', 'out', 'plain.mcap']


def test_a_bag_that_is_given_twice_is_refused(tmp_path, capsys):
    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH)
    (tmp_path / 'link').symlink_to(path)
    words = path, tmp_path / 'link', tmp_path / 'out', '--layout', 'object'
    code, _, (line,) = command(capsys, *words)
    assert code == 2
    assert 'is given twice' in line


@pytest.mark.parametrize('option', ['--plan-file', '--calib'])
@pytest.mark.parametrize('kind', ['pipe', 'bytes'])
def test_files_beside_the_bag_that_are_no_text_are_refused(option, kind, tmp_path, capsys):
    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH)
    beside = tmp_path / 'beside'
    os.mkfifo(beside) if kind == 'pipe' else beside.write_bytes(bytes(range(256)))
    words = path, tmp_path / 'out', '--layout', 'object', '-q', option, beside
    code, _, (line,) = command(capsys, *words)
    assert code == 2
    assert str(beside) in line
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('frame', ['cam_left_optical', 'imu_sensor', 'roof'])
def test_a_fix_is_of_its_antenna_and_a_packet_of_the_imu(frame, tmp_path):
    places = {'cam_left_optical': foreign.BASE_T_CAMERA, 'imu_sensor': foreign.BASE_T_IMU}
    base_t_antenna = places.get(frame, foreign.BASE_T_IMU)

    def of_its_antenna(message):
        stamp = message.header.stamp
        pose = foreign.base_pose(stamp.sec * 10**9 + stamp.nanosec) @ base_t_antenna
        east, north, _ = np.degrees(pose.translation / 6378137.0)
        header = replace(message.header, frame_id=frame)
        alt = 110.0 + pose.translation[2]
        return replace(message, header=header, latitude=north, longitude=east, altitude=alt)

    path = hostile(tmp_path, '/gps/fix', None, of_its_antenna)
    report = convert(path, tmp_path / 'out', Layout.RAW)
    texts = sorted((tmp_path / 'out').rglob('oxts/data/*.txt'))
    packets = [parse_packet(text.read_text(), text) for text in texts]
    degrees = np.array([[packet.lon, packet.lat] for packet in packets])
    stamps = open_recording(texts[0].parents[2]).streams[Stream.OXTS].stamps_ns
    poses = [foreign.base_pose(at) @ foreign.BASE_T_IMU for at in stamps.tolist()]
    truth = np.array([pose.translation[:2] for pose in poses])
    # Places between two fixes lie on a straight line.
    np.testing.assert_allclose(np.radians(degrees) * 6378137.0, truth, atol=0.01)
    notes = [note for note in report.notes if note.startswith('/gps/fix')]
    told = {
        'cam_left_optical': ['its antenna (cam_left_optical) is ', 'moved there'],
        'imu_sensor': [],
        'roof': ["no static transform joins its frame 'roof'", 'taken as those of imu_sensor'],
    }
    assert len(notes) == bool(told[frame])
    assert all(words in notes[0] for words in told[frame])
