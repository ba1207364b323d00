# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The packets of an unsynchronised drive as a stream: what is taken, missing, damaged, refused."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from extract_drive import FAST, copy_extract, fast_drive, open_with

from kitti_ros2.kitti.extract_oxts import order_packets
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.text_file import format_timestamps, parse_timestamps
from kitti_ros2.model.errors import BadFileError, KittiRos2Error, UsageError
from kitti_ros2.model.recording import MARGIN_NS
from kitti_ros2.model.streams import Layout, Stream, format_stamp, parse_stamp
from kitti_ros2.options.read import ImuOptions, ImuStamps, ReadOptions
from kitti_ros2.synthetic import SyntheticDrive
from kitti_ros2.synthetic.drive import extract_of

IMU = Stream.OXTS_EXTRACT


@pytest.fixture(scope='module')
def drive(tmp_path_factory):
    return fast_drive(tmp_path_factory)


@pytest.fixture
def extract(drive, tmp_path):
    """The unsynchronised drive, to be damaged."""
    return copy_extract(drive, tmp_path)


def lines_of(extract):
    return (extract / 'oxts' / 'timestamps.txt').read_text().splitlines()


def write_lines(extract, lines):
    (extract / 'oxts' / 'timestamps.txt').write_text(''.join(f'{line}\n' for line in lines))


def packet_file(extract, number):
    return extract / 'oxts' / 'data' / f'{number:010d}.txt'


def texts_of(losses):
    return [loss.text() for loss in losses if loss.stream == IMU.value]


def test_packets_span_every_turn_that_has_no_gap(drive):
    recording = open_with(drive)
    stamps = recording.streams[IMU].stamps_ns
    assert (np.diff(stamps) > 0).all()
    first, last = recording.turns[0], recording.turns[FAST.frames - 1]
    assert first.start_ns - MARGIN_NS <= stamps[0] <= first.start_ns
    assert last.end_ns <= stamps[-1] <= last.end_ns + MARGIN_NS
    gaps = [note for note in recording.notes if 'during the turns' in note]
    assert len(gaps) == 1
    wide = np.flatnonzero(np.diff(stamps) > 15_000_000)
    for number, turn in recording.turns.items():
        crossed = any(stamps[at] < turn.end_ns and stamps[at + 1] > turn.start_ns for at in wide)
        within = ((stamps >= turn.start_ns) & (stamps <= turn.end_ns)).sum()
        assert crossed or within in (9, 10, 11), number


def test_repeats_and_gaps_are_those_that_were_made(drive):
    recording = open_with(drive)
    arrivals = SyntheticDrive(FAST).arrivals
    again = len(arrivals.stamps_ns) - len(np.unique(arrivals.stamps_ns))
    kept = recording.streams[IMU]
    taken = np.unique(arrivals.stamps_ns)
    taken = taken[(taken >= kept.stamps_ns[0]) & (taken <= kept.stamps_ns[-1])]
    np.testing.assert_array_equal(kept.stamps_ns, taken)
    missing = round((kept.stamps_ns[-1] - kept.stamps_ns[0]) / 1e7) + 1 - len(kept)
    notes = [note.partition('oxts: ')[2] for note in recording.notes]
    assert again == 6
    assert '6 packets left out that repeat one shortly before' in notes
    assert any(
        note.startswith(f'{missing} packets missing in 1 gap, the longest') for note in notes
    )
    assert recording.losses == []


def test_packets_of_the_synchronised_drive_are_those_nearest_in_time(drive):
    recording = open_with(drive)
    packets, frames = recording.streams[IMU], recording.streams[Stream.OXTS]
    for number, stamp in zip(frames.numbers.tolist(), frames.stamps_ns.tolist(), strict=True):
        nearest = int(np.argmin(np.abs(packets.stamps_ns - stamp)))
        assert packets.stamps_ns[nearest] == stamp
        found = recording.read(IMU, int(packets.numbers[nearest]))
        assert found == recording.read(Stream.OXTS, number)


def test_regular_stamps_are_even_between_gaps(drive):
    original, regular = (open_with(drive, stamps=kind) for kind in ImuStamps)
    stamps = regular.streams[IMU].stamps_ns
    np.testing.assert_array_equal(regular.streams[IMU].numbers, original.streams[IMU].numbers)
    steps = np.diff(stamps)
    assert np.ptp(steps[steps < 15_000_000]) <= 1
    assert np.abs(stamps - original.streams[IMU].stamps_ns).max() < 5_000_000
    (note,) = [note for note in regular.notes if 'regular stamps' in note]
    assert 'by least squares over' in note
    assert 'in 2 runs' in note
    assert not any('even intervals' in note for note in original.notes)


def test_late_packets_are_counted_and_evened_out(drive, extract):
    at = int(open_with(drive).streams[IMU].numbers[30])
    lines = lines_of(extract)
    lines[at] = format_stamp(parse_stamp(lines[at]) + 3_000_000)
    write_lines(extract, lines)
    late = open_with(drive, extract)
    (note,) = [note for note in late.notes if 'even intervals' in note]
    assert ': 1 of 129 stamps more than 1 ms off even intervals of 9.99' in note
    assert note.endswith('--imu-stamps regular evens them out')
    even = open_with(drive, extract, ImuStamps.REGULAR).streams[IMU].stamps_ns
    assert np.abs(even - open_with(drive).streams[IMU].stamps_ns).max() < 300_000


def test_poses_and_packets_of_frames_remain(drive):
    recording, plain = open_with(drive), open_recording(drive)
    for stream in plain.streams:
        np.testing.assert_array_equal(
            recording.streams[stream].stamps_ns, plain.streams[stream].stamps_ns
        )
    assert recording.describe().values['files'] == plain.describe().values['files']
    assert recording.describe().values['imu_from'] == {
        'drive': '2011_09_26_drive_0001_extract',
        'stamps': 'original',
    }


def test_missing_files_are_losses_of_their_numbers(drive, extract):
    recording = open_with(drive)
    numbers = recording.streams[IMU].numbers
    gone = numbers[60:64].tolist()
    for number in gone:
        packet_file(extract, number).unlink()
    damaged = open_with(drive, extract)
    (text,) = texts_of(damaged.losses)
    assert f'no file for frames {gone[0]}-{gone[-1]}, which timestamps.txt lists' in text
    assert any('4 packets missing in' in note or '2 gaps' in note for note in damaged.notes)
    assert len(damaged.streams[IMU]) == len(numbers) - 4


def test_missing_files_out_of_the_time_are_no_losses(drive, extract):
    packet_file(extract, 0).unlink()
    assert texts_of(open_with(drive, extract).losses) == []


def test_an_invalid_line_is_a_loss_of_its_packet(drive, extract):
    number = int(open_with(drive).streams[IMU].numbers[30])
    lines = lines_of(extract)
    lines[number] = 'yesterday'
    write_lines(extract, lines)
    damaged = open_with(drive, extract)
    (text,) = texts_of(damaged.losses)
    assert f'timestamps.txt:{number + 1}: ' in text
    assert number not in damaged.streams[IMU].numbers


def test_packets_beyond_the_last_stamp_are_losses(drive, extract):
    numbers = open_with(drive).streams[IMU].numbers
    count, files = int(numbers[-5]), len([*(extract / 'oxts' / 'data').iterdir()])
    write_lines(extract, lines_of(extract)[:count])
    damaged = open_with(drive, extract)
    (text,) = texts_of(damaged.losses)
    assert text.endswith(f'{count} lines, so no stamp for frames {count}-{files - 1}')
    assert damaged.streams[IMU].numbers[-1] == numbers[-6]


@pytest.mark.parametrize('content', [b'', b'1 2 3', b'\xff\xfe', b'nan ' * 30, b'91 ' * 30])
def test_a_damaged_packet_is_an_error_when_it_is_read(drive, extract, content):
    number = int(open_with(drive).streams[IMU].numbers[30])
    packet_file(extract, number).write_bytes(content)
    recording = open_with(drive, extract)
    with pytest.raises(BadFileError, match=f'{number:010d}.txt'):
        recording.read(IMU, number)


def test_packets_that_clash_are_losses(drive, extract):
    numbers = open_with(drive).streams[IMU].numbers
    lines = lines_of(extract)
    lines[numbers[40]] = lines[numbers[39]]
    write_lines(extract, lines)
    damaged = open_with(drive, extract)
    (text,) = texts_of(damaged.losses)
    assert text.endswith(f'packets {numbers[40]} have the stamp of another one, but other values')


def test_packets_out_of_order_are_noted(drive, extract):
    numbers = open_with(drive).streams[IMU].numbers
    lines = lines_of(extract)
    a, b = numbers[39], numbers[40]
    lines[a], lines[b] = lines[b], lines[a]
    write_lines(extract, lines)
    damaged = open_with(drive, extract)
    assert any('1 packet listed after one of a later stamp' in note for note in damaged.notes)
    assert (np.diff(damaged.streams[IMU].stamps_ns) > 0).all()


def test_a_single_packet_is_taken(drive, extract):
    numbers = open_with(drive).streams[IMU].numbers
    for path in (extract / 'oxts' / 'data').iterdir():
        if path.name != packet_file(extract, numbers[30]).name:
            path.unlink()
    recording = open_with(drive, extract, ImuStamps.REGULAR)
    assert recording.streams[IMU].numbers.tolist() == [numbers[30]]
    assert [loss.count for loss in recording.losses] == [len(lines_of(extract)) - 1]


def shifted(extract, offset_ns):
    found = parse_timestamps('\n'.join(lines_of(extract)) + '\n', 'x').values
    path = extract / 'oxts' / 'timestamps.txt'
    path.write_text(format_timestamps(stamp + offset_ns for stamp in found))


def rename(extract, name):
    return extract.rename(extract.with_name(name))


def without(extract, *parts):
    path = extract.joinpath(*parts)
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    return extract


REFUSED = {
    'no folder': (lambda e: e / 'nowhere', 'no such folder'),
    'a file': (lambda e: e / 'oxts' / 'timestamps.txt', 'is not a folder'),
    'another number': (
        lambda e: rename(e, '2011_09_26_drive_0002_extract'),
        'is not the drive of 2011_09_26_drive_0001_sync; expected 2011_09_26_drive_0001_extract',
    ),
    'another date': (
        lambda e: rename(e, '2011_09_28_drive_0001_extract'),
        'is not the drive of 2011_09_26_drive_0001_sync; expected 2011_09_26_drive_0001_extract',
    ),
    'sync': (
        lambda e: rename(e, '2011_09_26_drive_0001_sync'),
        'is the synchronised drive, with 10 Hz packets; expected the unsynchronised drive',
    ),
    'the folder above': (lambda e: e.parent, 'contains drives; did you mean '),
    'no oxts': (lambda e: without(e, 'oxts'), 'has no folder oxts; expected the unsynchronised'),
    'no stamps': (lambda e: without(e, 'oxts', 'timestamps.txt'), 'so no stamps of packets'),
    'no packets': (lambda e: without(e, 'oxts', 'data'), 'has no packet with a stamp'),
    'another time': (
        lambda e: (shifted(e, 3600 * 10**9), e)[1],
        'none during 2011_09_26_drive_0001_sync, from 2011-09-26 13:00:00.0',
    ),
}


@pytest.mark.parametrize('case', REFUSED)
def test_wrong_folders_are_refused(drive, extract, case):
    make, expected = REFUSED[case]
    given = make(extract)
    with pytest.raises(UsageError) as caught:
        open_with(drive, given)
    text = str(caught.value)
    assert str(given) in text
    assert expected in text
    assert '\n' not in text


def test_packets_at_ten_hertz_are_refused_under_any_name(drive, extract):
    given = rename(extract, 'packets')
    shutil.rmtree(given / 'oxts')
    shutil.copytree(drive / 'oxts', given / 'oxts')
    with pytest.raises(UsageError, match=r'its packets are 0\.1 s apart, as in a synchronised'):
        open_with(drive, given)


def test_a_renamed_extract_is_taken(drive, extract):
    assert len(open_with(drive, rename(extract, 'my_imu')).streams[IMU]) > 100


@pytest.mark.parametrize('stamps', [b'\xff\xfe\x00', b'no stamp\n'])
def test_unreadable_stamps_are_one_error(drive, extract, stamps):
    (extract / 'oxts' / 'timestamps.txt').write_bytes(stamps)
    with pytest.raises(KittiRos2Error, match='oxts'):
        open_with(drive, extract)


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.ODOMETRY, Layout.TRACKING])
def test_other_layouts_are_refused(recordings, drive, layout):
    drive_of_00 = ', a part of 2011_10_03_drive_0027: give 2011_10_03_drive_0027_sync'
    expected = f'this is layout {layout.value}' + drive_of_00 * (layout is Layout.ODOMETRY)
    with pytest.raises(UsageError, match=f'{expected}$'):
        open_with(recordings[layout], extract_of(drive))


def test_an_unsynchronised_source_is_refused(drive):
    with pytest.raises(UsageError, match='is unsynchronised itself, with 100 Hz packets'):
        open_with(extract_of(drive), extract_of(drive))


def test_a_drive_without_stamps_is_refused(drive, tmp_path):
    bare = shutil.copytree(drive, tmp_path / drive.name)
    for path in bare.glob('*/timestamps*.txt'):
        path.unlink()
    with pytest.raises(UsageError, match='has no stamps, by which --imu-from pairs'):
        open_with(bare, extract_of(drive), read=ReadOptions())


def test_stamps_without_an_extract_are_refused():
    with pytest.raises(UsageError, match='--imu-stamps is for --imu-from; give both'):
        ImuOptions(None, ImuStamps.REGULAR)


def test_real_packets_of_a_synchronised_drive_are_those_of_its_extract(real_kitti):
    """The synchronised drive's packets, in KITTI itself: the same text at the nearest stamp."""
    pairs = [
        (path, extract_of(path))
        for path in sorted((real_kitti / 'raw').glob('*/*_sync'))
        if extract_of(path).is_dir()
    ]
    if not pairs:
        pytest.skip('needs an unsynchronised drive beside a synchronised one in shared/kitti/raw')
    for sync, extract in pairs:
        recording = open_with(sync, extract)
        packets, frames = recording.streams[IMU], recording.streams[Stream.OXTS]
        for number, stamp in zip(frames.numbers.tolist(), frames.stamps_ns.tolist(), strict=True):
            nearest = int(np.argmin(np.abs(packets.stamps_ns - stamp)))
            found = recording.read(IMU, int(packets.numbers[nearest]))
            assert found == recording.read(Stream.OXTS, number), (sync.name, number)


def test_real_packets_follow_each_other_without_repeats(real_kitti):
    """Of the synchronised drives at hand: none is a repeat, and all are in order."""
    for sync in sorted((real_kitti / 'raw').glob('*/*_sync')):
        folder = sync / 'oxts'
        if not (folder / 'timestamps.txt').is_file():
            continue
        text = (folder / 'timestamps.txt').read_text()
        stamps = np.array(parse_timestamps(text, folder).values, np.int64)
        order = order_packets(stamps, lambda _: None)
        assert (order.repeats, order.clashes, order.late) == ((), (), 0)
