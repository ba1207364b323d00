# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Object frames with the stamps of their raw drives: read, written to bags and back, played."""

import json
import shutil

import numpy as np
import pytest
from builders import one_line
from folder_and_bag import BAGS, rerecord
from hypothesis import given
from hypothesis import strategies as st
from mapped_set import IN_TIME, A, B, C, make_mapped_set, true_stamp

import kitti_ros2
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.kitti.object_set import DriveFrame, RealTimes, describe_times, parse_times_of
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import peek_header
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Clock, Stream
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.read import Bound, ReadOptions, SelectionOptions
from kitti_ros2.player.bag_program import BagProgram
from kitti_ros2.player.program import RecordingProgram

REAL = ReadOptions(real_time=True)
ALL = SelectionOptions()
stamps = st.integers(0, 2**31 * 10**9 - 1)
pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')
IMAGE = 'image_02/timestamps.txt'


@pytest.fixture(scope='module')
def shared_set(recordings, tmp_path_factory):
    """A set that no test changes."""
    return make_mapped_set(recordings, tmp_path_factory.mktemp('mapped'))


@pytest.fixture
def own_set(recordings, tmp_path):
    """A set to break."""
    return make_mapped_set(recordings, tmp_path)


@pytest.fixture(scope='module')
def bag(shared_set, tmp_path_factory):
    out = tmp_path_factory.mktemp('bag') / 'bag.mcap'
    kitti_ros2.to_bag(shared_set.object, out, real_time=True)
    return out


def texts(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob('*.*')}


def test_every_stream_has_the_stamps_of_its_drive(shared_set):
    recording = open_recording(shared_set.object, REAL)
    assert recording.clock is Clock.UTC
    assert {loss.stream for loss in recording.losses} == {'image_2'}  # the hole in the set
    for stream, index in recording.streams.items():
        file = IMAGE.replace('2', str(stream.camera)) if stream.camera else None
        expected = [true_stamp(n, *[file] * bool(file)) for n in index.numbers.tolist()]
        assert index.stamps_ns.tolist() == expected, stream
    assert {n: (o.drive, o.number) for n, o in recording.origins.items()} == {
        8: (A, 11), 10: (B, 9), 15: (B, 2), 16: (B, 7), 30: (C, 1)
    }  # fmt: skip
    assert all(not turn.nominal for turn in recording.turns.values())
    assert {turn.length_ns for turn in recording.turns.values()} == {103_000_001}


def test_without_the_option_stamps_are_nominal(shared_set):
    recording = open_recording(shared_set.object)
    assert recording.clock is Clock.NOMINAL
    assert recording.origins == {}


@pytest.mark.parametrize('stamp', ['forward', 'start'])
@pytest.mark.parametrize('storage', BAGS)
def test_a_bag_gives_back_every_file(storage, stamp, shared_set, tmp_path):
    out = tmp_path / BAGS[storage]
    report = kitti_ros2.to_bag(shared_set.object, out, real_time=True, scan_stamp=stamp)
    assert report.frames == len(IN_TIME)
    (back,) = kitti_ros2.to_kitti(out, tmp_path / 'back')
    assert back.frames == len(IN_TIME)
    assert texts(tmp_path / 'back') == texts(shared_set.object)


def test_messages_are_in_order_of_time_with_the_stamps_in_their_headers(bag):
    with open_messages(bag, {'/kitti/velo/points'}) as messages:
        scans = [(each.stamp_ns, peek_header(bytes(each.data))[0]) for each in messages]
    assert scans == [(true_stamp(number), true_stamp(number)) for number in IN_TIME]


def test_a_selection_goes_by_number(shared_set, tmp_path, capsys):
    out = tmp_path / 'part.mcap'
    kitti_ros2.to_bag(shared_set.object, out, real_time=True, start=10, end=16)
    assert [frame.number for frame in kitti_ros2.open(out)] == [10, 15, 16]
    assert main(['info', str(out), '--json']) == 0
    assert [*json.loads(capsys.readouterr().out)['origins']] == ['10', '15', '16']


def test_the_library_names_drive_and_stamp(shared_set, bag):
    for opened in (kitti_ros2.open(shared_set.object, real_time=True), kitti_ros2.open(bag)):
        assert [frame.number for frame in opened] == sorted(IN_TIME)
        for frame in opened:
            assert frame.stamp_ns == frame.origin.stamp_ns == true_stamp(frame.number)
        assert (opened.frame(16).origin.drive, opened.frame(16).origin.number) == (B, 7)
    with_none = kitti_ros2.open(shared_set.object)
    assert with_none[0].origin is None


def test_points_and_labels_of_a_bag_are_those_of_their_frame(shared_set, bag):
    folder, copy = kitti_ros2.open(shared_set.object), kitti_ros2.open(bag)
    for number in IN_TIME:
        ours, theirs = folder.frame(number), copy.frame(number)
        assert np.array_equal(ours.points, theirs.points)
        lines = [[each.label for each in frame.objects] for frame in (ours, theirs)]
        assert lines[0] == lines[1] != []
        same = np.array_equal(ours.transform(2, 'velo_link'), theirs.transform(2, 'velo_link'))
        assert same


def test_info_names_each_frame(shared_set, bag, capsys):
    for words in ([str(bag)], [str(shared_set.object), '--real-time']):
        main(['info', *words, '--json'])
        values = json.loads(capsys.readouterr().out)
        assert {int(n): each['stamp_ns'] for n, each in values['origins'].items()} == {
            number: true_stamp(number) for number in IN_TIME
        }
        main(['info', *words])
        printed = capsys.readouterr().out
        places = [printed.index(f'\n{number} ') for number in IN_TIME]
        assert places == sorted(places)
        assert B in printed


@pytest.mark.parametrize('kind', ['folder', 'bag'])
def test_a_player_plays_frames_in_order_of_time(kind, shared_set, bag):
    if kind == 'bag':
        program = BagProgram(bag, ALL)
    else:
        recording = open_recording(shared_set.object, REAL)
        program = RecordingProgram(recording, MessageOptions(), ALL, 1)
    assert tuple(dict.fromkeys(program.frames.tolist())) == IN_TIME
    assert program.longest_gap_ns == 1_000_000_000
    program.close()


def test_a_bag_recorded_from_a_player_is_the_same(bag, shared_set, tmp_path):
    again = rerecord(bag, tmp_path / 'again.mcap', 10**17 + 12_345)
    program = BagProgram(again, ALL)
    assert tuple(dict.fromkeys(program.frames.tolist())) == IN_TIME
    program.close()
    assert kitti_ros2.open(again).frame(16).stamp_ns == true_stamp(16)
    kitti_ros2.to_kitti(again, tmp_path / 'back')
    assert texts(tmp_path / 'back') == texts(shared_set.object)


def test_nominal_frames_keep_their_gaps(shared_set):
    program = RecordingProgram(open_recording(shared_set.object), MessageOptions(), ALL, 1)
    assert program.longest_gap_ns is None


def test_a_part_of_a_bag_is_played_by_time(bag):
    with pytest.raises(UsageError, match='in order of time, not of number'):
        BagProgram(bag, SelectionOptions(start=Bound(frame=10)))
    program = BagProgram(bag, SelectionOptions(start=Bound(stamp_ns=true_stamp(16))))
    assert tuple(dict.fromkeys(program.frames.tolist())) == IN_TIME[2:]
    program.close()


def test_frames_without_a_stamp_are_named_and_left_out(own_set, capsys):
    shutil.rmtree(own_set.drive(C))
    starts = own_set.drive(B) / 'velodyne_points' / 'timestamps.txt'
    lines = starts.read_text('utf-8').splitlines()
    lines[2] = 'no stamp'
    starts.write_text('\n'.join(lines[:9]) + '\n', 'utf-8')
    (own_set.drive(A) / IMAGE).unlink()
    out = own_set.folder / 'bag.mcap'
    assert main(['to-bag', str(own_set.object), str(out), '--real-time', '-q']) == 1
    complaints = capsys.readouterr().err
    assert f'no time stamps of 1 drive ({C}); no true stamp for frames 30' in complaints
    assert f'{starts}:3: ' in complaints
    assert f'{starts}: 9 lines; no true stamp for frames 10' in complaints
    assert f'{own_set.drive(A) / IMAGE}: No such file or directory; no true stamp' in complaints
    recording = open_recording(own_set.object, REAL)
    assert recording.streams[Stream.SCAN].numbers.tolist() == [8, 16]
    assert recording.streams[Stream.IMAGE_2].numbers.tolist() == [10, 15]
    assert recording.streams[Stream.LABELS].numbers.tolist() == [8, 10, 15, 16]
    assert recording.streams[Stream.LABELS].stamps_ns[1] == true_stamp(10, IMAGE)


def test_a_frame_beyond_the_mapping_is_named(own_set, capsys):
    for path in own_set.object.rglob('000030.*'):
        path.rename(path.with_name(f'000099{path.suffix}'))
    main(['info', str(own_set.object), '--real-time', '-q'])
    complaint = 'train_rand.txt: 32 numbers, so no drive; no true stamp for frames 99'
    assert complaint in capsys.readouterr().err


@pytest.mark.parametrize(
    ('gone', 'words', 'complaint'),
    [
        ('mapping', (), 'give their folder with --mapping'),
        ('raw', (), 'give their folder with --raw-drives'),
        ('', ('--raw-drives', 'nowhere'), 'nowhere: no such folder'),
        ('', ('--mapping', 'nowhere'), 'in nowhere'),
        ('drives', (), 'no frame has a true stamp: '),
    ],
)
def test_what_is_missing_is_named_in_one_line(gone, words, complaint, own_set, capsys):
    if gone == 'drives':
        for drive in (A, B, C):
            shutil.rmtree(own_set.drive(drive))
    elif gone:
        shutil.rmtree(getattr(own_set, gone))
    out = own_set.folder / 'bag.mcap'
    assert main(['to-bag', str(own_set.object), str(out), '--real-time', *words]) == 2
    assert complaint in one_line(capsys.readouterr().err)
    assert not out.exists()


def test_drives_may_lie_without_their_dates(own_set, tmp_path):
    flat = tmp_path / 'flat'
    flat.mkdir()
    for drive in (A, B, C):
        own_set.drive(drive).rename(flat / drive)
    recording = open_recording(own_set.object, ReadOptions(real_time=True, raw=flat))
    assert set(recording.origins) == {*IN_TIME}


@pytest.mark.parametrize('words', [('--raw-drives', '.'), ('--mapping', '.')])
def test_its_options_need_it(words, shared_set, capsys):
    assert main(['info', str(shared_set.object), *words]) == 2
    assert 'is for --real-time' in one_line(capsys.readouterr().err)


def test_other_layouts_have_their_own_time(recording_path, capsys):
    code = main(['info', str(recording_path), '--real-time'])
    complaint = one_line(capsys.readouterr().err)
    assert code == 2
    assert ('real time is for the object layout' in complaint) != ('object' in recording_path.parts)


def test_testing_frames_have_no_mapping(own_set, capsys):
    (own_set.object / 'training').rename(own_set.object / 'testing')
    assert main(['info', str(own_set.object), '--real-time']) == 2
    assert 'drives of training frames only' in one_line(capsys.readouterr().err)


def test_real_frames_have_the_stamps_of_their_drives(real_kitti, tmp_path):
    """The numbers are those of drives 0001 and 0005; the contents are of frames 0 to 2."""
    stamps = {
        129: 1317042147394332863, 45: 1317042148116014201, 4736: 1317042283595032884,
        310: 1317042286380561323,
    }  # fmt: skip
    for source, number in zip((0, 1, 2, 0), stamps, strict=True):
        for path in (real_kitti / 'object' / 'training').glob(f'*/{source:06d}.*'):
            copy = tmp_path / 'object' / 'training' / path.parent.name
            copy.mkdir(parents=True, exist_ok=True)
            (copy / f'{number:06d}{path.suffix}').symlink_to(path)
    shutil.rmtree(tmp_path / 'object' / 'training' / 'velodyne_reduced', ignore_errors=True)
    places = {'mapping': real_kitti / 'devkit' / 'object', 'raw': real_kitti / 'raw'}
    kitti_ros2.to_bag(tmp_path / 'object', tmp_path / 'bag.mcap', real_time=True, **places)
    frames = [*kitti_ros2.open(tmp_path / 'bag.mcap')]
    assert {frame.number: frame.stamp_ns for frame in frames} == stamps
    kitti_ros2.to_kitti(tmp_path / 'bag.mcap', tmp_path / 'back')
    assert texts(tmp_path / 'back') == texts(tmp_path / 'object')


@given(
    st.dictionaries(
        st.integers(0, 9999),
        st.tuples(st.sampled_from((A, B, C)), st.integers(0, 9999), *[st.none() | stamps] * 3),
    )
)
def test_times_are_read_back(rows):
    columns = ('scan', 'start', 'image_2')
    times = RealTimes(
        {number: DriveFrame(*row[:2]) for number, row in rows.items()},
        {
            name: {number: row[place] for number, row in rows.items() if row[place] is not None}
            for place, name in enumerate(columns, 2)
        },
    )
    assert parse_times_of(json.loads(json.dumps(describe_times(times)))) == times


@pytest.mark.parametrize(
    'drives',
    [
        {'../2011_09_26_drive_0001_sync': [[1, 2, 3]]},
        {A: [[1, 2]]},
        {A: [[1, 2, 3, 4]]},
        {A: [[-1, 2, 3]]},
        {A: [[1, 2, -3]]},
        {A: [[1, 2, 10**30]]},
        {A: [[1, 2.5, 3]]},
        {A: [['1', 2, 3]]},
        {A: [1, 2, 3]},
        {A: None},
        [A],
        None,
    ],
)
def test_invalid_times_in_a_bag_are_refused(drives):
    with pytest.raises((ValueError, TypeError, KeyError, AttributeError)):
        parse_times_of({'columns': ['scan'], 'drives': drives})
