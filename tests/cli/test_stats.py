# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 stats: tables, JSON, CSV, pictures, exit codes, mistakes."""

from __future__ import annotations

import csv
import importlib
import json
import shutil
from importlib.util import find_spec

import cv2
import pytest
from builders import one_line
from label_set import FRAMES, TRAINING, write_labels

from kitti_ros2.cli import main
from kitti_ros2.cli.stats_tables import titles_of
from kitti_ros2.drawing import labelled_objects
from kitti_ros2.model.streams import Layout

needs_matplotlib = pytest.mark.skipif(
    find_spec('matplotlib') is None, reason='matplotlib is not installed'
)
CAR = 'Car 0.00 0 -1.5 600 100 650 150 1.5 1.6 4.0 3.0 1.7 4.0 0.0\n'


@pytest.fixture(autouse=True)
def columns(monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    monkeypatch.setattr(labelled_objects, '_DPI', 60)


@pytest.fixture(scope='session')
def training(tmp_path_factory):
    """The labels of KITTI's training set in number, not in place."""
    return write_labels(tmp_path_factory.mktemp('labels') / 'training', TRAINING, FRAMES)


@pytest.fixture
def all_recordings(recordings, tmp_path):
    """A folder with a recording of each layout."""
    root = tmp_path / 'kitti'
    for layout, path in recordings.items():
        # A drive needs the calibration in the folder of its date.
        source, name = (
            (path.parent, path.parent.name) if layout is Layout.RAW else (path, path.name)
        )
        shutil.copytree(source, root / layout.value / name)
    return root


def table_in(text, first):
    """The rows of a table by name, each with its cells."""
    lines = text.split(f'\n{first} ')[1].split('\n\n')[0].splitlines()[1:]
    return {line.split()[0]: line.split()[1:] for line in lines}


def test_the_training_set_has_its_known_table(training, capsys):
    assert main(['stats', str(training)]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines()[1:])) <= 80
    assert text.startswith(
        f'{training}: object, 1 recording, 7,481 frames, 40,570 objects in 7,481 (5.4 a frame)\n'
    )
    classes = table_in(text, 'class')
    assert [(name, int(cells[0])) for name, cells in classes.items()] == [*TRAINING.items()]
    assert classes['Car'][1] == '70.8%'
    for name, cells in classes.items():
        if name != 'DontCare':
            assert sum(map(int, cells[4:])) == TRAINING[name]
    for table in ('occlusion', 'distance m', 'box m'):
        assert [*table_in(text, table)] == [name for name in TRAINING if name != 'DontCare']


def test_a_folder_of_many_has_a_row_for_each_and_for_all(all_recordings, capsys):
    root = all_recordings
    assert main(['stats', str(root)]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines()[1:])) <= 80
    rows = table_in(text, 'recording')
    assert len(rows) == len(Layout) + 1
    frames = [int(cells[0]) for cells in rows.values()]
    assert sum(frames[:-1]) == frames[-1] == 25
    assert [*rows][-1] == 'all'
    layouts = 'raw, kitti360, object, odometry, tracking'
    assert f'{root}: {layouts}, 5 recordings, 25 frames' in text


def test_several_sets_are_columns(recordings, capsys):
    paths = [recordings[Layout.OBJECT], recordings[Layout.TRACKING], recordings[Layout.RAW].parent]
    assert main(['stats', *map(str, paths)]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 80
    lines = text.splitlines()
    assert lines[0].split() == ['object', 'tracking', '2011_09_26']
    assert next(line.split() for line in lines if line.startswith('frames ')) == [
        'frames', '5', '5', '5'
    ]  # fmt: skip
    for title in ('objects', 'easy moderate hard beyond, %', 'distance, m', 'route'):
        assert title in [line.strip() for line in lines]


def test_more_sets_than_fit_get_another_table(recordings, tmp_path, capsys):
    copies = [tmp_path / f'copy_{index}' for index in range(6)]
    for copy in copies:
        shutil.copytree(recordings[Layout.OBJECT], copy)
    assert main(['stats', *map(str, copies)]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 80
    heads = [line.split() for line in text.splitlines() if 'copy_' in line]
    assert heads == [[f'copy_{n}' for n in range(4)], ['copy_4', 'copy_5']]


def test_titles_differ(tmp_path):
    paths = [tmp_path / 'a/training', tmp_path / 'b/training', tmp_path / 'c']
    assert titles_of(paths) == ['a/training', 'b/training', f'{tmp_path.name}/c']
    assert titles_of(paths[:1]) == ['training']
    assert titles_of([paths[0], paths[0]]) == ['training', 'training']


def test_json_and_csv_have_all_figures(all_recordings, tmp_path, capsys):
    root = all_recordings
    table = tmp_path / 'stats.csv'
    assert main(['stats', str(root), '--count-points', '--json', '--csv', str(table)]) == 0
    (found,) = json.loads(capsys.readouterr().out)['sets']
    assert len(found['recordings']) == len(Layout)
    assert found['total']['frames'] == 25
    with table.open(newline='') as file:
        rows = [*csv.DictReader(file)]
    assert {row['recording'] for row in rows} == {'', *(p['name'] for p in found['recordings'])}
    figures = {
        (row['group'], row['name'], row['quantity']): row['value']
        for row in rows
        if not row['recording']
    }
    assert figures['recording', '', 'frames'] == '25'
    for name, each in found['total']['classes'].items():
        assert figures['classes', name, 'count'] == str(each['count'])
        assert figures['classes', name, 'difficulty easy'] == str(each['difficulty']['easy'])
        if each['points']:
            assert float(figures['classes', name, 'points mean']) == each['points']['mean']
            bins = each['points']['bins']
            assert sum(bins.values()) == each['points']['count']
            assert figures['classes', name, 'points 1-5'] == str(bins['1-5'])
    assert float(figures['route', '', 'length_m']) == found['total']['route']['length_m']
    assert figures['samples', 'scan', 'count'] == '25'


def test_losses_are_listed_and_the_rest_is_counted(tmp_path, capsys):
    folder = tmp_path / 'training' / 'label_2'
    folder.mkdir(parents=True)
    (folder / '000000.txt').write_text(f'{CAR}Car 1\n{CAR}')
    assert main(['stats', str(tmp_path)]) == 1
    said = capsys.readouterr()
    assert table_in(said.out, 'class')['Car'][0] == '2'
    assert f'{folder}/000000.txt:2: 2 columns' in said.err
    assert '1 skipped in all' in said.err
    assert main(['stats', str(tmp_path), '-q']) == 1
    quiet = capsys.readouterr()
    assert quiet.out == ''
    assert quiet.err == said.err
    assert main(['stats', str(tmp_path), '--json']) == 1
    (found,) = json.loads(capsys.readouterr().out)['sets']
    assert [loss['stream'] for loss in found['total']['losses']] == ['labels']


def test_any_names_and_numbers_fit_into_the_tables(tmp_path, capsys):
    folder = tmp_path / 'training' / 'label_2'
    folder.mkdir(parents=True)
    kinds = ('[bold]x', ':car:', '$\\foo$', '汽车', 'x' * 70)
    lines = [CAR.replace('Car', kind).replace('4.0 3.0', '1e30 3e200') for kind in kinds]
    (folder / '000000.txt').write_text(''.join(lines))
    assert main(['stats', str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines()[1:])) <= 80
    assert all(text.count(kind) == 4 for kind in kinds[:-1])
    assert '3.0e+200' in text


def test_points_without_scans_are_a_note(capsys, tmp_path):
    folder = tmp_path / 'training' / 'label_2'
    folder.mkdir(parents=True)
    (folder / '000000.txt').write_text(CAR)
    assert main(['stats', str(tmp_path), '--count-points']) == 0
    assert f'note: {tmp_path}: no scans' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['stats'], 'usage: kitti-ros2 stats PATH...'),
        (['stats', '{tmp}/absent'], 'no such file or folder'),
        (['stats', '{tmp}/empty'], 'the folder is empty'),
        (['stats', '{tmp}/file.txt'], 'expected'),
        (['stats', '{raw}', '--sequence', '77'], "no sequence '77'"),
        (['stats', '{raw}', '--layout', 'tracking'], 'it is layout raw'),
        (['stats', '{raw}', '--layout', 'nuscenes'], 'raw, object, odometry, tracking or kitti360'),
        (['stats', '{raw}', '-o', '{tmp}/o.jpg'], 'ends in .png, .pdf or .svg'),
        (['stats', '{raw}', '--csv', '{tmp}/file.txt'], 'exists already'),
        (['stats', '{raw}', '--csv', '{tmp}/file.txt', '--overwrite'], 'it is no table'),
        (['stats', '{raw}', '-o', '{tmp}/file.txt', '--overwrite'], 'it is no picture'),
        (['stats', '{raw}', '--csv', '{raw}/oxts/o.csv'], 'lies inside the recording'),
        (['stats', '{raw}', '{tmp}/absent', '--csv', '{tmp}/o.csv'], 'no such file or folder'),
        (['stats', '{raw}', '--count-point'], 'did you mean --count-points'),
    ],
)
def test_mistakes_are_one_line(words, said, recordings, tmp_path, capsys):
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'file.txt').write_text('text')
    places = {'tmp': tmp_path, 'raw': recordings[Layout.RAW]}
    assert main([word.format(**places) for word in words]) == 2
    assert said in one_line(capsys.readouterr().err)
    assert sorted(path.name for path in tmp_path.iterdir()) == ['empty', 'file.txt']


def test_a_full_disk_leaves_nothing(recordings, tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('kitti_ros2.datasets.set_statistics.write_csv', fail)
    assert main(['stats', str(recordings[Layout.RAW]), '--csv', str(tmp_path / 'o.csv')]) == 2
    assert 'the disk is full' in one_line(capsys.readouterr().err)
    assert [*tmp_path.iterdir()] == []


def test_without_matplotlib_the_extra_is_named(recordings, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('kitti_ros2.cli.output.find_spec', lambda _: None)
    assert main(['stats', str(recordings[Layout.RAW]), '-o', str(tmp_path / 'o.png')]) == 2
    assert "pip install 'kitti_ros2[plot]'" in one_line(capsys.readouterr().err)


@needs_matplotlib
def test_a_picture_has_a_panel_for_all_that_is_known(recordings, tmp_path, monkeypatch):
    """Its rows are full, and legends are beside the data."""
    titles, right_ends = [], {}
    figures = importlib.import_module('matplotlib.figure')
    save = figures.Figure.savefig

    def note(figure, *given, **options):
        titles.extend(axes.get_title('left') for axes in figure.axes if axes.axison)
        save(figure, *given, **options)
        for axes in figure.axes:
            place, legend = axes.get_position(), axes.get_legend()
            right_ends[round(place.y0, 2)] = place.x1
            if legend:
                assert legend.get_window_extent().x0 > axes.get_window_extent().x1

    monkeypatch.setattr(figures.Figure, 'savefig', note)
    out = tmp_path / 'stats.png'
    words = ['stats', str(recordings[Layout.TRACKING]), '--count-points', '-o', str(out), '-q']
    assert main(words) == 0
    assert titles == [
        'Labels',
        'Difficulty',
        'Occlusion',
        'Truncation',
        '3D boxes, mean ± deviation',
        'Distance',
        'Points in a 3D box',
        'Length of a track',
        'Objects in a frame',
        'Speed',
        'Turn rate',
    ]
    assert max(right_ends.values()) - min(right_ends.values()) < 0.05
    picture = cv2.imread(str(out))
    assert picture.shape[1] > 500
    assert picture.std() > 10
    assert main(words) == 2  # it exists


@needs_matplotlib
def test_sets_are_drawn_side_by_side(recordings, tmp_path):
    out = tmp_path / 'stats.png'
    paths = [str(recordings[layout]) for layout in (Layout.ODOMETRY, Layout.RAW)]
    assert main(['stats', *paths, '-o', str(out), '-q']) == 0
    height, width, _ = cv2.imread(str(out)).shape
    assert height > width > 380  # a column for each set, a row for each panel


@needs_matplotlib
@pytest.mark.parametrize(
    ('ending', 'first', 'labels'),
    [('pdf', b'%PDF', CAR.replace('Car', '$\\foo$')), ('svg', b'<?xml', '')],
    ids=['pdf', 'svg'],
)
def test_pictures_for_papers(tmp_path, capsys, ending, first, labels):
    """Also of a set with nothing to draw."""
    folder = tmp_path / 'set' / 'label_2'
    folder.mkdir(parents=True)
    (folder / '000000.txt').write_text(labels)
    out = tmp_path / f'stats.{ending}'
    out.write_bytes(first)
    assert main(['stats', str(tmp_path / 'set'), '-o', str(out), '--overwrite']) == 0
    assert '1 frame' in capsys.readouterr().out
    assert out.read_bytes().startswith(first)
    assert out.stat().st_size > 1000
