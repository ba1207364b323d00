# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Depth images and one-ring scans become KITTI's scans."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import robot_bags as bags
import turtlebot as robot
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.plan import format_plan, parse_plan
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.scan_sources import decode_laser_scan
from kitti_ros2.model.errors import MissingDataError, UsageError
from kitti_ros2.model.samples import rect_from_velo
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions

CAMERA_T_OPTICAL = robot.CAMERA_T_OPTICAL[:3, :3]


def convert(bag, out, change=lambda plan: plan, layout=Layout.OBJECT):
    """(plan, report, recording) of a bag."""
    options = ImportOptions(layout=layout)
    survey = survey_bags([bag])
    plan = change(guess([bag], survey, options).plan)
    plan = parse_plan(format_plan(plan), out.with_suffix('.yaml'))
    report = convert_by_plan([bag], plan, survey, out, options)
    return plan, report, open_recording(out, ReadOptions(layout=layout))


def in_camera(plan):
    """The plan with scans in the frame of the depth camera whose x is ahead."""
    return replace(plan, scan=replace(plan.scan, frame='camera_link', forward=''))


@pytest.mark.parametrize('container', ['mcap', 'ros1', 'sqlite3'])
def test_without_a_scanner_depth_images_are_the_scans(tmp_path, container):
    bag = bags.write(tmp_path / 'bag', robot.said(scans=False), container)
    plan, report, recording = convert(bag, tmp_path / 'out', in_camera)
    assert (plan.scan.from_, plan.scan.topic) == ('depth', '/camera/depth/image_raw')
    assert plan.scan.info == '/camera/depth/camera_info'
    assert report.losses == ()
    assert report.frames == robot.FRAMES
    assert any('no reflectance' in note for note in report.notes)
    for number in range(robot.FRAMES):
        metres = robot.millimetres(robot.depth_m(number)) / 1000
        metres[metres == 0] = np.nan
        true = robot.optical_points(metres) @ CAMERA_T_OPTICAL.T
        points = recording.read(Stream.SCAN, number).points
        assert np.abs(points[:, :3] - true).max() < 1e-6
        assert not points[:, 3].any()


@pytest.mark.parametrize(('kind', 'off_m'), [('32FC1', 1e-6), ('mm', 6e-4), ('inverse', 0.02)])
def test_every_form_of_depth(tmp_path, kind, off_m):
    bag = bags.write(tmp_path / 'bag', robot.said(kind, scans=False))
    _, report, recording = convert(bag, tmp_path / 'out', in_camera)
    assert report.losses == ()
    true = robot.optical_points(robot.depth_m(2)) @ CAMERA_T_OPTICAL.T
    points = recording.read(Stream.SCAN, 2).points
    assert np.abs(points[:, :3] - true).max() < off_m


@pytest.mark.parametrize('lens', [False, True], ids=['pinhole', 'lens'])
def test_each_point_projects_into_its_own_pixel(tmp_path, lens):
    """Through the written calibration; with a lens into that of the rectified image."""
    bag = bags.write(tmp_path / 'bag', robot.said('32FC1', scans=False, lens=lens))
    _, _, recording = convert(bag, tmp_path / 'out')
    calibration, metres = recording.calibration(0), robot.depth_m(0)
    v, u = np.nonzero(np.isfinite(metres))
    pixels = np.column_stack([u, v]).astype(float)
    if lens:
        pixels = cv2.undistortPoints(pixels[:, None], robot.K, np.array(robot.D), P=robot.K)[:, 0]
    points = recording.read(Stream.SCAN, 0).points[:, :3].astype(float)
    rect = rect_from_velo(calibration).apply(points)
    assert np.abs(rect[:, 2] - metres[v, u]).max() < 2e-3
    shown = np.column_stack([rect, np.ones(len(rect))]) @ calibration.cameras[2].p_rect.T
    assert np.abs(shown[:, :2] / shown[:, 2:] - pixels).max() < 0.01


@pytest.mark.parametrize(
    ('layout', 'place'),
    [
        (Layout.OBJECT, 'training/depth_2/000002.png'),
        (Layout.RAW, '*/*/proj_depth/velodyne_raw/image_02/0000000002.png'),
    ],
)
def test_depth_maps_are_written_as_in_the_depth_benchmark(tmp_path, layout, place):
    bag = bags.write(tmp_path / 'bag', robot.said(scans=False))
    _, report, _ = convert(bag, tmp_path / 'out', layout=layout)
    (path,) = (tmp_path / 'out').glob(place)
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    true = np.round(robot.millimetres(robot.depth_m(2)) / 1000 * 256)
    assert found.dtype == np.uint16
    assert np.abs(found - true).max() <= 1
    assert ((found == 0) == (true == 0)).all()
    assert any('depth maps of camera 2' in note for note in report.notes)


def test_other_layouts_have_no_depth_maps(tmp_path):
    bag = bags.write(tmp_path / 'bag', robot.said(scans=False))
    convert(bag, tmp_path / 'out', layout=Layout.TRACKING)
    assert not any('depth' in path.name for path in (tmp_path / 'out').rglob('*'))


def test_the_one_ring_scan_goes_before_depth(tmp_path):
    bag = bags.write(tmp_path / 'bag', robot.said())
    plan, report, recording = convert(bag, tmp_path / 'out')
    assert (plan.scan.topic, plan.scan.from_, plan.scan.info) == ('/scan', '', '')
    assert plan.scan.intensity_scale == 255
    assert report.losses == ()
    points = recording.read(Stream.SCAN, 1).points
    # The ring looks to the left: its points are turned to look ahead.
    assert (plan.scan.frame, plan.scan.forward) == ('base_scan', 'base_link')
    true = robot.ring()[1] @ robot.BASE_T_RING[:3, :3].T
    assert np.abs(points[:, :3] - true).max() < 1e-6
    assert points[-1, 3] == pytest.approx((robot.RAYS - 1) / 2 / 255)
    assert any('one ring' in note for note in report.notes)
    notes = guess([bag], survey_bags([bag]), ImportOptions(layout=Layout.OBJECT)).notes
    told = 'scan.topic of the plan chooses it, with scan.info: /camera/depth/camera_info'
    assert f'passed over for scans: /camera/depth/image_raw; {told}' in notes


def test_depth_images_without_a_camera_info_are_told(tmp_path):
    said = [each for each in robot.said(scans=False) if '/depth/camera_info' not in each.topic]
    said = [
        each._replace(
            values=bags.image(each.log_ns, 'elsewhere', np.ones((4, 4), np.uint16), '16UC1')
        )
        if '/depth/' in each.topic
        else each
        for each in said
    ]
    bag = bags.write(tmp_path / 'bag', said)
    guessed = guess([bag], survey_bags([bag]), ImportOptions(layout=Layout.OBJECT))
    assert guessed.plan.scan is None
    assert any('a depth image without a camera_info' in note for note in guessed.notes)


def test_the_plan_may_choose_depth(tmp_path):
    bag = bags.write(tmp_path / 'bag', robot.said())
    chosen = '/camera/depth/image_raw'

    def to_depth(plan):
        scan = replace(plan.scan, topic=chosen, info='/camera/depth/camera_info')
        return replace(
            plan, scan=replace(scan, frame='camera_link', forward='', intensity_scale=1.0)
        )

    _, report, recording = convert(bag, tmp_path / 'out', to_depth)
    assert report.losses == ()
    true = robot.optical_points(robot.depth_m(3)) @ CAMERA_T_OPTICAL.T
    assert np.abs(recording.read(Stream.SCAN, 3).points[:, :3] - true).max() < 1e-3


@pytest.mark.parametrize(
    ('between_s', 'turn_ns'),
    [(95e-3 / (robot.RAYS - 1), (0, 95_000_000)), (0.0, None), (1e9, None)],
)
def test_rings_are_of_the_middle_of_their_turn(tmp_path, between_s, turn_ns):
    """Images 60 ms after the first ray are of that ring, not of the next."""
    said = [
        bags.Said(
            each.topic,
            each.log_ns,
            each.msgtype,
            robot.laser_scan(each.log_ns - 60_000_000, time_increment=between_s),
        )
        if each.topic == '/scan'
        else each
        for each in robot.said()
    ]
    bag = bags.write(tmp_path / 'bag', said)
    assert survey_bags([bag]).topics['/scan'].turn_ns == pytest.approx(turn_ns, abs=10)
    if turn_ns:
        _, report, _ = convert(bag, tmp_path / 'out', layout=Layout.RAW)
        assert report.frames == robot.FRAMES
        true = robot.START_NS - 60_000_000 + robot.PERIOD_NS * np.arange(robot.FRAMES)
        found = bags.scan_stamps(tmp_path / 'out') - true[:, None]
        assert np.abs(found - (47_500_000, 0, 95_000_000)).max() <= 10


class TestWrongPlans:
    @pytest.mark.parametrize(
        ('changed', 'told'),
        [
            ({'from_': 'depth'}, r'scan.topic: /scan is a sensor_msgs/msg/LaserScan; scan.from'),
            ({'topic': '/tf'}, r'scan.topic: /tf is a tf2_msgs/msg/TFMessage; scans are made of'),
            ({'info': '/camera/depth/camera_info'}, r'scan.info is not for scans of laser_scan'),
            ({'model': 'VLP-16'}, r'scan.model is not for scans of laser_scan'),
            ({'calibration': 'x.yaml'}, r'scan.calibration is not for scans of laser_scan'),
            ({'topic': '/camera/depth/image_raw'}, r'scan.info: .* needs the CameraInfo'),
            ({'topic': '/camera/depth/image_raw', 'info': '/scan'}, r'scan.info: /scan: no Camera'),
        ],
    )
    def test_is_refused_by_name(self, tmp_path, changed, told):
        bag = bags.write(tmp_path / 'bag', robot.said())
        with pytest.raises(UsageError, match=told):
            convert(
                bag,
                tmp_path / 'out',
                lambda plan: replace(plan, scan=replace(plan.scan, **changed)),
            )

    def test_an_unknown_word_of_from(self, tmp_path):
        text = 'layout: object\nname: training\nreference: scan\ntolerance_s: 0.05\n'
        with pytest.raises(UsageError, match=r"scan: from: 'dept'; expected one of .*depth"):
            parse_plan(f'{text}scan: {{topic: /a, frame: b, from: dept}}\n', tmp_path / 'plan.yaml')


class TestHostile:
    def test_a_ring_that_the_bag_defines_without_ranges(self, tmp_path):
        store = get_typestore(Stores.EMPTY)
        types = get_typestore(Stores.ROS2_HUMBLE).fielddefs
        names = ('builtin_interfaces/msg/Time', 'std_msgs/msg/Header')
        store.register({name: types[name] for name in names})
        kind = 'sensor_msgs/msg/LaserScan'
        store.register(get_types_from_msg('std_msgs/Header header\nint32 a\n', kind))
        made = store.types
        with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            said = writer.add_connection('/scan', kind, typestore=store)
            for number in range(3):
                header = made[names[1]](made[names[0]](robot.START_NS // 10**9, number), 'ring')
                data = store.serialize_cdr(made[kind](header, 3), kind)
                writer.write(said, robot.START_NS + number, data)
        survey = survey_bags([tmp_path / 'bag'])
        assert survey.topics['/scan'].turn_ns is None
        with pytest.raises(MissingDataError, match='LaserScan without angle_min'):
            guess([tmp_path / 'bag'], survey, ImportOptions(layout=Layout.OBJECT))

    @pytest.mark.parametrize('d', [(0.1, 0.2, 0.3), (0.1,) * 6, (float('nan'),) * 5])
    def test_a_lens_that_cannot_be(self, tmp_path, d):
        bag = bags.write(tmp_path / 'bag', robot.said(scans=False, lens=d))
        with pytest.raises(UsageError) as caught:
            convert(bag, tmp_path / 'out')
        assert '\n' not in str(caught.value)

    def test_an_extract_has_no_depth_maps_and_says_so(self, tmp_path):
        bag = bags.write(tmp_path / 'bag', robot.said(scans=False, lens=True))
        _, report, _ = convert(bag, tmp_path / 'out', layout=Layout.RAW)
        assert 'no depth maps were written' in ' '.join(report.notes)

    @pytest.mark.parametrize(
        'changed',
        [
            {'angle_increment': 0.0},
            {'angle_increment': np.nan},
            {'angle_min': np.inf},
            {'angle_increment': 1.0},
        ],
    )
    def test_angles_of_a_ring(self, tmp_path, changed):
        said = robot.said()
        said += [
            bags.Said(
                '/scan', START + 1, 'sensor_msgs/msg/LaserScan', robot.laser_scan(START, **changed)
            )
            for START in [robot.START_NS + 1_000_000]
        ]
        said = [each for each in said if each.topic != '/scan' or each.log_ns != robot.START_NS]
        _, report, _ = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        assert [loss.stream for loss in report.losses] == ['/scan']
        assert 'a LaserScan' in report.losses[0].text()

    def test_a_ring_that_claims_2_to_the_31_ranges(self, tmp_path):
        """In the length of its sequence, and as a message that is that long."""
        said = [each for each in robot.said() if each.topic != '/camera/depth/image_raw']
        bag = bags.write(tmp_path / 'bag', said, 'sqlite3')
        (file,) = bag.glob('*.db3')
        count, huge = robot.RAYS.to_bytes(4, 'little'), (2**31).to_bytes(4, 'little')
        ranges = np.asarray(robot.ring()[0], np.float32).tobytes()[:16]
        data = file.read_bytes()
        assert count + ranges in data
        file.write_bytes(data.replace(count + ranges, huge + ranges, 1))
        _, report, _ = convert(bag, tmp_path / 'out')
        assert [(loss.stream, loss.count) for loss in report.losses] == [('/scan', 1)]
        scan = SimpleNamespace(
            angle_min=0.0,
            angle_increment=1e-9,
            range_min=0.0,
            range_max=1.0,
            intensities=np.zeros(0),
            ranges=np.broadcast_to(np.float32(0.5), 2**31),
        )
        with pytest.raises(ValueError, match='2147483648 ranges'):
            decode_laser_scan(scan)

    def test_a_depth_image_of_another_size_is_a_loss(self, tmp_path):
        said = robot.said(scans=False)
        place = next(
            n
            for n, each in enumerate(said)
            if each.topic.endswith('depth/image_raw') and each.log_ns > robot.START_NS
        )
        small = bags.image(
            said[place].log_ns, 'camera_optical_frame', np.ones((4, 4), np.uint16), '16UC1'
        )
        said[place] = said[place]._replace(values=small)
        _, report, _ = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        assert [loss.count for loss in report.losses] == [1]
        assert '4x4' in report.losses[0].text()

    @pytest.mark.parametrize('cut', [0, 11, 12, 25, 200])
    def test_a_truncated_compressed_depth_image_is_a_loss(self, tmp_path, cut):
        said = robot.said('mm', scans=False)
        place = next(
            n
            for n, each in enumerate(said)
            if each.topic.endswith('compressedDepth') and each.log_ns > robot.START_NS
        )
        values = dict(said[place].values)
        values['data'] = values['data'][:cut]
        said[place] = said[place]._replace(values=values)
        _, report, _ = convert(bags.write(tmp_path / 'bag', said), tmp_path / 'out')
        assert [loss.count for loss in report.losses] == [1]
