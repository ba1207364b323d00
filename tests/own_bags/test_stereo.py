# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs in bags: stamps, frames, CameraInfo, depth, and the files that come back."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest

import kitti_ros2
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import decode_static
from kitti_ros2.messages.cdr import deserialize, stamp_ns_of
from kitti_ros2.messages.tf_tree import FrameTree
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MessageOptions, StereoFrame
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from builders import convert_recording, files_of  # isort: skip

GREY, COLOUR = ('gray_left', 'gray_right'), ('color_left', 'color_right')
PAIRS = {
    Layout.RAW: (GREY, COLOUR),
    Layout.ODOMETRY: (GREY, COLOUR),
    Layout.OBJECT: (COLOUR,),
    Layout.TRACKING: (COLOUR,),
    Layout.KITTI_360: (('0', '1'),),
}
EXTRACT = 'extract'


def as_extract(drive):
    """A drive renamed to an unsynchronised one, its right images numbered one lower."""
    extract = drive.with_name(drive.name.replace('sync', 'extract'))
    drive.rename(extract)
    for camera in ('image_01', 'image_03'):
        folder = extract / camera
        files = sorted((folder / 'data').iterdir())
        files[0].unlink()
        for number, path in enumerate(files[1:]):
            path.rename(path.with_name(f'{number:010d}.png'))
        lines = (folder / 'timestamps.txt').read_text().splitlines(keepends=True)
        (folder / 'timestamps.txt').write_text(''.join(lines[1:]))
    return extract


def stereo_bag(source, out, **options):
    messages = MessageOptions(stereo=True, **options)
    report = convert_recording(source, out, messages, read=ReadOptions(stereo=True))
    return out, report


def read(bag, part=''):
    """By topic the messages of a bag whose topics contain a word."""
    found = {}
    with open_messages(bag) as messages:
        for message in messages:
            if part in message.topic:
                decoded = deserialize(bytes(message.data), message.msgtype)
                found.setdefault(message.topic, []).append((message.stamp_ns, decoded))
    return found


def stamps_by_camera(bag):
    """By camera the stamps of its images, which are those of its CameraInfos and in the log."""
    found = {}
    for topic, messages in read(bag, '/kitti/camera_').items():
        stamps = [stamp_ns_of(message.header) for _, message in messages]
        assert stamps == [log_ns for log_ns, _ in messages]
        assert found.setdefault(topic.split('/')[2].removeprefix('camera_'), stamps) == stamps
    return found


@pytest.mark.parametrize('layout', [*Layout, EXTRACT])
def test_no_pair_has_two_stamps(recordings, drive, tmp_path, layout):
    source = as_extract(drive) if layout == EXTRACT else recordings[layout]
    bag, report = stereo_bag(source, tmp_path / 'o.mcap')
    stamps = stamps_by_camera(bag)
    pairs = PAIRS[Layout.RAW if layout == EXTRACT else layout]
    for left, right in pairs:
        assert stamps[right]
        if layout == EXTRACT:  # without the first right image
            assert stamps[right] == stamps[left][1:]
        else:
            assert stamps[right] == stamps[left]
    apart = [note for note in report.notes if 'ms from its own' in note]
    stamped = layout in (Layout.RAW, Layout.KITTI_360, EXTRACT)
    assert len(apart) == (len(pairs) if stamped else 0)


def test_without_the_option_the_stamps_are_those_of_the_files(recordings, tmp_path):
    convert_recording(recordings[Layout.RAW], tmp_path / 'o.mcap')
    stamps = stamps_by_camera(tmp_path / 'o.mcap')
    for left, right in PAIRS[Layout.RAW]:
        assert not {*stamps[left]} & {*stamps[right]}


@pytest.mark.parametrize('layout', [*Layout, EXTRACT])
def test_each_camera_has_its_own_frame_and_the_baseline_in_tf_and_in_p(
    recordings, drive, tmp_path, layout
):
    source = as_extract(drive) if layout == EXTRACT else recordings[layout]
    bag, _ = stereo_bag(source, tmp_path / 'o.mcap')
    ((_, static), *_) = read(bag, '/tf_static')['/tf_static']
    tree = FrameTree(decode_static(static))
    infos = {topic.split('/')[2]: each[0][1] for topic, each in read(bag, 'camera_info').items()}
    images = {topic.split('/')[2]: each[0][1] for topic, each in read(bag, 'compressed').items()}
    for left, right in PAIRS[Layout.RAW if layout == EXTRACT else layout]:
        l_info, r_info = (infos[f'camera_{name}'] for name in (left, right))
        for name, info in ((left, l_info), (right, r_info)):
            assert info.header.frame_id == f'camera_{name}_optical_frame'
            assert images[f'camera_{name}'].header.frame_id == info.header.frame_id
        l_p, r_p = (info.p.reshape(3, 4) for info in (l_info, r_info))
        assert l_p[:, 3].tolist() == [0, 0, 0]
        assert r_p[1:, 3].tolist() == [0, 0]
        assert np.array_equal(l_p[:, :3], r_p[:, :3])  # image_geometry asserts fx, fy and cy
        l_t_r = tree.transform(l_info.header.frame_id, r_info.header.frame_id)
        baseline_m = -r_p[0, 3] / r_p[0, 0]
        assert 0.4 < baseline_m < 0.7
        # Unrectified cameras of an extract are not parallel: their baseline is along R's x.
        along = l_info.r.reshape(3, 3) @ l_t_r.translation
        assert along[0] == pytest.approx(baseline_m, abs=1e-3)


@pytest.mark.parametrize('layout', [*Layout, EXTRACT])
def test_a_pair_shares_the_left_frame_on_request(recordings, drive, tmp_path, layout):
    """As image_geometry asserts; unrectified cameras are not parallel and keep their own."""
    source = as_extract(drive) if layout == EXTRACT else recordings[layout]
    bag, _ = stereo_bag(source, tmp_path / 'l.mcap', stereo_frame=StereoFrame.LEFT)
    own, _ = stereo_bag(source, tmp_path / 'o.mcap')
    of_pair, of_own = (
        {topic: each[0][1] for topic, each in read(path, 'camera_').items()} for path in (bag, own)
    )
    assert of_pair.keys() == of_own.keys()
    for topic, message in of_pair.items():
        camera = topic.split('/')[2].removeprefix('camera_')
        if layout != EXTRACT:
            camera = {'1': '0'}.get(camera, camera.replace('right', 'left'))
        assert message.header.frame_id == f'camera_{camera}_optical_frame'
        if hasattr(message, 'p'):
            assert np.array_equal(message.p, of_own[topic].p)


def test_a_frame_of_pairs_without_stereo_is_refused(recordings, tmp_path, capsys):
    words = [str(recordings[Layout.RAW]), str(tmp_path / 'o.mcap'), '--stereo-frame', 'left']
    assert main(['to-bag', *words]) == 2
    assert 'stereo_frame is for stereo; give both' in capsys.readouterr().err


def test_images_without_a_partner_keep_their_stamps_and_are_counted(drive, tmp_path):
    for camera, numbers in (('image_02', (1,)), ('image_03', (3, 4)), ('image_00', ())):
        for number in numbers:
            (drive / camera / f'data/{number:010d}.png').unlink()
    plain = open_recording(drive).streams
    bag, report = stereo_bag(drive, tmp_path / 'o.mcap')
    stamps = stamps_by_camera(bag)
    left, right = (set(stamps[name]) for name in COLOUR)
    own = dict(zip(plain[Stream.IMAGE_3].numbers, plain[Stream.IMAGE_3].stamps_ns, strict=True))
    assert right - left == {own[1]}
    assert len(left & right) == 2
    assert len(left - right) == 2
    assert stamps[GREY[0]] == stamps[GREY[1]]
    notes = [note for note in report.notes if 'without a pair' in note]
    assert [note.partition(' has no')[0] for note in notes] == [
        'image_3 of frames 1 (1 image)',
        'image_2 of frames 3-4 (2 images)',
    ]
    assert {loss.stream: loss.count for loss in report.losses} == {'image_2': 1, 'image_3': 2}


def test_a_recording_without_pairs_says_so(drive, tmp_path):
    for camera in ('image_01', 'image_03'):
        shutil.rmtree(drive / camera)
    _, report = stereo_bag(drive, tmp_path / 'o.mcap')
    assert 'stereo changes nothing: no two cameras are a pair' in report.notes


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('ending', 'words'), [('.mcap', []), ('', ['--stereo-frame', 'left']), ('.bag', [])]
)
@pytest.mark.parametrize('layout', [*Layout, EXTRACT])
def test_every_file_comes_back_to_the_byte(recordings, drive, tmp_path, layout, ending, words):
    source = as_extract(drive) if layout == EXTRACT else recordings[layout]
    bag, out = tmp_path / f'bag{ending}', tmp_path / 'out'
    assert main(['to-bag', str(source), str(bag), '-q', '--stereo', *words]) == 0
    assert main(['to-kitti', str(bag), str(out), '-q']) == 0
    is_drive = 'drive' in source.name
    made = out / source.parent.name if is_drive else out
    assert files_of(made) == files_of(source.parent if is_drive else source)


def test_lone_images_and_parts_come_back_to_the_byte(drive, tmp_path):
    (drive / 'image_02/data/0000000001.png').unlink()
    (drive / 'image_03/data/0000000003.png').unlink()
    bag, out, part = tmp_path / 'bag.mcap', tmp_path / 'out', tmp_path / 'part'
    assert main(['to-bag', str(drive), str(bag), '-q', '--stereo', '--ring-time']) == 1
    assert main(['to-kitti', str(bag), str(out), '-q']) == 0
    assert files_of(out / drive.parent.name) == files_of(drive.parent)
    assert main(['to-kitti', str(bag), str(part), '-q', '--start', '1', '--end', '2']) == 0
    images = {path.stem[-1] for path in part.rglob('image_03/data/*.png')}
    assert images == {'1', '2'}


def test_a_bag_gives_each_image_the_stamp_of_its_file(drive, tmp_path):
    bag, _ = stereo_bag(drive, tmp_path / 'o.mcap')
    with kitti_ros2.open(bag) as made, kitti_ros2.open(drive) as true:
        for number in true.numbers:
            for camera in range(4):
                assert np.array_equal(
                    made.frame(number).image(camera), true.frame(number).image(camera)
                )


@pytest.mark.one_in(3)
@pytest.mark.parametrize('images', ['compressed', 'raw', 'both'])
@pytest.mark.parametrize('encoding', ['rgb8', 'bgr8', 'mono8'])
def test_images_of_any_encoding_come_back(recordings, tmp_path, images, encoding):
    source, bag, out = recordings[Layout.RAW], tmp_path / 'bag.mcap', tmp_path / 'out'
    words = ['--stereo', '--images', images, '--color-encoding', encoding, '--end', '1']
    assert main(['to-bag', str(source), str(bag), '-q', *words]) == 0
    greyed = encoding == 'mono8' and images == 'raw'
    assert main(['to-kitti', str(bag), str(out), '-q']) == int(greyed)
    made, true = files_of(out), files_of(source.parent.parent)
    for name, data in made.items():
        is_pixels = images == 'raw' and name.endswith('.png')
        if not is_pixels:
            assert data == true[name], name
            continue
        again, before = (
            cv2.imdecode(np.frombuffer(each, np.uint8), cv2.IMREAD_UNCHANGED)
            for each in (data, true[name])
        )
        if greyed and before.ndim == 3:
            before = cv2.cvtColor(before, cv2.COLOR_BGR2GRAY)
        assert np.array_equal(again, before), name
    assert sum(name.endswith('.png') for name in made) == 8


def test_what_is_written_grey_is_named(recordings, tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    words = ['--images', 'raw', '--color-encoding', 'mono8']
    assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), '-q', *words]) == 0
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q']) == 1
    said = capsys.readouterr().err
    assert 'image_2 of frames 0-4 is written grey' in said
    assert 'image_3 of frames 0-4 is written grey' in said
    assert 'image_0' not in said


def test_the_encodings_are_opencvs(recordings, tmp_path):
    pixels = {}
    for encoding in ('bgr8', 'rgb8', 'mono8'):
        bag = tmp_path / f'{encoding}.mcap'
        words = ['--images', 'raw', '--color-encoding', encoding, '--end', '0', '-q']
        assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), *words]) == 0
        found = read(bag, '/image_rect')
        for name, expected in ((COLOUR[0], encoding), (GREY[0], 'mono8')):
            ((_, image),) = found[f'/kitti/camera_{name}/image_rect']
            assert image.encoding == expected
            channels = 1 if expected == 'mono8' else 3
            assert image.step == image.width * channels
            shape = (image.height, image.width, channels)
            pixels[encoding, name] = np.asarray(image.data).reshape(shape)
    bgr = pixels['bgr8', COLOUR[0]]
    assert np.array_equal(pixels['rgb8', COLOUR[0]], bgr[..., ::-1])
    grey = bgr @ np.array([0.114, 0.587, 0.299])
    assert np.abs(pixels['mono8', COLOUR[0]][..., 0] - grey).max() <= 0.51
    assert np.array_equal(pixels['mono8', GREY[0]], pixels['bgr8', GREY[0]])


def test_an_encoding_without_raw_images_is_noted(recordings, tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    words = ['--color-encoding', 'rgb8', '--end', '0']
    assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), *words]) == 0
    (line,) = [text for text in capsys.readouterr().out.splitlines() if 'color_encoding' in text]
    assert 'color_encoding rgb8 changes nothing: images are compressed' in line


def test_disparity_places_points_at_their_depth(tmp_path):
    """Half of the points within 1 % and 85 % of them within 2 % of their depth.

    They are the scan's up to 30 m, moved to the moment of the image; the scanner sees over edges
    that hide some of them from the camera.
    """
    source = write_synthetic(tmp_path, Layout.RAW, SyntheticOptions(frames=2))
    bag = tmp_path / 'o.mcap'
    words = ['--images=raw', '--color-encoding=mono8', '--end=0', '-q']
    assert main(['to-bag', str(source), str(bag), '--stereo', *words]) == 0
    found = read(bag, '/kitti/camera_color_')
    left, right = (found[f'/kitti/camera_{name}/image_rect'][0][1] for name in COLOUR)
    l_info, r_info = (found[f'/kitti/camera_{name}/camera_info'][0][1] for name in COLOUR)
    rows = slice(left.height // 2, None)
    grey = [np.asarray(each.data).reshape(each.height, each.width)[rows] for each in (left, right)]
    matcher = cv2.StereoSGBM_create(
        numDisparities=96, blockSize=5, P1=200, P2=800, disp12MaxDiff=1, uniquenessRatio=10,
        speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    disparity = matcher.compute(*grey).astype(np.float64) / 16
    fx, tx = r_info.p[0], r_info.p[3]
    shift = l_info.p[2] - r_info.p[2]  # as image_geometry's getZ
    depth = np.where(disparity > 0, -tx / np.maximum(disparity - shift, 1e-3), np.nan)
    assert fx == l_info.p[0]
    with kitti_ros2.open(source) as recording:
        frame = recording.frame(0)
        points = frame.points_at(stamp_ns_of(left.header))
        uv, true = frame.calibration.project(points, 2)
    u, v = np.rint(np.nan_to_num(uv, nan=-1)).astype(int).T
    v = v - rows.start
    seen = (true > 0) & (true < 30) & (u >= 0) & (u < left.width) & (v >= 0) & (v < len(depth))
    error = np.abs(depth[v[seen], u[seen]] / true[seen] - 1)
    error = error[np.isfinite(error)]
    assert len(error) > 5000
    assert np.median(error) < 0.01
    assert np.percentile(error, 85) < 0.02
