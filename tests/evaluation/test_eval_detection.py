# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""`kitti-ros2 eval detection` on good and on damaged folders."""

from __future__ import annotations

import json
import re
import shutil

import cv2
import pytest
from result_folders import line, write_frames

from kitti_ros2 import evaluation
from kitti_ros2.api.arguments import KittiRos2Warning
from kitti_ros2.cli import main
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.streams import Layout

CAR = line()
FOUND = line(score=0.9)
LEVELS = ['easy', 'moderate', 'hard']


def one_line(text):
    (only,) = text.splitlines()
    return only


@pytest.fixture
def folders(tmp_path):
    """Labels and results of frames with holes in their numbers, one of them without objects."""
    labels = {3: CAR, 4: CAR + line('Cyclist', (500, 100, 600, 200)), 9: '', 120: CAR}
    results = {number: FOUND if text else '' for number, text in labels.items()}
    return (
        write_frames(tmp_path / 'object' / 'training' / 'label_2', labels),
        write_frames(tmp_path / 'results', results),
    )


def run(capsys, *words):
    """The exit code, and what is printed."""
    code = main(['eval', 'detection', *map(str, words)])
    return code, *capsys.readouterr()


def test_json_has_exactly_the_documented_shape(folders, capsys):
    code, out, err = run(capsys, *folders, '--json')
    assert (code, err) == (0, '')
    values = json.loads(out)
    assert list(values) == ['detection', 'frames']
    assert values['frames'] == 4
    assert list(values['detection']) == ['car', 'pedestrian', 'cyclist']
    for metrics in values['detection'].values():
        assert sorted(metrics) == ['2d', '3d', 'aos', 'bev']
        for levels in metrics.values():
            assert list(levels) == LEVELS
            assert all(list(figures) == ['R40', 'R11'] for figures in levels.values())
    assert values['detection']['car']['3d']['easy'] == {'R40': 5.0, 'R11': 9.0909}
    assert values['detection']['pedestrian']['3d']['easy'] == {'R40': None, 'R11': None}


def test_labels_of_unknown_occlusion_are_counted(folders, capsys):
    labels = {3: line('Car', occluded=3) * 2 + CAR, 4: line('Tram', occluded=3)}
    write_frames(folders[0], labels)
    assert 'note: 2 of 4 labels left out: occlusion 3, unknown;' in run(capsys, *folders)[1]
    assert 'left out' not in run(capsys, *folders, '--classes', 'cyclist')[1]


def test_tables_fit_into_80_columns(folders, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    long = line('x' * 90)
    write_frames(folders[0], {3: CAR + long})
    words = ['--loose', '--classes', 'car', 'pedestrian', f'{"x" * 90}=0.5']
    code, out, _ = run(capsys, *folders, *words)
    assert code == 0
    first, *rows = out.splitlines()
    assert first == f'{folders[1]}: 4 frames, labels of {folders[0]}'
    tables = [row for row in rows if not row.startswith('note: ')]
    assert max(map(len, tables)) <= 80
    assert [row.split()[:3] for row in rows if 'IoU' in row and 'car' in row] == [
        ['car', 'IoU', '0.70'], ['car', 'IoU', '0.50']
    ]  # fmt: skip
    assert [row.split() for row in rows if row.startswith('3d')][:2] == [
        ['3d', *['5.00'] * 3, *['9.09'] * 3],
        ['3d', *['-'] * 6],
    ]
    assert rows[6].split() == ['objects', *'333']


@pytest.mark.parametrize('given', ['label_2', 'training', 'object'])
@pytest.mark.parametrize('below', ['', 'data'])
def test_labels_and_results_are_found_below_a_folder(given, below, folders, tmp_path, capsys):
    labels, results = folders
    if below:
        results.rename(tmp_path / 'data')
        results.mkdir()
        (tmp_path / 'data').rename(results / 'data')
        (results / 'plot').mkdir()
    path = {'label_2': labels, 'training': labels.parent, 'object': labels.parent.parent}[given]
    code, out, err = run(capsys, path, results, '--json')
    assert (code, json.loads(out)['frames'], err) == (0, 4, '')


def test_frames_without_a_result_file_are_listed_and_not_scored(folders, capsys):
    labels, results = folders
    write_frames(labels, dict.fromkeys(range(200, 210), CAR))
    (results / '000009.txt').unlink()
    code, out, err = run(capsys, labels, results, '--json')
    assert code == 1
    assert json.loads(out)['frames'] == 3
    assert f'skipped results (11): {results}: no file for frames 9, 200-209' in err
    assert '11 skipped in all' in err
    quiet = run(capsys, labels, results, '-q')
    assert quiet == (1, '', err)


def test_results_of_frames_without_labels_are_listed(folders, capsys):
    labels, results = folders
    write_frames(results, {5: FOUND, 7: ''})
    code, out, err = run(capsys, labels, results, '--json')
    assert (code, json.loads(out)['frames']) == (1, 4)
    assert f'skipped ground truth (2): {labels}: no labels for frames 5, 7' in err


def test_a_list_chooses_the_frames(folders, tmp_path, capsys):
    labels, results = folders
    write_frames(labels, dict.fromkeys(range(200, 210), CAR))
    write_frames(results, {5: FOUND, 9: 'invalid\n'})
    chosen = tmp_path / 'val.txt'
    chosen.write_text('000003\n000120\n')
    code, out, err = run(capsys, labels, results, '--json', '--frame-list', chosen)
    assert (code, json.loads(out)['frames'], err) == (0, 2, '')
    chosen.write_text('000003\n000200\n000300\nabc\n')
    code, out, err = run(capsys, labels, results, '--json', '--frame-list', chosen)
    assert (code, json.loads(out)['frames']) == (1, 1)
    assert f'{results}: no file for frames 200,' in err
    assert f'{labels}: no labels for frames 300,' in err
    assert f'{chosen}:4: ' in err
    assert '3 skipped in all' in err


def test_invalid_lines_and_files_are_named_and_the_rest_is_scored(folders, capsys):
    labels, results = folders
    (results / '000003.txt').write_text(FOUND + 'Car 1 2\n' + FOUND.replace('0.9', 'nan'))
    (labels / '000004.txt').write_text(CAR + CAR.replace('0.5', 'x'))
    (results / '000120.txt').write_bytes(b'\xff\xfe')
    (results / '3.txt').write_text(FOUND)
    (results / 'notes.txt').write_text('')
    code, out, err = run(capsys, labels, results, '--json')
    assert (code, json.loads(out)['frames']) == (1, 3)
    for named in (
        f'{results}/000003.txt:2: 3 columns',
        f"{results}/000003.txt:3: 'nan' is no finite number",
        f"{labels}/000004.txt:2: 'x' is no number",
        f'{results}/000120.txt: byte 0 is no text',
        f'{results}: 3.txt not read; their frames have other files',
    ):
        assert named in err
    assert '5 skipped in all' in err
    assert 'notes.txt' not in err


def test_a_folder_that_is_named_as_a_file_is_told(folders, capsys):
    labels, results = folders
    for folder, number in ((results, 3), (labels, 4)):
        path = folder / f'{number:06d}.txt'
        path.unlink()
        path.mkdir()
    code, out, err = run(capsys, labels, results, '--json')
    assert code == 1
    assert json.loads(out)['frames'] > 0
    assert f'{results}/000003.txt: Is a directory' in err
    assert f'{labels}/000004.txt: Is a directory' in err
    assert '2 skipped in all' in err


def test_boxes_that_match_no_label_are_noted(folders, capsys):
    labels, results = folders
    write_frames(
        results,
        {
            3: line(area=(200, 100, 100, 200), score=0.9) + line(area=(1, 90, 9, 20), score=0.8),
            4: line(size=(1.5, -1.6, 4), score=0.7) + line(size=(-1, -1, -1), score=0.6),
        },
    )
    code, out, err = run(capsys, labels, results)
    assert (code, err) == (0, '')
    assert '2 detections with a 2D box whose right is left of its left edge' in out
    assert '1 detection with a height, width or length below 0' in out


def test_a_byte_order_mark_costs_no_line(folders, capsys):
    labels, results = folders
    expected = run(capsys, labels, results, '--json')
    for path in (*labels.iterdir(), *results.iterdir()):
        path.write_bytes(b'\xef\xbb\xbf' + path.read_bytes().replace(b'\n', b'\r\n'))
    assert run(capsys, labels, results, '--json') == expected


def test_losses_are_warnings_in_python(folders):
    labels, results = folders
    (results / '000009.txt').unlink()
    with pytest.warns(KittiRos2Warning, match='no file for frames 9'):
        scores = evaluation.evaluate_detection(labels, str(results))
    assert (scores.frames, scores.losses[0].numbers) == (3, (9,))
    with pytest.raises(KittiRos2Error, match='did you mean'):
        evaluation.evaluate_detection(labels, results, clases='car')


@pytest.mark.parametrize(
    'classes', ['car,truck=0.5', ['car', 'truck=0.5'], {'car': None, 'truck': 0.5}]
)
def test_classes_in_python(classes, folders):
    scores = evaluation.evaluate_detection(*folders, classes=classes)
    assert scores.limits == {'car': 0.7, 'truck': 0.5}


def test_a_tracking_sequence_against_its_own_file(recordings, capsys):
    """Its labels have the frame in the first column; one without objects has no line."""
    root = recordings[Layout.TRACKING]
    (labels,) = (root / 'training' / 'label_02').iterdir()
    code, out, err = run(capsys, root, labels, '--json', '--classes', 'car', 'pedestrian')
    assert (code, err) == (0, '')
    of_root = json.loads(out)
    code, out, _ = run(capsys, labels, labels, '--json', '--classes', 'car', 'pedestrian')
    assert code == 0
    assert json.loads(out)['detection'] == of_root['detection']
    assert of_root['detection']['car']['3d']['hard']['R40'] > 0


def test_overlaps_are_those_of_iou(folders, capsys):
    write_frames(folders[0], {3: CAR + line('Truck')})
    former = ['--classes', 'car=0.5', 'truck=0.25', 'pedestrian']
    code, out, err = run(capsys, *folders, *former)
    assert code == 0
    assert err.splitlines() == [
        f'note: --classes {each} is --classes {each.split("=")[0]} --iou {each} now; the next'
        ' release takes names alone'
        for each in former[1:3]
    ]
    assert re.findall(r'^(\w+) +IoU (0\.\d+)', out, re.MULTILINE) == [
        ('car', '0.50'), ('truck', '0.25'), ('pedestrian', '0.50')
    ]  # fmt: skip
    words = ['--classes', 'car', 'truck', 'pedestrian', '--iou', 'Car=0.5', 'truck=0.25']
    assert run(capsys, *folders, *words) == (0, out, '')


def test_tracklets_of_a_drive_are_projected_into_the_image(recordings, tmp_path, capsys):
    """The object layout has the same objects in its label files."""
    labels = recordings[Layout.OBJECT] / 'training' / 'label_2'
    copy = shutil.copytree(labels, tmp_path / 'results')
    words = ['--iou', '0.5', '--json']
    code, out, err = run(capsys, recordings[Layout.RAW], copy, *words)
    drive = json.loads(out)
    assert (code, err) == (0, '')
    code, out, _ = run(capsys, labels, copy, *words)
    assert drive['frames'] == json.loads(out)['frames']
    assert drive['detection']['car']['2d']['hard']['R40'] > 0
    assert drive['detection']['car']['3d']['hard']['R40'] > 0


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['{gt}'], 'usage: kitti-ros2 eval detection'),
        (['{gt}', '{tmp}/absent'], 'absent: no such file or folder'),
        (['{tmp}/absent', '{res}'], 'absent: no such file or folder'),
        (['{gt}', '{tmp}/empty'], 'the folder is empty; expected a file like 000000.txt'),
        (['{tmp}/empty', '{res}'], 'the folder is empty'),
        (['{gt}', '{tmp}'], 'did you mean {tmp}/others, {res}?'),
        (['{gt}', '{tmp}/object'], 'is a folder of a KITTI data set; expected result files like'),
        (['{res}', '{tmp}/object'], 'takes GROUND_TRUTH first, then RESULTS'),
        (['{res}', '{gt}'], '{res}: all labels have scores, and {gt} has none; give GROUND_TRUTH'),
        (['{gt}', '{tmp}/odd/broken'], '000003.txt: byte 0 is no text'),
        (['{gt}', '{tmp}/odd/text.mcap'], 'text.mcap: is a file of another kind'),
        (['{gt}', '{res}', '--topic', '/boxes'], '{res}: is no bag; --topic is for results'),
        (['{gt}', '{res}', '--tolerance', '1', '--class-map', 'a=Car'], '--class-map is for'),
        (['{gt}', '{tmp}/tracks'], 'give the file of one sequence, such as {tmp}/tracks/0000.txt'),
        (['{gt}', '{tmp}/text.txt'], 'text.txt: no line begins with a frame number'),
        (['{gt}', '{gt}/000003.txt'], '000003.txt: no line begins with a frame number'),
        (['{gt}', '{tmp}/others'], 'no frame has both results and labels'),
        (['{testing}', '{res}'], 'has no labels'),
        (['{gt}', '{res}', '--classes', 'truck'], 'such as --iou truck=0.5'),
        (['{gt}', '{res}', '--iou', 'bus=0.5'], 'for bus, which is not scored; give --classes car'),
        (['{gt}', '{res}', '--classes', 'car=x'], "such as car or truck=0.5, not 'car=x'"),
        (['{gt}', '{res}', '--classes', 'car=1'], 'not within 0 to 1'),
        (['{gt}', '{res}', '--classes', 'car=nan'], 'not within 0 to 1'),
        (['{gt}', '{res}', '--frame-list', '{tmp}/absent'], 'absent'),
        (['{gt}', '{res}', '--frame-list', '{tmp}/tracks/empty.txt'], 'no frame among those of'),
        (['{gt}', '{res}', '-o', '{tmp}/o.jpg'], 'ends in .png, .pdf or .svg'),
        (['{gt}', '{res}', '-o', '{tmp}/text.txt', '--overwrite'], 'it is no picture'),
        (['{gt}', '{res}', '-o', '{res}/o.png'], 'lies inside the recording'),
        (['{gt}', '{res}', '--clases', 'car'], 'did you mean --classes'),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(words, said, folders, tmp_path, recordings, capsys):
    (tmp_path / 'empty').mkdir()
    write_frames(tmp_path / 'others', {7777: FOUND})
    (tmp_path / 'tracks').mkdir()
    (tmp_path / 'tracks' / '0000.txt').write_text('7777 1 ' + FOUND)
    (tmp_path / 'tracks' / 'empty.txt').write_text('')
    (tmp_path / 'text.txt').write_text('no labels\n')
    (tmp_path / 'odd' / 'broken').mkdir(parents=True)
    (tmp_path / 'odd' / 'broken' / '000003.txt').write_bytes(b'\xff\xfe')
    (tmp_path / 'odd' / 'text.mcap').write_text('no labels\n')
    testing = tmp_path / 'testing'
    shutil.copytree(recordings[Layout.OBJECT] / 'training' / 'calib', testing / 'calib')
    shutil.copytree(recordings[Layout.OBJECT] / 'training' / 'velodyne', testing / 'velodyne')
    places = {'gt': folders[0], 'res': folders[1], 'tmp': tmp_path, 'testing': testing}
    code, out, err = run(capsys, *(word.format(**places) for word in words))
    assert (code, out) == (2, '')
    assert said.format(**places) in one_line(err)
    assert not (tmp_path / 'o.jpg').exists()


def test_curves_are_drawn(folders, tmp_path, capsys):
    pytest.importorskip('matplotlib')
    out = tmp_path / 'curves.png'
    code, printed, _ = run(capsys, *folders, '-o', out)
    assert code == 0
    assert printed.splitlines()[-1].endswith('curves.png')
    picture = cv2.imread(str(out))
    assert picture.shape[1] > 1500
    assert picture.std() > 10
    code, _, err = run(capsys, *folders, '-o', out)
    assert code == 2
    assert 'exists already' in one_line(err)
    words = ['-o', out, '--overwrite', '-q', '--classes', 'car']
    assert run(capsys, *folders, *words) == (0, '', '')
    assert cv2.imread(str(out)).shape[0] < picture.shape[0]
