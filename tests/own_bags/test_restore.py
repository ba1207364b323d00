# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI -> bag -> KITTI gives back every file."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.messages.cdr import serialize
from kitti_ros2.messages.naming import FILES, RECORDING
from kitti_ros2.messages.ros_types import TYPESTORE, String
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.errors import BadBagError, OutputExistsError, UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Images, MessageOptions, Preset
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import Bound, ReadOptions, SelectionOptions
from kitti_ros2.own_bags.restore import restore
from kitti_ros2.own_bags.source_files import find_source_files

from builders import convert_recording  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

ENDINGS = {'mcap': '.mcap', 'directory': '', 'sqlite3': '', 'ros1': '.bag'}
CONTAINERS = ('mcap', 'sqlite3', 'ros1')


def to_bag(source, folder, storage='mcap', messages=None, selection=None, read=None, **bag):
    """A bag of a recording."""
    out = folder / f'bag{ENDINGS[storage]}'
    storage = 'mcap' if storage == 'directory' else storage
    convert_recording(source, out, messages, selection, read=read, storage=storage, **bag)
    return out


def back(bag, out):
    """The bag as KITTI again."""
    source_files = find_source_files(bag)
    assert source_files is not None
    (report,) = restore([(bag, source_files)], out)
    return report


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


def data_set_of(source: Path, layout: Layout) -> Path:
    """The folder that corresponds to the output."""
    return source.parent.parent if layout is Layout.RAW else source


@pytest.mark.one_in(3)
@pytest.mark.parametrize('storage', CONTAINERS)
@pytest.mark.parametrize('layout', list(Layout))
def test_every_file_comes_back_to_the_byte(recordings, layout, storage, tmp_path):
    source = recordings[layout]
    report = back(to_bag(source, tmp_path, storage), tmp_path / 'out')
    assert files_of(tmp_path / 'out') == files_of(data_set_of(source, layout))
    assert report.losses == ()
    assert report.notes == ()
    assert report.frames == 5
    assert report.layout is layout


@pytest.mark.parametrize('layout', list(Layout))
def test_images_of_pixels_come_back_pixel_for_pixel(recordings, layout, tmp_path):
    source = recordings[layout]
    messages = MessageOptions(images=Images.RAW, preset=Preset.KITTI2BAG, ring_and_time=True)
    back(to_bag(source, tmp_path, messages=messages, compression='zstd'), tmp_path / 'out')
    made, true = files_of(tmp_path / 'out'), files_of(data_set_of(source, layout))
    assert made.keys() == true.keys()
    for name, content in true.items():
        if name.endswith('.png'):
            pixels = [
                cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
                for data in (content, made[name])
            ]
            assert np.array_equal(*pixels), name
        else:
            assert made[name] == content, name


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('layout', 'image'),
    [
        (Layout.RAW, 'image_rect'),
        (Layout.RAW, 'image_raw'),
        (Layout.RAW, 'image'),
        (Layout.ODOMETRY, 'image'),
    ],
)
def test_every_name_of_images_comes_back_to_the_byte(recordings, layout, image, tmp_path):
    source = recordings[layout]
    bag = to_bag(source, tmp_path, messages=MessageOptions(preset=Preset.KITTI2BAG))
    renamed = tmp_path / 'renamed.mcap'
    with open_messages(bag) as messages, open_bag(renamed, BagOptions(), TYPESTORE) as writer:
        names = {
            topic: re.sub(r'/image_(raw|rect)', f'/{image}', topic)
            for topic, _ in messages.channels
        }
        ids = {
            topic: writer.add_channel(Channel(names[topic], msgtype))
            for topic, msgtype in messages.channels
        }
        for message in messages:
            writer.write(ids[message.topic], message.stamp_ns, (message.data,))
    assert {topic for topic in names.values() if f'/{image}/compressed' in topic}
    report = back(renamed, tmp_path / 'out')
    assert report.losses == ()
    assert files_of(tmp_path / 'out') == files_of(data_set_of(source, layout))


def test_a_bag_of_both_kinds_of_images_gives_each_once(recordings, tmp_path):
    source = recordings[Layout.OBJECT]
    messages = MessageOptions(images=Images.BOTH)
    bag = to_bag(source, tmp_path, 'directory', messages=messages, split_size=100_000)
    report = back(bag, tmp_path / 'out')
    assert report.losses == ()
    assert files_of(tmp_path / 'out') == files_of(source)


def test_missing_frames_stay_missing_and_shift_nothing(drive, tmp_path):
    for number in (1, 3):
        (drive / 'velodyne_points/data' / f'{number:010d}.bin').unlink()
    (drive / 'image_02/data/0000000002.png').unlink()
    report = back(to_bag(drive, tmp_path / 'bags'), tmp_path / 'out')
    assert files_of(tmp_path / 'out' / drive.parent.name) == files_of(drive.parent)
    assert report.counts['scan'] == 3
    assert report.notes == ()


def test_equal_calibrations_of_frames_all_come_back(recordings, tmp_path):
    """The bag holds a calibration only when it changes."""
    source = recordings[Layout.OBJECT]
    texts = {path.read_text() for path in (source / 'training/calib').iterdir()}
    assert len(texts) == 1
    back(to_bag(source, tmp_path), tmp_path / 'out')
    assert len(list((tmp_path / 'out/training/calib').iterdir())) == 5


def test_a_selection_gives_its_files_and_says_what_the_bag_lacks(recordings, tmp_path):
    source = recordings[Layout.OBJECT]
    selection = SelectionOptions(start=Bound(frame=1), end=Bound(frame=2))
    report = back(to_bag(source, tmp_path, selection=selection), tmp_path / 'out')
    made, true = files_of(tmp_path / 'out'), files_of(source)
    assert all(true[name] == data for name, data in made.items())
    assert sorted(name for name in made if 'calib' in name) == [
        'training/calib/000001.txt',
        'training/calib/000002.txt',
    ]
    assert report.losses == ()
    assert 'the bag was made without scan of frames 0, 3-4' in report.notes


def test_point_labels_become_files_again(recordings, tmp_path):
    source = tmp_path / 'set'
    made = files_of(recordings[Layout.ODOMETRY])
    rng = np.random.default_rng(0)
    for name, data in list(made.items()):
        if name.endswith('.bin'):
            labels = rng.integers(0, 2**32, len(data) // 16, dtype=np.uint32)
            made[name.replace('velodyne', 'labels').replace('.bin', '.label')] = labels.tobytes()
    for name, data in made.items():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_bytes(data)
    read = ReadOptions(semantic=True)
    messages = MessageOptions(semantic=True)
    back(to_bag(source, tmp_path, messages=messages, read=read), tmp_path / 'out')
    assert files_of(tmp_path / 'out') == made


def test_an_output_that_holds_something_is_refused(recordings, tmp_path):
    bag = to_bag(recordings[Layout.OBJECT], tmp_path)
    out = tmp_path / 'out'
    out.mkdir()
    back(bag, out)  # empty, so it may be taken
    before = files_of(out)
    with pytest.raises(OutputExistsError):
        back(bag, out)
    assert files_of(out) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag.mcap', 'out']


def write_strings(path, texts):
    """A bag of strings by topic."""
    with open_bag(path, BagOptions(), TYPESTORE) as writer:
        channels = {
            topic: writer.add_channel(Channel(topic, 'std_msgs/msg/String', latched=True, depth=1))
            for topic in dict.fromkeys(topic for topic, _ in texts)
        }
        for topic, text in texts:
            writer.write(channels[topic], 1, serialize(String(text)))


DESCRIPTION = {'layout': 'object', 'name': 'training', 'epoch_ns': 1, 'files': {}}
SCANS = {'folder': 'training/velodyne', 'digits': 6, 'suffix': '.bin', 'numbers': [[0, 1]]}


@pytest.mark.parametrize('name', ['../escaped.txt', '/escaped.txt', 'a/../../escaped.txt', ''])
def test_file_names_that_would_escape_cost_that_file_only(name, tmp_path):
    path = tmp_path / 'bag.mcap'
    texts = [(RECORDING, json.dumps(DESCRIPTION)), (FILES, f'{name}\ntext'), (FILES, 'a.txt\nb')]
    write_strings(path, texts)
    report = back(path, tmp_path / 'deep/in/out')
    assert files_of(tmp_path / 'deep') == {'in/out/a.txt': b'b'}
    (loss,) = report.losses
    assert loss.stream == FILES
    assert f'names a file {name!r}, which would lie outside of the output' in loss.text()


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'change',
    [
        {'layout': 'nuscenes'},
        {'files': {'scan': {**SCANS, 'digits': 99}}},
        {'files': {'scan': {**SCANS, 'suffix': '.sh'}}},
        {'files': {'scan': {**SCANS, 'numbers': [[5, 1]]}}},
        {'files': {'scan': {**SCANS, 'numbers': [[0, 10**12]]}}},
        {'files': {'scan': {**SCANS, 'folder': '../../velodyne'}}},
        {'files': {'radar': SCANS}},
        {'files': {'scan': SCANS}, 'names': ['a', '../../b']},
        {'files': {'scan': SCANS}, 'names': ['a', 'a']},
        {'files': {'scan': SCANS}, 'names': ['a', '']},
        {'files': {'scan': SCANS}, 'names': ['a', '.b']},
        {'files': {'scan': SCANS}, 'names': ['a']},
        {'files': {'scan': {**SCANS, 'others': [[0, '/etc/000000.bin']]}}},
        {'files': {'scan': {**SCANS, 'others': [[0, '00000.sh']]}}},
        {'files': {'scan': {**SCANS, 'others': [[0, '000001.bin']]}}},
        {'files': {'scan': {**SCANS, 'others': [[0, 'a.bin']]}}},
        {'files': {'scan': {**SCANS, 'others': [1]}}},
        {'files': {'scan': {**SCANS, 'numbers': [[0, 1], [1, 2]]}}},
        {'files': {'scan': {**SCANS, 'numbers': [[0, 999_999]]}, 'oxts': SCANS}},
        {'files': []},
        {'epoch_ns': None},
        {'epoch_ns': float('inf')},
        {'period_ns': 0},
        {'period_ns': 10**12},
        {'period_ns': None},
        {'scan_stamp': 'later'},
    ],
)
def test_a_description_that_cannot_be_meant_is_refused(change, tmp_path):
    path = tmp_path / 'bag.mcap'
    write_strings(path, [(RECORDING, json.dumps({**DESCRIPTION, **change}))])
    with pytest.raises(BadBagError):
        find_source_files(path)


@pytest.mark.parametrize('text', ['layout: object', '[' * 100_000, '[1, 2]', ''])
def test_a_description_that_is_no_json_is_refused(text, tmp_path):
    write_strings(tmp_path / 'bag.mcap', [(RECORDING, text)])
    with pytest.raises(BadBagError, match='not what kitti-ros2 writes'):
        find_source_files(tmp_path / 'bag.mcap')


def test_a_bag_of_an_earlier_version_says_so_and_goes_by_a_plan(recordings, tmp_path, capsys):
    """Its description does not tell which numbers the files had."""

    def change(topic, text):
        if topic != RECORDING:
            return text
        values = json.loads(text)
        for entry in values['files'].values():
            del entry['numbers']
        return json.dumps(values)

    earlier = with_texts(to_bag(recordings[Layout.OBJECT], tmp_path), change)
    out = tmp_path / 'out'
    assert main(['to-kitti', str(earlier), str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'made by an earlier version' in line
    assert 'make it again with to-bag, or give --layout' in line
    assert main(['to-kitti', str(earlier), str(out), '--layout', 'object']) == 0
    made = files_of(out / 'training')
    for name, content in files_of(recordings[Layout.OBJECT] / 'training').items():
        if name.split('/')[0] in {'image_2', 'velodyne'}:
            assert made[name] == content


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING])
def test_a_description_without_a_period_means_a_tenth_of_a_second(recordings, tmp_path, layout):
    def change(topic, text):
        if topic != RECORDING:
            return text
        values = json.loads(text)
        assert (values.pop('period_ns'), values.pop('scan_stamp')) == (10**8, 'forward')
        return json.dumps(values)

    bag = to_bag(recordings[layout], tmp_path, read=ReadOptions(period_ns=10**8))
    report = back(with_texts(bag, change), tmp_path / 'out')
    assert report.losses == ()
    assert files_of(tmp_path / 'out') == files_of(recordings[layout])


def test_lines_of_frames_that_would_escape_are_named_and_nothing_else_is_lost(
    recordings, tmp_path, capsys
):
    def change(topic, text):
        return '../../evil\ntext' if topic == '/kitti/source/labels' else text

    source = recordings[Layout.OBJECT]
    hostile = with_texts(to_bag(source, tmp_path), change)
    assert main(['to-kitti', str(hostile), str(tmp_path / 'a/b/out'), '-q']) == 1
    first, last = capsys.readouterr().err.splitlines()
    assert first.startswith('skipped /kitti/source/labels (5): ')
    assert "names a file '../../evil', which is no labels file of training" in first
    assert last == 'kitti-ros2: 5 skipped in all, listed above; exit code 1'
    made = files_of(tmp_path / 'a')
    true = {f'b/out/{name}': data for name, data in files_of(source).items()}
    assert made == {name: data for name, data in true.items() if 'label_2' not in name}


def with_texts(bag, change):
    """The bag with every text of /kitti/source changed."""
    path = bag.with_name(f'changed_{bag.name}')
    kind = 'std_msgs/msg/String'
    with (
        open_messages(bag) as messages,
        open_bag(path, BagOptions(), messages.typestore) as writer,
    ):
        channels = {
            topic: writer.add_channel(Channel(topic, msgtype, latched=topic in messages.latched))
            for topic, msgtype in messages.channels
        }
        for message in messages:
            parts = (bytes(message.data),)
            if message.msgtype == kind:
                text = TYPESTORE.deserialize_cdr(message.data, kind).data
                parts = serialize(String(change(message.topic, text)))
            writer.write(channels[message.topic], message.stamp_ns, parts)
    return path


def test_a_bag_of_others_has_no_blueprint(tmp_path):
    write_strings(tmp_path / 'bag.mcap', [('/chatter', 'hello')])
    assert find_source_files(tmp_path / 'bag.mcap') is None


def test_samples_without_a_file_are_named_and_counted(recordings, tmp_path):
    bag = to_bag(recordings[Layout.OBJECT], tmp_path)
    source_files = find_source_files(bag)
    assert source_files is not None
    later = replace(source_files, epoch_ns=source_files.epoch_ns + 7)
    (report,) = restore([(bag, later)], tmp_path / 'out')
    assert {loss.stream: loss.count for loss in report.losses}['/kitti/velo/points'] == 5
    assert 'no file of training has this stamp' in report.losses[0].text()


def test_a_cut_bag_gives_what_it_has_and_says_so(recordings, tmp_path):
    bag = to_bag(recordings[Layout.RAW], tmp_path)
    data = bag.read_bytes()
    bag.write_bytes(data[: len(data) * 2 // 3])
    report = back(bag, tmp_path / 'out')
    made, true = (
        files_of(tmp_path / 'out'),
        files_of(data_set_of(recordings[Layout.RAW], Layout.RAW)),
    )
    assert 0 < report.counts['scan'] < 5
    assert all(true[name] == content for name, content in made.items())
    assert any('cut off' in loss.text() for loss in report.losses)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('place', 'storage'),
    [
        ('object/training', 'mcap'),
        ('object/training', 'sqlite3'),
        ('object/training', 'ros1'),
        ('tracking/training', 'mcap'),
        ('odometry/dataset', 'mcap'),
        ('raw/2011_09_26/2011_09_26_drive_0005_sync', 'mcap'),
    ],
)
def test_real_files_come_back_to_the_byte(real_kitti, place, storage, tmp_path):
    back(to_bag(real_kitti / place, tmp_path, storage), tmp_path / 'out')
    made = files_of(tmp_path / 'out')
    root = real_kitti / place.split('/', maxsplit=1)[0]
    if 'dataset' in place:
        root /= 'dataset'
    others = ('velodyne_reduced', 'drive_0001', 'drive_0052')
    true = {
        name: data for name, data in files_of(root).items() if not any(o in name for o in others)
    }
    assert made.keys() == true.keys()
    assert made == true


@pytest.mark.one_in(3)
@pytest.mark.parametrize('gap', [(), ('velodyne_points:5-6',)])
@pytest.mark.parametrize('storage', CONTAINERS)
def test_a_full_real_drive_comes_back_to_the_byte(make_drive, gap, storage, tmp_path):
    source = make_drive(8, *gap)
    back(to_bag(source, tmp_path, storage), tmp_path / 'out')
    assert files_of(tmp_path / 'out') == files_of(source.parent.parent)


def test_text_scans_of_an_extract_keep_their_numbers(drive, tmp_path):
    extract = drive.with_name(drive.name.replace('sync', 'extract'))
    drive.rename(extract)
    for path in sorted((extract / 'velodyne_points/data').iterdir()):
        points = np.frombuffer(path.read_bytes(), '<f4').reshape(-1, 4)
        lines = [f'{x:.3f} {y:.3f} {z:.3f} {r:.2f}' for x, y, z, r in points.tolist()]
        path.with_suffix('.txt').write_text('\n'.join(lines) + '\n')
        path.unlink()
    back(to_bag(extract, tmp_path / 'bags'), tmp_path / 'out')
    made, true = files_of(tmp_path / 'out' / drive.parent.name), files_of(drive.parent)
    assert made.keys() == true.keys()
    for name, content in true.items():
        if 'velodyne_points/data' in name:
            numbers = [np.array(data.split(), float) for data in (content, made[name])]
            assert np.array_equal(*numbers), name
        else:
            assert made[name] == content, name


def test_a_bag_without_its_source_files_names_what_it_cannot_place(recordings, tmp_path):
    """Time stamps are in these files; without them no number is known."""
    topics = ('/kitti/source/recording', '/kitti/velo/points')
    selection = SelectionOptions(topics=topics)
    report = back(to_bag(recordings[Layout.RAW], tmp_path, selection=selection), tmp_path / 'out')
    assert [loss.count for loss in report.losses] == [5]


def test_several_recordings_make_one_data_set(recordings, tmp_path):
    drives = []
    for number in (1, 2):
        date = tmp_path / f'source{number}' / recordings[Layout.RAW].parent.name
        shutil.copytree(recordings[Layout.RAW].parent, date)
        drive = next(date.glob('*_sync'))
        drives.append(drive.rename(drive.with_name(drive.name.replace('0001', f'000{number}'))))
    bags = [to_bag(drive, tmp_path / f'bag{place}') for place, drive in enumerate(drives)]
    found = [(bag, find_source_files(bag)) for bag in bags]
    reports = restore(found, tmp_path / 'out')
    assert [report.name for report in reports] == [drive.name for drive in drives]
    whole = files_of(drives[0].parent.parent) | files_of(drives[1].parent.parent)
    assert files_of(tmp_path / 'out') == whole
    with pytest.raises(UsageError, match='give one of them'):
        restore([found[0], (bags[1], found[0][1])], tmp_path / 'twice')
    calib = drives[1].parent / 'calib_cam_to_cam.txt'
    calib.write_text(calib.read_text() + '\n')
    other = to_bag(drives[1], tmp_path / 'other')
    with pytest.raises(UsageError, match='differs from that of another bag'):
        restore([found[0], (other, find_source_files(other))], tmp_path / 'differing')
    assert not (tmp_path / 'differing').exists()


def test_remarks_on_a_bag_are_notes_of_its_files(recordings, tmp_path):
    bag = to_bag(recordings[Layout.OBJECT], tmp_path / 'bags', 'directory')
    (bag / 'metadata.yaml').unlink()
    report = back(bag, tmp_path / 'out')
    assert any('has no metadata.yaml' in note for note in report.notes)
    assert not report.losses
