# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Every frame that messages name is in the transform tree, whatever calibration is missing."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import MarkerOptions, MessageOptions, Preset
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.report.overview import inspect_recording

from builders import convert_recording  # isort: skip

FILES = {
    Layout.RAW: ['calib_cam_to_cam.txt', 'calib_velo_to_cam.txt', 'calib_imu_to_velo.txt'],
    Layout.OBJECT: [f'training/calib/00000{number}.txt' for number in range(5)],
    Layout.ODOMETRY: ['sequences/00/calib.txt'],
    Layout.TRACKING: ['training/calib/0000.txt'],
    Layout.KITTI_360: [
        f'calibration/{name}'
        for name in (
            'perspective.txt',
            'calib_cam_to_pose.txt',
            'calib_cam_to_velo.txt',
            'image_02.yaml',
            'image_03.yaml',
        )
    ],
}
KEYS = {
    Layout.RAW: ['P_rect_01', 'P_rect_02', 'R_rect_00', 'T_03'],
    Layout.OBJECT: ['P0', 'P2', 'P3', 'R0_rect', 'Tr_velo_to_cam', 'Tr_imu_to_velo'],
    Layout.ODOMETRY: ['P0', 'P1', 'P2', 'Tr'],
    Layout.TRACKING: ['P2', 'R_rect', 'Tr_velo_cam', 'Tr_imu_velo'],
    Layout.KITTI_360: [
        'P_rect_00',
        'P_rect_01',
        'R_rect_00',
        'T_01',
        'image_00',
        'image_02',
        'image_03',
    ],
}


def copied(recordings, layout, tmp_path):
    """A data set of one's own, and the folder of its calibration names."""
    source = recordings[layout]
    if layout is not Layout.RAW:
        shutil.copytree(source, tmp_path / 'set')
        return tmp_path / 'set', tmp_path / 'set'
    shutil.copytree(source.parent, tmp_path / source.parent.name)
    return tmp_path / source.parent.name / source.name, tmp_path / source.parent.name


def write(source, out, layout, **options):
    messages = MessageOptions(markers=MarkerOptions(trails=True), **options)
    return convert_recording(source, out, messages, read=ReadOptions(layout=layout))


def named_in(message):
    """All frame_id of a message and of the messages in it."""
    if isinstance(message, list):
        return {name for each in message for name in named_in(each)}
    slots = getattr(message, '__slots__', ())
    found = {name for slot in slots for name in named_in(getattr(message, slot))}
    frame = getattr(message, 'frame_id', '') or getattr(message, 'child_frame_id', '')
    return found | ({frame} if frame else set())


def lost_frames(bag):
    """The frames that messages name and no chain of transforms joins to base_link."""
    named, parents = {'base_link'}, {}
    for item in read_ros2_messages(str(bag)):
        named |= named_in(item.ros_msg)
        if item.channel.topic in {'/tf', '/tf_static'}:
            for link in item.ros_msg.transforms:
                parents[link.child_frame_id] = link.header.frame_id

    def root(frame):
        return root(parents[frame]) if frame in parents else frame

    return {frame for frame in named if root(frame) != root('base_link')}


def without_key(path, key):
    lines = path.read_text().splitlines(keepends=True)
    kept = [line for line in lines if line.split()[:1] not in ([key], [f'{key}:'])]
    assert len(kept) == len(lines) - 1
    path.write_text(''.join(kept))


@pytest.mark.parametrize('preset', list(Preset))
@pytest.mark.parametrize('layout', list(Layout))
def test_with_the_whole_calibration(recordings, tmp_path, layout, preset):
    report = write(recordings[layout], tmp_path / 'o.mcap', layout, preset=preset)
    assert lost_frames(tmp_path / 'o.mcap') == set()
    assert not any('camera' in note for note in report.notes)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('layout', 'missing'),
    [(layout, [name]) for layout, files in FILES.items() for name in files] + [*FILES.items()],
)
def test_without_calibration_files(recordings, tmp_path, layout, missing):
    source, folder = copied(recordings, layout, tmp_path)
    for name in missing:
        (folder / name).unlink()
    report = write(source, tmp_path / 'o.mcap', layout)
    assert lost_frames(tmp_path / 'o.mcap') == set()
    assert report.losses
    # Frames of an object set without a file keep the transforms of the frame before; the file of a
    # fisheye has no mount.
    others = layout is Layout.OBJECT or missing[0].endswith('.yaml')
    if missing == FILES[layout] or not others:
        assert any('a nominal value is used' in note for note in report.notes)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('layout', 'key'), [(layout, key) for layout, keys in KEYS.items() for key in keys]
)
def test_without_a_line_of_the_calibration(recordings, tmp_path, layout, key):
    source, folder = copied(recordings, layout, tmp_path)
    first = int(key.startswith('image_'))  # mounts of KITTI-360 are in the second file
    for name in FILES[layout] if layout is Layout.OBJECT else FILES[layout][first : first + 1]:
        without_key(folder / name, key)
    write(source, tmp_path / 'o.mcap', layout)
    assert lost_frames(tmp_path / 'o.mcap') == set()


@pytest.mark.parametrize('missing', [[], FILES[Layout.RAW][:1], FILES[Layout.RAW][1:], ['R_02']])
def test_of_unrectified_images(recordings, tmp_path, missing):
    source, folder = copied(recordings, Layout.RAW, tmp_path)
    source = source.rename(source.with_name(source.name.replace('_sync', '_extract')))
    for name in missing:
        if name.endswith('.txt'):
            (folder / name).unlink()
        else:
            without_key(folder / FILES[Layout.RAW][0], name)
    write(source, tmp_path / 'o.mcap', Layout.RAW)
    assert lost_frames(tmp_path / 'o.mcap') == set()


def test_of_cameras_with_mounts_of_their_own(recordings, tmp_path):
    """As the Waymo converters write them; one has lost its mount."""
    source, folder = copied(recordings, Layout.OBJECT, tmp_path)
    for name in FILES[Layout.OBJECT]:
        text = (folder / name).read_text()
        line = next(line for line in text.splitlines() if line.startswith('Tr_velo_to_cam:'))
        own = ''.join(line.replace('cam:', f'cam_{index}:') + '\n' for index in (0, 1, 2))
        (folder / name).write_text(text.replace(line + '\n', own))
    report = write(source, tmp_path / 'o.mcap', Layout.OBJECT)
    assert lost_frames(tmp_path / 'o.mcap') == set()
    note = 'the mount of camera 3: not in the calibration, a nominal value is used'
    assert note in report.notes


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.OBJECT, Layout.ODOMETRY])
def test_nominal_mounts_are_those_of_the_car(recordings, tmp_path, layout):
    """Within a few centimetres and a degree or two of the synthetic rig, which is like KITTI's."""
    source, folder = copied(recordings, layout, tmp_path)
    true = inspect_recording(open_recording(source, ReadOptions(layout=layout)), source)
    for name in FILES[layout]:
        (folder / name).unlink()
    made = inspect_recording(open_recording(source, ReadOptions(layout=layout)), source)
    expected = {link.child: link for link in true.links}
    cameras = [link for link in made.links if 'optical' in link.child]
    assert len(cameras) >= 2
    for link in cameras:
        if link.parent == expected[link.child].parent:
            np.testing.assert_allclose(link.xyz_m, expected[link.child].xyz_m, atol=0.1)
            np.testing.assert_allclose(link.rpy_deg, expected[link.child].rpy_deg, atol=2.5)
    assert any('the mount of camera 3' in note for note in made.notes)


def test_boxes_and_camera_info_do_without_nominal_values(recordings, tmp_path):
    source, folder = copied(recordings, Layout.TRACKING, tmp_path)
    (folder / FILES[Layout.TRACKING][0]).unlink()
    counts = write(source, tmp_path / 'o.mcap', Layout.TRACKING).counts
    assert counts['/kitti/camera_color_left/image_rect/compressed'] == 5
    for topic in ('/kitti/camera_color_left/camera_info', '/kitti/labels/detections'):
        assert counts[topic] == 0
