# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Sets of others in KITTI's folders: other digits, names that are no numbers, JPEG."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

import kitti_ros2
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.datasets import validate
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.errors import AmbiguousLayoutError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.own_bags.restore import restore
from kitti_ros2.own_bags.source_files import find_source_files

from builders import convert_recording, files_of, png_bytes  # isort: skip
from renamed_files import BY_NAME, KINDS, renamed, token  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

BAGS = {'mcap': 'bag.mcap', 'sqlite3': 'bag', 'ros1': 'bag.bag'}


def data_set_of(source: Path, layout: Layout) -> Path:
    """The folder that corresponds to the output of to-kitti."""
    return source.parent.parent if layout is Layout.RAW else source


def back(bag: Path, out: Path):
    """The bag as files again."""
    source_files = find_source_files(bag)
    assert source_files is not None
    (report,) = restore([(bag, source_files)], out)
    return report


@pytest.mark.one_in(3)
@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('layout', list(Layout))
def test_every_file_is_read_and_comes_back_to_the_byte(recordings, layout, kind, tmp_path):
    plain = open_recording(recordings[layout])
    source = renamed(recordings[layout], layout, tmp_path / 'in', kind)
    found = open_recording(source)
    assert found.losses == []
    assert {s: i.numbers.tolist() for s, i in found.streams.items()} == {
        stream: index.numbers.tolist() for stream, index in plain.streams.items()
    }
    assert any('file names are no numbers' in note for note in found.notes) is (kind in BY_NAME)
    report = convert_recording(source, tmp_path / 'bag.mcap')
    assert report.losses == ()
    made = back(tmp_path / 'bag.mcap', tmp_path / 'out')
    assert made.losses == ()
    # Another program may have made the JPEGs of a set's own PNG files: the bag does not tell.
    assert bool(made.notes) is (kind == 'JPEG named .png')
    assert files_of(tmp_path / 'out') == files_of(data_set_of(source, layout))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('kind', ['tokens', 'some .jpg'])
@pytest.mark.parametrize('storage', BAGS)
def test_every_container_keeps_the_names(recordings, storage, kind, tmp_path):
    source = renamed(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path / 'in', kind)
    convert_recording(source, tmp_path / BAGS[storage], storage=storage)
    assert back(tmp_path / BAGS[storage], tmp_path / 'out').losses == ()
    assert files_of(tmp_path / 'out') == files_of(source)


def test_frames_are_numbered_in_the_order_of_names(recordings, tmp_path):
    source = renamed(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path, 'tokens')
    found = open_recording(source)
    names = sorted(map(token, range(5)))
    assert [found.path(Stream.SCAN, number).stem for number in range(5)] == names
    source = renamed(recordings[Layout.ODOMETRY], Layout.ODOMETRY, tmp_path, 'prefix')
    found = open_recording(source)
    assert [found.path(Stream.SCAN, n).stem for n in range(5)] == [f'frame_{n}' for n in range(5)]


def test_a_jpeg_passes_through(recordings, tmp_path):
    source = renamed(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path, '.jpg')
    file = (source / 'training/image_2/000003.jpg').read_bytes()
    true = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_COLOR)
    options = MessageOptions(images=Images.BOTH)
    convert_recording(source, tmp_path / 'bag.mcap', options)
    stamp_ns = open_recording(source).streams[Stream.IMAGE_2].stamps_ns[3]
    topics = {f'/kitti/camera_color_left/image_rect{end}' for end in ('', '/compressed')}
    with open_messages(tmp_path / 'bag.mcap', topics) as messages:
        found = {
            message.topic: TYPESTORE.deserialize_cdr(message.data, message.msgtype)
            for message in messages
            if message.stamp_ns == stamp_ns
        }
    assert found.keys() == topics
    compressed = found[f'{min(topics, key=len)}/compressed']
    assert (compressed.format, compressed.data.tobytes()) == ('jpeg', file)
    pixels = found[min(topics, key=len)]
    assert pixels.encoding == 'bgr8'
    np.testing.assert_array_equal(pixels.data.reshape(true.shape), true)
    for place in (source, tmp_path / 'bag.mcap'):
        with kitti_ros2.open(place) as recording:
            np.testing.assert_array_equal(recording[3].image(2), true[..., ::-1])
            png = np.frombuffer(recording[3].png(2), np.uint8)
            np.testing.assert_array_equal(cv2.imdecode(png, cv2.IMREAD_COLOR), true)


def test_pixels_of_a_jpeg_come_back_as_png_and_are_a_loss(recordings, tmp_path):
    source = renamed(recordings[Layout.TRACKING], Layout.TRACKING, tmp_path / 'in', '.jpg')
    convert_recording(source, tmp_path / 'bag.mcap', MessageOptions(images=Images.RAW))
    report = back(tmp_path / 'bag.mcap', tmp_path / 'out')
    assert {(loss.stream, loss.count) for loss in report.losses} == {
        ('image_2', 5),
        ('image_3', 5),
    }
    assert 'image_2 of frames 0-4 is written as PNG' in report.losses[0].text()
    images = [*(tmp_path / 'out').rglob('image_0*/*/*')]
    assert len(images) == 10
    assert all(path.read_bytes().startswith(b'\x89PNG') for path in images)
    assert {path.suffix for path in images} == {'.png'}


DOUBLES = {
    '000001.jpg': b'jpeg',
    '00001.png': png_bytes(4, 4),
    '1.png': png_bytes(4, 4),
    '000001.PNG': png_bytes(4, 4),
}


@pytest.mark.parametrize('name', DOUBLES)
def test_of_two_files_of_a_frame_one_is_a_loss(recordings, tmp_path, name):
    source = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], source)
    folder = source / 'training' / 'image_2'
    (folder / name).write_bytes(DOUBLES[name])
    found = open_recording(source)
    (loss,) = found.losses
    text = f'{folder}: {name} left out; 000001.png is another file of the same frame: 1'
    assert (loss.stream, loss.count, loss.text()) == ('image_2', 1, text)
    assert found.path(Stream.IMAGE_2, 1).name == '000001.png'


def test_names_without_anything_in_common_are_refused(recordings, tmp_path, capsys):
    source = renamed(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path, 'tokens')
    for path in (source / 'training' / 'velodyne').iterdir():
        path.rename(path.with_stem(f'scan_{path.stem}'))
    assert main(['info', str(source)]) == 2
    error = capsys.readouterr().err
    assert 'training/' in error
    assert 'have no file of the same name in' in error


def test_calibrations_of_sequences_beside_those_of_frames(recordings, tmp_path):
    """The archives of object and tracking unpack to one folder."""
    source = tmp_path / 'both'
    shutil.copytree(recordings[Layout.OBJECT], source)
    shutil.copytree(
        recordings[Layout.TRACKING] / 'training', source / 'training', dirs_exist_ok=True
    )
    found = open_recording(source, ReadOptions(layout=Layout.OBJECT))
    assert found.losses == []
    assert found.path(Stream.CALIBRATION, 0).name == '000000.txt'
    found = open_recording(source, ReadOptions(layout=Layout.TRACKING))
    assert (found.losses, len(found.streams[Stream.SCAN])) == ([], 5)
    with pytest.raises(AmbiguousLayoutError):
        open_recording(source)


@pytest.mark.parametrize(
    ('folder', 'name'),
    [('image_2', '000001.webp'), ('velodyne', '000001.pcd'), ('image_2', 'left.jpg')],
)
def test_other_formats_are_a_loss(recordings, tmp_path, folder, name):
    source = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], source)
    place = source / 'training' / folder
    for path in place.iterdir():
        path.unlink()
    (place / name).touch()
    found = open_recording(source)
    texts = [loss.text() for loss in found.losses]
    usual = '000000.bin' if folder == 'velodyne' else '000000.png'
    assert f'{place}: {name} not read; expected files like {usual}' in texts
    assert not any('absent' in note and folder in note for note in found.notes)


def test_a_jpeg_that_is_cut_is_a_loss(recordings, tmp_path):
    source = renamed(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path, '.jpg')
    path = source / 'training' / 'image_2' / '000001.jpg'
    path.write_bytes(path.read_bytes()[:-500])
    report = convert_recording(source, tmp_path / 'bag.mcap')
    assert report.losses
    assert all(f'{path}: the JPEG is cut after' in loss.text() for loss in report.losses)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('kind', ['five digits', 'tokens', '.jpg'])
@pytest.mark.parametrize('layout', list(Layout))
def test_every_command_reads_them(recordings, layout, kind, tmp_path, capsys):
    source = renamed(recordings[layout], layout, tmp_path / 'in', kind)
    bag, out = tmp_path / 'bag.mcap', tmp_path / 'out'
    for words in (
        ('info', source),
        ('to-bag', source, bag, '--images', 'both', '-q'),
        ('info', bag),
        ('view', source, '-o', out / 'a.png', '--mode', 'lidar', '--frame', 2),
        ('view', bag, '-o', out / 'b.png', '--mode', 'lidar', '--frame', 2),
        ('report', source, '-o', out / 'a.html'),
        ('stats', source, '--count-points'),
        ('crop', source, out / 'crop', '--range', ':40'),
        ('info', out / 'crop'),
    ):
        out.mkdir(exist_ok=True)
        assert main([str(word) for word in words]) == 0, (words, capsys.readouterr())
    assert (out / 'a.png').read_bytes() == (out / 'b.png').read_bytes()
    report = validate(source, decode=True)
    assert [str(each) for each in report.findings if each.rule == 'names-unusual'] == []
    assert report.ok


@pytest.mark.parametrize('kind', ['five digits', 'no zeros in front', 'tokens', 'time stamps'])
def test_results_and_lists_are_found_by_name(recordings, tmp_path, kind, capsys):
    source = renamed(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path, kind)
    results, lists = tmp_path / 'results', tmp_path / 'lists'
    results.mkdir()
    labels = source / 'training' / 'label_2'
    for path in labels.iterdir():
        lines = path.read_text().splitlines()
        (results / path.name).write_text(''.join(f'{line} 0.9\n' for line in lines))
    words = ['split', source, '--out', lists, '--ratio', '0.6', '0.4']
    assert main([str(word) for word in words]) == 0, capsys.readouterr()
    listed = (lists / 'val.txt').read_text().split()
    assert {*listed} <= {path.stem for path in labels.iterdir()}
    for truth in (labels, source):
        for more in ([], ['--frame-list', str(lists / 'val.txt')]):
            assert main(['eval', 'detection', str(truth), str(results), *more]) == 0
    # Of fewer results, each is compared with the labels of its own name.
    (results / min(results.iterdir()).name).unlink()
    assert main(['eval', 'detection', str(labels), str(results)]) == 1
    assert 'no file for frames' in capsys.readouterr().err


WAYMO_CALIB = ''.join(
    [f'P{camera}: 40 0 32 0 0 40 16 0 0 0 1 0\n' for camera in range(5)]
    + ['R0_rect: 1 0 0 0 1 0 0 0 1\n']
    + [f'Tr_velo_to_cam_{camera}: 0 -1 0 0 0 0 -1 0 1 0 0 0\n' for camera in range(5)]
)
CAR = 'Car 0 0 -10 {} 10 50 30 1.5 1.7 4.1 {} 1.65 15 0.3'


def waymo(folder: Path, suffix: str = '.jpg') -> Path:
    """A set as mmdetection3d's converter of Waymo writes it (save_label and others, 1.1)."""
    split = folder / 'kitti_format' / 'training'
    done, jpeg = cv2.imencode(suffix, np.zeros((32, 64, 3), np.uint8))
    assert done
    for name in ('0000000', '1003197'):
        files = {f'image_{camera}/{name}{suffix}': jpeg.tobytes() for camera in range(5)}
        files[f'velodyne/{name}.bin'] = np.ones((64, 4), np.float32).tobytes()
        files[f'calib/{name}.txt'] = WAYMO_CALIB.encode()
        lines = [CAR.format(10 + camera, camera) for camera in range(5)]
        files[f'label_all/{name}.txt'] = ''.join(
            f'{line} {camera}\n' for camera, line in enumerate(lines)
        ).encode()
        files |= {f'label_{c}/{name}.txt': f'{lines[c]}\n'.encode() for c in range(5)}
        for place, data in files.items():
            (split / place).parent.mkdir(parents=True, exist_ok=True)
            (split / place).write_bytes(data)
    return split.parent


@pytest.mark.parametrize('suffix', ['.jpg', '.png'])
def test_waymo_as_mmdetection3d_writes_it(tmp_path, suffix, capsys):
    source = waymo(tmp_path / 'in', suffix)
    found = open_recording(source)
    assert found.losses == []
    assert found.layout is Layout.OBJECT
    assert [found.streams[Stream(f'image_{camera}')].numbers.tolist() for camera in range(5)] == [
        [0, 1003197]
    ] * 5
    boxes = found.read(Stream.LABELS, 1003197).boxes
    assert [box.location[0] for box in boxes] == [0, 1, 2, 3, 4]
    # The last column is the camera of the 2D box, no score.
    assert {box.score for box in boxes} == {None}
    assert [box.box_2d[0] for box in boxes] == [0, 0, 12, 0, 0]
    report = convert_recording(source, tmp_path / 'bag.mcap')
    assert report.losses == ()
    assert back(tmp_path / 'bag.mcap', tmp_path / 'out').losses == ()
    made, true = files_of(tmp_path / 'out'), files_of(source)
    assert made == {name: data for name, data in true.items() if '/label_' not in name} | {
        name: data for name, data in true.items() if '/label_all/' in name
    }
    for place in (
        source,
        source / 'training',
        source / 'training/label_all',
        tmp_path / 'bag.mcap',
    ):
        words = ['eval', 'detection', str(place), str(source / 'training/label_0')]
        assert main(words) == 0, capsys.readouterr()


@pytest.mark.parametrize('kind', ['tokens', '.jpg'])
def test_collections_and_overwriting(recordings, tmp_path, kind, capsys):
    source = renamed(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path / 'in', kind)
    bags, out = tmp_path / 'bags', tmp_path / 'out'
    words = ['to-bag', tmp_path / 'in', bags, '--all', '--slice-frames', '2', '-q', '--jobs', '1']
    assert main([str(word) for word in words]) == 0, capsys.readouterr()
    assert len([*bags.rglob('*.mcap')]) == 3
    convert_recording(source, tmp_path / 'bag.mcap')
    for more in ([], ['--overwrite']):
        assert main(['to-kitti', str(tmp_path / 'bag.mcap'), str(out), '-q', *more]) == 0
        assert files_of(out) == files_of(source)
    part = ['to-kitti', str(tmp_path / 'bag.mcap'), str(tmp_path / 'part'), '--start', '1', '-q']
    assert main([*part, '--end', '2']) == 0, capsys.readouterr()
    scans = sorted((source / 'training/velodyne').iterdir())
    assert sorted(path.name for path in (tmp_path / 'part').rglob('*.bin')) == [
        path.name for path in scans[1:3]
    ]


def test_object_sets_of_four_digits_are_no_sequences(recordings, tmp_path):
    source = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], source)
    for path in source.glob('training/*/*.*'):
        path.rename(path.with_stem(path.stem[2:]))
    found = open_recording(source)
    assert (found.layout, found.losses) == (Layout.OBJECT, [])


@pytest.mark.parametrize(
    ('names', 'told'),
    [
        (('a.bin', 'b.bin'), 'holds 2 scans; move them to a folder velodyne'),
        (('000000.jpg',), 'holds 1 image; move them to a folder image_2'),
        (('a.txt',), 'holds label or result files; eval detection GROUND_TRUTH RESULTS scores'),
        (
            ('000000.txt',),
            'holds label or result files; eval detection GROUND_TRUTH RESULTS scores',
        ),
        (('velodyne/000000.pcd',), 'velodyne holds 000000.pcd; expected files like 000000.bin'),
        (('training/image_2/a.bmp',), 'image_2 holds a.bmp; expected files like 000000.png there'),
    ],
)
@pytest.mark.parametrize('forced', [[], ['--layout', 'object']])
def test_a_folder_without_those_around_it_is_told_the_next_step(
    tmp_path, capsys, names, told, forced
):
    for name in names:
        (tmp_path / 'set' / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / 'set' / name).write_text(f'{CAR.format(1, 2)}\n')
    assert main(['info', str(tmp_path / 'set'), *forced]) == 2
    assert told in capsys.readouterr().err
