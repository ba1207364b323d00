# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A recording of one layout, by way of its bag, in every other layout: the same world."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from folder_and_bag import rerecord

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.plan import TF as FROM_TF
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import decode_static, encode_static
from kitti_ros2.messages.cdr import deserialize, join, serialize
from kitti_ros2.model.bag_formats import TF
from kitti_ros2.model.geometry import NOMINAL_VELO_T_IMU, Transform, rotation_from_rpy
from kitti_ros2.model.samples import cuboids_of, rect_from_velo
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions

from builders import OF_OTHERS, convert_recording  # isort: skip

LABELLED = {Layout.RAW, Layout.OBJECT, Layout.TRACKING}


@pytest.fixture(scope='module')
def bags(recordings, tmp_path_factory):
    """The bag of each layout."""
    folder = tmp_path_factory.mktemp('bags')
    made = {}
    for layout, source in recordings.items():
        made[layout] = folder / f'{layout.value}.mcap'
        convert_recording(source, made[layout])
    return made


def pixels(calibration, camera, points):
    rect = rect_from_velo(calibration).apply(points)
    seen = np.column_stack([rect, np.ones(len(rect))]) @ calibration.cameras[camera].p_rect.T
    return seen[:, :2] / seen[:, 2:]


@pytest.mark.one_in(3)
@pytest.mark.parametrize('target', OF_OTHERS)
@pytest.mark.parametrize('layout', list(Layout))
def test_the_world_is_the_same(recordings, bags, layout, target, tmp_path):
    options = ImportOptions(layout=target)
    survey = survey_bags([bags[layout]])
    plan = guess([bags[layout]], survey, options).plan
    report = convert_by_plan([bags[layout]], plan, survey, tmp_path / 'out', options)
    assert report.losses == ()
    source = open_recording(recordings[layout])
    recording = open_recording(tmp_path / 'out', ReadOptions(layout=target))
    # The first frame of KITTI-360 has no pose in any drive, and so no boxes.
    first = int(layout is Layout.KITTI_360 and target is not Layout.RAW)
    before, after = source.calibration(first), recording.calibration(0)
    # The stereo pair of KITTI-360 becomes the colour cameras.
    shift = 2 * (layout is Layout.KITTI_360)
    ahead = np.array([[8.0, 2.0, -0.5], [25.0, -6.0, 0.3], [60.0, 0.0, 1.0]])
    for stream in recording.streams:
        number = recording.streams[stream].numbers[0]
        if stream.camera is not None:
            camera = stream.camera - shift
            image = source.read(Stream(f'image_{camera}'), number + first)
            assert recording.read(stream, number).data == image.data
            moved = pixels(before, camera, ahead) - pixels(after, stream.camera, ahead)
            assert np.abs(moved).max() < 0.01
    scan = recording.read(Stream.SCAN, 0).points
    assert scan.tobytes() == source.read(Stream.SCAN, first).points.tobytes()
    if {layout, target} <= LABELLED:
        true = cuboids_of(source.read(Stream.LABELS, 0), before)
        cuboids = cuboids_of(recording.read(Stream.LABELS, 0), after)
        assert cuboids
        for box in cuboids:
            near = min(true, key=lambda each, box=box: distance(each, box))
            assert distance(near, box) < 2e-3
            assert near.class_name == box.class_name
            assert np.allclose(near.size_lwh, box.size_lwh, atol=6e-3)  # two decimals in labels


def test_each_frame_keeps_the_calibration_of_its_day(recordings, tmp_path):
    source = tmp_path / 'set'
    shutil.copytree(recordings[Layout.OBJECT], source)
    for number in (2, 3):
        path = source / f'training/calib/{number:06d}.txt'
        path.write_text(path.read_text().replace('P2: ', f'P2: {number}'))
    bag = tmp_path / 'bag.mcap'
    convert_recording(source, bag)
    survey = survey_bags([bag])
    for target in (Layout.OBJECT, Layout.TRACKING):
        options = ImportOptions(layout=target)
        plan = guess([bag], survey, options).plan
        out = tmp_path / target.value
        report = convert_by_plan([bag], plan, survey, out, options)
        recording = open_recording(out, ReadOptions(layout=target))
        true = open_recording(source)
        for number in range(5):
            held = number if target is Layout.OBJECT else 0
            expected = true.calibration(held).cameras[2].p_rect
            assert np.allclose(recording.calibration(number).cameras[2].p_rect, expected)
        said = any('the calibration changes 3 times' in note for note in report.notes)
        assert said is (target is Layout.TRACKING)


UNIT = Transform(rotation_from_rpy(0.01, -0.02, 0.03), np.array([0.7, -0.2, 0.6]))
"""velo_link in imu_link of some robot."""


@pytest.mark.parametrize(
    ('imu_t_velo', 'is_taken'),
    [
        pytest.param(UNIT, True, id='as the scanner'),
        pytest.param(
            UNIT @ Transform(rotation_from_rpy(0, 0, np.pi), np.zeros(3)), False, id='backward'
        ),
    ],
)
@pytest.mark.parametrize('own', [True, False])
def test_the_unit_is_where_the_static_transforms_of_an_odometry_bag_have_it(
    bags, tmp_path, own, imu_t_velo, is_taken
):
    def moved(message):
        if message.topic != '/tf_static':
            return bytes(message.data)
        links = [
            (parent, child, imu_t_velo if (parent, child) == ('imu_link', 'velo_link') else place)
            for parent, child, place in decode_static(deserialize(message.data, TF))
        ]
        return join(serialize(encode_static(links, message.stamp_ns)))

    bag = tmp_path / 'bag.mcap'
    rerecord(bags[Layout.ODOMETRY], bag, 0, moved)
    options = ImportOptions(layout=Layout.OBJECT)
    survey = survey_bags([bag])
    plan = guess([bag], survey, options).plan
    plan = plan if own else replace(plan, calibration=FROM_TF)
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    found = open_recording(tmp_path / 'out').calibration(0).velo_T_imu
    expected = imu_t_velo.inverse() if is_taken else NOMINAL_VELO_T_IMU
    np.testing.assert_allclose(found.matrix(), expected.matrix(), atol=1e-9)
    assert any(note.startswith('velo_T_imu: not in the bag') for note in report.notes) != is_taken


def distance(one, other):
    return float(np.linalg.norm(one.velo_T_box.translation - other.velo_T_box.translation))
