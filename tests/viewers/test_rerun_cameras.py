# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A pinhole projects where CameraInfo does, and a baseline counts once."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rerun', reason='rerun-sdk is not installed')

import fisheye_drive
import foreign
from hypothesis import given
from hypothesis import strategies as st
from read_rrd import show_in

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import camera_model
from kitti_ros2.messages.pinhole_view import pinhole_view
from kitti_ros2.messages.rectified_cameras import Viewpoint
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.recording import BY_POSITION
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import Fisheye, MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.player.bag_program import BagProgram
from kitti_ros2.player.program import RecordingProgram
from kitti_ros2.viewers.rerun_archetypes import projection_of

ANGLE = st.floats(-0.3, 0.3)
METRES = st.floats(-2, 2)


def through(k, points):
    pixels = np.asarray(points) @ np.asarray(k).T
    return pixels[:, :2] / pixels[:, 2:]


def links_of(rrd):
    """Child frame to (parent, parent_T_child), of all transforms and pinholes in a file."""
    links = {}
    for rows in rrd.rows.values():
        for row in rows:
            parts = row.components
            if 'Transform3D:child_frame' in parts:
                link = Transform.from_quaternion(
                    parts['Transform3D:quaternion'][0], parts['Transform3D:translation'][0]
                )
                (child,) = parts['Transform3D:child_frame']
                links.setdefault(child, (parts['Transform3D:parent_frame'][0], link))
    return links


def in_frame(links, target, source, points):
    """Points of one frame in another, through the links of a file."""

    def root_t(frame):
        root = Transform.identity()
        while frame in links:
            frame, link = links[frame]
            root = link @ root
        return root

    return (root_t(target).inverse() @ root_t(source)).apply(points)


def pixels_in(rrd, image, frame, points):
    """Where Rerun draws points of a frame in the first image of an entity."""
    row = next(each for each in rrd.rows[image] if 'Pinhole:image_from_camera' in each.components)
    columns = np.reshape(row.components['Pinhole:image_from_camera'], (3, 3))
    (parent,) = row.components['Pinhole:parent_frame']
    return through(columns.T, in_frame(links_of(rrd), parent, frame, points))


def street():
    rng = np.random.default_rng(2)
    ahead = rng.uniform(5, 40, 300)
    return np.column_stack([ahead, ahead * rng.uniform(-0.5, 0.5, 300), rng.uniform(-1, 2, 300)])


def test_points_of_the_scanner_land_where_kitti_projects_them(recording_path, tmp_path):
    recording = open_recording(recording_path)
    number = int(recording.streams[Stream.SCAN].numbers[0])
    program = RecordingProgram(recording, MessageOptions(), SelectionOptions(), 1)
    rrd, report = show_in(tmp_path / 'o.rrd', program)
    assert not report.losses
    calibration = recording.calibration(number)
    rect = Transform(calibration.r0_rect, np.zeros(3)) @ calibration.cam0_T_velo
    points = np.column_stack([rect.apply(street()), np.ones(300)])
    for index, name in recording.cameras.items():
        if index in recording.layout.traits.raw_cameras:
            continue  # a fisheye
        image = f'/kitti/camera_{name}/image_rect/compressed'
        expected = through(calibration.cameras[index].p_rect, points)
        found = pixels_in(rrd, image, 'velo_link', street())
        np.testing.assert_allclose(found, expected, atol=0.05)  # Rerun keeps float32


def test_a_right_camera_in_its_own_frame_has_its_baseline_once(tmp_path):
    truth = foreign.make_truth()
    bag = foreign.write_foreign(tmp_path / 'o.mcap', truth)
    rrd, _ = show_in(tmp_path / 'o.rrd', BagProgram(bag, SelectionOptions()))
    places = foreign.lidar_t_camera().inverse().apply(truth[0].blobs)
    expected = through(foreign.K_RECT, places - [foreign.BASELINE, 0, 0])
    found = pixels_in(rrd, '/cam/right/image_rect/compressed', 'os_sensor', truth[0].blobs)
    np.testing.assert_allclose(found, expected, atol=0.01)
    # The left image is distorted: K shows it, as if it were not.
    found = pixels_in(rrd, '/cam/left/image_raw', 'os_sensor', truth[0].blobs)
    np.testing.assert_allclose(found, through(foreign.K, places), atol=0.01)


@given(
    rpy=st.tuples(ANGLE, ANGLE, ANGLE),
    offset=st.tuples(METRES, METRES, METRES),
    place=st.tuples(METRES, METRES, METRES),
)
def test_k_at_the_pinhole_is_p_after_r(rpy, offset, place):
    info = foreign.camera_info(0, 'c', right=True)
    r = rotation_from_rpy(*rpy)
    info.r = r.ravel()
    info.p = np.column_stack([foreign.K_RECT, foreign.K_RECT @ offset]).ravel()
    model = camera_model(info)
    view = Viewpoint('c', Transform(rotation_from_rpy(*rpy[::-1]), np.array(place)), model.p)
    k, pinhole_t_frame = projection_of(model, view, rectified=True)
    points = np.array([[0.0, 0, 20], [3, -2, 30], [-5, 1, 25]])
    inside = view.cam_T_frame.apply(points) @ r.T
    expected = through(model.p, np.column_stack([inside, np.ones(3)]))
    np.testing.assert_allclose(through(k, pinhole_t_frame.apply(points)), expected, atol=1e-6)


def test_a_fisheye_has_no_pinhole_but_by_its_view(recordings, tmp_path):
    """K of MEI's model is that of no pinhole: three times too long in the middle."""
    root = fisheye_drive.add_fisheyes(recordings[Layout.KITTI_360], tmp_path / 'set')
    recording = open_recording(root)
    options = MessageOptions(fisheye=Fisheye.PINHOLE)
    program = RecordingProgram(recording, options, SelectionOptions(), 1)
    rrd, report = show_in(tmp_path / 'o.rrd', program)
    assert not report.losses
    calibration = recording.calibration(0)
    for index in (2, 3):
        image = f'/kitti/camera_{index}/image_raw/compressed'
        assert len(rrd.having(image, 'EncodedImage:blob')) == len(fisheye_drive.FRAMES)
        assert rrd.having(image, 'Pinhole:image_from_camera') == []
        assert any(note.startswith(f'{image}: Rerun has no camera of') for note in report.notes)
        view = f'/kitti/camera_{index}/pinhole/image_rect/compressed'
        assert len(rrd.having(view, 'EncodedImage:blob')) == len(fisheye_drive.FRAMES)
        cam_t_velo = calibration.cameras[index].cam_T_velo
        seen = np.random.default_rng(3).uniform((-3, -3, 4), (3, 3, 9), (100, 3))
        p = pinhole_view(calibration, index).calibration.cameras[index].p_rect
        found = pixels_in(rrd, view, 'velo_link', cam_t_velo.inverse().apply(seen))
        np.testing.assert_allclose(found, through(p[:, :3], seen), atol=0.05)


def test_a_camera_without_calibration_is_noted(show_messages):
    info = foreign.camera_info(0, 'c', right=True)
    info.k = np.zeros(9)
    info.p = np.zeros(12)
    image = foreign.jpeg_image(np.zeros(foreign.SIZE[::-1], np.uint8), 0, 'c')
    rrd, report = show_messages(
        ('/cam/camera_info', 1, info), ('/cam/image_rect/compressed', 1, image)
    )
    assert not report.losses
    (note,) = {*report.notes} - {BY_POSITION}
    assert note.startswith('/cam/camera_info: ')
    assert 'not calibrated' in note
    assert rrd.having('/cam/image_rect/compressed', 'Pinhole:image_from_camera') == []
