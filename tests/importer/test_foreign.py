# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag that knows nothing of KITTI becomes every layout, and is true to the world it recorded."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import foreign
import numpy as np
import pytest
from builders import OF_OTHERS

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.files.image_files import decode_png
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.plan import Incomplete
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.text_file import parse_poses
from kitti_ros2.messages.cdr import stamp_ns_of
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.boxes import box_corners, box_of, project_corners
from kitti_ros2.model.errors import BadFileError, MissingDataError, UsageError
from kitti_ros2.model.samples import rect_from_velo
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import BagOptions, ImportOptions
from kitti_ros2.options.read import ReadOptions

TRUTH = foreign.make_truth()
SIZE = np.array(foreign.SIZE)
STREAMS = {
    Layout.RAW: {'scan', 'image_2', 'image_3', 'oxts', 'labels', 'pose'},
    Layout.OBJECT: {'scan', 'image_2', 'image_3', 'labels', 'calibration'},
    Layout.ODOMETRY: {'scan', 'image_2', 'image_3', 'pose'},
    Layout.TRACKING: {'scan', 'image_2', 'image_3', 'oxts', 'labels', 'pose'},
}
STORAGES = {'mcap': 'bag.mcap', 'sqlite3': 'bag', 'ros1': 'bag.bag'}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """The whole bag, MCAP."""
    return foreign.write_foreign(tmp_path_factory.mktemp('foreign') / 'bag.mcap', TRUTH)


def convert(bag, out, layout, change=lambda plan: plan, **options):
    """The bag in a layout, by the plan it gives, changed."""
    chosen = ImportOptions(layout=layout, **options)
    survey = survey_bags([bag])
    plan = change(guess([bag], survey, chosen).plan)
    return convert_by_plan([bag], plan, survey, out, chosen)


@pytest.fixture(scope='module', params=OF_OTHERS, ids=[layout.value for layout in OF_OTHERS])
def made(request, bag, tmp_path_factory):
    """(report, recording) in one layout after the other."""
    out = tmp_path_factory.mktemp('made') / 'out'
    report = convert(bag, out, request.param)
    return report, open_recording(out, ReadOptions(layout=request.param))


def test_every_stream_of_the_layout_is_there_and_nothing_is_lost(made):
    report, recording = made
    assert {stream.value for stream in recording.streams} == STREAMS[report.layout]
    assert all(len(index) == foreign.FRAMES for index in recording.streams.values())
    assert report.losses == ()
    assert recording.losses == []
    assert report.frames == foreign.FRAMES
    dropped = '48 points without a return were dropped: x y z not finite (48)'
    assert f'/sensors/ouster/points: {dropped}' in report.notes


def test_points_are_those_of_the_sensor(made):
    _, recording = made
    for number, frame in enumerate(TRUTH):
        points = recording.read(Stream.SCAN, number).points
        assert np.abs(points[:, :3] - frame.points[:, :3]).max() < 1e-5
        assert np.abs(points[:, 3] - frame.points[:, 3]).max() < 1e-6


def test_points_land_where_the_cameras_saw_them(made):
    """Through the calibration files alone, to 0.05 px; and the pixels show it, to a tenth."""
    _, recording = made
    calibration = recording.calibration(0)
    for number in (0, 7):
        blobs = TRUTH[number].blobs
        for camera in (2, 3):
            pixels = project(calibration, camera, blobs, rectified=recording.image_topic)
            true = true_pixels(blobs, camera, raw=recording.image_topic == 'image_raw')
            assert np.abs(pixels - true).max() < 0.05
            image = decode_png(recording.read(Stream(f'image_{camera}'), number))
            seen = np.array([centre(image, place) for place in true])
            assert np.abs(seen - true).max() < 0.1


def project(calibration, camera, points, rectified):
    """Pixels of points of the scanner, as KITTI's devkits do it."""
    model = calibration.cameras[camera]
    if rectified == 'image_rect':
        rect = rect_from_velo(calibration).apply(points)
        pixels = np.column_stack([rect, np.ones(len(rect))]) @ model.p_rect.T
        return pixels[:, :2] / pixels[:, 2:]
    places = (model.cam_T_cam0 @ calibration.cam0_T_velo).apply(points)
    pixels, _ = cv2.projectPoints(places, np.zeros(3), np.zeros(3), model.k, model.d)
    return pixels[:, 0]


def true_pixels(points, camera, *, raw):
    places = foreign.lidar_t_camera().inverse().apply(points)
    if camera == 3:
        places = places - [foreign.BASELINE, 0, 0]
    elif raw:
        lens = (np.zeros(3), np.zeros(3), foreign.K, foreign.D)
        return cv2.projectPoints(places, *lens)[0][:, 0]
    pixels = places @ foreign.K_RECT.T
    return pixels[:, :2] / pixels[:, 2:]


def centre(image, near):
    """The middle of the white dot around a place."""
    grey = image if image.ndim == 2 else image[..., 0]
    u, v = np.round(near).astype(int)
    window = grey[v - 9 : v + 10, u - 9 : u + 10].astype(float) - 20
    rows, columns = np.mgrid[v - 9 : v + 10, u - 9 : u + 10]
    window[window < 8] = 0
    return np.array([(window * columns).sum(), (window * rows).sum()]) / window.sum()


def test_calibration_is_that_of_the_rig(made):
    _, recording = made
    calibration = recording.calibration(0)
    raw = recording.layout is Layout.RAW
    digits = 2e-6 if raw else 1e-9  # KITTI writes its raw files with six digits
    left, right = calibration.cameras[2], calibration.cameras[3]
    p2 = np.column_stack([foreign.K_RECT, np.zeros(3)])
    p3 = np.column_stack([foreign.K_RECT, [-500 * foreign.BASELINE, 0, 0]])
    assert np.allclose(left.p_rect, p2, rtol=digits, atol=1e-9)
    assert np.allclose(right.p_rect, p3, rtol=digits, atol=1e-9)
    rect_t_velo = rect_from_velo(calibration).matrix()
    assert np.allclose(rect_t_velo, foreign.lidar_t_camera().inverse().matrix(), atol=digits)
    if recording.layout is not Layout.ODOMETRY:
        velo_t_imu = foreign.BASE_T_LIDAR.inverse() @ foreign.BASE_T_IMU
        assert np.allclose(calibration.velo_T_imu.matrix(), velo_t_imu.matrix(), atol=digits)
    if raw:
        assert np.allclose(left.k, foreign.K, rtol=digits)
        assert np.allclose(left.d, foreign.D, atol=1e-7)


def test_boxes_are_those_of_the_detector(made):
    _, recording = made
    if Stream.LABELS not in recording.streams:
        return
    rect_t_velo = rect_from_velo(recording.calibration(0))
    for number, frame in enumerate(TRUTH):
        labels = recording.read(Stream.LABELS, number)
        if recording.layout is Layout.RAW:  # tracklets, in the scanner's frame
            (cuboid,) = labels.cuboids
            assert cuboid.class_name == 'Car'
            true, seen = frame.cuboid.velo_T_box.matrix(), cuboid.velo_T_box.matrix()
            assert np.abs(true[:3, 3] - seen[:3, 3]).max() < 1e-3
            assert np.abs(true[:3, :3] - seen[:3, :3]).max() < 5e-3  # the camera leans by 3 degrees
            continue
        (box,) = labels.boxes
        location, size_hwl, rotation_y = box_of(frame.cuboid, rect_t_velo)
        assert (box.class_name, box.occluded, box.score) == ('Car', 0, None)
        assert np.abs(np.array(box.location) - location).max() < 1e-3
        assert np.abs(np.array(box.size_hwl) - size_hwl).max() < 1e-3
        assert abs(box.rotation_y - rotation_y) < 1e-3
        corners = box_corners(location, size_hwl, rotation_y)
        bounds = project_corners(corners, recording.calibration(0).cameras[2].p_rect)[0]
        limits = np.array([*foreign.SIZE] * 2) - 1.0
        assert np.abs(np.array(box.box_2d) - np.clip(bounds, 0, limits)).max() < 0.05
        if recording.layout is Layout.TRACKING:
            assert (box.frame, box.track_id) == (number, 7)


def test_stamps_are_the_samples_own_where_the_layout_has_them(made):
    _, recording = made
    stamps = recording.streams[Stream.SCAN].stamps_ns
    true = np.array([frame.stamp_ns for frame in TRUTH])
    if recording.layout is Layout.RAW:
        assert stamps.tolist() == true.tolist()
        images = recording.streams[Stream.IMAGE_2].stamps_ns
        assert 0 < np.abs(images - true).max() < 10_000_000
    elif recording.layout is Layout.ODOMETRY:
        assert np.abs(np.diff(stamps) - np.diff(true)).max() < 1000  # seven digits of a second


def test_packets_tell_what_the_unit_told(made):
    _, recording = made
    if Stream.OXTS not in recording.streams:
        return
    for number, frame in enumerate(TRUTH):
        packet = recording.read(Stream.OXTS, number)
        seconds = (frame.stamp_ns - foreign.START_NS) / 1e9
        assert packet.lat == pytest.approx(49 + 1e-3 * seconds, abs=1e-9)
        assert packet.yaw == pytest.approx(0.2 * seconds, abs=0.002)
        assert (packet.ax, packet.ay, packet.az) == (0.1, 0.2, 9.8)
        assert packet.vf == pytest.approx(5.0, abs=1e-9)
        assert packet.pos_accuracy == pytest.approx(0.2)


def test_poses_are_the_cameras_at_the_frames(bag, tmp_path):
    convert(bag, tmp_path / 'out', Layout.ODOMETRY)
    path = tmp_path / 'out/poses/00.txt'
    poses = parse_poses(path.read_text(), path).sound()
    true = foreign.camera_poses(TRUTH)
    assert len(poses) == len(true)
    for number, pose in enumerate(true):
        assert np.abs(poses[number] - pose[:3]).max() < 1e-4


@pytest.mark.parametrize('storage', list(STORAGES))
def test_every_container_gives_the_same_files(bag, storage, tmp_path):
    path = foreign.write_foreign(tmp_path / STORAGES[storage], TRUTH, storage)
    convert(path, tmp_path / 'out', Layout.TRACKING)
    convert(bag, tmp_path / 'true', Layout.TRACKING)
    made, true = (
        {p.relative_to(tmp_path / n): p.read_bytes() for p in (tmp_path / n).rglob('*.*')}
        for n in ('out', 'true')
    )
    assert made == true


def test_several_bags_are_one_recording(bag, tmp_path):
    topics = {topic for topic, *_ in foreign.messages(TRUTH)}
    images = {topic for topic in topics if topic.startswith('/cam')}
    parts = [
        foreign.write_foreign(tmp_path / 'images.mcap', TRUTH, 'mcap', *(topics - images)),
        foreign.write_foreign(tmp_path / 'rest.bag', TRUTH, 'ros1', *images),
    ]
    options = ImportOptions(layout=Layout.OBJECT)
    survey = survey_bags(parts)
    plan = guess(parts, survey, options).plan
    report = convert_by_plan(parts, plan, survey, tmp_path / 'out', options)
    whole = convert(bag, tmp_path / 'whole', Layout.OBJECT)
    assert report.counts == whole.counts
    for path in (tmp_path / 'whole').rglob('*.*'):
        other = tmp_path / 'out' / path.relative_to(tmp_path / 'whole')
        assert other.read_bytes() == path.read_bytes()


def test_all_frames_train_unless_a_split_is_asked_for(bag, tmp_path):
    convert(bag, tmp_path / 'all', Layout.OBJECT)
    convert(bag, tmp_path / 'part', Layout.OBJECT, train_fraction=0.75)
    sets = {
        name: {
            path.stem: path.read_text().split()
            for path in (tmp_path / name / 'ImageSets').iterdir()
        }
        for name in ('all', 'part')
    }
    every = [f'{number:06d}' for number in range(foreign.FRAMES)]
    assert sets['all'] == {'trainval': every, 'train': every, 'val': [], 'test': []}
    parts = {'train': every[:9], 'val': every[9:]}
    assert sets['part'] == {'trainval': every, **parts, 'test': []}


def test_a_second_bag_continues_an_object_set(bag, tmp_path):
    out = tmp_path / 'out'
    convert(bag, out, Layout.OBJECT)
    before = {path: path.read_bytes() for path in (out / 'training').rglob('*.*')}
    convert(bag, out, Layout.OBJECT, append=True)
    assert all(path.read_bytes() == content for path, content in before.items())
    recording = open_recording(out)
    assert recording.losses == []
    assert recording.streams[Stream.SCAN].numbers.tolist() == list(range(2 * foreign.FRAMES))
    listed = (out / 'ImageSets/train.txt').read_text().split()
    assert [int(number) for number in listed] == list(range(2 * foreign.FRAMES))


def test_points_are_brought_to_the_frame_of_the_plan(bag, tmp_path):
    def to_base(plan):
        return replace(plan, scan=replace(plan.scan, frame='base_link'))

    convert(bag, tmp_path / 'out', Layout.OBJECT, to_base)
    recording = open_recording(tmp_path / 'out')
    points = recording.read(Stream.SCAN, 3).points[:, :3]
    assert np.abs(points - foreign.BASE_T_LIDAR.apply(TRUTH[3].points[:, :3])).max() < 1e-5
    camera = foreign.BASE_T_CAMERA.inverse().matrix()
    assert np.allclose(rect_from_velo(recording.calibration(3)).matrix(), camera, atol=1e-9)


def test_a_calibration_of_the_users_own_overrides_the_bags(bag, tmp_path):
    convert(bag, tmp_path / 'first', Layout.OBJECT)
    file = tmp_path / 'first/training/calib/000000.txt'
    changed = tmp_path / 'calib.txt'
    changed.write_text(file.read_text().replace('P2: 5.0', 'P2: 6.0'))
    convert(bag, tmp_path / 'out', Layout.OBJECT, calib=changed)
    recording = open_recording(tmp_path / 'out')
    assert recording.calibration(0).cameras[2].p_rect[0, 0] == pytest.approx(600.0)


def test_a_calibration_that_lacks_a_camera_is_refused(bag, tmp_path):
    calib = tmp_path / 'calib.txt'
    calib.write_text('P0: 7 0 6 0 0 7 1 0 0 0 1 0\nTr_velo_to_cam: 1 0 0 0 0 1 0 0 0 0 1 0\n')
    with pytest.raises(BadFileError, match='no P2'):
        convert(bag, tmp_path / 'out', Layout.OBJECT, calib=calib)
    assert not (tmp_path / 'out').exists()


def test_a_camera_that_is_not_joined_is_an_error_that_shows_the_tree(tmp_path):
    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, 'mcap', '/tf_static')
    with pytest.raises(MissingDataError, match='there is no frame cam_left_optical'):
        convert(path, tmp_path / 'out', Layout.OBJECT)


def test_without_boxes_fix_or_odometry_the_rest_is_made(tmp_path):
    missing = ('/perception/objects', '/gps/fix', '/odom')
    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, 'mcap', *missing)
    report = convert(path, tmp_path / 'out', Layout.TRACKING)
    # The Imu makes oxts by itself.
    assert set(report.counts) == {'scan', 'image_2', 'image_3', 'calibration', 'oxts'}
    options = ImportOptions(layout=Layout.TRACKING)
    notes = guess([path], survey_bags([path]), options).notes
    assert any('labels' in note for note in notes)
    assert any('fix' in note for note in notes)


def test_a_bag_without_scan_camera_and_pose_says_what_it_has(tmp_path):
    topics = {topic for topic, *_ in foreign.messages(TRUTH)} - {'/imu/data'}
    path = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, 'mcap', *topics)
    with pytest.raises(MissingDataError, match='no point cloud and no image; it has /imu/data'):
        convert(path, tmp_path / 'out', Layout.OBJECT)


def test_frames_that_lack_an_image_are_kept_in_raw_and_numbers_stay(bag, tmp_path):
    def tight(plan):
        return replace(plan, tolerance_s=0.002)

    report = convert(bag, tmp_path / 'out', Layout.RAW, tight)
    recording = open_recording(tmp_path / 'out')
    assert len(recording.streams[Stream.SCAN]) == foreign.FRAMES
    images = recording.streams[Stream.IMAGE_2]
    assert 0 < len(images) < foreign.FRAMES
    stamps = {frame.stamp_ns for frame in TRUTH}
    for number, stamp_ns in zip(images.numbers, images.stamps_ns, strict=True):
        nearest = min(stamps, key=lambda each, stamp=stamp_ns: abs(each - stamp))
        assert TRUTH[number].stamp_ns == nearest
    assert report.losses == ()
    dropping = convert(
        bag,
        tmp_path / 'dropped',
        Layout.RAW,
        lambda plan: replace(tight(plan), incomplete=Incomplete.DROP),
    )
    assert dropping.frames == dropping.counts['image_2'] == dropping.counts['scan']


def test_numbers_of_tracks_come_from_the_detections(bag, tmp_path):
    convert(bag, tmp_path / 'out', Layout.TRACKING)
    lines = (tmp_path / 'out/training/label_02/0000.txt').read_text().splitlines()
    frames = [int(line.split()[0]) for line in lines]
    assert all(later >= earlier for earlier, later in pairwise(frames))
    assert {line.split()[1] for line in lines} == {'7'}


def test_a_plan_for_another_layout_is_wrong_usage(bag):
    survey = survey_bags([bag])
    with pytest.raises(UsageError, match='which layout is wanted'):
        guess([bag], survey, ImportOptions())


FISHEYE = np.array([-0.02, 0.01, 0.003, -0.002])


def fisheye_pixels(points):
    """Of the left camera, through another lens than that of the foreign rig."""
    places = foreign.lidar_t_camera().inverse().apply(points)
    lens = np.zeros(3), np.zeros(3), foreign.K, FISHEYE
    return cv2.fisheye.projectPoints(places[:, None], *lens)[0][:, 0]


def mixed(topic, place, message):
    """A fisheye, for which KITTI has no place, beside a lens for which it has one."""
    if topic == '/cam/left/image_raw':
        grey = foreign.draw(fisheye_pixels(TRUTH[place // 2].blobs))
        return foreign.rgb_image(grey, stamp_ns_of(message.header), message.header.frame_id)
    if topic == '/cam/left/camera_info':
        return replace(message, distortion_model='equidistant', d=FISHEYE)
    if topic == '/cam/right/camera_info':
        # So little that nobody sees it in the images; it makes the drive an extract.
        return replace(message, d=np.array([1e-9, 0, 0, 0, 0]), k=foreign.K_RECT.ravel())
    return message


@pytest.mark.parametrize('order', [(2, 3), (1, 0)])
def test_an_extract_of_which_one_camera_is_rectified_has_the_lens_of_its_pixels(order, tmp_path):
    plain = foreign.write_foreign(tmp_path / 'plain.mcap', TRUTH, change=mixed)
    path = tmp_path / 'bag.mcap'
    with (
        open_messages(plain) as messages,
        open_bag(path, BagOptions(), messages.typestore) as copy,
    ):
        ids = {
            topic: copy.add_channel(Channel(topic.replace('image_rect', 'image_raw'), msgtype))
            for topic, msgtype in messages.channels
        }
        for message in messages:
            copy.write(ids[message.topic], message.stamp_ns, [bytes(message.data)])

    def change(plan):
        assert plan.name.endswith('_extract')
        assert [plan.cameras[index].rectify for index in (2, 3)] == [True, False]
        cameras = {new: plan.cameras[old] for old, new in zip((2, 3), order, strict=True)}
        return replace(plan, cameras=cameras, labels=None)

    report = convert(path, tmp_path / 'out', Layout.RAW, change)
    assert report.losses == ()
    recording = open_recording(tmp_path / 'out')
    calibration = recording.calibration(0)
    for camera in order:
        pixels = decode_png(recording.read(Stream(f'image_{camera}'), 0))
        places = project(calibration, camera, TRUTH[0].blobs, rectified='image_raw')
        near = [each for each in places if (each > 12).all() and (each < SIZE - 12).all()]
        assert len(near) >= 6
        for place in near:
            assert np.abs(centre(pixels, place) - place).max() < 0.15


def test_an_extract_with_a_rectified_camera_needs_the_bags_own_calibration(bag, tmp_path):
    def change(plan):
        cameras = {index: replace(camera, rectify=True) for index, camera in plan.cameras.items()}
        return replace(plan, cameras=cameras, calibration=str(tmp_path))

    with pytest.raises(UsageError, match='rectify: true'):
        convert(bag, tmp_path / 'out', Layout.RAW, change)
