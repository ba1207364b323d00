# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""`kitti-ros2 eval detection --worst`: the list of frames and the folder of their pictures."""

from __future__ import annotations

import json
import shutil

import cv2
import numpy as np
import pytest
from prediction_set import line
from result_folders import write_frames

from kitti_ros2 import evaluation
from kitti_ros2.cli import main
from kitti_ros2.drawing.labelled_objects import VERDICT_COLORS
from kitti_ros2.evaluation import error_pictures
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.detections import encode_detections
from kitti_ros2.model.streams import Layout

from builders import convert_recording  # isort: skip
from folder_and_bag import make_holes  # isort: skip
from prediction_set import track_lines  # isort: skip
from result_bag import answers, stamps_of, write_bag  # isort: skip

NEAR, FAR = ('Car', 0, 20), ('Car', 5, 40)
LABELS = {8: [NEAR], 10: [NEAR, FAR], 15: [NEAR], 16: [NEAR, ('Truck', 4, 12)], 30: [NEAR]}
RESULTS = {
    8: [(*NEAR, 0.9)],
    10: [('car', 0, 60, 0.75)],
    15: [('CAR', 0, 20, 0.6)],
    16: [(*NEAR, 0.8), ('Truck', 0, 60, 1.0)],
    30: [(*NEAR, 0.9), ('Car', -5, 10, 0.5)],
}
"""Frame 10 has two misses and a false positive, frame 30 a false positive; trucks of frame 16 are
not scored."""
NAMES = ['01_000010.png', '02_000030.png']


def texts(frames):
    return {number: ''.join(line(*box) for box in boxes) for number, boxes in frames.items()}


@pytest.fixture
def made(recordings, tmp_path):
    """A set whose numbers have holes, and its results."""
    root = make_holes(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path / 'set')
    write_frames(root / 'training' / 'label_2', texts(LABELS))
    return root, write_frames(tmp_path / 'results', texts(RESULTS))


def run(capsys, *words):
    """The exit code, and what is printed."""
    code = main(['eval', 'detection', *map(str, words)])
    return code, *capsys.readouterr()


def listed(folder):
    return sorted(path.name for path in folder.iterdir())


def entries(folder):
    """All entries of a folder, also hidden ones."""
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize('given', ['.', 'training', 'training/label_2'])
def test_planted_errors_come_first(given, made, tmp_path, capsys):
    root, results = made
    words = [root / given, results, '--worst', 20, '-o', tmp_path / 'errors']
    code, out, err = run(capsys, *words)
    assert (code, err) == (0, '')
    assert listed(tmp_path / 'errors') == NAMES
    assert out.splitlines()[-1].endswith('errors')
    rows = [row.split(maxsplit=3) for row in out.splitlines() if row.startswith(('1 ', '2 '))]
    assert [row[:3] for row in rows] == [['1', '000010', '2.75'], ['2', '000030', '0.50']]
    assert rows[0][3].rstrip() == 'missed: 2 Car; false positive: car 0.75'
    table = out[out.index('worst ') :].splitlines()
    assert max(map(len, table[:-1])) <= 80


def test_pictures_show_the_errors(made, tmp_path, capsys):
    out = tmp_path / 'errors'
    assert run(capsys, *made, '--worst', 2, '-o', out, '-q')[0] == 0
    pictures = [cv2.imread(str(out / name)).astype(int) for name in NAMES]
    shown = [
        [bool((np.abs(picture - rgb[::-1]) < 8).all(axis=2).any()) for picture in pictures]
        for rgb in (VERDICT_COLORS['FN'], VERDICT_COLORS['FP'])
    ]
    assert shown == [[True, False], [True, True]]


def test_json_lists_the_frames(made, capsys):
    code, out, _ = run(capsys, *made, '--worst', 1, '--json')
    assert code == 0
    values = json.loads(out)
    assert list(values) == ['detection', 'frames', 'worst']
    assert values['worst'] == [
        {
            'number': 10,
            'penalty': 2.75,
            'missed': 2,
            'false_positives': 1,
            'reason': 'missed: 2 Car; false positive: car 0.75',
        }
    ]


def test_classes_and_frames_that_are_scored_are_ranked(made, tmp_path, capsys):
    chosen = tmp_path / 'val.txt'
    chosen.write_text('000016\n000030\n')
    words = ['--worst', 5, '--json', '--frame-list', chosen, '--classes', 'truck', '--iou', '0.5']
    values = json.loads(run(capsys, *made, *words)[1])
    assert [(frame['number'], frame['penalty']) for frame in values['worst']] == [(16, 2)]


def test_no_errors_make_an_empty_list_and_folder(made, tmp_path, capsys):
    labels = made[0] / 'training' / 'label_2'
    out = tmp_path / 'errors'
    code, printed, _ = run(capsys, labels, labels, '--worst', 3, '-o', out)
    assert code == 0
    assert 'no scored frame has errors' in printed
    assert listed(out) == []


def test_curves_and_the_list_in_one_run(made, tmp_path, capsys):
    pytest.importorskip('matplotlib')
    code, out, _ = run(capsys, *made, '--worst', 2, '-o', tmp_path / 'curves.png')
    assert code == 0
    assert '000010' in out
    assert cv2.imread(str(tmp_path / 'curves.png')) is not None


def test_in_python(made):
    scores = evaluation.evaluate_detection(*made, worst=1)
    assert [frame.number for frame in scores.worst] == [10]
    assert evaluation.evaluate_detection(*made).worst is None


def test_an_existing_folder_is_kept_unless_it_has_such_pictures_only(made, tmp_path, capsys):
    out = tmp_path / 'errors'
    words = [*made, '-q', '-o', out, '--worst']
    assert run(capsys, *words, 2)[0] == 0
    code, _, err = run(capsys, *words, 1)
    assert (code, listed(out)) == (2, NAMES)
    assert 'exists already; choose another name, or pass --overwrite' in err
    assert run(capsys, *words, 1, '--overwrite')[0] == 0
    assert listed(out) == NAMES[:1]
    (out / 'notes.txt').touch()
    code, _, err = run(capsys, *words, 2, '--overwrite')
    assert (code, listed(out)) == (2, [NAMES[0], 'notes.txt'])
    assert 'it holds more than such pictures' in err


@pytest.mark.parametrize('error', [KeyboardInterrupt, OSError(28, 'No space left on device')])
def test_an_interrupt_leaves_no_folder(error, made, tmp_path, capsys, monkeypatch):
    write = error_pictures.write_picture
    before = entries(tmp_path)

    def stop(path, picture):
        write(path, picture)
        raise error

    monkeypatch.setattr(error_pictures, 'write_picture', stop)
    code, *_ = run(capsys, *made, '--worst', 2, '-o', tmp_path / 'new' / 'errors')
    assert code not in {0, 1}
    assert entries(tmp_path) == before


def test_missing_data_of_a_picture_is_a_loss(made, tmp_path, capsys):
    root, results = made
    (root / 'training' / 'image_2' / '000010.png').write_bytes(b'\x89PNG')
    code, _, err = run(capsys, root, results, '--worst', 2, '-o', tmp_path / 'errors', '-q')
    assert code == 1
    assert '000010.png' in err
    assert listed(tmp_path / 'errors') == NAMES


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['{set}', '--worst', '0'], 'worst 0 lists no frame; give a number from 1'),
        (['{set}', '-o', '{tmp}/errors'], 'a plot ends in .png, .pdf or .svg'),
        (['{set}', '--worst', '2', '-o', '{tmp}/errors.jpg'], 'a plot ends in .png, .pdf or .svg'),
        (['{set}', '--worst', '2', '-o', '{set}/errors'], 'lies inside the recording'),
        (['{res}', '--worst', '2', '-o', '{tmp}/errors'], 'give as GROUND_TRUTH the split or'),
        (['{bare}', '--worst', '2', '-o', '{tmp}/errors'], 'has neither images nor scans'),
    ],
)
def test_mistakes_are_one_line(words, said, made, tmp_path, capsys):
    root, results = made
    bare = tmp_path / 'bare' / 'training'
    for folder in ('label_2', 'calib'):
        shutil.copytree(root / 'training' / folder, bare / folder)
    places = {'set': root, 'res': results, 'bare': bare, 'tmp': tmp_path}
    ground_truth, *rest = (word.format(**places) for word in words)
    code, out, err = run(capsys, ground_truth, results, *rest)
    assert (code, out) == (2, '')
    assert said in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / 'errors').exists()


@pytest.mark.parametrize('given', ['.', 'training/label_02/0000.txt'])
def test_a_sequence_and_its_label_file(given, recordings, tmp_path, capsys):
    tracks = tmp_path / 'tracks.txt'
    tracks.write_text(track_lines({0: [('Car', 0, 70, 0.5)] * 3, 3: [('Car', 0, 70, 0.5)]}))
    out = tmp_path / 'errors'
    words = [recordings[Layout.TRACKING] / given, tracks, '--worst', 2, '-o', out, '--json']
    code, printed, err = run(capsys, *words)
    assert (code, err) == (0, '')
    values = json.loads(printed)['worst']
    assert listed(out) == [
        f'0{rank}_{frame["number"]:06d}.png' for rank, frame in enumerate(values, 1)
    ]


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING])
def test_bags_of_labels_and_of_results(layout, recordings, tmp_path, capsys):
    """The labels of a bag are those of its folder; the answer to one frame has no boxes."""
    root = make_holes(recordings[layout], layout, tmp_path / 'holes')
    recording = open_recording(root)
    number, stamp_ns = list(stamps_of(recording).items())[1]
    messages = answers(recording)
    messages[1] = messages[1]._replace(message=encode_detections([], stamp_ns, 'velo_link'))
    results = write_bag(tmp_path / 'results.mcap', messages)
    convert_recording(root, tmp_path / 'labels.mcap')
    printed = []
    for name, labels in (('folder', root), ('bag', tmp_path / 'labels.mcap')):
        words = [labels, results, '--worst', 1, '-o', tmp_path / name, '--json']
        code, out, _ = run(capsys, *words)
        assert code in {0, 1}, 'images that are missing are losses'
        printed.append(json.loads(out))
        assert listed(tmp_path / name) == [f'01_{number:06d}.png']
    assert printed[0] == printed[1]
    assert printed[0]['worst'][0]['false_positives'] == 0


def test_a_bag_that_to_bag_did_not_write_has_no_frame_numbers(recordings, made, tmp_path, capsys):
    bag = write_bag(tmp_path / 'results.mcap', answers(open_recording(recordings[Layout.OBJECT])))
    code, out, err = run(capsys, bag, made[1])
    assert (code, out) == (2, '')
    assert 'convert it with to-kitti, and give that folder' in err


def test_results_that_no_transform_joins_are_an_error_with_its_reason(recordings, tmp_path, capsys):
    labels = recordings[Layout.OBJECT]
    bag = write_bag(tmp_path / 'results.mcap', answers(open_recording(labels), 'my_lidar'))
    code, out, err = run(capsys, labels, bag)
    assert (code, out) == (2, '')
    assert "no transform at its stamp joins frame 'my_lidar'" in err
