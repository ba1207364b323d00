# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of tracks: by hand, and against what TrackEval's own evaluator makes of the same files."""

from __future__ import annotations

import importlib.util
import json
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
import pytest

from kitti_ros2.cli import main
from kitti_ros2.evaluation import evaluate_tracking
from kitti_ros2.evaluation.track_metrics import load_trackeval
from kitti_ros2.kitti.label_file import format_tracking_labels
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.boxes import Box
from kitti_ros2.model.errors import BadFileError, KittiRos2Error, MissingPathError, UsageError
from kitti_ros2.model.streams import Layout

from result_bag import answers, answers_2d, stamps_of, write_bag  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.api.arguments.KittiRos2Warning')
needs_trackeval = pytest.mark.skipif(
    importlib.util.find_spec('trackeval') is None,
    reason="trackeval is not installed; pip install 'kitti_ros2[eval]'",
)
LENGTHS = {'0000': 40, '0002': 25}


def box(frame, track, kind='Car', left=100.0, width=60.0, height=50.0, **values) -> Box:
    top = values.pop('top', 150.0)
    return Box(
        kind,
        values.pop('truncated', 0),
        values.pop('occluded', 0),
        0.1,
        (left, top, left + width, top + height),
        (1.5, 1.6, 3.9),
        (1.0, 1.7, 20.0),
        0.2,
        None,
        frame,
        track,
    )


def write_tracks(folder: Path, sequences: dict[str, list[Box]], *parts: str) -> Path:
    place = folder.joinpath(*parts)
    place.mkdir(parents=True)
    for name, boxes in sequences.items():
        (place / f'{name}.txt').write_text(format_tracking_labels(boxes))
    return folder


@pytest.fixture
def truth(tmp_path):
    """Returns a function that writes labels; the folder is a split with label_02."""

    def write(boxes, name='0000') -> Path:
        return write_tracks(tmp_path / 'training', {name: boxes}, 'label_02')

    return write


@pytest.fixture
def tracks(tmp_path):
    def write(boxes, name='0000') -> Path:
        return write_tracks(tmp_path / 'tracks', {name: boxes})

    return write


@needs_trackeval
def test_a_track_that_changes_its_id_by_hand(truth, tracks):
    labels = [box(frame, 3, left=10 * frame) for frame in (0, 1, 4, 5)]
    detected = [replace(label, track_id=7 if label.frame < 2 else 8, score=0.5) for label in labels]
    scores = evaluate_tracking(truth(labels), tracks(detected))
    car = scores.classes['car']
    assert car['MOTA'] == pytest.approx(75)
    assert car['MOTP'] == pytest.approx(100)
    assert (car['IDSW'], car['MT'], car['ML'], car['CLR_TP']) == (1, 1, 0, 4)
    assert car['IDF1'] == pytest.approx(50)
    assert car['DetA'] == pytest.approx(100)
    assert car['AssA'] == pytest.approx(50)
    assert car['HOTA'] == pytest.approx(100 * sqrt(0.5))
    assert (scores.frames, [*scores.sequences]) == (6, ['0000'])
    assert not scores.losses


@needs_trackeval
@pytest.mark.parametrize(
    ('label', 'track', 'expected'),
    [
        (box(0, 2, 'Van', left=500), box(0, 9, left=500), 0),
        (box(0, 2, 'Person_sitting', left=500), box(0, 9, 'Pedestrian', left=500), 0),
        (box(0, 2, left=500, occluded=3), box(0, 9, left=500), 0),
        (box(0, 2, left=500, truncated=1), box(0, 9, left=500), 0),
        (box(0, -1, 'DontCare', left=480, width=200, height=90), box(0, 9, left=500), 0),
        (box(0, 2, 'Truck', left=500), box(0, 9, left=500), 1),
        (box(0, 2, 'Misc', left=500), box(0, 9, left=700, height=25), 0),
        (box(0, 2, 'Misc', left=500), box(0, 9, left=700, height=26), 1),
    ],
)
def test_false_positives_by_the_rules_of_the_benchmark(label, track, expected, truth, tracks):
    matched = [box(0, 1), box(0, 1, 'Pedestrian', left=300)]
    scores = evaluate_tracking(truth([*matched, label]), tracks([*matched, track]))
    assert sum(figures['CLR_FP'] for figures in scores.classes.values()) == expected
    assert [figures['CLR_TP'] for figures in scores.classes.values()] == [1, 1]


def random_tracks(rng: np.random.Generator, length: int) -> tuple[list[Box], list[Box]]:
    """Labels of all classes with holes in frame numbers, and imperfect tracks."""
    kinds = ['Car'] * 5 + ['Pedestrian'] * 4 + ['Van', 'Person', 'Cyclist', 'Truck', 'Misc']
    labels: list[Box] = []
    for track, kind in enumerate(kinds):
        first, last = sorted(rng.integers(0, length, 2))
        place, speed = rng.uniform(0, 1000), rng.uniform(-12, 12)
        for frame in range(first, last + 1):
            if frame in {3, 4, 11}:
                continue
            labels.append(
                box(
                    frame,
                    track,
                    kind,
                    place + speed * (frame - first),
                    rng.uniform(30, 90),
                    rng.uniform(18, 80),
                    occluded=int(rng.integers(0, 4)),
                    truncated=int(rng.random() < 0.1),
                )
            )
    regions = [box(n, -1, 'DontCare', rng.uniform(0, 1000), 200, 80) for n in range(0, length, 3)]
    detected = []
    for label in labels:
        if rng.random() < 0.15 or label.class_name == 'Cyclist':
            continue
        four = np.array(label.box_2d) + rng.normal(0, 4, 4)
        kind = {'Van': 'Car', 'Truck': 'Car', 'Person': 'Pedestrian'}.get(label.class_name)
        track = label.track_id + 100 * (label.frame > 13 + label.track_id)
        detected.append(
            replace(
                label,
                class_name=kind or label.class_name,
                box_2d=tuple(four.tolist()),
                track_id=track,
                score=float(rng.random()),
            )
        )
    false = [
        box(frame, 5000 + frame, str(rng.choice(['Car', 'Pedestrian'])), rng.uniform(0, 1000))
        for frame in rng.integers(0, length, length)
    ]
    unique = {(fake.frame, fake.track_id): replace(fake, score=0.1) for fake in false}
    return [*labels, *regions], [*detected, *unique.values()]


def own_figures(truth: Path, tracks: Path, out: Path) -> dict[str, dict[str, float]]:
    """What TrackEval's Evaluator makes of the files as they are."""
    library = load_trackeval()
    (out / 'mine').mkdir(parents=True)
    (out / 'mine' / 'data').symlink_to(tracks)
    dataset = library.datasets.Kitti2DBox(
        {
            'GT_FOLDER': str(truth),
            'TRACKERS_FOLDER': str(out),
            'TRACKERS_TO_EVAL': ['mine'],
            'PRINT_CONFIG': False,
        }
    )
    metrics = library.metrics
    quiet = {'PRINT_CONFIG': False}
    config = {'PRINT_RESULTS': False, 'PRINT_CONFIG': False, 'TIME_PROGRESS': False,
              'OUTPUT_SUMMARY': False, 'OUTPUT_DETAILED': False, 'PLOT_CURVES': False,
              'LOG_ON_ERROR': None}  # fmt: skip
    with redirect_stdout(StringIO()):
        results, _ = library.Evaluator(config).evaluate(
            [dataset], [metrics.HOTA(), metrics.CLEAR(quiet), metrics.Identity(quiet)]
        )
    score = {}
    for kind, values in results['Kitti2DBox']['mine']['COMBINED_SEQ'].items():
        hota, clear, identity = (values[name] for name in ('HOTA', 'CLEAR', 'Identity'))
        score[kind] = {name: 100 * np.mean(hota[name]) for name in ('HOTA', 'DetA', 'AssA', 'LocA')}
        score[kind] |= {name: 100 * clear[name] for name in ('MOTA', 'MOTP')}
        score[kind] |= {name: 100 * identity[name] for name in ('IDF1', 'IDP', 'IDR')}
        counts = ('IDSW', 'Frag', 'MT', 'PT', 'ML', 'CLR_TP', 'CLR_FN', 'CLR_FP')
        score[kind] |= {name: clear[name] for name in counts}
    return score


def write_seqmap(folder: Path, lengths: dict[str, int]) -> None:
    (folder / 'evaluate_tracking.seqmap.training').write_text(seqmap(lengths))


@needs_trackeval
@pytest.mark.parametrize('seed', range(4))
def test_figures_are_those_of_trackeval_on_the_same_files(seed, tmp_path):
    rng = np.random.default_rng(seed)
    made = {name: random_tracks(rng, length) for name, length in LENGTHS.items()}
    truth = write_tracks(tmp_path / 'gt', {n: pair[0] for n, pair in made.items()}, 'label_02')
    write_seqmap(truth, LENGTHS)
    tracks = write_tracks(tmp_path / 'tracks', {n: pair[1] for n, pair in made.items()})
    scores = evaluate_tracking(truth, tracks)
    assert scores.classes == own_figures(truth, tracks, tmp_path / 'own')
    assert 20 < scores.classes['car']['HOTA'] < 80
    assert scores.classes['car']['IDSW']
    assert scores.frames == sum(LENGTHS.values())
    assert any('of other classes' in note for note in scores.notes)


def seqmap(lengths: dict[str, int]) -> str:
    return ''.join(f'{name} empty 000000 {count:06d}\n' for name, count in lengths.items())


_OF_TEST = {f'{number:04d}': 40 for number in range(29)}


@needs_trackeval
@pytest.mark.parametrize(
    ('files', 'frames'),
    [
        ({'training/evaluate_tracking.seqmap.test': {'0000': 40}}, 2),
        ({'training/evaluate_tracking.seqmap.testing': _OF_TEST}, 2),
        ({'training/evaluate_tracking.seqmap.training': {'0000': 5}}, 5),
        ({'training/label_02/evaluate_tracking.seqmap.val': {'0000': 5}}, 5),
        ({'evaluate_tracking.seqmap.training': {'0000': 5}}, 5),
        ({'training/evaluate_tracking.seqmap.val': {'0001': 5}}, 2),
        ({'training/evaluate_tracking.seqmap': {'0000': 5}}, 5),
        ({'training/evaluate_tracking.seqmap': _OF_TEST}, 2),
        (
            {
                'training/evaluate_tracking.seqmap': {'0000': 40},
                'training/evaluate_tracking.seqmap.test': {'0000': 40},
            },
            2,
        ),
        (
            {
                'training/evaluate_tracking.seqmap': {'0000': 40},
                'training/evaluate_tracking.seqmap.training': {'0000': 5},
                'training/evaluate_tracking.seqmap.test': _OF_TEST,
            },
            5,
        ),
    ],
)
def test_the_length_is_that_of_the_list_of_this_split(files, frames, truth, tracks, tmp_path):
    labels = [box(frame, 1) for frame in range(2)]
    folder = truth(labels)
    for name, lengths in files.items():
        (tmp_path / name).write_text(seqmap(lengths))
    results = tracks([*labels, box(30, 2)])
    for path in (folder, folder / 'label_02', folder / 'label_02' / '0000.txt'):
        scores = evaluate_tracking(path, results)
        assert scores.frames == frames
        (loss,) = scores.losses
        assert f'in frames 30; the sequence has {frames} frames' in loss.text()


@needs_trackeval
def test_the_list_of_testing_is_for_labels_of_testing(tracks, tmp_path):
    labels = [box(frame, 1) for frame in range(2)]
    folder = write_tracks(tmp_path / 'testing', {'0000': labels}, 'label_02')
    (folder / 'evaluate_tracking.seqmap.training').write_text(seqmap({'0000': 5}))
    results = tracks(labels)
    assert evaluate_tracking(folder, results).frames == 2
    (folder / 'evaluate_tracking.seqmap.test').write_text(seqmap(_OF_TEST))
    assert evaluate_tracking(folder, results).frames == 40


@needs_trackeval
@pytest.mark.parametrize(
    ('label', 'track', 'expected'),
    [
        (None, None, None),
        (box(0, 9, 'Pedestrian', occluded=3), None, None),
        (box(0, 9, 'Pedestrian'), None, 0),
        (None, box(0, 9, 'Pedestrian', left=500), -100),
    ],
)
def test_a_class_without_objects_and_tracks_has_no_percentage(
    label, track, expected, truth, tracks
):
    labels = [box(frame, 1) for frame in range(2)]
    scores = evaluate_tracking(
        truth([*labels, *filter(None, [label])]), tracks([*labels, *filter(None, [track])])
    )
    pedestrian = scores.classes['pedestrian']
    assert pedestrian['MOTA'] == expected
    assert (pedestrian['HOTA'] is None) == (expected is None)
    assert (scores.sequences['0000']['pedestrian']['HOTA'] is None) == (expected is None)
    assert scores.classes['car']['MOTA'] == pytest.approx(100)


@needs_trackeval
def test_labels_of_unknown_occlusion_are_counted(truth, tracks):
    labels = [box(frame, 1, occluded=3) for frame in range(3)]
    results = tracks([replace(label, occluded=0) for label in labels])
    scores = evaluate_tracking(truth([*labels, box(0, 2, 'Truck', occluded=3)]), results)
    assert scores.classes['car']['MOTA'] is None
    assert '3 of 3 labels left out: occlusion 3, unknown; 0 counts as visible' in scores.notes


@needs_trackeval
def test_figures_of_a_real_sequence_are_those_of_trackeval(real_kitti, tmp_path):
    source = real_kitti / 'tracking' / 'training'
    truth = tmp_path / 'gt'
    (truth / 'label_02').mkdir(parents=True)
    text = (source / 'label_02' / '0000.txt').read_text()
    (truth / 'label_02' / '0000.txt').write_text(text)
    write_seqmap(truth, {'0000': 154})
    rng = np.random.default_rng(1)
    recording = open_recording(source)
    assert recording.name == '0000'
    lines = []
    for row, line in enumerate(text.splitlines()):
        words = line.split()
        if words[2] == 'DontCare' or row % 7 == 0:
            continue
        words[6:10] = [f'{float(word) + rng.normal(0, 5):.9f}' for word in words[6:10]]
        words[1] = str(int(words[1]) + 50 * (int(words[0]) > 80))
        lines.append(' '.join([*words, '0.5']))
    tracks = tmp_path / 'tracks'
    tracks.mkdir()
    (tracks / '0000.txt').write_text('\n'.join(lines))
    scores = evaluate_tracking(source, tracks)
    assert scores.classes == own_figures(truth, tracks, tmp_path / 'own')
    assert scores.frames == 154
    assert scores.classes['car']['CLR_TP'] > 100


@needs_trackeval
def test_ids_of_any_size_take_no_memory(truth, tracks):
    labels = [box(frame, 2**31 - 1) for frame in range(3)]
    scores = evaluate_tracking(truth(labels), tracks(labels))
    assert scores.classes['car']['HOTA'] == pytest.approx(100)


@needs_trackeval
def test_sequences_without_results_and_results_without_labels_are_losses(tmp_path):
    boxes = [box(0, 1), box(1, 1)]
    truth = write_tracks(
        tmp_path / 'gt', dict.fromkeys(['0000', '0003', '0005'], boxes), 'label_02'
    )
    tracks = write_tracks(tmp_path / 'tracks', dict.fromkeys(['0003', '0007'], boxes), 'data')
    scores = evaluate_tracking(truth, tracks)
    assert [*scores.sequences] == ['0003']
    assert [loss.count for loss in scores.losses] == [2, 1]
    assert 'no file of 0000, 0005; not scored' in scores.losses[0].text()
    assert 'no labels of 0007' in scores.losses[1].text()
    assert not evaluate_tracking(truth, tracks, sequence='0003').losses
    assert not evaluate_tracking(truth / 'label_02' / '0003.txt', tracks).losses
    assert not evaluate_tracking(truth / 'label_02', tracks / 'data' / '0003.txt').losses


@needs_trackeval
def test_frames_with_labels_and_no_track_are_named(truth, tracks):
    labels = [box(frame, 1) for frame in range(9)]
    scores = evaluate_tracking(truth(labels), tracks(labels[2:4]))
    (note,) = scores.notes
    assert 'in frames 0-1, 4-8' in note


@needs_trackeval
def test_detections_without_ids_are_noted(truth, tracks):
    labels = [box(frame, 1) for frame in range(3)]
    detected = [replace(label, track_id=label.frame) for label in labels]
    (note,) = evaluate_tracking(truth(labels), tracks(detected)).notes
    assert note == '0000: every track has one box; a tracker gives the boxes of an object one id'


@needs_trackeval
def test_lines_that_cannot_be_used_are_losses(truth, tracks):
    labels = [box(frame, 1) for frame in range(3)]
    detected = [*labels, box(0, -1, left=500), box(3, 4), box(1, 5, 'robot'), box(2, 6, 'robot')]
    results = tracks(detected)
    with (results / '0000.txt').open('a') as file:
        file.write('2 9 Car 0 0\n')
    scores = evaluate_tracking(truth(labels), results)
    texts = [loss.text() for loss in scores.losses]
    assert [loss.count for loss in scores.losses] == [1, 1, 1, 2]
    assert '0000.txt:8: ' in texts[0]
    assert 'track id below 0' in texts[1]
    assert 'in frames 3; the sequence has 3 frames' in texts[2]
    assert "'robot' (2)" in texts[3]
    assert scores.classes['car']['HOTA'] == pytest.approx(100)


@needs_trackeval
@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('0 1 Car 0 0 0 1 1 9 9 1 1 1 1 1 1 0\n' * 2, r'0000.txt:2: track 1 of class Car has two'),
        ('Car 0 0 0 1 1 9 9 1 1 1 1 1 1 0\n', r'0000.txt:1: no frame and no track id'),
        ('\xff\xfe', 'no file'),
    ],
)
def test_files_that_are_no_tracks_are_errors_of_one_line(text, reason, truth, tmp_path):
    (tmp_path / 'tracks').mkdir()
    (tmp_path / 'tracks' / '0000.txt').write_text(text, encoding='latin-1')
    folder = truth([box(0, 1)])
    with pytest.raises(KittiRos2Error) as error:
        evaluate_tracking(folder, tmp_path / 'tracks')
    assert '\n' not in str(error.value)
    if reason != 'no file':
        assert error.match(reason)


def test_a_label_with_two_boxes_is_an_error_of_the_ground_truth(truth, tracks):
    pytest.importorskip('trackeval')
    folder = truth([box(0, 1), box(0, 1, left=300)])
    with pytest.raises(BadFileError, match=r'label_02/0000.txt:2: track 1 of class Car has two'):
        evaluate_tracking(folder, tracks([box(0, 1)]))


@needs_trackeval
@pytest.mark.parametrize('kind', ['3d', '2d'])
def test_a_bag_scores_as_the_labels_it_was_made_of(kind, recordings, tmp_path):
    recording = open_recording(recordings[Layout.TRACKING])
    made = answers(recording) if kind == '3d' else answers_2d(recording)
    gone = [*stamps_of(recording)][2]
    path = write_bag(tmp_path / 'bag.mcap', [*made[:gone], *made[gone + 1 :]])
    scores = evaluate_tracking(recordings[Layout.TRACKING], path)
    (loss,) = scores.losses
    assert f'no message for frames {gone}' in loss.text()
    car = scores.classes['car']
    assert car['IDSW'] == 0
    assert car['CLR_FP'] == 0
    assert car['CLR_TP'] > 0
    assert car['MOTP'] > (99 if kind == '2d' else 70)


@needs_trackeval
def test_a_bag_is_of_one_sequence(tmp_path, recordings):
    recording = open_recording(recordings[Layout.TRACKING])
    path = write_bag(tmp_path / 'bag.mcap', answers(recording))
    boxes = [box(0, 1)]
    truth = write_tracks(tmp_path / 'gt', {'0000': boxes, '0001': boxes}, 'label_02')
    with pytest.raises(UsageError, match='choose it with --sequence'):
        evaluate_tracking(truth, path)


@needs_trackeval
@pytest.mark.parametrize(
    ('results', 'reason'),
    [('absent', 'no such file'), ('empty', 'the folder is empty'), ('others', 'has no 0000.txt')],
)
def test_results_that_are_missing_are_errors(results, reason, truth, tmp_path):
    (tmp_path / 'empty').mkdir()
    write_tracks(tmp_path / 'others', {'0004': [box(0, 1)]})
    folder = truth([box(0, 1)])
    with pytest.raises(KittiRos2Error, match=reason):
        evaluate_tracking(folder, tmp_path / results)


@needs_trackeval
def test_ground_truth_without_labels_is_an_error(recordings, tmp_path):
    tracks = write_tracks(tmp_path / 'tracks', {'0000': [box(0, 1)]})
    with pytest.raises(KittiRos2Error, match='tracking'):
        evaluate_tracking(recordings[Layout.RAW], tracks)
    with pytest.raises(UsageError, match='ground truth is a tracking set with label_02'):
        evaluate_tracking(tracks / '0000.txt', tracks)


@needs_trackeval
def test_exchanged_arguments_are_noticed(truth, tmp_path):
    tracks, labelled = write_tracks(tmp_path / 'tracks', {'0000': [box(0, 1)]}), truth([box(0, 1)])
    for results in (tracks, tracks / '0000.txt'):
        with pytest.raises(UsageError, match='has the labels; give GT first, then RESULTS'):
            evaluate_tracking(results, labelled)
    with pytest.raises(MissingPathError):
        evaluate_tracking(tmp_path / 'absent', labelled)


def test_without_trackeval_the_error_says_what_to_install(truth, tracks, monkeypatch):
    folder, results = truth([box(0, 1)]), tracks([box(0, 1)])
    monkeypatch.setattr('kitti_ros2.evaluation.track_metrics.find_spec', lambda _: None)
    with pytest.raises(UsageError, match=r"run pip install 'kitti_ros2\[eval\]'"):
        evaluate_tracking(folder, results)


@needs_trackeval
def test_the_command_prints_a_table_of_80_columns_and_losses(truth, tracks, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    labels = [box(frame, 1) for frame in range(3)]
    folder, results = truth(labels), tracks([*labels, box(0, -1)])
    assert main(['eval', 'tracking', str(folder), str(results)]) == 1
    out, err = capsys.readouterr()
    assert max(map(len, out.splitlines())) <= 80
    assert out.startswith('1 sequence (0000), 3 frames\n')
    rows = [line.split() for line in out.splitlines()]
    assert ' '.join(rows[1]) == 'class HOTA DetA AssA MOTA MOTP IDF1 IDs FRAG MT PT ML'
    assert rows[2] == ['car', *['100.00'] * 6, '0', '0', '1', '0', '0']
    assert rows[3] == ['pedestrian', *'-' * 11]
    assert out.endswith('\n- has no objects and no tracks\n')
    assert 'track id below 0' in err
    assert main(['eval', 'tracking', str(folder), str(results), '-q']) == 1
    assert capsys.readouterr().out == ''


@needs_trackeval
def test_json_has_the_figures_by_class(truth, tracks, capsys):
    labels = [box(frame, 1) for frame in range(3)]
    assert main(['eval', 'tracking', str(truth(labels)), str(tracks(labels)), '--json']) == 0
    values = json.loads(capsys.readouterr().out)
    assert [*values] == ['tracking', 'sequences', 'frames', 'losses']
    assert [*values['tracking']] == ['car', 'pedestrian']
    car = values['tracking']['car']
    assert (car['HOTA'], car['MOTA'], car['IDF1'], car['IDSW']) == (100, 100, 100, 0)
    assert values['sequences']['0000']['car'] == car
    assert values['frames'] == 3
    nobody = values['tracking']['pedestrian']
    assert (nobody['HOTA'], nobody['MOTA'], nobody['IDR'], nobody['CLR_FP']) == (
        None,
        None,
        None,
        0,
    )
