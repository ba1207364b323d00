# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Images that a player makes of a bag's: decoded ones, and ones with the labels drawn on them."""

from __future__ import annotations

import random
from dataclasses import replace

import cv2
import numpy as np
import pytest

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.messages.cdr import deserialize, join, make_header, serialize
from kitti_ros2.messages.ros_types import TYPESTORE, CompressedImage
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.table import make_play_settings, make_settings
from kitti_ros2.player import bag_program
from kitti_ros2.player.bag_program import open_program

from builders import convert_recording  # isort: skip
from foreign import D, K, SIZE, lidar_t_camera, make_truth, write_foreign  # isort: skip

IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED = 'sensor_msgs/msg/CompressedImage'
LEFT, RIGHT = '/cam/left', '/cam/right'
STORAGES = {'mcap': 'o.mcap', 'sqlite3': 'o', 'ros1': 'o.bag'}


def played(source, **values):
    return open_program(source, make_play_settings(values))


def names(program, msgtype=IMAGE):
    return {outlet.topic for outlet in program.channels if outlet.msgtype == msgtype}


def images(program, order=None):
    """By Image topic the serialised images in order, and what is missing; all are subscribed."""
    wanted = {n for n, each in enumerate(program.channels) if each.msgtype == IMAGE}
    found, lost = {}, []
    places = range(len(program.stamps_ns)) if order is None else order
    for place in places:
        due, missing = program.fetch(place, wanted)
        lost += missing
        for message in due:
            if message.channel in wanted:
                name = program.channels[message.channel].topic
                found.setdefault(name, []).append((message.stamp_ns, message.data))
    return {name: [data for _, data in sorted(each)] for name, each in found.items()}, lost


def converted(source, out, kind=Images.COMPRESSED, storage='mcap'):
    convert_recording(source, out, MessageOptions(images=kind), storage=storage)
    return out


def raw_messages(path):
    """By topic the Image messages of a bag, as a subscriber has them."""
    found = {}
    with open_messages(path) as messages:
        for message in messages:
            if message.msgtype == IMAGE:
                data = bytes(message.data)
                found.setdefault(message.topic, []).append(data + bytes(-len(data) % 4))
    return found


@pytest.fixture
def holes(drive):
    """A raw drive whose cameras begin late and have gaps, each others."""
    for camera, numbers in ((0, [0]), (1, [0, 2]), (2, [0, 3]), (3, [])):
        for number in numbers:
            (drive / f'image_0{camera}' / 'data' / f'{number:010d}.png').unlink()
    return drive


@pytest.mark.parametrize('storage', list(STORAGES))
def test_decoded_images_are_those_that_to_bag_writes(holes, tmp_path, storage):
    bag = converted(holes, tmp_path / STORAGES[storage], storage=storage)
    expected = raw_messages(converted(holes, tmp_path / 'raw.mcap', Images.RAW))
    found, lost = images(played(bag))
    assert [len(each) for _, each in sorted(expected.items())] == [3, 5, 4, 3]
    assert (found, lost) == (expected, [])


def test_decoded_images_of_object_frames(recordings, tmp_path):
    source = recordings[Layout.OBJECT] / 'training'
    bag = converted(source, tmp_path / 'o.mcap')
    expected = raw_messages(converted(source, tmp_path / 'raw.mcap', Images.RAW))
    assert images(played(bag))[0] == expected


def test_the_order_of_positions_does_not_matter(holes, tmp_path):
    bag = converted(holes, tmp_path / 'o.mcap')
    program = played(bag, annotated=True)
    places = list(range(len(program.stamps_ns)))
    expected, _ = images(program)
    random.Random(3).shuffle(places)
    assert images(program, places) == (expected, [])


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING])
def test_labels_are_drawn_as_they_are_on_a_folder(recordings, tmp_path, layout):
    bag = converted(recordings[layout], tmp_path / 'o.mcap')
    check_drawn_alike(recordings[layout], bag)


@pytest.mark.parametrize('storage', list(STORAGES))
def test_labels_of_a_drive_with_holes_are_drawn_as_on_its_folder(holes, tmp_path, storage):
    check_drawn_alike(holes, converted(holes, tmp_path / STORAGES[storage], storage=storage))


def test_labels_of_real_frames_are_drawn_as_on_their_folder(real_kitti, tmp_path):
    """Their images have different sizes, and each frame its calibration."""
    source = real_kitti / 'object' / 'training'
    check_drawn_alike(source, converted(source, tmp_path / 'o.mcap'))


def check_drawn_alike(folder, bag):
    expected, _ = images(played(folder, annotated=True))
    found, lost = images(played(bag, annotated=True))
    assert lost == []
    assert found == expected
    drawn = [name for name in found if name.endswith('/annotated')]
    assert drawn
    for name in drawn:
        (plain,) = (each for each in found if each.startswith(name.removesuffix('annotated') + 'i'))
        assert found[name] != found[plain]


@pytest.fixture(scope='module')
def truth():
    return make_truth()


@pytest.fixture(scope='module')
def foreign(truth, tmp_path_factory):
    """Raw images on the left, JPEGs on the right, boxes in the lidar's frame."""
    return write_foreign(tmp_path_factory.mktemp('foreign') / 'o.mcap', truth)


def test_jpegs_are_decoded_and_keep_their_headers(foreign):
    found, lost = images(played(foreign))
    expected = []
    with open_messages(foreign, {f'{RIGHT}/image_rect/compressed'}) as messages:
        for message in messages:
            stored = deserialize(bytes(message.data), COMPRESSED)
            expected.append((stored.header, cv2.imdecode(stored.data, cv2.IMREAD_COLOR)))
    decoded = [deserialize(data, IMAGE) for data in found[f'{RIGHT}/image_rect']]
    assert lost == []
    assert [each.header for each in decoded] == [header for header, _ in expected]
    for image, (_, pixels) in zip(decoded, expected, strict=True):
        assert (image.encoding, image.width, image.height) == ('bgr8', *SIZE)
        assert np.array_equal(image.data, pixels.ravel())


def test_boxes_of_a_foreign_bag_are_drawn_where_its_lens_shows_them(foreign, truth):
    """By OpenCV's own projection, on the image as it is: it is distorted."""
    program = played(foreign, annotated=True)
    assert {f'{LEFT}/annotated', f'{RIGHT}/annotated'} <= names(program)
    found, lost = images(program)
    assert lost == []
    drawn = [deserialize(data, IMAGE) for data in found[f'{LEFT}/annotated']]
    stamps = np.array([each.header.stamp.sec * 10**9 + each.header.stamp.nanosec for each in drawn])
    for frame in truth[:6]:
        image = drawn[int(np.argmin(np.abs(stamps - frame.stamp_ns)))]
        assert image.header.frame_id == 'cam_left_optical'
        pixels = image.data.reshape(image.height, image.width, 3).astype(int)
        grey = (pixels == pixels[..., :1]).all(axis=2)
        for column, row in np.round(corners(frame)).astype(int):
            near = grey[row - 2 : row + 3, column - 2 : column + 3]
            assert not near.all(), (column, row)


def corners(frame):
    """(N, 2) pixels of the corners of a frame's box that the left camera sees."""
    signs = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5]), -1).reshape(-1, 3)
    places = frame.cuboid.velo_T_box.apply(signs * np.array(frame.cuboid.size_lwh))
    seen = lidar_t_camera().inverse().apply(places)
    pixels, _ = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), K, D)
    pixels = pixels[:, 0]
    inside = ((pixels > 4) & (pixels < np.array(SIZE) - 5)).all(axis=1)
    assert inside.any()
    return pixels[inside]


@pytest.mark.parametrize(
    ('left_out', 'said'),
    [
        (['/perception/objects'], 'no labels (a Detection3DArray'),
        ([f'{LEFT}/camera_info', f'{RIGHT}/camera_info'], 'no calibration (camera_info)'),
        (['/tf_static'], 'no static transform from '),
        (
            [f'{LEFT}/image_raw', f'{RIGHT}/image_rect/compressed', '/perception/objects'],
            'no camera images and no labels',
        ),
    ],
)
def test_what_is_missing_for_labels_is_one_line(truth, tmp_path, left_out, said):
    bag = write_foreign(tmp_path / 'o.mcap', truth, 'mcap', *left_out)
    with pytest.raises(UsageError) as error:
        played(bag, annotated=True)
    assert str(error.value).startswith(f'{bag}: no annotated images can be made: ')
    assert said in str(error.value)
    assert '\n' not in str(error.value)
    assert played(bag).channels


def test_a_folder_without_labels_is_refused_alike(recordings):
    with pytest.raises(UsageError, match='no annotated images can be made'):
        played(recordings[Layout.ODOMETRY], annotated=True)


def write_images(path, topics):
    """A bag of one PNG in each of some topics of CompressedImage."""
    done, data = cv2.imencode('.png', np.arange(35, dtype=np.uint8).reshape(5, 7))
    assert done
    with open_bag(path, BagOptions(), TYPESTORE) as writer:
        for stamp_ns, (topic, form) in enumerate(topics.items(), 10**9):
            channel = writer.add_channel(Channel(topic, COMPRESSED))
            message = CompressedImage(make_header(stamp_ns, 'cam'), form, data.ravel())
            writer.write(channel, stamp_ns, (join(serialize(message)),))
    return path


def test_names_of_topics_that_do_not_end_in_compressed(tmp_path):
    topics = {'/a/image/compressed': 'png', '/b/front': 'png', '/compressed': 'png'}
    program = played(write_images(tmp_path / 'o.mcap', topics))
    assert names(program) == {'/a/image', '/b/front/raw', '/compressed/raw'}
    found, lost = images(program)
    assert lost == []
    assert {name: deserialize(data, IMAGE).encoding for name, (data,) in found.items()} == (
        dict.fromkeys(found, 'mono8')
    )


def test_depth_images_are_played_as_they_are(tmp_path):
    topic = '/depth/image/compressedDepth'
    bag = write_images(tmp_path / 'o.mcap', {topic: '16UC1; compressedDepth', '/a/compressed': ''})
    program = played(bag, images='raw')
    assert names(program, COMPRESSED) == {topic}
    assert names(program) == {'/a'}
    assert [note for note in program.notes() if topic in note]


@pytest.mark.parametrize('recorded', ['compressed', 'raw', 'both'])
@pytest.mark.parametrize('asked', ['compressed', 'raw', 'both'])
def test_which_images_are_played(recordings, tmp_path, recorded, asked):
    """As a folder does it, but that nothing compresses what a bag has raw only."""
    folder = recordings[Layout.TRACKING]
    bag = converted(folder, tmp_path / 'o.mcap', Images(recorded))
    program, expected = played(bag, images=asked), played(folder, images=asked)
    if recorded == 'raw':
        assert (len(names(program)), len(names(program, COMPRESSED))) == (2, 0)
        return
    for msgtype in (IMAGE, COMPRESSED):
        assert names(program, msgtype) == names(expected, msgtype)


def test_topics_may_name_what_is_made(recordings, tmp_path):
    bag = converted(recordings[Layout.TRACKING], tmp_path / 'o.mcap')
    name = '/kitti/camera_color_left/image_rect'
    program = played(bag, topics=(name,))
    assert [outlet.topic for outlet in program.channels] == [name]
    assert len(images(program)[0][name]) == len(program.stamps_ns) == 5
    with pytest.raises(UsageError, match='no topic is called /kitti/camera_x'):
        played(bag, topics=('/kitti/camera_x',))


def test_nothing_is_decoded_for_nobody(recordings, tmp_path, monkeypatch):
    bag = converted(recordings[Layout.RAW], tmp_path / 'o.mcap')
    program = played(bag, annotated=True)
    monkeypatch.setattr(bag_program, 'pixels_of', pytest.fail)
    compressed = {n for n, each in enumerate(program.channels) if each.msgtype == COMPRESSED}
    for wanted in ((), compressed):
        for place in range(len(program.stamps_ns)):
            due, missing = program.fetch(place, wanted)
            assert not missing
            made = [each for each in due if program.channels[each.channel].msgtype == IMAGE]
            assert not any(each.data for each in made)


def test_an_image_is_decoded_once(recordings, tmp_path, monkeypatch):
    bag = converted(recordings[Layout.TRACKING], tmp_path / 'o.mcap')
    decoded = []
    decode = bag_program.pixels_of
    monkeypatch.setattr(bag_program, 'pixels_of', lambda image: decoded.append(1) or decode(image))
    found, _ = images(played(bag, annotated=True))
    assert len(found) == 4
    assert len(decoded) == 10


def test_a_damaged_image_costs_itself(truth, tmp_path):
    def change(topic, place, message):
        if topic.endswith('compressed') and place == 3:
            return replace(message, data=np.frombuffer(b'no picture', np.uint8))
        return message

    bag = write_foreign(tmp_path / 'o.mcap', truth, change=change)
    found, lost = images(played(bag))
    assert (len(found[f'{RIGHT}/image_rect']), len(found[f'{LEFT}/image_raw'])) == (23, 24)
    assert [each.count for each in lost] == [1]
    assert f'{bag}: {RIGHT}/image_rect cannot be made: neither PNG nor JPEG' in lost[0].message


def test_a_header_that_no_image_can_have_costs_its_image(truth, tmp_path):
    """More nanoseconds than a second has, in the last second that there is."""

    def change(topic, place, message):
        if topic.endswith('compressed') and place == 3:
            stamp = replace(message.header.stamp, sec=2**31 - 1, nanosec=2**32 - 1)
            return replace(message, header=replace(message.header, stamp=stamp))
        return message

    found, lost = images(played(write_foreign(tmp_path / 'o.mcap', truth, change=change)))
    assert len(found[f'{RIGHT}/image_rect']) == 23
    assert [each.count for each in lost] == [1]


def test_what_is_not_played_is_as_it_was(recordings, tmp_path):
    """Settings of a conversion, which Rerun's view has: a bag shows what it holds."""
    bag = converted(recordings[Layout.TRACKING], tmp_path / 'o.mcap', Images.BOTH)
    program = open_program(bag, make_settings({}))
    with open_messages(bag) as messages:
        assert [(each.topic, each.msgtype) for each in program.channels] == list(messages.channels)


def test_wrong_images_are_wrong_usage(recordings, capsys):
    assert main(['play', str(recordings[Layout.RAW]), '--images', 'jpeg', '--foxglove']) == 2
    assert 'images takes compressed, raw or both' in capsys.readouterr().err


def recorded_later(source, path):
    """A bag with other log times than header stamps, as a recording of a player has them."""
    rng = random.Random(4)
    with open_messages(source) as messages, open_bag(path, BagOptions(), TYPESTORE) as writer:
        channels = {
            topic: writer.add_channel(
                Channel(
                    topic,
                    msgtype,
                    latched=topic in messages.latched,
                    depth=messages.latched.get(topic, 10),
                )
            )
            for topic, msgtype in messages.channels
        }
        late = [
            (each.stamp_ns + 4 * 10**17 + rng.randrange(2_000_000), each.topic, bytes(each.data))
            for each in messages
        ]
        for stamp_ns, topic, data in sorted(late):
            writer.write(channels[topic], stamp_ns, (data,))
    return path


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING])
def test_labels_are_drawn_in_a_recording_of_a_player(recordings, tmp_path, layout):
    bag = recorded_later(converted(recordings[layout], tmp_path / 'o.mcap'), tmp_path / 'r.mcap')
    check_drawn_alike(recordings[layout], bag)


def test_an_image_without_labels_near_it_stays_plain(recordings, tmp_path):
    """Frames without a label file, at both ends of a gap."""
    bag = converted(recordings[Layout.RAW], tmp_path / 'o.mcap')
    thin = tmp_path / 'thin.mcap'
    with open_messages(bag) as messages, open_bag(thin, BagOptions(), TYPESTORE) as writer:
        channels = {t: writer.add_channel(Channel(t, kind)) for t, kind in messages.channels}
        labels = 0
        for each in messages:
            labels += each.topic == '/kitti/labels/detections'
            if each.topic != '/kitti/labels/detections' or labels not in (2, 3):
                writer.write(channels[each.topic], each.stamp_ns, (bytes(each.data),))
    expected, _ = images(played(recordings[Layout.RAW], annotated=True))
    found, lost = images(played(thin, annotated=True))
    name = '/kitti/camera_color_left/annotated'
    same = [one == two for one, two in zip(found[name], expected[name], strict=True)]
    assert (same, lost) == ([True, False, False, True, True], [])
    plain = [
        deserialize(data, IMAGE).data for data in found[name.replace('annotated', 'image_rect')]
    ]
    drawn = [deserialize(data, IMAGE).data for data in found[name]]
    assert [np.array_equal(*pair) for pair in zip(plain, drawn, strict=True)] == (
        [False, True, True, False, False]
    )
