# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Every mode makes its picture of any frame that has what it takes, and says what is missing."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from kitti_ros2.cli import main
from kitti_ros2.drawing.labelled_objects import LabelledObject, colour_pixels, compared, objects_of
from kitti_ros2.kitti.label_file import ResultFiles
from kitti_ros2.model.errors import MissingDataError, UsageError
from kitti_ros2.model.samples import FrameLabels
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import BirdOptions, ColorBy, PictureOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.painters import Predictions
from kitti_ros2.pictures.panel import (
    BIRD,
    BOXES_2D,
    DISTANCE,
    INTENSITY,
    LIDAR,
    MODES,
    SIZE,
    facts_of,
    parts_of,
)
from kitti_ros2.pictures.recording_frames import FrameData, open_frames
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions

ANY = PictureOptions()
DRIVE = SyntheticDrive(SyntheticOptions(frames=1, image_size=(414, 125), lidar_columns=300))


def make_frame(**changes) -> FrameData:
    """The first frame of the synthetic drive, in memory."""
    labels = FrameLabels(boxes=DRIVE.boxes(0))
    frame = FrameData(
        source='synthetic',
        number=0,
        stamp_ns=DRIVE.stamps(0).scan,
        images={camera: colour_pixels(DRIVE.picture(0, camera)) for camera in range(4)},
        points=DRIVE.scan(0).points,
        calibration=DRIVE.calibration,
        objects=objects_of(labels, DRIVE.calibration),
        packet=DRIVE.packet(0),
    )
    return replace(frame, **changes)


FRAME = make_frame()


def count_colors(pixels: np.ndarray) -> int:
    return len(np.unique(pixels @ (1 << 16, 1 << 8, 1)))


@pytest.mark.parametrize('camera', range(4))
@pytest.mark.parametrize('mode', ['camera', 'boxes', 'lidar'])
def test_images_are_drawn_on_copies(mode, camera):
    picture = MODES[mode].draw(FRAME, PictureOptions(camera=camera))
    original = FRAME.images[camera]
    assert picture.shape == original.shape
    assert picture.dtype == np.uint8
    changed = (picture != original).any(axis=2)
    assert 0.005 < changed.mean() < 0.9
    np.testing.assert_array_equal(original, colour_pixels(DRIVE.picture(0, camera)))


def test_the_view_from_above_has_the_size_asked_for():
    bird = BirdOptions((0.0, 30.0), (-10.0, 10.0), 5.0)
    assert MODES['bev'].draw(FRAME, PictureOptions(bird=bird)).shape == (150, 100, 3)


@pytest.mark.parametrize('mode', MODES)
def test_every_mode_on_every_layout(recording_path, mode):
    source = open_frames(recording_path, ReadOptions())
    streams = MODES[mode].streams(source.cameras, ANY)
    frame = source.frame(int(source.numbers[1]), streams)
    assert MODES[mode].draw(frame, ANY).any()


@pytest.mark.parametrize('mode', MODES)
def test_a_mode_reads_no_more_than_it_shows(recordings, mode):
    """What a mode asks for gives the same picture as everything there is."""
    source = open_frames(recordings[Layout.TRACKING], ReadOptions())
    draw = MODES[mode].draw
    few = source.frame(1, MODES[mode].streams(source.cameras, ANY))
    np.testing.assert_array_equal(draw(few, ANY), draw(source.frame(1), ANY))


def test_the_streams_of_the_modes():
    assert MODES['camera'].streams({0, 2, 3}, ANY) == {'image_2', 'labels'}
    assert MODES['lidar'].streams({0, 1}, ANY) == {'image_0', 'scan'}
    assert MODES['boxes'].streams({2}, PictureOptions(camera=3)) == {'image_3', 'labels'}
    assert MODES['bev'].streams({2}, ANY) == {'scan', 'labels'}
    assert MODES['panel'].streams((), ANY) == {'scan', 'labels', 'oxts', 'pose', 'path'}


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('mode', 'changes', 'reason'),
    [
        ('camera', {'images': {}}, 'no image'),
        ('camera', {'images': {3: FRAME.images[3]}, 'calibration': None}, 'no calibration'),
        ('boxes', {'calibration': None}, 'no calibration'),
        ('boxes', {'calibration': replace(DRIVE.calibration, cameras={})}, 'camera 2'),
        ('boxes', {'calibration': replace(DRIVE.calibration, cam0_T_velo=None)}, 'Tr_velo_to_cam'),
        ('lidar', {'points': None}, 'no scan'),
        (
            'lidar',
            {'points': None, 'missing': {'scan': '0.bin: cut off'}},
            'no scan: 0.bin: cut off',
        ),
        ('lidar', {'calibration': None}, 'no calibration'),
        ('bev', {'points': None, 'objects': ()}, 'no scan'),
    ],
)
def test_what_a_frame_lacks_is_named_in_a_line(mode, changes, reason):
    with pytest.raises(MissingDataError, match=f'^synthetic: frame 0: .*{reason}') as caught:
        MODES[mode].draw(make_frame(**changes), ANY)
    assert '\n' not in str(caught.value)


def test_a_camera_without_an_image_is_named():
    with pytest.raises(MissingDataError, match='no image of camera 4'):
        MODES['camera'].draw(FRAME, PictureOptions(camera=4))


@pytest.mark.parametrize(
    'changes',
    [
        {'objects': ()},
        {'calibration': None, 'objects': [label for label in FRAME.objects if label.box_2d]},
        {'points': np.empty((0, 4), np.float32)},
    ],
)
def test_what_need_not_be_there(changes):
    frame = make_frame(**changes)
    MODES['camera'].draw(frame, ANY)
    MODES['bev'].draw(frame, ANY)
    MODES['panel'].draw(frame, ANY)


@pytest.mark.parametrize('mode', ['camera', 'boxes', 'bev', 'panel'])
def test_predictions_are_seen_and_seen_to_be_predictions(mode):
    predicted = [replace(obj, score=0.5, occluded=None) for obj in FRAME.objects]
    draw = MODES[mode].draw
    labels, predictions = make_frame(), make_frame(objects=(), predictions=predicted)
    neither = draw(make_frame(objects=()), ANY)
    assert (draw(predictions, ANY) != neither).any()
    assert (draw(predictions, ANY) != draw(labels, ANY)).any()


def test_predictions_are_compared_with_labels():
    car = next(obj for obj in FRAME.objects if obj.class_name == 'Car')
    cyclist = next(obj for obj in FRAME.objects if obj.class_name == 'Cyclist')
    predicted = [replace(car, score=0.9), replace(car, score=0.5)]
    labels, predictions = compared([car, cyclist], predicted)
    frame = make_frame(objects=labels, predictions=predictions)
    assert dict(facts_of(frame, ANY))['compared'] == '1 TP, 1 FP, 1 FN'
    assert [prediction.match.verdict.value for prediction in frame.predictions] == ['TP', 'FP']
    assert [obj.match.verdict.value for obj in frame.objects] == ['TP', 'FN']
    assert 'compared' not in dict(facts_of(make_frame(predictions=predicted), ANY))
    assert (MODES['boxes'].draw(frame, ANY) != MODES['boxes'].draw(FRAME, ANY)).any()


@pytest.mark.parametrize('labels', ['absent', 'empty', 'there'])
def test_predictions_are_compared_where_there_are_labels(recordings, tmp_path, labels):
    root = tmp_path / 'set'
    shutil.copytree(recordings[Layout.OBJECT], root)
    path = root / 'training/label_2/000001.txt'
    lines = path.read_text()
    if labels == 'absent':
        path.unlink()
    if labels == 'empty':
        path.write_text('')
    (tmp_path / '000001.txt').write_text(
        ''.join(f'{line} 0.9\n' for line in lines.splitlines() if 'DontCare' not in line)
    )
    predictions = Predictions(ResultFiles(tmp_path).read)
    frame = predictions.add_to(open_frames(root, ReadOptions()).frame(1))
    assert frame.predictions
    verdicts = {box.match.verdict.value if box.match else None for box in frame.predictions}
    assert verdicts == {'absent': {None}, 'empty': {'FP'}, 'there': {'TP'}}[labels]


@pytest.mark.parametrize('mode', ['camera', 'boxes', 'bev', 'panel'])
def test_only_the_classes_asked_for_are_drawn(mode):
    draw = MODES[mode].draw
    cars = [obj for obj in FRAME.objects if obj.class_name == 'Car']
    assert 0 < len(cars) < len(FRAME.objects)
    chosen = draw(FRAME, PictureOptions(classes=('Car',)))
    np.testing.assert_array_equal(chosen, draw(make_frame(objects=cars), ANY))


def test_the_panel_shows_all_parts():
    page = MODES['panel'].draw(FRAME, ANY)
    assert page.shape == (SIZE[1], SIZE[0], 3)
    for area in (BOXES_2D, LIDAR, BIRD, INTENSITY, DISTANCE, parts_of(FRAME, ANY).behind):
        assert count_colors(area.of(page)) > 20


def covered_by(areas):
    """The share of the panel that areas cover; none is beyond its edge or overlaps another."""
    page = np.zeros((SIZE[1], SIZE[0]), int)
    for area in areas:
        assert area.left + area.width <= SIZE[0]
        assert area.top + area.height <= SIZE[1]
        area.of(page)[:] += 1
    assert page.max() == 1
    return page.mean()


def test_parts_of_the_panel_do_not_overlap():
    """Also with many facts and classes, which then leave no room for the view from behind."""
    many = [LabelledObject(f'class {number}', None) for number in range(9)]
    frames = [make_frame(), make_frame(objects=many), make_frame(objects=many, predictions=many)]
    for frame, shown in zip(frames, (True, True, False), strict=True):
        parts = parts_of(frame, ANY)
        covered_by(parts.titles())
        assert (parts.behind is not None) == shown
        assert parts.classes.height >= 22 * 9 or frame.objects != many


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'changes',
    [
        {'images': {}},
        {'calibration': None},
        {'points': None},
        {'packet': None},
        {'points': None, 'images': {}, 'calibration': None, 'objects': (), 'packet': None},
        {'images': {2: np.zeros((1, 1, 3), np.uint8)}},
        {'images': {2: np.zeros((900, 30, 3), np.uint8)}},
        {'missing': {f'thing {number}': 'bad' for number in range(99)}},
        {'source': 'x' * 999, 'timed': False},
        {'objects': [LabelledObject(f'class {number}', None) for number in range(99)]},
    ],
    ids=['images', 'calibration', 'scan', 'motion', 'all', 'dot', 'strip', 'gap', 'name', 'many'],
)
def test_the_panel_of_a_frame_with_parts_missing_or_odd(changes):
    page = MODES['panel'].draw(make_frame(**changes), ANY)
    assert page.shape == (SIZE[1], SIZE[0], 3)
    whole = MODES['panel'].draw(FRAME, ANY)
    assert (page != whole).any()


@pytest.fixture
def sequence(recordings, tmp_path):
    """An odometry sequence with labels of points, which scan 2 lacks."""
    root = tmp_path / 'odometry'
    shutil.copytree(recordings[Layout.ODOMETRY], root)
    labels = root / 'sequences/00/labels'
    labels.mkdir()
    scans = open_frames(root, ReadOptions())
    for number in (0, 1):
        classes = np.resize([10, 40, 50], len(scans.frame(number).points)).astype('<u4')
        (labels / f'{number:06d}.label').write_bytes(classes.tobytes())
    return root


SEMANTIC = PictureOptions(color_by=ColorBy.SEMANTIC)


@pytest.mark.parametrize('mode', ['lidar', 'bev', 'perspective', 'panel'])
def test_points_are_coloured_by_class(sequence, mode):
    frame = open_frames(sequence, ReadOptions(semantic=True)).frame(1)
    picture = MODES[mode].draw(frame, SEMANTIC)
    assert (picture != MODES[mode].draw(frame, ANY)).any()
    assert (picture == (0xF5, 0x96, 0x64)).all(axis=2).any()


def test_a_bag_has_the_labels_of_points(sequence, tmp_path):
    assert main(['to-bag', str(sequence), str(tmp_path / 'b.mcap'), '--semantic', '-q']) == 1
    there, here = (
        open_frames(path, ReadOptions(semantic=path == sequence)).frame(1)
        for path in (tmp_path / 'b.mcap', sequence)
    )
    np.testing.assert_array_equal(there.point_labels, here.point_labels)


@pytest.mark.parametrize('mode', ['lidar', 'bev', 'perspective'])
def test_missing_labels_of_points_are_named(sequence, mode):
    asked, not_asked = ReadOptions(semantic=True), ReadOptions()
    with pytest.raises(MissingDataError, match=r'no labels of points: .*000002\.label: no such'):
        MODES[mode].draw(open_frames(sequence, asked).frame(2), SEMANTIC)
    with pytest.raises(MissingDataError, match='no labels of points: semantic takes Semantic'):
        MODES[mode].draw(open_frames(sequence, not_asked).frame(1), SEMANTIC)
    with pytest.raises(MissingDataError, match='no labels of points: semantic takes Semantic'):
        MODES[mode].draw(FRAME, SEMANTIC)


def test_colours_of_the_view_from_above_are_chosen():
    for mode in ('bev', 'perspective'):
        height, depth = (
            MODES[mode].draw(FRAME, PictureOptions(color_by=by))
            for by in (ColorBy.HEIGHT, ColorBy.DEPTH)
        )
        np.testing.assert_array_equal(height, MODES[mode].draw(FRAME, ANY))
        assert (height != depth).any()


def unimaged(**changes):
    """The frame of a recording without images, 30 m into its path."""
    path = np.array([[0.0, 0, 0], [20, 10, 0], [20, 17, 0]])
    return make_frame(images={}, imaged=False, **{'path': path, **changes})


@pytest.mark.parametrize(
    'changes',
    [
        {},
        {'path': None},
        {'points': None, 'scanned': False},
        {'points': None, 'scanned': False, 'path': None},
    ],
    ids=['all', 'no path', 'no scan', 'neither'],
)
def test_a_panel_without_images_uses_the_room(changes):
    frame = unimaged(**changes)
    parts = parts_of(frame, ANY)
    assert parts.images is None
    assert (parts.route is None) == (frame.path is None)
    assert (parts.maps is None) == (frame.points is None)
    assert parts.bird.width * parts.bird.height > 2 * BIRD.width * BIRD.height
    areas = list(parts.titles())
    assert covered_by(areas) > 0.8
    drawn = MODES['panel'].draw(frame, ANY)
    for area in areas:
        assert count_colors(area.of(drawn)) > 10


def test_a_frame_that_lost_its_image_keeps_the_places():
    assert parts_of(make_frame(images={}), ANY).images == parts_of(FRAME, ANY).images


@pytest.mark.parametrize('layout', [Layout.TRACKING, Layout.ODOMETRY, Layout.RAW])
def test_the_path_is_that_up_to_the_frame(recordings, tmp_path, layout):
    """Of a folder without images, and of its bag."""
    source = recordings[layout]
    root = tmp_path / source.relative_to(source.parents[1])
    shutil.copytree(source, root, ignore=shutil.ignore_patterns('*.png'))
    for name in ('calib_cam_to_cam.txt', 'calib_velo_to_cam.txt', 'calib_imu_to_velo.txt'):
        if (source.parent / name).is_file():
            shutil.copy(source.parent / name, root.parent / name)
    bag = tmp_path / 'b.mcap'
    main(['to-bag', str(root), str(bag), '-q'])
    folder, there = (open_frames(path, ReadOptions()) for path in (root, bag))
    wanted = MODES['panel'].streams(folder.cameras, ANY)
    for number in folder.numbers.tolist():
        mine, own = there.frame(number, wanted), folder.frame(number, wanted)
        assert (mine.imaged, own.imaged) == (False, False)
        assert len(own.path) == number + 1
        np.testing.assert_allclose(mine.path, own.path, atol=1e-6)
        np.testing.assert_array_equal(own.path[-1], own.pose.world_T_imu.translation)
    assert folder.frame(0).path is None, 'it takes all poses'


def test_poses_that_cannot_be_read_are_named(drive):
    (drive / 'oxts/data/0000000001.txt').write_text('1 2 3')
    source = open_frames(drive, ReadOptions())
    wanted = MODES['panel'].streams((), ANY)
    assert 'path' not in source.frame(0, wanted).missing
    frame = source.frame(3, wanted)
    assert len(frame.path) == 3
    assert '0000000001.txt' in frame.missing['path']


def test_facts():
    facts = dict(facts_of(FRAME, ANY))
    packet = FRAME.packet
    speed = np.hypot(packet.vn, packet.ve)
    assert facts['image'] == '414 x 125, camera 2'
    assert facts['points'].replace(' ', '') == str(len(FRAME.points))
    assert facts['objects'] == str(len(FRAME.objects))
    assert facts['speed'] == f'{speed:.1f} m/s, {3.6 * speed:.0f} km/h'
    assert facts['yaw'] == f'{np.degrees(packet.yaw):.1f} deg from east'
    assert 'time' not in facts, 'it is in the head'
    assert dict(facts_of(make_frame(timed=False), ANY))['time'] == 'none in this layout'


def test_the_same_from_several_threads():
    expected = {mode: MODES[mode].draw(FRAME, ANY) for mode in MODES}
    jobs = [*MODES] * 8
    with ThreadPoolExecutor(4) as pool:
        pictures = pool.map(lambda mode: MODES[mode].draw(FRAME, ANY), jobs)
        for mode, picture in zip(jobs, pictures, strict=True):
            np.testing.assert_array_equal(picture, expected[mode])


@pytest.mark.parametrize('values', [{'camera': -1}, {'point_size': 0}, {'point_size': 99}])
def test_options_out_of_range_are_refused(values):
    with pytest.raises(UsageError):
        PictureOptions(**values)
