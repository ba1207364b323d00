# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that other tools cut, split, sorted and merged: what they hold comes back to the byte."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest

import kitti_ros2
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli import main
from kitti_ros2.messages.cdr import serialize
from kitti_ros2.messages.naming import CALIBRATION, FILES, RECORDING, SWEEP
from kitti_ros2.messages.ros_types import TYPESTORE, String
from kitti_ros2.model.bag_formats import STRING, Channel
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import BagOptions

from builders import OF_OTHERS, files_of  # isort: skip
from mapped_set import make_mapped_set  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable

SCANS = '/kitti/velo/points'
LABELS = '/kitti/source/labels'
OXTS = '/kitti/source/oxts'


class Stored(NamedTuple):
    """A message of a bag; depth is 0 unless its topic is latched."""

    topic: str
    msgtype: str
    depth: int
    stamp_ns: int
    data: bytes

    @property
    def text(self) -> str:
        return TYPESTORE.deserialize_cdr(self.data, STRING).data

    def with_text(self, text: str) -> Stored:
        return self._replace(data=b''.join(map(bytes, serialize(String(text)))))


def read(bag: Path) -> list[Stored]:
    with open_messages(bag) as messages:
        depths = messages.latched
        return [
            Stored(m.topic, m.msgtype, depths.get(m.topic, 0), m.stamp_ns, bytes(m.data))
            for m in messages
        ]


def write(path: Path, stored: list[Stored], **options) -> Path:
    with open_bag(path, BagOptions(**options), TYPESTORE) as writer:
        channels = {}
        for each in stored:
            if each.topic not in channels:
                latched = {'latched': True, 'depth': each.depth} if each.depth else {}
                channels[each.topic] = writer.add_channel(
                    Channel(each.topic, each.msgtype, **latched)
                )
            writer.write(channels[each.topic], each.stamp_ns, (each.data,))
    return path


# What tools do to the messages of a bag; those of others begin with the tool's option.


def latest_latched(stored: list[Stored]) -> list[Stored]:
    """Of latched topics the latest message alone, as tools keep it that know of latching."""
    last = {each.topic: at for at, each in enumerate(stored) if each.depth}
    return [each for at, each in enumerate(stored) if last.get(each.topic, at) == at]


def by_topic(stored: list[Stored]) -> list[Stored]:
    return sorted(stored, key=lambda each: each.topic)


def third_scan(stored: list[Stored]) -> int:
    return [each.stamp_ns for each in stored if each.topic == SCANS][2]


def until(stored: list[Stored]) -> list[Stored]:
    return [each for each in stored if each.stamp_ns < third_scan(stored)]


def since(stored: list[Stored]) -> list[Stored]:
    return [each for each in stored if each.stamp_ns >= third_scan(stored)]


def since_with_latched(stored: list[Stored]) -> list[Stored]:
    first_ns = third_scan(stored)
    last = {each.topic: each for each in stored if each.depth and each.stamp_ns < first_ns}
    return [each._replace(stamp_ns=first_ns) for each in last.values()] + since(stored)


def merged(stored: list[Stored]) -> list[Stored]:
    return sorted(until(stored) + since_with_latched(stored), key=lambda each: each.stamp_ns)


def repeated_lines(stored: list[Stored]) -> list[Stored]:
    """With the texts of a frame once more, as in parts for which all of /kitti/source is kept."""
    return [each for each in stored for _ in range(1 + (each.topic in {LABELS, OXTS}))]


def recorded(stored: list[Stored]) -> list[Stored]:
    """With the times of a recorder, which starts after the latched messages were published."""
    return [each._replace(stamp_ns=10**18 + at * 10**7) for at, each in enumerate(stored)]


def of_an_earlier_version(stored: list[Stored]) -> list[Stored]:
    """A message for each text file."""
    return [
        each.with_text(f'{name}\n{text}') if whole else each
        for each in stored
        for whole in [each.topic in {FILES, CALIBRATION}]
        for name, text in (json.loads(each.text).items() if whole else [('', '')])
    ]


def latest_of_an_earlier_version(stored: list[Stored]) -> list[Stored]:
    return latest_latched(of_an_earlier_version(stored))


def without(*topics: str) -> Callable[[list[Stored]], list[Stored]]:
    return lambda stored: [each for each in stored if each.topic not in topics]


def damaged(stored: list[Stored]) -> list[Stored]:
    """The texts of files without their end."""
    return [each.with_text(each.text[:-20]) if each.topic == FILES else each for each in stored]


@dataclass(frozen=True)
class Cut:
    """What a tool does, and what is lost by it.

    Attributes:
        change: Makes the messages of the cut bag.
        lost: Pattern of the files that are absent, or made and said to be.
    """

    change: Callable[[list[Stored]], list[Stored]]
    lost: str = ''


CALIB = r'calib\w*\.txt|calib/\d+\.txt|calibration/'
OTHER_TEXTS = r'tracklet_labels\.xml|dataformat\.txt|ImageSets/|poses/|data_3d_bboxes/'
CUTS = {
    'latest latched': Cut(latest_latched),
    'sorted by topic': Cut(by_topic),
    'until': Cut(until, r'[^/]*00000[2-4]\.'),
    'since, with latched': Cut(since_with_latched, r'[^/]*00000[0-2]\.'),
    'merged': Cut(merged),
    'recorded': Cut(recorded),
    'repeated lines': Cut(repeated_lines),
    'of an earlier version': Cut(of_an_earlier_version),
    'latest of an earlier version': Cut(
        latest_of_an_earlier_version, f'{CALIB}|{OTHER_TEXTS}'),
    'without files': Cut(without(FILES), OTHER_TEXTS),
    'without calibration': Cut(without(CALIBRATION), CALIB),
    'damaged files': Cut(damaged, OTHER_TEXTS),
}  # fmt: skip


LAYOUTS = [layout.value for layout in Layout]
OTHERS = {
    'of pixels': ('raw', ('--images', 'raw')),
    'extract': ('extract', ()),
    'real time': ('real time', ('--real-time',)),
    'stereo': ('raw', ('--stereo',)),
    'from start': ('raw', ('--scan-stamp', 'start')),
    'of xyzirc': ('odometry', ('--points', 'xyzirc')),
}
"""Other recordings and options: the source, and the words of to-bag."""


@pytest.fixture(scope='module')
def source_of(recordings, tmp_path_factory):
    """A function that returns the source of a bag by its name."""

    def source(name: str) -> Path:
        if name in LAYOUTS:
            return recordings[Layout(name)]
        folder = tmp_path_factory.mktemp('source')
        if name == 'real time':
            return make_mapped_set(recordings, folder).object
        drive = recordings[Layout.RAW]
        shutil.copytree(drive.parent, folder / drive.parent.name)
        copy = folder / drive.parent.name / drive.name
        return copy.rename(copy.with_name(drive.name.replace('_sync', '_extract')))

    return source


@pytest.fixture(scope='module')
def whole(source_of, tmp_path_factory):
    """A function that returns a bag by its name, and the files that come back of it."""

    @cache
    def of(name: str) -> tuple[Path, dict[str, bytes]]:
        folder = tmp_path_factory.mktemp('whole')
        source, words = OTHERS.get(name, (name, ()))
        path = source_of(source)
        code = main(['to-bag', str(path), str(folder / 'bag.mcap'), '-q', *words])
        assert code == (source == 'real time')  # a set with a hole
        assert main(['to-kitti', str(folder / 'bag.mcap'), str(folder / 'out'), '-q']) == 0
        true = files_of(folder / 'out')
        if name in LAYOUTS:
            assert true == files_of(path.parent.parent if name == 'raw' else path)
        return folder / 'bag.mcap', true

    return of


@pytest.fixture
def back(tmp_path, capsys):
    """A function that converts a bag back: exit code, what is said, the files."""

    def convert(bag: Path, *words: str) -> tuple[int, str, dict[str, bytes]]:
        capsys.readouterr()
        code = main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q', *words])
        return code, capsys.readouterr().err, files_of(tmp_path / 'out')

    return convert


def check(cut: Cut, result, true: dict[str, bytes]) -> None:
    """Check that all is as it was but the files that a cut costs, and these are named."""
    code, said, files = result
    pattern = re.compile(cut.lost or '(?!)')
    other = {path for path in true if files.get(path) != true[path]}
    assert all(pattern.search(path) for path in other), sorted(other)
    assert files.keys() <= true.keys()
    if not cut.lost:
        assert (code, said) == (0, '')
        assert not other
    if other:
        assert code == 1
    for path in other:
        is_numbered = re.fullmatch(r'.*/(\d+)\.\w+', path)
        assert path.rpartition('/')[2] in said or (is_numbered and 'of frames' in said), path
    for path in other & files.keys():
        assert re.search(rf'{re.escape(path.rpartition("/")[2])}; a plan makes it', said), path


@pytest.mark.parametrize('cut', CUTS.values(), ids=CUTS)
@pytest.mark.parametrize('layout', LAYOUTS)
def test_what_a_cut_bag_holds_comes_back(layout, cut, whole, back, tmp_path):
    bag, true = whole(layout)
    check(cut, back(write(tmp_path / 'cut.mcap', cut.change(read(bag)))), true)


@pytest.mark.parametrize('cut', ['latest latched', 'since, with latched', 'merged', 'recorded'])
@pytest.mark.parametrize('name', OTHERS)
def test_of_other_recordings_and_options_as_well(name, cut, whole, back, tmp_path):
    bag, true = whole(name)
    lost = r'\d{6}\.' if CUTS[cut].lost else ''  # the files of some frames
    made = write(tmp_path / 'cut.mcap', CUTS[cut].change(read(bag)))
    result = back(made)
    check(Cut(list, lost), result, true)
    assert any('velodyne' in path for path in result[2])


@pytest.mark.parametrize('cut', ['latest latched', 'since, with latched', 'without files'])
@pytest.mark.parametrize('storage', ['sqlite3', 'ros1'])
def test_in_other_containers_as_well(storage, cut, whole, back, tmp_path):
    bag, true = whole('raw')
    path = tmp_path / ('cut.bag' if storage == 'ros1' else 'cut')
    check(CUTS[cut], back(write(path, CUTS[cut].change(read(bag)), storage=storage)), true)


def test_frames_of_a_part_keep_their_numbers(whole, back, tmp_path):
    bag, _ = whole('odometry')
    code, said, files = back(write(tmp_path / 'cut.mcap', since_with_latched(read(bag))))
    assert code == 1
    assert 'the bag does not hold scan of frames 0-1' in said
    names = sorted(path for path in files if 'velodyne' in path)
    assert names == [f'sequences/00/velodyne/00000{number}.bin' for number in (2, 3, 4)]


@pytest.mark.parametrize('layout', [layout.value for layout in OF_OTHERS])
def test_without_the_description_a_plan_takes_over_and_says_so(layout, whole, tmp_path, capsys):
    """And without any source: the images and scans are KITTI's, numbered from 0."""
    bag, true = whole(layout)
    name = next(path for path in true if 'velodyne' in path).split('/')
    words = ('--layout', layout, '--name', name[1] if layout in {'raw', 'odometry'} else name[0])
    words = words[:2] if layout == 'tracking' else words
    sources = [each.topic for each in read(bag) if each.topic.startswith('/kitti/source/')]
    for topics in ([RECORDING], sources):
        cut = write(tmp_path / 'cut.mcap', without(*topics)(read(bag)))
        assert main(['to-kitti', str(cut), str(tmp_path / 'none')]) == 2
        assert 'which layout is wanted? give --layout' in capsys.readouterr().err
        assert main(['to-kitti', str(cut), str(tmp_path / 'made'), *words]) == 0
        noted = f'no {RECORDING}: names and numbers of the files are unknown'
        assert (noted in capsys.readouterr().out) == (topics == [RECORDING])
        made = files_of(tmp_path / 'made')
        scans = [data for path, data in sorted(true.items()) if path.endswith('.bin')]
        assert [data for path, data in sorted(made.items()) if path.endswith('.bin')] == scans
        shutil.rmtree(tmp_path / 'made')
        cut.unlink()


def test_where_no_stamp_tells_a_number_a_plan_converts_the_bag(whole, back, tmp_path):
    """A scan and an image of each camera are missing, so that those left are of unknown files."""
    bag, true = whole('raw')
    stored = without(FILES)(since_with_latched(read(bag)))
    code, said, files = back(write(tmp_path / 'cut.mcap', stored))
    assert code == 1
    assert 'without the stamps of the files their numbers are unknown: a plan converts' in said
    scans = [data for path, data in sorted(true.items()) if path.endswith('.bin')]
    assert [data for path, data in sorted(files.items()) if path.endswith('.bin')] == scans[2:]


def test_of_a_bag_merged_of_two_recordings_the_first_is_read(whole, back, tmp_path):
    bag, true = whole('object')
    other = [each._replace(stamp_ns=each.stamp_ns + 10**18) for each in read(whole('odometry')[0])]
    code, said, files = back(write(tmp_path / 'merged.mcap', [*read(bag), *other]))
    assert code == 1
    assert 'describes 00; the bag is read as that of training, its first' in said
    assert files == true


@pytest.mark.parametrize('text', ['{"a', '{"a": 1}', '{"a": {"b": "c"}}', '{"\\ud800": "b"}',
                                  '{"../a": "b"}', '[' * 3 + ']' * 3, '{' * 100_000])  # fmt: skip
def test_texts_that_are_no_json_cost_no_more_than_themselves(text, whole, back, tmp_path):
    bag, true = whole('tracking')
    stored = [each.with_text(text) if each.topic == CALIBRATION else each for each in read(bag)]
    code, said, files = back(write(tmp_path / 'odd.mcap', stored))
    assert code == 1
    assert f'skipped {CALIBRATION} (1)' in said
    assert 'calib/0000.txt; a plan makes it' in said
    assert {
        path: data for path, data in files.items() if 'calib' not in path
    }.items() <= true.items()


@pytest.mark.parametrize('start', ['1e30', '1' + '0' * 30, '-5', 'null', '"a"', '[' * 9999])
def test_sweeps_that_are_no_stamps_make_no_file(start, whole, back, tmp_path):
    bag, true = whole('raw')
    stored = [
        each.with_text(f'{{"start_ns": {start}, "end_ns": 5}}') if each.topic == SWEEP else each
        for each in without(FILES)(read(bag))
    ]
    code, said, files = back(write(tmp_path / 'odd.mcap', stored))
    assert code == 1
    assert (
        'the bag does not hold 2011_09_26_drive_0001_sync/velodyne_points/timestamps_end.txt\n'
        in said
    )
    assert files.items() <= true.items()


@pytest.mark.parametrize('layout', ['raw', 'odometry'])
def test_every_reader_gives_the_frames_their_numbers(layout, whole, tmp_path, capsys):
    bag, _ = whole(layout)
    cut = write(tmp_path / 'cut.mcap', without(FILES)(read(bag)))
    with kitti_ros2.open(bag) as true, kitti_ros2.open(cut) as recording:
        assert {'scan', 'image_0'} <= recording.streams.keys() <= true.streams.keys()
        for stream, numbers in recording.streams.items():
            assert numbers.tolist() == true.streams[stream].tolist()
    named = 'timestamps.txt; it is made' if layout == 'raw' else 'times.txt; it is made'
    for words in (['info'], ['report', '-o', str(tmp_path / 'report.html')]):
        assert main([*words[:1], str(cut), *words[1:]]) == 1
        assert named in capsys.readouterr().err
    picture = str(tmp_path / 'view.png')
    assert main(['view', str(cut), '-o', picture, '--frame', '3']) in {0, 1}
    assert main(['validate', str(cut)]) == 0


# The tools themselves, where they are installed.


def pymcap(*words: str) -> Callable[[Path, Path], Path]:
    def run(bag: Path, out: Path) -> Path:
        stamps = [each.stamp_ns for each in read(bag) if each.topic == SCANS]
        filled = [word.format(bag=bag, out=out, third=stamps[2]) for word in words]
        subprocess.run(['pymcap-cli', *filled], check=True, capture_output=True)
        return out

    return run


def pymcap_split(bag: Path, out: Path) -> Path:
    """Split by time and merge again."""
    latched = '/kitti/source/(recording|files|calibration)'
    words = 'split', bag, '--duration', '200ms', '--latch', latched, '-t', f'{out}_{{index}}.mcap'
    subprocess.run(['pymcap-cli', *words], check=True, capture_output=True)
    parts = sorted(out.parent.glob(f'{out.name}_*'))
    assert len(parts) > 1
    subprocess.run(['pymcap-cli', 'merge', *parts, '-o', out], check=True, capture_output=True)
    return out


def kappe(bag: Path, out: Path) -> Path:
    subprocess.run(['kappe', 'convert', bag, out.with_suffix('')], check=True, capture_output=True)
    return out.with_suffix('') / bag.name


def rosbags(ending: str, *words: str) -> Callable[[Path, Path], Path]:
    """rosbags-convert, in place of `ros2 bag convert`, of which there is no package on PyPI."""

    def run(bag: Path, out: Path) -> Path:
        folder, made = write(out.with_name('bag'), read(bag)), out.with_name(f'converted{ending}')
        program = Path(sys.executable).with_name('rosbags-convert')
        arguments = ['--src', folder, '--dst', made, *words]
        subprocess.run([program, *arguments], check=True, capture_output=True)
        return made

    return run


OUT = ('{bag}', '-o', '{out}')
WHOLE, UNTIL, SINCE = Cut(list), CUTS['until'], CUTS['since, with latched']
TOOLS = {
    'pymcap-cli filter': (pymcap('filter', *OUT), WHOLE),
    'pymcap-cli filter --end': (pymcap('filter', *OUT, '--end', '{third}'), UNTIL),
    'pymcap-cli filter --start': (
        pymcap('filter', *OUT, '--start', '{third}', '--latch', '/kitti/source/.*'), SINCE),
    'pymcap-cli filter --exclude-topic': (
        pymcap('filter', *OUT, '--exclude-topic', FILES), CUTS['without files']),
    'pymcap-cli compress': (pymcap('compress', *OUT, '--compression', 'lz4'), WHOLE),
    'pymcap-cli rechunk': (pymcap('rechunk', *OUT), WHOLE),
    'pymcap-cli sort': (pymcap('sort', *OUT, '--order', 'topic'), WHOLE),
    'pymcap-cli split and merge': (pymcap_split, WHOLE),
    'kappe convert': (kappe, WHOLE),
    'rosbags-convert to sqlite3': (rosbags('', '--dst-storage', 'sqlite3'), WHOLE),
    'rosbags-convert to MCAP': (rosbags('', '--dst-storage', 'mcap'), WHOLE),
    'rosbags-convert to ROS 1': (rosbags('.bag'), WHOLE),
}  # fmt: skip


@pytest.mark.parametrize('layout', LAYOUTS)
@pytest.mark.parametrize('name', TOOLS)
def test_after_a_tool(name, layout, whole, back, tmp_path):
    program = name.split()[0]
    if program != 'rosbags-convert' and shutil.which(program) is None:
        pytest.skip(f'{program} is not installed; CUTS has what it does')
    bag, true = whole(layout)
    run, cut = TOOLS[name]
    check(cut, back(run(bag, tmp_path / 'cut.mcap')), true)
