# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which topic is taken for what, told from names, types and first messages alone."""

from __future__ import annotations

from array import array
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from surveyed import at, cloud, compressed, image, info, topic

from kitti_ros2.importer import apply_plan
from kitti_ros2.importer.guess import guess_plan, unused_notes
from kitti_ros2.importer.plan import NONE, TF, Incomplete
from kitti_ros2.importer.survey import Survey
from kitti_ros2.messages.camera_info import make_transform
from kitti_ros2.messages.oxts import position_of
from kitti_ros2.messages.ros_types import TFMessage
from kitti_ros2.messages.tf_tree import LinkTally
from kitti_ros2.model import bag_formats as types
from kitti_ros2.model.errors import MissingDataError, UsageError
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

PATH = Path('bag.mcap')


def guess(*topics, layout=Layout.OBJECT, static=(), moving=(), with_calibration=False):
    survey = Survey({one_topic.name: one_topic for one_topic in topics}, list(static), list(moving))
    return guess_plan(survey, layout, PATH, with_calibration=with_calibration)


def cameras_of(*topics, layout=Layout.OBJECT):
    plan = guess(*topics, layout=layout).plan
    return {index: camera.topic for index, camera in plan.cameras.items()}


def test_a_lone_camera_is_the_left_colour_camera_in_whose_pixels_labels_are():
    assert cameras_of(image('/front/image_raw'), info('/front/camera_info')) == {
        2: '/front/image_raw'
    }


def test_left_and_right_are_told_by_name():
    pair = [image(f'/{side}/image_raw') for side in ('right', 'left')]
    infos = [info(f'/{side}/camera_info') for side in ('right', 'left')]
    assert cameras_of(*pair, *infos) == {2: '/left/image_raw', 3: '/right/image_raw'}


def test_our_own_names_keep_their_numbers():
    names = ('gray_left', 'color_right')
    topics = [image(f'/kitti/camera_{name}/image_rect') for name in names]
    infos = [info(f'/kitti/camera_{name}/camera_info') for name in names]
    assert sorted(cameras_of(*topics, *infos)) == [0, 3]


def test_beyond_four_cameras_the_rest_is_named():
    topics = [image(f'/cam{number}/image_raw') for number in range(6)]
    infos = [info(f'/cam{number}/camera_info') for number in range(6)]
    guessed = guess(*topics, *infos)
    assert len(guessed.plan.cameras) == 4
    assert sum('KITTI has four cameras' in note for note in guessed.notes) == 2


@pytest.mark.parametrize(
    ('topics', 'best'),
    [
        ([image('/c/image_raw'), image('/c/image_rect')], '/c/image_rect'),
        ([image('/c/image_rect'), image('/c/image_rect_color')], '/c/image_rect_color'),
        ([image('/c/image_raw'), compressed('/c/image_raw/compressed')], '/c/image_raw/compressed'),
        ([image('/c/image_raw'), compressed('/c/image_raw/compressed', 'jpeg')], '/c/image_raw'),
        ([image('/c/image_raw'), image('/c/image_depth', '16UC1')], '/c/image_raw'),
    ],
)
def test_of_one_cameras_topics_the_best_is_taken(topics, best):
    assert cameras_of(*topics, info('/c/camera_info')) == {2: best}


def test_depth_images_are_no_pictures():
    with pytest.raises(MissingDataError, match='no point cloud and no image'):
        guess(
            image('/c/aligned', '32FC1'),
            compressed('/c/raw/compressedDepth', '16UC1; compressedDepth png'),
        )


def test_camera_info_is_found_by_its_frame_where_names_do_not_tell():
    guessed = guess(image('/pictures', frame='eye'), info('/somewhere/else', frame='eye'))
    assert guessed.plan.cameras[2].info == '/somewhere/else'
    assert guessed.plan.calibration == TF


@pytest.mark.parametrize(
    'overlay', ['/detectnet/overlay', '/a_debug/image', '/tag_detections_image']
)
@pytest.mark.parametrize('camera', ['/usb_cam/image_raw', '/image_raw'])
def test_images_with_drawings_are_not_the_camera_whose_frame_they_have(camera, overlay):
    beside = camera.rpartition('/')[0] + '/camera_info'
    topics = image(camera, frame='lens'), image(overlay, frame='lens'), info(beside, 'lens')
    guessed = guess(*topics)
    assert {each.topic for each in guessed.plan.cameras.values()} == {camera}
    apart = camera.rpartition('/')[0] != overlay.rpartition('/')[0]
    assert any(f'passed over: {overlay}' in note for note in guessed.notes) is apart


def test_of_images_with_one_info_by_its_frame_one_is_the_camera():
    topics = [image(name, frame='lens') for name in ('/a/overlay', '/b/image_raw')]
    assert cameras_of(*topics, info('/calibration', 'lens')) == {2: '/b/image_raw'}


def test_without_camera_info_there_is_no_calibration_and_that_is_said():
    guessed = guess(image('/c/image_raw'))
    assert guessed.plan.calibration == NONE
    assert any('calibration (no camera_info)' in note for note in guessed.notes)


@pytest.mark.parametrize(
    ('layout', 'd', 'model', 'name', 'rectify'),
    [
        (Layout.OBJECT, (), 'plumb_bob', 'image_raw', False),
        (Layout.OBJECT, (0.1, 0, 0, 0, 0), 'plumb_bob', 'image_raw', True),
        (Layout.OBJECT, (0.1, 0, 0, 0, 0), 'plumb_bob', 'image_rect', False),
        (Layout.RAW, (0.1, 0, 0, 0, 0), 'plumb_bob', 'image_raw', False),
        (Layout.RAW, (0.1, 0, 0, 0), 'equidistant', 'image_raw', True),
        (Layout.RAW, (0.1,) * 8, 'rational_polynomial', 'image_raw', True),
    ],
)
def test_distorted_images_are_rectified_where_the_layout_needs_it(layout, d, model, name, rectify):
    topics = image(f'/c/{name}'), info('/c/camera_info', d=d, model=model)
    plan = guess(*topics, layout=layout).plan
    assert plan.cameras[2].rectify is rectify
    if layout is Layout.RAW:
        assert plan.name.endswith('_sync' if rectify else '_extract')
        assert plan.incomplete is Incomplete.KEEP


def test_a_lidar_goes_before_a_depth_cameras_cloud():
    depth = cloud('/realsense/points', width=300_000, frame='camera_depth')
    found = guess(depth, cloud('/velodyne_points', 'intensity'))
    assert found.plan.scan.topic == '/velodyne_points'
    assert any(note.startswith('passed over for scans: /realsense/points') for note in found.notes)


@pytest.mark.parametrize(
    'others',
    [
        [cloud('/Laser_map', 'intensity', frame='camera_init', width=9000)],
        [cloud('/map/pointcloud_map', 'intensity', frame='map', width=9000, count=1)],
        [cloud('/velodyne_cloud_map', 'intensity', width=9000)],
        [cloud('/cloud_registered', 'intensity', frame='camera_init', width=900, count=9)],
        [cloud('/accumulated', 'intensity', frame='world', width=900)],
    ],
)
@pytest.mark.parametrize(('name', 'frame'), [('/points', 'lidar'), ('/os/points', 'os_sensor')])
def test_scans_go_before_what_a_mapper_made_of_them(name, frame, others):
    own = cloud(name, frame=frame)
    static = [('body', frame, Transform.identity())]
    guessed = guess(*others, own, static=static, moving=[('camera_init', 'body')])
    assert (guessed.plan.scan.topic, guessed.plan.scan.frame) == (name, frame)
    assert f'passed over for scans: {others[0].name} ({others[0].count})' in guessed.notes


def test_scans_alone_have_no_calibration_and_that_is_said():
    guessed = guess(cloud('/velodyne_points'))
    assert guessed.plan.calibration == NONE
    assert 'missing: calibration (no camera); --calib FILE gives it' in guessed.notes


@pytest.mark.parametrize(('field', 'told'), [('rgb', True), ('Intensity', False)])
def test_clouds_without_an_intensity_are_pointed_out(field, told):
    guessed = guess(cloud('/points', field))
    assert any('the reflectance of the scans is 0' in note for note in guessed.notes) is told


def test_points_of_an_optical_frame_are_pointed_out():
    guessed = guess(cloud('/points', frame='camera_depth_optical_frame'))
    assert any('z forward' in note for note in guessed.notes)


def odometry(name, *along):
    """A topic of poses at some x, metres."""
    samples = [SimpleNamespace(child_frame_id='/base_link', pose=at(x)) for x in along or (0.0,)]
    return topic(name, types.ODOMETRY, *samples)


def test_poses_that_move_go_before_others_of_the_same_body():
    topics = odometry('/debug/odom', 0.0, 0.0), odometry('/odom', 0.0, 1.0)
    assert guess(*topics, layout=Layout.ODOMETRY).plan.pose.topic == '/odom'


def fix_at(latitude):
    status = SimpleNamespace(status=0)
    return SimpleNamespace(latitude=latitude, longitude=latitude, altitude=1.0, status=status)


def imu_with(acceleration):
    vector = SimpleNamespace(x=0.0, y=0.0, z=acceleration)
    return SimpleNamespace(
        orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=[0.0] * 9,
        angular_velocity=SimpleNamespace(x=0.0, y=0.0, z=0.0),
        linear_acceleration=vector,
    )


def test_a_unit_that_measures_goes_before_one_that_does_not():
    topics = [cloud('/points', frame='lidar')]
    for name, value in (('/a', 0.0), ('/z', 9.8)):
        topics.append(topic(f'{name}/imu', types.IMU, imu_with(value), frame='lidar'))
        topics.append(topic(f'{name}/fix', types.FIX, fix_at(value), frame='lidar'))
        topics[-1].positions = array('d', position_of(fix_at(value)))
    plan = guess(*topics, layout=Layout.RAW).plan
    assert (plan.imu, plan.fix) == ('/z/imu', '/z/fix')


def test_ground_truth_goes_before_other_odometry():
    topics = [odometry(name) for name in ('/odom', '/ground_truth/odom')]
    plan = guess(*topics, layout=Layout.ODOMETRY).plan
    assert (plan.pose.topic, plan.pose.body) == ('/ground_truth/odom', 'base_link')
    assert plan.reference == 'pose'


def test_a_moving_base_link_tells_poses_too():
    guessed = guess(
        topic('/tf', 'tf2_msgs/msg/TFMessage'),
        layout=Layout.ODOMETRY,
        moving=[('odom', 'base_footprint'), ('wheel', 'rim')],
    )
    assert (guessed.plan.pose.topic, guessed.plan.pose.body) == ('/tf', 'base_footprint')
    assert guessed.plan.pose.world == 'odom'


def test_an_imu_that_is_joined_gives_the_imu_frame_and_one_that_is_not_a_remark():
    topics = cloud('/velodyne_points'), topic('/imu', types.IMU, frame='imu')
    assert guess(*topics, static=[('lidar', 'imu', Transform.identity())]).plan.imu_frame == 'imu'
    apart = guess(*topics)
    assert apart.plan.imu_frame == ''
    assert any('static transform from imu to lidar' in note for note in apart.notes)


FRD = Transform(np.diag([1.0, -1, -1]), np.zeros(3))
OPTICAL = Transform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.zeros(3))


@pytest.mark.parametrize(
    ('scan_frame', 'static', 'taken', 'said'),
    [
        ('lidar', [('lidar', 'imu', FRD)], 'lidar', 'imu_frame is lidar, and oxts is turned'),
        ('lidar', [('rig', 'lidar', FRD), ('rig', 'imu', FRD)], 'imu', ''),
        (
            'eye_optical_frame',
            [('eye', 'eye_optical_frame', OPTICAL), ('eye_optical_frame', 'imu', OPTICAL)],
            'eye',
            'imu_frame is eye, and oxts is turned',
        ),
        (
            'eye_optical_frame',
            [('eye_optical_frame', 'imu', Transform.identity())],
            'imu',
            'and so has no frame of the bag: oxts is along the axes of imu',
        ),
    ],
)
def test_an_imu_is_turned_where_no_frame_is_called_the_body(scan_frame, static, taken, said):
    topics = cloud('/points', frame=scan_frame), topic('/imu', types.IMU, frame='imu')
    guessed = guess(*topics, static=static, layout=Layout.RAW)
    assert guessed.plan.imu_frame == taken
    assert said in ' '.join(note for note in guessed.notes if note.startswith('the Imu is in'))


@pytest.mark.parametrize(
    ('parent', 'step_m', 'moves'),
    [
        ('base_link', 1e-4, False),
        ('base_link', 1e-3, True),
        ('odom', 1e-5, True),
        ('a/map', 1e-5, True),
        ('odom', 1e-7, False),
    ],
)
def test_a_link_of_a_rig_on_tf_may_jitter(parent, step_m, moves):
    tally = LinkTally()
    for number in range(4):
        there = Transform.from_translation((step_m * (number % 2), 0, 0))
        tally.add(TFMessage([make_transform(there, number, parent, 'lidar')]), still=False)
    static, moving, _ = tally.sorted()
    assert (len(static), moving) == ((0, [(parent, 'lidar')]) if moves else (1, []))


def tallied(*topics, moves=False, other=''):
    """Links of base_link to lidar on topics, in order; that of another robot is elsewhere."""
    tally = LinkTally()
    for place, name in enumerate(topics):
        there = Transform.from_translation(((name == other) + moves * place, 0, 0))
        link = make_transform(there, place, 'base_link', 'lidar')
        tally.add(TFMessage([link]), still=not moves, topic=name)
    return tally


@pytest.mark.parametrize('moves', [False, True])
@pytest.mark.parametrize('other', ['/robot2/tf', '/tf'])
def test_transforms_of_two_robots_are_refused(moves, other):
    """Frames of both have the same names."""
    tally = tallied('/robot1/tf', '/robot1/tf', other, moves=moves, other=other)
    assert tally.clashes == {('base_link', 'lidar'): ('/robot1/tf', other)}
    survey = Survey({}, [], [], clashes=tally.clashes)
    with pytest.raises(
        UsageError, match=r'differ in base_link -> lidar, so they are of two robots'
    ):
        apply_plan.guess([PATH], survey, ImportOptions(layout=Layout.OBJECT))


def test_transforms_that_two_topics_repeat_are_of_one_robot():
    assert tallied('/tf_static', '/relay/tf_static').clashes == {}


@pytest.mark.parametrize(
    ('layout', 'taken'), [(Layout.OBJECT, '/detector'), (Layout.TRACKING, '/tracker')]
)
def test_labels_are_chosen_by_what_they_tell(layout, taken):
    clusters, detector, tracker = (
        topic(name, types.DETECTIONS_3D, count=count)
        for name, count in (('/a_clusters', 30), ('/detector', 20), ('/tracker', 10))
    )
    clusters.classes[''] = 30
    detector.classes['Car'] = tracker.classes['Car'] = 10
    tracker.has_tracks = True
    camera = image('/c/image_raw'), info('/c/camera_info')
    guessed = guess(clusters, detector, tracker, *camera, layout=layout)
    assert guessed.plan.labels.topic == taken
    objects = topic('/objects', types.TRACKED_OBJECTS)
    objects.has_tracks = True
    objects.classes['CAR'] = 10
    guessed = guess(clusters, detector, objects, *camera, layout=layout)
    assert guessed.plan.labels.topic == ('/objects' if layout is Layout.TRACKING else taken)


def namespace(**values):
    return SimpleNamespace(**values)


def pose_of_box():
    return namespace(
        position=namespace(x=8.0, y=1.0, z=0.0), orientation=namespace(x=0.0, y=0.0, z=0.0, w=1.0)
    )


def boxes_on(name, msgtype, kind, size, count=5):
    """A topic with a box of a class and a size in each message."""
    x, y, z = size
    header = namespace(frame_id='velo', stamp=namespace(sec=1, nanosec=0))
    if msgtype == types.MARKERS:
        cube = namespace(
            header=header,
            ns=kind,
            id=1,
            type=1,
            action=0,
            pose=pose_of_box(),
            scale=namespace(x=x, y=y, z=z),
            color=namespace(r=1.0, g=0.0, b=0.0, a=1.0),
            text='',
            frame_locked=False,
        )
        look = namespace(markers=[cube])
    else:
        result = namespace(hypothesis=namespace(class_id=kind, score=1.0))
        bbox = namespace(center=pose_of_box(), size=namespace(x=x, y=y, z=z))
        detection = namespace(header=header, id='1', results=[result], bbox=bbox)
        look = namespace(header=header, detections=[detection])
    found = topic(name, msgtype, look, frame='velo', count=count)
    found.classes[kind] = count
    found.has_tracks = True
    return found


_CAR = (4.0, 1.7, 1.5)


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING, Layout.RAW])
@pytest.mark.parametrize(
    'other',
    [
        ('/debug/roi', types.MARKERS, 'roi', (60.0, 40.0, 4.0)),
        ('/debug/roi', types.MARKERS, 'car', (60.0, 40.0, 4.0), 500),
        ('/a/grid', types.MARKERS, 'cell', (0.01, 0.01, 0.01), 500),
        ('/a/zones', types.MARKERS, 'zone', (5.0, 5.0, 2.0), 500),
        ('/a/boxes', types.DETECTIONS_3D, 'zone', (5.0, 5.0, 2.0), 500),
        ('/a/boxes', types.DETECTIONS_3D, 'car', (500.0, 5.0, 2.0), 500),
        ('/a/clusters', types.DETECTIONS_3D, 'UNKNOWN', (1.0, 1.0, 1.0), 500),
    ],
)
@pytest.mark.parametrize('msgtype', [types.MARKERS, types.DETECTIONS_3D])
def test_labels_are_of_known_classes_and_sane_sizes(msgtype, other, layout):
    camera = image('/c/image_raw'), info('/c/camera_info')
    labels = boxes_on('/perception', msgtype, 'pedestrian', (0.6, 0.7, 1.8))
    plan = guess(boxes_on(*other), labels, *camera, layout=layout).plan
    assert plan.labels.topic == '/perception'


def test_of_equal_topics_the_one_with_most_boxes_is_taken():
    camera = image('/c/image_raw'), info('/c/camera_info')
    few, most = (boxes_on(name, types.MARKERS, 'car', _CAR) for name in ('/a', '/b'))
    most.classes['pedestrian'] = 5
    assert guess(few, most, *camera).plan.labels.topic == '/b'


def test_boxes_of_other_classes_are_labels_where_there_are_no_better_ones():
    camera = image('/c/image_raw'), info('/c/camera_info')
    roi = boxes_on('/debug/roi', types.MARKERS, 'roi', (60.0, 40.0, 4.0))
    forklifts = boxes_on('/forklifts', types.MARKERS, 'forklift', _CAR)
    assert guess(roi, forklifts, *camera).plan.labels.topic == '/forklifts'
    guessed = guess(roi, *camera)
    assert guessed.plan.labels.topic == '/debug/roi'
    assert 'are they metres, and objects?' in ' '.join(guessed.notes)
    truth = boxes_on('/ground_truth/boxes', types.MARKERS, 'forklift', _CAR)
    cars = boxes_on('/boxes', types.MARKERS, 'car', _CAR)
    assert guess(cars, truth, *camera).plan.labels.topic == '/ground_truth/boxes'


def test_boxes_that_are_no_labels_are_named_with_the_reason():
    lines = SimpleNamespace(markers=[SimpleNamespace(type=5)])
    topics = [
        cloud('/points'),
        topic('/boxes', types.DETECTIONS_3D),
        topic('/boxes_2d', types.DETECTIONS_2D, frame='lens'),
        topic('/lines', types.MARKERS, lines),
    ]
    survey = Survey({one_topic.name: one_topic for one_topic in topics}, [], [])
    plan = guess(*topics).plan
    (alone,) = unused_notes(survey, plan)
    assert 'labels are of a camera with a camera_info, which the plan has not' in alone
    topics += [image('/c/image_raw', frame='c'), info('/c/camera_info', 'c')]
    survey = Survey({one_topic.name: one_topic for one_topic in topics}, [], [])
    notes = unused_notes(survey, guess(*topics).plan)
    assert any('not used: /lines (5)' in note and 'without a cube' in note for note in notes)
    assert any('2D boxes whose frame is lens; those of camera 2 have c' in note for note in notes)


VELOCITY = SimpleNamespace(linear=SimpleNamespace(x=0.0, y=0.0, z=0.0))
ODOMETRY = SimpleNamespace(
    child_frame_id='a/base_link', twist=SimpleNamespace(twist=VELOCITY), pose=at(0.0)
)


@pytest.mark.parametrize(('joined', 'prefix'), [(True, 'b'), (False, 'b'), (False, '')])
def test_a_unit_of_another_robot_is_passed_over(joined, prefix):
    frame = f'{prefix}/base_link'.lstrip('/')
    links = [('a/base_link', 'a/lidar', Transform.identity()), (frame, 'x', Transform.identity())]
    links += [('map', 'a/base_link', Transform.identity()), ('map', frame, Transform.identity())][
        : 2 * joined
    ]
    topics = [
        topic('/imu', types.IMU, frame=frame),
        topic('/fix', types.FIX, frame=frame),
        topic('/odom', types.ODOMETRY, ODOMETRY, frame='odom'),
    ]
    topics.append(cloud('/points', frame='a/lidar'))
    guessed = guess(*topics, layout=Layout.RAW, static=links)
    apart = bool(prefix) and not joined
    assert (guessed.plan.imu, guessed.plan.fix) == (('', '') if apart else ('/imu', '/fix'))
    said = [note for note in guessed.notes if 'no transform joins its frame, b/base_link' in note]
    assert len(said) == 2 * apart


def test_a_command_is_no_velocity():
    names = ('/cmd_vel', '/gps/vel')
    twists = [topic(name, types.TWIST, count=5 + 5 * (name == '/cmd_vel')) for name in names]
    fix = topic('/fix', types.FIX)
    plan = guess(cloud('/velodyne_points'), fix, *twists, layout=Layout.RAW).plan
    assert plan.velocity == '/gps/vel'


def test_a_calibration_that_is_given_is_not_missing():
    guessed = guess(cloud('/velodyne_points'), with_calibration=True)
    assert not any('calibration' in note for note in guessed.notes)
