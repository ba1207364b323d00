# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Result files of a detector or tracker: which frames they have, and files with mistakes."""

from __future__ import annotations

import pytest
from prediction_set import RESULTS, line, track_lines, write_results

from kitti_ros2.kitti.label_file import ResultFiles
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.prepare import add_predictions
from kitti_ros2.model.errors import BadFileError, MissingDataError, MissingPathError, UsageError
from kitti_ros2.model.streams import Layout, Stream

HOLES = {2: RESULTS[0], 5: [], 9: RESULTS[1]}


@pytest.fixture
def results(tmp_path):
    return write_results(tmp_path / 'results', HOLES)


def classes_of(labels):
    return [(box.class_name, box.score) for box in labels.boxes]


def test_a_folder_has_the_frames_of_its_files(results):
    found = ResultFiles(results)
    assert found.numbers == (2, 5, 9)
    assert classes_of(found.read(2)) == [('Car', 0.9), ('Car', 0.8), ('Car', 0.7)]
    assert classes_of(found.read(5)) == []
    assert found.path(9) == results / '000009.txt'
    assert found.absent([2, 5, 9]) is None
    assert found.absent([2, 3, 4, 9]).text() == f'{results}: no result file for frames 3-4'
    with pytest.raises(MissingDataError, match=r'no result file for frames \{\}'):
        found.read(3)


def test_the_folder_of_a_devkit_has_them_in_data(results, tmp_path):
    results.rename(tmp_path / 'data')
    assert ResultFiles(tmp_path).root == tmp_path / 'data'
    assert ResultFiles(tmp_path).numbers == (2, 5, 9)


def test_files_of_the_folder_itself_come_first(results):
    (results / 'data').mkdir()
    (results / '000002.txt').rename(results / 'data' / '000007.txt')
    assert ResultFiles(results).numbers == (5, 9)


def test_a_second_file_of_a_frame_is_a_loss(results):
    for name in ('12.txt', '2.txt', 'notes.txt'):
        (results / name).touch()
    found = ResultFiles(results)
    assert found.numbers == (2, 5, 9, 12)
    assert (found.path(2).name, found.path(12).name) == ('000002.txt', '12.txt')
    [loss] = found.losses
    assert loss.text() == f'{results}: 2.txt not read; their frames have other files'


def test_a_file_of_a_tracker_has_all_frames(tmp_path):
    path = tmp_path / '0000.txt'
    path.write_text(track_lines(HOLES))
    found = ResultFiles(path)
    assert found.numbers == (2, 9)
    assert [box.track_id for box in found.read(2).boxes] == [0, 1, 2]
    assert classes_of(found.read(3)) == []
    assert found.absent([2, 3]) is None
    assert found.losses == ()


def test_an_invalid_line_costs_itself(results, tmp_path):
    (results / '000002.txt').write_text(f'Car 1 2\n{line("Car", 0, 20, 0.9)}')
    labels = ResultFiles(results).read(2)
    assert [box and box.class_name for box in labels.boxes] == [None, 'Car']
    assert '000002.txt:1: 3 columns' in labels.missing['0']
    path = tmp_path / '0000.txt'
    path.write_text(f'{track_lines(HOLES)}{line("Car", 0, 20)}2 7 Car\n')
    tracks = ResultFiles(path)
    [loss] = tracks.losses
    assert (loss.stream, loss.count) == ('predictions', 1)
    assert "0000.txt:5: 'Car' is no frame number" in loss.text()
    assert '0000.txt:6: 3 columns' in tracks.read(2).missing['5']
    assert not tracks.read(9).missing


def test_a_file_without_frame_numbers_is_an_error(results, tmp_path):
    with pytest.raises(BadFileError, match='no line begins with a frame number; expected 17 or 18'):
        ResultFiles(results / '000002.txt')
    (tmp_path / '0000.txt').touch()
    assert ResultFiles(tmp_path / '0000.txt').numbers == ()


def test_a_number_as_the_class_is_no_frame(tmp_path):
    """An object line whose class is an id has 16 columns."""
    path = tmp_path / '0000.txt'
    path.write_text(track_lines({2: RESULTS[1]}) + line('2', 0, 20, 0.9))
    [box], [error] = ResultFiles(path).boxes(2)
    assert (box.frame, box.class_name) == (2, 'Car')
    assert '0000.txt:2: 16 columns; expected 17 or 18 columns' in str(error)


@pytest.mark.parametrize('frame', ['2', '2.0', '000002'])
@pytest.mark.parametrize('mark', ['', '\ufeff'])
@pytest.mark.parametrize('end', ['\n', '\r\n'])
def test_how_other_programs_write_frames_and_files(frame, mark, end, tmp_path):
    text = (mark + track_lines({2: RESULTS[1]}).replace('2 0 ', f'{frame} 0 ', 1)).replace(
        '\n', end
    )
    (tmp_path / '0000.txt').write_bytes(text.encode())
    assert classes_of(ResultFiles(tmp_path / '0000.txt').read(2)) == [('Car', 0.6)]
    (tmp_path / '000002.txt').write_bytes(f'{mark}{line("Car", 0, 20, 0.6).strip()}{end}'.encode())
    assert classes_of(ResultFiles(tmp_path).read(2)) == [('Car', 0.6)]


def test_impossible_sizes_are_named(results):
    text = line('Car', 0, 20, 0.9).replace('1.50 2.00 4.00', '1.50 0.00 4.00')
    (results / '000005.txt').write_text(text)
    labels = ResultFiles(results).read(5)
    assert '000005.txt:1: a box of height, width, length' in labels.missing['0']


@pytest.mark.parametrize(
    ('name', 'message'),
    [
        (
            '0003.txt',
            'no file like 000000.txt, but 0003.txt; give the file of one sequence, such as',
        ),
        ('readme.txt', 'contains no file like 000000.txt, but readme.txt$'),
    ],
)
def test_folders_of_something_else(tmp_path, name, message):
    (tmp_path / name).touch()
    with pytest.raises(UsageError, match=message):
        ResultFiles(tmp_path)


def test_paths_that_are_no_results(tmp_path):
    with pytest.raises(MissingPathError, match='no such file or folder'):
        ResultFiles(tmp_path / 'nothing')
    (tmp_path / 'bag.mcap').write_bytes(b'\x89MCAP0\r\n\xff')
    with pytest.raises(BadFileError, match='a text file in UTF-8'):
        ResultFiles(tmp_path / 'bag.mcap')


@pytest.fixture
def set_of_five(recordings):
    return open_recording(recordings[Layout.OBJECT])


def test_predictions_have_the_stamps_of_their_frames(set_of_five, tmp_path):
    add_predictions(set_of_five, write_results(tmp_path / 'results', {1: [], 3: []}))
    index, labels = (set_of_five.streams[each] for each in (Stream.PREDICTIONS, Stream.LABELS))
    assert index.numbers.tolist() == [1, 3]
    assert index.stamps_ns.tolist() == labels.stamps_ns[[1, 3]].tolist()
    assert set_of_five.path(Stream.PREDICTIONS, 3) == tmp_path / 'results' / '000003.txt'
    [loss] = set_of_five.losses
    assert loss.text().endswith('no result file for frames 0, 2, 4')


def test_results_of_other_frames_are_losses(set_of_five, tmp_path):
    results = {number: [] for number in (0, 1, 2, 3, 4, 7, 8)}
    add_predictions(set_of_five, write_results(tmp_path / 'results', results))
    [loss] = set_of_five.losses
    assert loss.numbers == (7, 8)
    assert loss.text().endswith('results of frames 7-8, which training does not have')


def test_results_of_other_frames_alone_are_an_error(set_of_five, tmp_path):
    with pytest.raises(UsageError, match='results of 1 frame, 7 to 7; training has 5 frames, 0 to'):
        add_predictions(set_of_five, write_results(tmp_path / 'results', {7: []}))


def test_a_tracker_has_predictions_in_all_frames(recordings, tmp_path):
    path = tmp_path / '0000.txt'
    path.write_text(track_lines({1: RESULTS[0], 3: RESULTS[1]}))
    recording = open_recording(recordings[Layout.TRACKING])
    add_predictions(recording, path)
    assert recording.streams[Stream.PREDICTIONS].numbers.tolist() == [0, 1, 2, 3, 4]
    counts = [len(recording.read(Stream.PREDICTIONS, number).boxes) for number in range(5)]
    assert counts == [0, 3, 0, 1, 0]
    assert recording.losses == []


def test_a_raw_drive_takes_the_stamps_of_scans_where_nothing_is_labelled(drive, tmp_path):
    (drive / 'tracklet_labels.xml').unlink()
    recording = open_recording(drive)
    results = {number: [] for number in range(5)}
    add_predictions(recording, write_results(tmp_path / 'results', results))
    scans, found = (recording.streams[each] for each in (Stream.SCAN, Stream.PREDICTIONS))
    assert found.stamps_ns.tolist() == scans.stamps_ns.tolist()
