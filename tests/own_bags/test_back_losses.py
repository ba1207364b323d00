# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The way back names what is missing from a bag, costs no more than that, and ends with 1.

The bags are as earlier versions wrote them: a message for each text file, so that one can be lost.
"""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import foreign
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

from builders import SHARED  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

FOUND = SHARED / 'found'
RECORDING = '/kitti/source/recording'
FILES = '/kitti/source/files'
CALIBRATION = '/kitti/source/calibration'
OXTS = '/kitti/source/oxts'
SCANS = '/kitti/velo/points'
PLANNED = re.compile(r'the bag does not hold (\S+); a plan makes it of other messages')
MADE = re.compile(r'the bag does not hold (\S+); it is (made|joined) of')


@dataclass
class Entry:
    """A message of an MCAP file as the reference library reads it."""

    topic: str
    stamp_ns: int
    data: bytes

    @property
    def text(self) -> str:
        return self.data[8:].split(b'\0')[0].decode()

    def with_text(self, text: bytes) -> Entry:
        size = len(text) + 1
        return Entry(
            self.topic, self.stamp_ns, self.data[:4] + size.to_bytes(4, 'little') + text + b'\0'
        )


def rewrite(bag: Path, change: Callable[[Entry], Entry | None]) -> Path:
    """A copy of an MCAP file, a message a text file, its messages changed or left out."""
    out = bag.with_name(f'changed_{bag.name}')
    with bag.open('rb') as source, out.open('wb') as target:
        writer = Writer(target)
        writer.start('ros2')
        channels: dict[str, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.topic not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(
                    channel.topic, 'cdr', schema_id, channel.metadata
                )
            entries = one_a_file(Entry(channel.topic, message.log_time, message.data))
            for entry in filter(None, map(change, entries)):
                stamp_ns = entry.stamp_ns
                writer.add_message(channels[entry.topic], stamp_ns, entry.data, stamp_ns)
        writer.finish()
    return out


def one_a_file(entry: Entry) -> list[Entry]:
    """The messages of a text file each that earlier versions wrote for a message of whole files."""
    if entry.topic not in {FILES, CALIBRATION} or not entry.text.startswith('{'):
        return [entry]
    files = json.loads(entry.text)
    return [entry.with_text(f'{name}\n{text}'.encode()) for name, text in files.items()]


def files_of(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob('*') if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.fixture(scope='module')
def converted(recordings, tmp_path_factory):
    """A function that gives the bag of a layout, written once."""

    @cache
    def convert(layout: Layout, *words: str) -> Path:
        bag = tmp_path_factory.mktemp('bags') / 'bag.mcap'
        assert main(['to-bag', str(recordings[layout]), str(bag), '-q', *words]) == 0
        return bag

    return convert


@pytest.fixture
def made(recordings, converted, tmp_path):
    """A function that gives a bag of a layout, of one's own: (bag, the files it was made of)."""

    def make(layout: Layout, *words: str) -> tuple[Path, dict[str, bytes]]:
        source, bag = recordings[layout], tmp_path / 'bag.mcap'
        shutil.copy(converted(layout, *words), bag)
        return bag, files_of(source.parent.parent if layout is Layout.RAW else source)

    return make


@pytest.fixture
def back(tmp_path, capsys):
    """A function that converts a bag back, quietly: (exit code, lines of stderr, files).

    Files that a plan makes in place of lost ones are said to be, and are not among them.
    """

    def convert(bag: Path, *words: str) -> tuple[int, list[str], dict[str, bytes]]:
        out = tmp_path / 'out'
        shutil.rmtree(out, ignore_errors=True)
        capsys.readouterr()
        code = main(['to-kitti', str(bag), str(out), '-q', *words])
        said = capsys.readouterr()
        assert said.out == ''
        assert 'internal error' not in said.err
        files, lines = files_of(out), said.err.splitlines()
        for name in PLANNED.findall(said.err):
            (path,) = (path for path in files if path.endswith(name))
            del files[path]
        return code, lines, files

    return convert


def texts_of(bag: Path, *topics: str) -> list[str]:
    """The names of the text files in a bag."""
    with bag.open('rb') as source:
        messages = list(make_reader(source).iter_messages(topics=list(topics)))
    entries = [Entry(channel.topic, 0, message.data) for _, channel, message in messages]
    return [each.text.split('\n')[0] for entry in entries for each in one_a_file(entry)]


@pytest.mark.parametrize('layout', list(Layout))
def test_each_text_file_that_is_lost_is_named(made, back, layout):
    bag, true = made(layout)
    names = texts_of(bag, FILES, CALIBRATION)
    assert names
    for name in names:
        changed = rewrite(
            bag, lambda e, name=name: None if e.data[8:].startswith(name.encode()) else e
        )
        code, said, files = back(changed)
        assert code == 1
        assert any(name in line or 'calibration of frames' in line for line in said), name
        assert files.items() <= true.items()
        path = next(path for path in true if path.endswith(name))
        assert (path in files) == any(MADE.search(line) for line in said)


@pytest.mark.parametrize(
    ('topic', 'said_of'),
    [(SCANS, 'scan of frames 2'), (OXTS, 'oxts of frames 2'), (CALIBRATION, 'calib_')],
)
def test_a_message_that_is_lost_is_named(made, back, topic, said_of):
    bag, true = made(Layout.RAW)
    seen = []

    def change(entry):
        seen.extend([entry.topic] if entry.topic == topic else [])
        return None if entry.topic == topic and len(seen) == 3 else entry

    code, said, files = back(rewrite(bag, change))
    assert code == 1
    assert len(said) == 2
    assert said_of in said[0]
    assert said[1] == 'kitti-ros2: 1 skipped in all, listed above; exit code 1'
    assert len(true) - len(files) == 1


def test_a_stream_that_is_lost_as_a_whole_is_named(made, back):
    bag, _ = made(Layout.OBJECT)
    code, said, files = back(rewrite(bag, lambda entry: None if entry.topic == SCANS else entry))
    assert code == 1
    assert 'scan of frames 0-4' in said[0]
    assert not [name for name in files if 'velodyne' in name]


def test_a_lost_calibration_of_one_frame_is_not_replaced_by_another(made, back):
    bag, true = made(Layout.OBJECT)
    lost = 'training/calib/000002.txt'
    changed = rewrite(
        bag, lambda e: None if e.topic == CALIBRATION and e.text.startswith(lost) else e
    )
    code, said, files = back(changed)
    assert code == 1
    assert 'the bag does not hold calibration of frames 2' in said[0]
    assert files == {name: data for name, data in true.items() if name != lost}


@pytest.mark.parametrize('text', ['P_rect_02', 'lat: ', '<poses>', 'R_rect_02', 'oxts/data/'])
def test_a_flipped_byte_costs_what_its_chunk_holds_and_is_named(made, back, text):
    """Also where the first of the two passes alone reads the chunk."""
    bag, true = made(Layout.RAW)
    data = bytearray(bag.read_bytes())
    place = data.find(text.encode())
    assert place > 0
    data[place] ^= 0x01
    bag.write_bytes(bytes(data))
    code, said, files = back(bag)
    assert code == 1
    assert 'damaged (wrong checksum)' in said[0]
    assert files.items() <= true.items()
    assert files != true
    named = '\n'.join(said)
    for name in true.keys() - files.keys():
        stream = name.split('/')[2] if '/data/' in name else ''
        assert name.rpartition('/')[2] in named or stream in named, name


NAMES = {
    'long': b'x' * 300,
    'deep': b'a/' * 900 + b'b',
    'folder': b'2011_09_26_drive_0001_sync/image_00',
    'inside a file': b'2011_09_26_drive_0001_sync/oxts/data/0000000001.txt/x',
    'of a scan': b'2011_09_26_drive_0001_sync/velodyne_points/data/0000000000.bin',
    'of a calibration': b'calib_velo_to_cam.txt',
    'of a text': b'2011_09_26_drive_0001_sync/tracklet_labels.xml',
    'not listed': b'notes.txt',
    'no UTF-8': b'\xff\xfe\xff.txt',
    'outside': b'../../evil',
    'empty': b'',
}


SAME_TOPIC = {('of a calibration', CALIBRATION), ('of a text', FILES)}


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('name', 'topic'),
    [
        (name, topic)
        for name in NAMES
        for topic in (FILES, CALIBRATION, OXTS)
        if (name, topic) not in SAME_TOPIC
    ],
)
def test_a_damaged_name_costs_that_file_only(made, back, name, topic):
    bag, true = made(Layout.RAW)
    spoiled = []

    def change(entry):
        if entry.topic != topic or spoiled or 'calib_velo' in entry.text:
            return entry
        old, _, text = entry.text.partition('\n')
        if topic == FILES and not old.endswith('dataformat.txt'):
            return entry
        spoiled.append(old)
        return entry.with_text(NAMES[name] + b'\n' + text.encode())

    code, said, files = back(rewrite(bag, change))
    (lost,) = spoiled
    assert code == 1
    assert said[0].startswith(f'skipped {topic} (1): ')
    expected = {path: data for path, data in true.items() if not path.endswith(lost)}
    assert len(expected) == len(true) - 1
    assert files == expected


@pytest.mark.parametrize('topic', [FILES, CALIBRATION, OXTS])
def test_of_two_texts_of_one_name_no_wrong_one_is_written(made, back, topic):
    bag, true = made(Layout.RAW)
    names = [name for name in texts_of(bag, topic) if 'timestamps' not in name]

    def change(entry):
        if entry.topic != topic or not entry.text.startswith(names[0]):
            return entry
        return entry.with_text(entry.text.replace(names[0], names[1]).encode())

    code, said, files = back(rewrite(bag, change))
    assert code == 1
    assert names[1] in said[0]
    assert files.items() <= true.items()
    assert len(true) - len(files) <= 2


@pytest.mark.parametrize('layout', list(Layout))
def test_a_text_that_is_no_utf8_costs_its_own_file(made, back, layout):
    bag, true = made(layout)
    topics = {FILES, CALIBRATION, OXTS, '/kitti/source/labels'}
    with bag.open('rb') as source:
        found = [c.topic for _, c, _ in make_reader(source).iter_messages()]
    for topic in sorted(topics & set(found)):
        spoiled = []

        def change(entry, topic=topic, spoiled=spoiled):
            name = entry.text.split('\n')[0] if entry.topic in topics else ''
            if entry.topic != topic or spoiled or name.endswith(('timestamps.txt', 'times.txt')):
                return entry
            spoiled.append(name)
            return entry.with_text(entry.text.encode() + b'\xff')

        code, said, files = back(rewrite(bag, change))
        assert code == 1
        assert f'{topic} at ' in said[0]
        assert files.items() <= true.items()
        assert len(true) - len(files) <= 1  # none where the line is also in a whole file


def test_a_damaged_description_is_one_line_and_a_plan_goes_without_it(made, back, tmp_path, capsys):
    bag, _ = made(Layout.OBJECT)

    def change(entry):
        return entry.with_text(b'\xff' * 40) if entry.topic == RECORDING else entry

    bag = rewrite(bag, change)
    assert main(['to-kitti', str(bag), str(tmp_path / 'out')]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'has no readable /kitti/source/recording' in line
    assert '--layout' in line
    code, said, files = back(bag, '--layout', 'object')
    assert code == 1
    assert said[0].startswith(f'skipped {RECORDING} (1): ')
    assert 'training/velodyne/000004.bin' in files


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'words',
    [
        ('--streams', 'scan', '--streams', 'recording'),
        ('--streams', 'image', '--streams', 'recording', '--streams', 'calibration'),
        ('--topics', RECORDING, '--topics', SCANS, '--topics', FILES),
        ('--topics', RECORDING, '--topics', '/tf_static', '--topics', '*camera_info'),
        ('--start', '1', '--end', '3'),
        ('--start', '3'),
    ],
)
@pytest.mark.parametrize('layout', list(Layout))
def test_a_bag_of_a_selection_is_not_blamed_for_the_rest(made, back, layout, words):
    bag, true = made(layout, *words)
    code, said, files = back(bag)
    assert (code, said) == (0, [])
    assert files.items() <= true.items()


def test_a_selection_is_held_to_what_was_selected(made, back):
    bag, _ = made(Layout.RAW, '--start', '1', '--end', '3')
    seen = []

    def change(entry):
        seen.extend([entry.topic] if entry.topic == SCANS else [])
        return None if entry.topic == SCANS and len(seen) == 2 else entry

    code, said, _ = back(rewrite(bag, change))
    assert code == 1
    assert 'the bag does not hold scan of frames 2' in said[0]


def test_what_to_bag_could_not_read_is_named_on_the_way_back(drive, back, tmp_path):
    """The description comes first in the bag, before samples turn out to be unreadable."""
    (drive / 'image_02/data/0000000002.png').write_bytes(b'no image')
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(drive), str(bag), '-q']) == 1
    code, said, files = back(bag)
    assert code == 1
    assert 'image_2 of frames 2' in said[0]
    assert len(files_of(drive.parent)) - len(files) == 1


def test_a_scan_or_image_without_its_data_is_lost_by_name(made, back):
    bag, true = made(Layout.OBJECT)
    image = '/kitti/camera_color_left/image_rect/compressed'
    seen = []

    def change(entry):
        if entry.topic not in {SCANS, image} or entry.topic in seen:
            return entry
        seen.append(entry.topic)
        start = entry.data.find(b'png\0') + 4 if entry.topic == image else None
        if start:
            return Entry(image, entry.stamp_ns, entry.data[:start] + bytes(4))
        # The fields of a cloud are followed by is_bigendian, point_step, row_step, and the data.
        tail = entry.data.find(b'intensity\0') + 10
        steps = (16).to_bytes(4, 'little')
        place = entry.data.find(steps, tail)
        return Entry(SCANS, entry.stamp_ns, entry.data[: place + 8] + bytes(4) + b'\1')

    code, said, files = back(rewrite(bag, change))
    assert code == 1
    assert {line.split()[1] for line in said[:-1]} == {SCANS, image}
    assert said[-1].startswith('kitti-ros2: 2 skipped in all')
    lost = {'training/velodyne/000000.bin', 'training/image_2/000000.png'}
    assert files == {name: data for name, data in true.items() if name not in lost}


def test_a_description_of_two_streams_in_one_folder_is_refused(made, tmp_path, capsys):
    bag, _ = made(Layout.OBJECT)

    def change(entry):
        if entry.topic != RECORDING:
            return entry
        values = json.loads(entry.text)
        values['files']['image_3']['folder'] = values['files']['image_2']['folder']
        return entry.with_text(json.dumps(values).encode())

    assert main(['to-kitti', str(rewrite(bag, change)), str(tmp_path / 'out')]) == 2
    assert 'two streams in one folder' in capsys.readouterr().err


@pytest.mark.parametrize('words', [['--start', '1'], ['--end', '3s']], ids=' '.join)
def test_a_part_of_a_bag_whose_description_lists_no_files_is_refused(made, tmp_path, capsys, words):
    bag, _ = made(Layout.OBJECT)

    def change(entry):
        if entry.topic != RECORDING:
            return entry
        return entry.with_text(json.dumps(json.loads(entry.text) | {'files': {}}).encode())

    assert main(['to-kitti', str(rewrite(bag, change)), str(tmp_path / 'out'), *words]) == 2
    assert 'the selection takes no frame; it has no numbered frames' in capsys.readouterr().err


def without_promises(entry: Entry) -> Entry:
    """The description as it was written before it listed what a bag carries."""
    if entry.topic != RECORDING:
        return entry
    values = json.loads(entry.text)
    del values['texts']
    for folder in values['files'].values():
        del folder['carried']
    return entry.with_text(json.dumps(values).encode())


@pytest.mark.parametrize('layout', list(Layout))
def test_a_bag_whose_description_lists_less_comes_back_as_well(made, back, layout):
    bag, true = made(layout)
    assert back(rewrite(bag, without_promises)) == (0, [], true)


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.ODOMETRY, Layout.TRACKING])
def test_its_lost_calibration_is_noticed_all_the_same(made, back, layout):
    bag, true = made(layout)
    gone = CALIBRATION
    changed = rewrite(rewrite(bag, without_promises), lambda e: None if e.topic == gone else e)
    code, said, files = back(changed)
    assert code == 1
    assert 'calib' in said[0]
    assert files == {name: data for name, data in true.items() if 'calib' not in name}


@pytest.mark.parametrize('layout', ['object', 'tracking'])
def test_boxes_with_nan_are_losses_of_the_labels(made, back, layout, tmp_path, capsys):
    bag, _ = made(Layout.RAW)
    detections = '/kitti/labels/detections'

    def change(entry):
        if entry.topic != detections:
            return entry
        place = entry.data.find(np.float64(1.0).tobytes())
        assert place > 0
        data = entry.data[:place] + np.float64('nan').tobytes() + entry.data[place + 8 :]
        return Entry(detections, entry.stamp_ns, data)

    bag = rewrite(bag, change)
    code, said, _ = back(bag, '--layout', layout)
    assert code == 1
    assert said[0].startswith(f'skipped {detections} (')
    assert 'without a possible size, place or score' in said[0]
    # Without KITTI's own lines, which pictures of a bag of our own show instead.
    bare = rewrite(bag, lambda entry: None if entry.topic.startswith('/kitti/source') else entry)
    picture, page = str(tmp_path / 'view.png'), str(tmp_path / 'report.html')
    for words in (['view', str(bare), '-o', picture], ['report', str(bare), '-o', page]):
        assert main(words) == 1
        assert 'without a possible size, place or score' in capsys.readouterr().err


@pytest.mark.parametrize('command', [['info'], ['report', '-o', '{tmp}/report.html']])
def test_info_and_report_name_what_the_bag_lacks(made, command, tmp_path, capsys):
    bag, _ = made(Layout.RAW)
    seen = []

    def change(entry):
        seen.extend([entry.topic] if entry.topic == SCANS else [])
        gone = (entry.topic == SCANS and len(seen) == 2) or 'calib_velo' in entry.data[8:40].decode(
            errors='replace'
        )
        return None if gone else entry

    name, *options = (word.format(tmp=tmp_path) for word in command)
    assert main([name, str(rewrite(bag, change)), *options]) == 1
    said = capsys.readouterr().err
    assert 'the bag holds 4 of 5 scan messages' in said
    assert 'the bag does not hold calib_velo_to_cam.txt' in said


def test_a_plan_is_held_to_the_description_as_well(made, back):
    bag, _ = made(Layout.RAW)
    seen = []

    def change(entry):
        seen.extend([entry.topic] if entry.topic == SCANS else [])
        return None if entry.topic == SCANS and len(seen) == 2 else entry

    code, said, _ = back(rewrite(bag, change), '--layout', 'object')
    assert code == 1
    assert said[0] == 'skipped scan (1): the bag holds 4 of 5 scan messages'


@pytest.mark.one_in(3)
@pytest.mark.parametrize('place', [0, 3])
@pytest.mark.parametrize('topic', ['/imu/data', '/cam/left/image_raw', '/sensors/ouster/points'])
def test_what_the_first_pass_could_not_decode_is_named(topic, place, back, tmp_path):
    """Also a message that no frame needs."""
    bag = foreign.write_foreign(tmp_path / 'bag.mcap', foreign.make_truth())
    seen = []

    def change(entry):
        seen.extend([topic] if entry.topic == topic else [])
        cut = entry.topic == topic and len(seen) - 1 == place
        return Entry(topic, entry.stamp_ns, entry.data[:30]) if cut else entry

    code, said, _ = back(rewrite(bag, change), '--layout', 'raw')
    assert code == 1
    assert said[0].startswith(f'skipped {topic} (1): {topic}')
    assert said[1] == 'kitti-ros2: 1 skipped in all, listed above; exit code 1'


MUST = {
    'flip_digit_t.mcap': (28, 'the chunk at byte 26933 is damaged'),
    'flip_utf8_t.mcap': (28, 'the chunk at byte 26933 is damaged'),
    'flip_utf8_t.bag': (30, '/kitti/source/calibration at 1317042000123456789: cannot be decoded'),
    'flip_utf8_dirs_dirs_0.db3': (30, 'the bag does not hold calib_cam_to_cam.txt'),
    'chunkflip_tl.bag': (30, 'tracklet_labels.xml'),
    'chunkflip_tz.mcap': (29, 'the chunk at byte 1516 is damaged'),
    'lack_calib.mcap': (30, 'the bag does not hold calib_imu_to_velo.txt'),
    'lackall_calib.mcap': (28, 'the bag does not hold calib_cam_to_cam.txt'),
    'lack_files.mcap': (30, 'tracklet_labels.xml'),
    'lack_oxts.mcap': (30, 'oxts of frames 2'),
    'lack_scan.mcap': (30, 'scan of frames 2'),
    'oxts_long.mcap': (30, "names a file 'xxxxx"),
    'oxts_Dfold.mcap': (30, "image_00', which is no oxts file"),
    'oxts_Dscan.mcap': (30, "0000000000.bin', which is no oxts file"),
    'cloud_nodata.mcap': (28, 'a cloud of 1016 points with 0 bytes of data'),
}


@pytest.mark.parametrize('name', list(MUST))
def test_bags_that_once_lost_files_in_silence(name, back):
    path = FOUND / name
    if not path.is_file():
        pytest.skip(f'no such bag at {path}')
    count, expected = MUST[name]
    code, said, files = back(path)
    assert code == 1
    assert any(expected in line for line in said)
    assert len(files) == count
    assert all(files.values())
