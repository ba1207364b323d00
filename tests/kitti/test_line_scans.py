# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of KITTI-360's SICK: their files, their numbers, and what a drive lacks of them."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sick_scans import SICK, TO_VELO, D, add_sick, sick_file, sick_stamps

import kitti_ros2
from kitti_ros2.cli import main
from kitti_ros2.kitti.kitti360_calib import format_kitti360_calibration, parse_kitti360_calibration
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.scan_file import format_line_scan, parse_line_scan
from kitti_ros2.messages.scan import decode_line_scan, encode_line_scan
from kitti_ros2.model.errors import BadFileError
from kitti_ros2.model.streams import Clock, Layout, Stream

pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')

FILES = st.binary(min_size=1, max_size=90).map(lambda data: data * 8)


@given(FILES)
def test_files_come_back_to_the_byte(data):
    """Of any bits: also those of NaN, which another sign has too."""
    assert format_line_scan(parse_line_scan(data, 'scan.bin')) == data


@given(FILES)
def test_clouds_come_back_to_the_byte(data):
    scan = parse_line_scan(data, 'scan.bin')
    cloud = encode_line_scan(scan, 5, 'sick_link')
    assert [field.name for field in cloud.fields] == ['x', 'y', 'z']
    assert (cloud.height, cloud.width, cloud.row_step) == (1, len(data) // 8, len(cloud.data))
    assert cloud.is_dense == bool(np.isfinite(np.frombuffer(data, '<f4')).all())
    assert format_line_scan(decode_line_scan(cloud)) == data


def test_a_pair_is_a_point_in_the_plane_of_y_and_z():
    points = parse_line_scan(np.array([1.5, -2.5, -3, 4], '<f4').tobytes(), 'scan.bin').points
    assert points.tolist() == [[0, -1.5, -2.5], [0, 3, 4]]


@pytest.mark.parametrize('data', [b'', b'1234567', b'123456789'])
def test_a_cut_file_is_named(data):
    with pytest.raises(BadFileError, match=r'scan\.bin: .*expected two float32 a point, 8 bytes'):
        parse_line_scan(data, 'scan.bin')


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'point_step': 16}, '6 points with 72 bytes'),
        ({'width': 2**31}, '2147483648 points with 72 bytes'),
        ({'is_bigendian': True}, 'not of x y z'),
        ({'fields': []}, 'not of x y z'),
    ],
)
def test_other_clouds_are_refused(change, reason):
    cloud = encode_line_scan(parse_line_scan(bytes(48), 'scan.bin'), 5, 'sick_link')
    for name, value in change.items():
        setattr(cloud, name, value)
    with pytest.raises(ValueError, match=reason):
        decode_line_scan(cloud)


@pytest.fixture
def root(recordings, tmp_path):
    """A drive with scans of the SICK, three of which are missing."""
    shutil.copytree(recordings[Layout.KITTI_360], tmp_path / 'set')
    add_sick(tmp_path / 'set', missing=(3, 20, 21))
    return tmp_path / 'set'


def losses_of(recording):
    return [loss.text() for loss in recording.losses]


def test_scans_have_numbers_and_stamps_of_their_own(root):
    recording = open_recording(root)
    stamps, index = sick_stamps(root), recording.streams[Stream.SICK]
    assert index.numbers.tolist() == [n for n in range(len(stamps)) if n not in {3, 20, 21}]
    assert index.stamps_ns.tolist() == [stamps[number] for number in index.numbers.tolist()]
    assert losses_of(recording) == [
        f'{root / SICK}/data: no file for frames 3, 20-21, which timestamps.txt lists'
    ]
    pairs = np.fromfile(sick_file(root, 5), '<f4').reshape(-1, 2)
    points = recording.read(Stream.SICK, 5).points
    np.testing.assert_array_equal(points[:, 1], -pairs[:, 0])
    np.testing.assert_array_equal(points[:, 2], pairs[:, 1])
    assert not any('sick' in note for note in recording.notes)


def test_a_file_beyond_the_stamps_is_a_loss(root):
    sick_file(root, 200).write_bytes(bytes(8))
    assert any(
        loss.endswith('timestamps.txt: 105 lines, so no stamp for frames 200')
        for loss in losses_of(open_recording(root))
    )


def test_without_stamps_they_are_left_out(root):
    (root / SICK / 'timestamps.txt').unlink()
    recording = open_recording(root)
    assert Stream.SICK not in recording.streams
    assert any('0 lines, so no stamp for frames 0-2, 4-19' in loss for loss in losses_of(recording))


def test_with_stamps_alone_they_are_left_out(root):
    """Others are stamped from an assumed epoch on."""
    for path in root.glob('data_*/*/[ivo]*/timestamps.txt'):
        path.unlink()
    recording = open_recording(root)
    assert recording.clock is Clock.NOMINAL
    assert Stream.SICK not in recording.streams
    assert f'{root / SICK}: left out, as no other stream has stamps' in losses_of(recording)


def test_they_may_be_all_that_there_is(root):
    for part in ('data_2d_raw', 'data_poses', f'data_3d_raw/{D}/velodyne_points'):
        shutil.rmtree(root / part)
    recording = open_recording(root)
    assert [*recording.streams] == [Stream.SICK]
    assert recording.clock is Clock.UTC


def test_those_of_the_second_half_of_a_drive_begin_where_they_do(root, tmp_path):
    """Files of drive 0002 begin behind those of 0018, stamps of both are listed."""
    other = D.replace('0000', '0002')
    for number in range(60):
        sick_file(root, number).unlink(missing_ok=True)
    for folder in [*root.glob('data_*/*')]:
        folder.rename(folder.with_name(other))
    assert not any('sick' in loss for loss in losses_of(open_recording(root)))
    main(['to-bag', str(root), str(tmp_path / 'bag.mcap'), '-q'])
    with kitti_ros2.open(tmp_path / 'bag.mcap') as bag:
        assert not any('sick' in loss.text() for loss in bag.losses)


def test_their_mount_is_read_and_written(root):
    calibration = open_recording(root).calibration(0)
    expected = [[0, -1, 0, -0.4], [1, 0, 0, -0.01], [0, 0, 1, -0.07], [0, 0, 0, 1]]
    np.testing.assert_array_equal(calibration.velo_T_sick.matrix(), expected)
    again = parse_kitti360_calibration(format_kitti360_calibration(calibration), root)
    np.testing.assert_array_equal(again.velo_T_sick.matrix(), expected)


def test_a_missing_mount_is_named_where_there_are_scans(root):
    (root / TO_VELO).unlink()
    missing = open_recording(root).calibration(0).missing
    assert any(f'{root / TO_VELO}: no such file' in reason for reason in missing.values())
    shutil.rmtree(root / SICK)
    assert not open_recording(root).calibration(0).missing


def test_the_library_has_them_by_time(root):
    recording = kitti_ros2.open(root)
    stamps = sick_stamps(root)
    scans = [*recording.line_scans()]
    assert [stamp for stamp, _ in scans] == [
        stamp for number, stamp in enumerate(stamps) if number not in {3, 20, 21}
    ]
    assert {points.shape[1] for _, points in scans} == {3}
    first, second = recording[0].stamp_ns, recording[1].stamp_ns
    between = [stamp for stamp, _ in recording.line_scans(first, second)]
    assert between == [stamp for stamp in stamps if first <= stamp < second]
    assert len(between) > 5
    turn = recording[0].transform('velo_link', 'sick_link')
    np.testing.assert_array_equal(turn[:3, 3], [-0.4, -0.01, -0.07])
    assert len(recording) == 5
    assert 'sick' not in recording.streams


def test_a_recording_without_them_says_so(recordings):
    with pytest.raises(kitti_ros2.KittiRos2Error, match='has no scans of a SICK'):
        next(kitti_ros2.open(recordings[Layout.KITTI_360]).line_scans())


def test_info_counts_them_but_no_frames_of_them(root, capsys):
    assert main(['info', str(root)]) == 1  # three are missing
    printed = capsys.readouterr().out
    assert '140 samples, 5 frames' in printed
    assert any(line.split()[:2] == ['sick', '102'] for line in printed.splitlines())
    assert 'sick_link' in printed


def test_the_real_mount(real_360):
    rig = kitti_ros2.read_calibration(real_360 / 'calibration')
    origin = rig.transform('velo_link', 'sick_link')[:3, 3]
    np.testing.assert_allclose(origin, (-0.3971, -0.0091, -0.0707), atol=6e-5)
