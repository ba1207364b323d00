# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""--objects autoware and --annotations: bags of every layout, read by a reader of others."""

from __future__ import annotations

from collections import defaultdict
from contextlib import closing

import numpy as np
import pytest
from folder_and_bag import BAGS, make_holes, rerecord
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from prediction_set import write_prediction_set

from kitti_ros2.api.conversions import to_kitti
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import decode_static
from kitti_ros2.messages.detections import cuboids_of_objects
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.boxes import count_points
from kitti_ros2.model.classes import class_of, label_of
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.samples import cuboids_of
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MessageOptions, Objects
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program

from builders import SMALL, convert_recording  # isort: skip

LABELLED = [Layout.RAW, Layout.OBJECT, Layout.TRACKING]
DETECTIONS = '/kitti/labels/detections'
DETECTED, TRACKED = '/kitti/labels/detected_objects', '/kitti/labels/tracked_objects'
LEFT = '/kitti/camera_color_left'
ANNOTATIONS = f'{LEFT}/annotations'
LINE_LOOP = 2
BOTH = MessageOptions(objects=Objects.BOTH, annotations=True)
AUTOWARE = MessageOptions(objects=Objects.AUTOWARE, annotations=True)


def foreign_read(bag):
    """By topic and log time the messages, decoded by the definitions in the file alone."""
    found = defaultdict(dict)
    with bag.open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found[channel.topic][message.log_time] = decoded
    return found


def only_of_holes(report) -> None:
    """That files are missing, and no message is."""
    assert {loss.stream for loss in report.losses} <= {each.value for each in Stream}


def stamp_of(annotation) -> int:
    return annotation.timestamp.sec * 10**9 + annotation.timestamp.nanosec


def name_of(box) -> str:
    """Class and track."""
    has_track = box.track_id is not None and box.track_id >= 0
    return f'{box.class_name} {box.track_id}' if has_track else box.class_name


def corners_of(left, top, right, bottom):
    """In Foxglove's pixels, which begin half a pixel before KITTI's."""
    corners = (left, top), (right, top), (right, bottom), (left, bottom)
    return tuple((x + 0.5, y + 0.5) for x, y in corners)


def base_t_velo(static) -> Transform:
    found = {child: transform for _, child, transform in decode_static(static)}
    return found['imu_link'] @ found['velo_link']


@pytest.fixture(scope='module', params=LABELLED, ids=[layout.value for layout in LABELLED])
def holed(request, recordings, tmp_path_factory):
    """A recording with holes in its numbers, and its bag."""
    folder = tmp_path_factory.mktemp(request.param.value)
    source = make_holes(recordings[request.param], request.param, folder)
    bag = folder / 'bag.mcap'
    only_of_holes(convert_recording(source, bag, BOTH))
    return open_recording(source), foreign_read(bag)


def test_objects_are_the_boxes_of_the_labels(holed):
    """In base_link, placed by the transforms in the bag."""
    recording, found = holed
    index = recording.streams[Stream.LABELS]
    to_velo = {'base_link': base_t_velo(next(iter(found['/tf_static'].values()))).inverse()}
    assert sorted(found[DETECTED]) == sorted(index.stamps_ns.tolist())
    compared = 0
    for number, stamp in zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True):
        calibration = recording.calibration(number)
        expected = cuboids_of(recording.read(Stream.LABELS, number), calibration)
        made, skipped = cuboids_of_objects(found[DETECTED][stamp], to_velo)
        assert not skipped
        for one, other in zip(made, expected, strict=True):
            assert one.class_name == class_of(label_of(other.class_name, {}))
            assert one.size_lwh == other.size_lwh
            if recording.layout is not Layout.OBJECT:  # whose transforms change with each frame
                matrices = one.velo_T_box.matrix(), other.velo_T_box.matrix()
                np.testing.assert_allclose(*matrices, atol=1e-6)
            compared += 1
    assert compared > 10


def test_tracks_are_where_a_layout_has_them(holed):
    recording, found = holed
    if recording.layout is Layout.OBJECT:
        assert TRACKED not in found
        return
    assert sorted(found[TRACKED]) == sorted(found[DETECTED])
    for stamp, message in found[TRACKED].items():
        identities = [each.id for each in found[DETECTIONS][stamp].detections]
        made, _ = cuboids_of_objects(message, {'base_link': Transform.identity()})
        assert [each.identity for each in made] == identities


def test_annotations_have_the_stamps_of_the_images(holed):
    _, found = holed
    for camera in ('color_left', 'color_right'):
        images = found[f'/kitti/camera_{camera}/image_rect/compressed']
        made = found[f'/kitti/camera_{camera}/annotations']
        assert sorted(made) == sorted(images)
        for stamp, message in made.items():
            header = images[stamp].header.stamp
            stamps = {stamp_of(each) for each in (*message.points, *message.texts)}
            assert stamps == {header.sec * 10**9 + header.nanosec}
            assert {each.type for each in message.points} == {LINE_LOOP}


def test_annotations_are_the_2d_boxes_of_the_labels(holed):
    """In the labelled camera exactly."""
    recording, found = holed
    if recording.layout is Layout.RAW:
        return
    index, compared = recording.streams[Stream.IMAGE_2], 0
    labelled = recording.streams[Stream.LABELS].numbers.tolist()
    for number, stamp in zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True):
        boxes = recording.read(Stream.LABELS, number).boxes if number in labelled else []
        message = found[ANNOTATIONS][stamp]
        corners = {tuple((p.x, p.y) for p in each.points) for each in message.points}
        expected = {corners_of(*box.box_2d) for box in boxes}
        assert corners == (expected or {()})
        texts = sorted(each.text for each in message.texts)
        assert texts == sorted(map(name_of, boxes))
        compared += len(boxes)
    assert compared > 10


def test_tracklets_have_the_bounds_of_their_projection(holed):
    recording, found = holed
    if recording.layout is not Layout.RAW:
        return
    loops = [each for message in found[ANNOTATIONS].values() for each in message.points]
    width, height = SMALL.image_size
    xs = [point.x for each in loops for point in each.points]
    ys = [point.y for each in loops for point in each.points]
    assert len(xs) > 20
    assert 0.5 <= min(xs) <= max(xs) <= width - 0.5
    assert 0.5 <= min(ys) <= max(ys) <= height - 0.5


@pytest.mark.one_in(3)
@pytest.mark.parametrize('storage', BAGS)
@pytest.mark.parametrize('layout', LABELLED, ids=lambda layout: layout.value)
def test_own_bags_become_the_same_files(recordings, tmp_path, layout, storage):
    source = make_holes(recordings[layout], layout, tmp_path)
    bag, back = tmp_path / BAGS[storage], tmp_path / 'back'
    only_of_holes(convert_recording(source, bag, AUTOWARE, storage=storage))
    to_kitti(bag, back)
    folder = source.parent if layout is Layout.RAW else source
    assert files_in(back / folder.name if layout is Layout.RAW else back) == files_in(folder)


def files_in(folder):
    """By path the bytes of the files in a folder."""
    files = (path for path in folder.rglob('*') if path.is_file())
    return {path.relative_to(folder): path.read_bytes() for path in files}


def test_the_default_has_neither(recordings, tmp_path):
    bag = tmp_path / 'bag.mcap'
    convert_recording(recordings[Layout.TRACKING], bag, MessageOptions())
    topics = set(foreign_read(bag))
    assert DETECTIONS in topics
    assert not {DETECTED, TRACKED, ANNOTATIONS} & topics


def test_autoware_takes_the_place_of_detections(recordings, tmp_path):
    bag = tmp_path / 'bag.mcap'
    convert_recording(recordings[Layout.TRACKING], bag, AUTOWARE)
    topics = set(foreign_read(bag))
    assert {DETECTED, TRACKED, '/kitti/labels/boxes_2d', '/kitti/labels/markers'} <= topics
    assert DETECTIONS not in topics


def without_source(bag, out, *topics):
    """The bag of others: without the files of the recording, and without some topics."""
    with open_messages(bag) as messages, open_bag(out, BagOptions(), TYPESTORE) as writer:
        left_out = {name for name, _ in messages.channels if '/source/' in name} | {*topics}
        ids = {
            topic: writer.add_channel(
                Channel(topic, msgtype, latched=topic in messages.latched, depth=1)
            )
            for topic, msgtype in messages.channels
            if topic not in left_out
        }
        for message in messages:
            if message.topic in ids:
                writer.write(ids[message.topic], message.stamp_ns, [bytes(message.data)])
    return out


@pytest.mark.parametrize('topic', [DETECTED, TRACKED])
def test_objects_of_others_become_labels(recordings, tmp_path, topic):
    """A label file as from the labels of the recording, but for classes that share a label."""
    own, foreign = tmp_path / 'own.mcap', tmp_path / 'foreign.mcap'
    source = recordings[Layout.TRACKING]
    convert_recording(source, own, AUTOWARE)
    other = {DETECTED: TRACKED, TRACKED: DETECTED}[topic]
    without_source(own, foreign, other, '/kitti/labels/markers')
    to_kitti(foreign, tmp_path / 'back', layout='tracking')
    truth, back = open_recording(source), open_recording(tmp_path / 'back')
    index, compared = truth.streams[Stream.LABELS], 0
    for number, stamp in zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True):
        expected = boxes_of(truth, number)
        place = back.streams[Stream.LABELS].stamps_ns.tolist().index(stamp)
        for one in boxes_of(back, place):
            other = min(expected, key=lambda each: distance(each, one))
            np.testing.assert_allclose(
                one.velo_T_box.matrix(), other.velo_T_box.matrix(), atol=0.02
            )
            np.testing.assert_allclose(one.size_lwh, other.size_lwh, atol=0.01)
            assert one.class_name == class_of(label_of(other.class_name, {}))
            if topic == TRACKED:
                assert one.track_id == other.track_id
            compared += 1
    assert compared > 10


def boxes_of(recording, number):
    """The 3D boxes of a frame; locations in labels depend on which cameras a calibration has."""
    return cuboids_of(recording.read(Stream.LABELS, number), recording.calibration(number))


def distance(one, other) -> float:
    return float(np.linalg.norm(one.velo_T_box.translation - other.velo_T_box.translation))


def test_predictions_keep_their_scores_and_colours(recordings, tmp_path):
    """Compared with the labels, as markers are; those of a detector have no tracks."""
    root, results = write_prediction_set(recordings[Layout.OBJECT], tmp_path)
    bag = tmp_path / 'bag.mcap'
    words = ('--predictions', str(results), '--objects', 'autoware', '--annotations', '-q')
    assert main(['to-bag', str(root), str(bag), *words]) == 1  # a frame without results
    found = foreign_read(bag)
    scores = [
        [round(each.existence_probability, 2) for each in message.objects]
        for message in found['/kitti/predictions/detected_objects'].values()
    ]
    assert scores == [[0.9, 0.8, 0.7], [0.6], [0.4], [0.5]]
    assert '/kitti/predictions/tracked_objects' not in found
    texts = [
        sorted(each.text for each in message.texts)
        for message in found[f'{LEFT}/prediction_annotations'].values()
    ]
    assert texts == [
        ['Car 0.70', 'Car 0.80 FP', 'Car 0.90 TP IoU 0.90', 'Car FN'],
        ['Car 0.60 FP IoU 0.60', 'Car FN'],
        ['Pedestrian 0.40 FP'],
        ['Car 0.50'],
        [],
    ]


def test_a_class_gets_another_label(recordings, tmp_path):
    bag = tmp_path / 'bag.mcap'
    words = ('--objects', 'autoware', '--autoware-labels', 'Car=BUS', '-q', '--topics', DETECTED)
    assert main(['to-bag', str(recordings[Layout.TRACKING]), str(bag), *words]) == 0
    labels = {
        each.classification[0].label
        for message in foreign_read(bag)[DETECTED].values()
        for each in message.objects
    }
    assert 3 in labels
    assert 1 in labels  # Van


def test_annotations_of_nothing_are_an_error(recordings, tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(recordings[Layout.ODOMETRY]), str(bag), '--annotations']) == 2
    assert 'has neither labels nor predictions' in capsys.readouterr().err
    assert not bag.exists()


def test_a_bag_is_not_annotated(recordings, tmp_path):
    bag = tmp_path / 'bag.mcap'
    convert_recording(recordings[Layout.TRACKING], bag, MessageOptions())
    with pytest.raises(UsageError, match='to-bag --annotations makes a bag with them'):
        open_program(bag, make_play_settings({'annotations': True}))
    made = tmp_path / 'made.mcap'
    convert_recording(recordings[Layout.TRACKING], made, AUTOWARE)
    with closing(open_program(made, make_play_settings({'annotations': True}))) as program:
        assert ANNOTATIONS in {each.topic for each in program.channels}


def test_another_layout_keeps_the_classes_of_own_bags(recordings, tmp_path):
    """Tracklets have no label lines in a bag; Autoware calls a van a car, markers do not."""
    found = {}
    for name, options in (('vision', MessageOptions()), ('autoware', AUTOWARE)):
        bag, back = tmp_path / f'{name}.mcap', tmp_path / name
        convert_recording(recordings[Layout.RAW], bag, options)
        to_kitti(bag, back, layout='object')
        files = sorted((back / 'training' / 'label_2').iterdir())
        found[name] = [
            sorted(line.split()[0] for line in each.read_text().splitlines()) for each in files
        ]
    assert found['autoware'] == found['vision']
    assert any('Van' in classes for classes in found['autoware'])


def test_real_objects_contain_their_points(real_kitti, tmp_path):
    """As many as the labels themselves, by the transforms of the bag alone."""
    bag = tmp_path / 'bag.mcap'
    convert_recording(real_kitti / 'object' / 'training', bag, AUTOWARE)
    found = foreign_read(bag)
    counts, static = [], None
    for stamp, message in sorted(found[DETECTED].items()):
        static = found['/tf_static'].get(stamp, static)
        to_velo = {'base_link': base_t_velo(static).inverse()}
        cuboids, _ = cuboids_of_objects(message, to_velo)
        cloud = found['/kitti/velo/points'][stamp]
        points = np.frombuffer(cloud.data, '<f4').reshape(-1, 4)
        counted = zip(cuboids, count_points(cuboids, points), strict=True)
        counts.append({each.class_name: count for each, count in counted})
    assert counts == [
        {'Pedestrian': 376},
        {'Truck': 70, 'Car': 9, 'Cyclist': 18},
        {'Misc': 1351, 'Car': 67},
    ]


def test_a_recorded_bag_becomes_the_same_files(recordings, tmp_path):
    """Annotations have no header that would number them."""
    bag, back = tmp_path / 'bag.mcap', tmp_path / 'back'
    convert_recording(recordings[Layout.TRACKING], bag, BOTH)
    recorded = rerecord(bag, tmp_path / 'recorded.mcap', 10**9)
    to_kitti(recorded, back)
    assert files_in(back) == files_in(recordings[Layout.TRACKING])
