# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reading what the synthetic writer wrote, and drives with something wrong."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import BadFileError, format_numbers
from kitti_ros2.model.samples import FrameLabels, Image, OxtsPacket, Pose, Scan
from kitti_ros2.model.streams import Layout, Stream, format_stamp
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.synthetic import SyntheticDrive

from builders import SMALL, png_bytes  # isort: skip

KINDS = {Stream.SCAN: Scan, Stream.OXTS: OxtsPacket, Stream.POSE: Pose, Stream.LABELS: FrameLabels}


def test_every_listed_sample_reads(recording):
    assert not recording.losses
    posed = SyntheticDrive(SMALL, recording.layout).posed
    of_poses = {Stream.POSE, Stream.LABELS} if recording.layout.traits.world_boxes else set()
    for stream, index in recording.streams.items():
        expected = posed if stream in of_poses else range(SMALL.frames)
        assert index.numbers.tolist() == sorted(expected)
        for number in index.numbers.tolist():
            sample = recording.read(stream, number)
            assert isinstance(sample, KINDS.get(stream, (Image, object)))


def test_expected_streams(recordings):
    images = {Stream(f'image_{i}') for i in range(4)}
    colour = {Stream.IMAGE_2, Stream.IMAGE_3}
    expected = {
        Layout.RAW: {Stream.SCAN, Stream.OXTS, Stream.POSE, Stream.LABELS, *images},
        Layout.OBJECT: {Stream.SCAN, Stream.CALIBRATION, Stream.LABELS, *colour},
        Layout.ODOMETRY: {Stream.SCAN, Stream.POSE, *images},
        Layout.TRACKING: {Stream.SCAN, Stream.OXTS, Stream.POSE, Stream.LABELS, *colour},
        Layout.KITTI_360: {Stream.SCAN, Stream.OXTS, Stream.POSE, Stream.LABELS, *images},
    }
    for layout, path in recordings.items():
        assert set(open_recording(path).streams) == expected[layout]


def test_samples_are_what_was_made(recording):
    made = SyntheticDrive(SMALL, recording.layout)
    scan = made.scan(3, is_compensated=recording.layout is Layout.ODOMETRY)
    np.testing.assert_array_equal(recording.read(Stream.SCAN, 3).points, scan.points)
    traits = recording.layout.traits
    for camera in (*traits.cameras, *traits.raw_cameras):
        image = made.image(3, camera, traits.png)
        assert recording.read(Stream(f'image_{camera}'), 3).data == image.data


@pytest.mark.parametrize('layout', [layout for layout in Layout if layout is not Layout.OBJECT])
def test_poses_agree_across_layouts(recordings, layout):
    """oxts by Mercator and odometry's camera poses tell the same trajectory."""
    raw = open_recording(recordings[Layout.RAW])
    other = open_recording(recordings[layout])
    first, *numbers = other.streams[Stream.POSE].numbers.tolist()
    assert len(numbers) >= SMALL.frames - 2
    origin = other.read(Stream.POSE, first).world_T_imu.inverse()
    start = raw.read(Stream.POSE, first).world_T_imu.inverse()
    for number in numbers:
        expected = start @ raw.read(Stream.POSE, number).world_T_imu
        moved = origin @ other.read(Stream.POSE, number).world_T_imu
        # Odometry has no imu calibration; its nominal one is off by centimetres and a degree.
        np.testing.assert_allclose(moved.translation, expected.translation, atol=0.15)


def test_a_gap_shifts_nothing(drive):
    whole = open_recording(drive)
    (drive / 'velodyne_points' / 'data' / '0000000002.bin').unlink()
    gapped = open_recording(drive)
    assert gapped.streams[Stream.SCAN].numbers.tolist() == [0, 1, 3, 4]
    kept = whole.streams[Stream.SCAN].stamps_ns[[0, 1, 3, 4]]
    assert gapped.streams[Stream.SCAN].stamps_ns.tolist() == kept.tolist()
    [loss] = gapped.losses
    assert (loss.stream, loss.count) == ('scan', 1)
    assert 'no file for frames 2,' in loss.text()


def edit_stamps(drive, stream: str, edit) -> None:
    path = drive / stream / 'timestamps.txt'
    path.write_text('\n'.join(edit(path.read_text().splitlines())) + '\n')


def test_fewer_stamps_than_files(drive):
    edit_stamps(drive, 'image_02', lambda lines: lines[:3])
    recording = open_recording(drive)
    assert recording.streams[Stream.IMAGE_2].numbers.tolist() == [0, 1, 2]
    [loss] = recording.losses
    assert loss.count == 2
    assert '3 lines, so no stamp for frames 3-4' in loss.text()


def test_a_malformed_stamp_costs_its_frame(drive):
    edit_stamps(drive, 'image_02', lambda lines: [*lines[:1], 'soon', *lines[2:]])
    recording = open_recording(drive)
    assert recording.streams[Stream.IMAGE_2].numbers.tolist() == [0, 2, 3, 4]
    [loss] = recording.losses
    assert 'image_02/timestamps.txt:2: ' in loss.text()


def test_stamps_out_of_order_are_kept_and_told(drive):
    edit_stamps(drive, 'oxts', lambda lines: [lines[1], lines[0], *lines[2:]])
    recording = open_recording(drive)
    assert not recording.losses
    assert any('oxts/timestamps.txt:2: 1 stamps earlier' in note for note in recording.notes)


def test_no_stamps_for_one_stream(drive):
    (drive / 'oxts' / 'timestamps.txt').unlink()
    recording = open_recording(drive)
    assert Stream.OXTS not in recording.streams
    assert recording.losses[0].count == SMALL.frames


def test_without_any_stamps_frames_are_a_nominal_period_apart(drive):
    for path in drive.glob('*/timestamps.txt'):
        path.unlink()
    recording = open_recording(drive, ReadOptions(epoch_ns=10**18))
    for index in recording.streams.values():
        assert index.stamps_ns.tolist() == [10**18 + 103_600_000 * i for i in range(SMALL.frames)]
    assert any('nominal, 0.1036 s a frame' in note for note in recording.notes)
    recording = open_recording(drive, ReadOptions(period_ns=10**8))
    assert np.unique(np.diff(recording.streams[Stream.OXTS].stamps_ns)).tolist() == [10**8]


IDLE_TIMES = {
    Layout.RAW: ['period', 'epoch'],
    Layout.OBJECT: [],
    Layout.ODOMETRY: ['period'],
    Layout.TRACKING: [],
    Layout.KITTI_360: ['epoch'],
}


@pytest.mark.parametrize('layout', IDLE_TIMES)
def test_options_of_time_that_time_stamps_override_are_named(layout, recordings):
    options = ReadOptions(period_ns=2 * 10**8, epoch_ns=10**18)
    notes = open_recording(recordings[layout], options).notes
    idle = [note.split()[0] for note in notes if 'changes nothing' in note]
    assert idle == IDLE_TIMES[layout]


def test_the_period_is_that_of_turns_without_stamps(drive):
    (drive / 'velodyne_points/timestamps_end.txt').unlink()
    recording = open_recording(drive, ReadOptions(period_ns=2 * 10**8))
    assert {turn.length_ns for turn in recording.turns.values()} == {2 * 10**8}
    assert not any('changes nothing' in note for note in recording.notes)


def test_an_absent_stream_is_a_note(drive):
    shutil.rmtree(drive / 'image_01')
    recording = open_recording(drive)
    assert Stream.IMAGE_1 not in recording.streams
    assert not recording.losses
    assert any('image_01: absent' in note for note in recording.notes)


def test_a_stray_file_is_named(drive):
    (drive / 'velodyne_points' / 'data' / 'copy of 1.bin').write_bytes(b'')
    assert any('copy of 1.bin' in note for note in open_recording(drive).notes)


def test_an_image_of_another_size_is_bad(drive):
    path = drive / 'image_02' / 'data' / '0000000001.png'
    path.write_bytes(png_bytes(20, 10))
    recording = open_recording(drive)
    with pytest.raises(BadFileError, match='20x10; expected 310x94'):
        recording.read(Stream.IMAGE_2, 1)


def test_extract_streams_run_on_their_own(drive):
    """Text scans, unrectified images, oxts at another rate: no common frame number."""
    extract = drive.rename(drive.with_name(drive.name.replace('_sync', '_extract')))
    for path in (extract / 'velodyne_points' / 'data').glob('*.bin'):
        points = np.frombuffer(path.read_bytes(), np.float32).reshape(-1, 4)
        path.with_suffix('.txt').write_text(
            ''.join(' '.join(f'{v:.3f}' for v in point) + '\n' for point in points.tolist())
        )
        path.unlink()
    stamp = open_recording(extract).streams[Stream.OXTS].stamps_ns[0]
    packet = (extract / 'oxts' / 'data' / '0000000000.txt').read_text()
    for number in range(50):
        (extract / 'oxts' / 'data' / f'{number:010d}.txt').write_text(packet)
    lines = [format_stamp(int(stamp) + number * 10_000_000) for number in range(50)]
    edit_stamps(extract, 'oxts', lambda _: lines)
    recording = open_recording(extract)
    assert not recording.losses
    assert not recording.rectified
    assert recording.image_topic == 'image_raw'
    assert not recording.common_numbers
    assert len(recording.streams[Stream.OXTS]) == 50
    assert recording.read(Stream.SCAN, 1).points.shape[1] == 4


def test_frame_numbers_as_ranges():
    assert format_numbers([3, 177, 178, 179]) == '3, 177-179'
    assert format_numbers([0, 2, 4, 6, 8], most=2) == '0, 2 and 3 more'
