# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Predictions from result files to messages: compared with labels, with scores, never labels."""

from __future__ import annotations

import shutil
from filecmp import dircmp
from typing import TYPE_CHECKING

import pytest
from prediction_set import LABELS, RESULTS, track_lines, write_prediction_set, write_results

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.drawing.labelled_objects import NEUTRAL_COLOR, PREDICTION_COLOR, VERDICT_COLORS
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.model.boxes import Verdict
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program

if TYPE_CHECKING:
    from pathlib import Path

MARKERS, DETECTIONS, BOXES_2D = (
    f'/kitti/predictions/{name}' for name in ('markers', 'detections', 'boxes_2d')
)
COLORS = {
    'true_positive': VERDICT_COLORS[Verdict.TRUE_POSITIVE],
    'false_positive': VERDICT_COLORS[Verdict.FALSE_POSITIVE],
    'miss': VERDICT_COLORS[Verdict.FALSE_NEGATIVE],
    'uncounted': NEUTRAL_COLOR,
    'prediction': PREDICTION_COLOR,
}
CUBE, LINES, ARROW, TEXT, DELETE_ALL = 1, 5, 0, 9, 3


@pytest.fixture
def made(recordings, tmp_path):
    return write_prediction_set(recordings[Layout.OBJECT], tmp_path)


def to_bag(source: Path, results: Path, *words: str) -> tuple[int, Path]:
    out = source.parent / 'bag.mcap'
    return main(['to-bag', str(source), str(out), '--predictions', str(results), *words]), out


def messages_of(bag: Path, topic: str) -> list:
    with open_messages(bag, {topic}) as messages:
        return [deserialize(each.data, each.msgtype) for each in messages]


def texts_of(message) -> dict[str, list[str]]:
    """By namespace the texts, without their distances."""
    found: dict[str, list[str]] = {}
    for marker in message.markers:
        if marker.type == TEXT:
            found.setdefault(marker.ns, []).append(marker.text.partition('\n')[0])
    return found


def test_each_result_has_its_namespace_text_and_colour(made, capsys):
    code, bag = to_bag(*made)
    assert code == 1
    assert 'no result file for frames 4' in capsys.readouterr().err
    arrays = messages_of(bag, MARKERS)
    assert [texts_of(each) for each in arrays] == [
        {
            'true_positive': ['Car 0.90 TP IoU 0.90'],
            'false_positive': ['Car 0.80 FP'],
            'uncounted': ['Car 0.70'],
            'miss': ['Car FN'],
        },
        {'false_positive': ['Car 0.60 FP IoU 0.60'], 'miss': ['Car FN']},
        {'false_positive': ['Pedestrian 0.40 FP']},
        {'prediction': ['Car 0.50']},
    ]
    for array in arrays:
        first, *others = array.markers
        assert first.action == DELETE_ALL
        assert len({(each.ns, each.id) for each in others}) == len(others)
        for each in others:
            assert each.header.frame_id == 'velo_link'
            rgb = (each.color.r, each.color.g, each.color.b)
            expected = (1, 1, 1) if each.type == TEXT else [v / 255 for v in COLORS[each.ns]]
            assert rgb == pytest.approx(expected, abs=1e-6)


def test_an_object_has_four_markers_at_its_place(made):
    _, bag = to_bag(*made, '-q')
    array, *_ = messages_of(bag, MARKERS)
    hit = [each for each in array.markers if each.ns == 'true_positive']
    assert [each.type for each in hit] == [CUBE, LINES, ARROW, TEXT]
    assert (hit[0].scale.x, hit[0].scale.y, hit[0].scale.z) == (4.0, 2.0, 1.5)
    boxes = messages_of(bag, DETECTIONS)[0].detections
    assert hit[0].pose.position == boxes[0].bbox.center.position


@pytest.mark.parametrize(
    ('words', 'expected'),
    [
        (['0.5'], ['Car 0.60 TP IoU 0.60']),
        (['Car=0.5'], ['Car 0.60 TP IoU 0.60']),
        (['0.5', 'Car=0.65'], None),
        (['Pedestrian=0.1'], None),
    ],
)
def test_the_least_overlap_is_chosen(made, words, expected):
    _, bag = to_bag(*made, '-q', '--iou', *words)
    texts = texts_of(messages_of(bag, MARKERS)[1])
    assert texts.get('true_positive') == expected
    assert ('miss' in texts) is (expected is None)


def test_detections_have_the_scores_of_the_files(made):
    _, bag = to_bag(*made, '-q')
    for topic in (DETECTIONS, BOXES_2D):
        scores = [
            [each.results[0].hypothesis.score for each in message.detections]
            for message in messages_of(bag, topic)
        ]
        assert scores == [[box[-1] for box in RESULTS[number]] for number in range(4)]


def test_all_is_stamped_like_the_labels(made):
    _, bag = to_bag(*made, '-q')
    labels = open_recording(made.root).streams[Stream.LABELS]
    stamp_of = dict(zip(labels.numbers.tolist(), labels.stamps_ns.tolist(), strict=True))
    with open_messages(bag, {MARKERS, DETECTIONS, BOXES_2D}) as messages:
        stamps = {each.stamp_ns for each in messages}
    assert {stamp_of[number] for number in (0, 1, 2)} < stamps
    assert len(stamps) == len(RESULTS)


def test_without_predictions_there_are_no_topics_of_them(made):
    out = made.root.parent / 'plain.mcap'
    main(['to-bag', str(made.root), str(out), '-q'])
    with open_messages(out) as messages:
        assert not [topic for topic, _ in messages.channels if 'predictions' in topic]


@pytest.mark.parametrize(
    ('words', 'topics'),
    [
        (['--topics', MARKERS], {MARKERS}),
        (['--streams', 'predictions'], {MARKERS, DETECTIONS, BOXES_2D}),
    ],
)
def test_predictions_can_be_selected(made, words, topics):
    _, bag = to_bag(*made, '-q', *words)
    with open_messages(bag) as messages:
        assert {topic for topic, _ in messages.channels} == topics


def test_losses_outside_of_the_selection_do_not_count(made, capsys):
    assert to_bag(*made, '--end', '2')[0] == 0
    assert to_bag(*made, '--start', '4', '--overwrite')[0] == 1
    assert 'no result file for frames 4' in capsys.readouterr().err
    assert to_bag(*made, '--start', '4', '--exclude-topics', '/kitti/pred*', '--overwrite')[0] == 0


def test_a_bad_line_costs_itself(made, capsys):
    path = made.results / '000000.txt'
    path.write_text(f'Car 1 2\n{path.read_text()}')
    code, bag = to_bag(*made, '-q')
    assert code == 1
    assert f'{path}:1: 3 columns' in capsys.readouterr().err
    assert len(messages_of(bag, DETECTIONS)[0].detections) == 3


def test_an_unreadable_file_costs_its_frame(made, capsys):
    (made.results / '000001.txt').write_bytes(b'\xff')
    code, bag = to_bag(*made, '-q')
    assert code == 1
    assert '000001.txt: byte 0 is no text' in capsys.readouterr().err
    assert len(messages_of(bag, MARKERS)) == 3


def test_a_calibration_is_needed_for_3d_boxes_alone(made, capsys):
    (made.root / 'training/calib/000000.txt').unlink()
    code, bag = to_bag(*made, '-q')
    assert code == 1
    assert '000000.txt: no such file' in capsys.readouterr().err
    assert len(messages_of(bag, BOXES_2D)) == 4
    assert len(messages_of(bag, MARKERS)) == 3


def test_a_tracker_s_frames_without_objects_are_compared(recordings, tmp_path):
    """A sequence has one label file, so frames that it does not name have no object."""
    sequence = shutil.copytree(recordings[Layout.TRACKING], tmp_path / 'tracking')
    labels = sequence / 'training/label_02/0000.txt'
    labels.write_text(track_lines({0: LABELS[1], 2: LABELS[1]}))
    results = tmp_path / 'tracks.txt'
    results.write_text(track_lines({0: RESULTS[0][:1], 3: RESULTS[1]}))
    code, bag = to_bag(sequence, results, '-q')
    assert code == 0
    assert [texts_of(each) for each in messages_of(bag, MARKERS)] == [
        {'true_positive': ['Car 0 0.90 TP IoU 0.90']},
        {},
        {'miss': ['Car 0 FN']},
        {'false_positive': ['Car 0 0.60 FP']},
        {},
    ]


def differences(comparison: dircmp) -> list[str]:
    found = [*comparison.left_only, *comparison.right_only, *comparison.diff_files]
    return found + [each for below in comparison.subdirs.values() for each in differences(below)]


def test_the_bag_restores_the_set_and_not_the_predictions(made):
    _, bag = to_bag(*made, '-q')
    back = made.root.parent / 'back'
    assert main(['to-kitti', str(bag), str(back), '-q']) == 0
    assert differences(dircmp(made.root, back)) == []


def test_recorded_predictions_are_no_labels(made, capsys):
    """Without its own texts a bag is converted as that of another robot."""
    words = ('--exclude-topics', '/kitti/source/*', '/kitti/labels/*')
    _, bag = to_bag(*made, '-q', *words)
    back = made.root.parent / 'back'
    main(['to-kitti', str(bag), str(back), '--layout', 'object'])
    assert 'missing: labels' in capsys.readouterr().out
    assert not list(back.rglob('label_2/*'))


def test_labels_are_taken_from_the_topic_of_labels(made):
    _, bag = to_bag(*made, '-q', '--exclude-topics', '/kitti/source/*')
    back = made.root.parent / 'back'
    main(['to-kitti', str(bag), str(back), '--layout', 'object', '-q'])
    text = (back / 'training/label_2/000000.txt').read_text()
    assert [line.split()[0] for line in text.splitlines()] == ['Car', 'Car', 'Van']


def test_info_lists_the_topics(made, capsys):
    _, bag = to_bag(*made, '-q')
    capsys.readouterr()
    assert main(['info', str(bag)]) == main(['info', str(made[0])]) == 1  # a frame lacks labels
    out = capsys.readouterr().out
    assert all(topic in out for topic in (MARKERS, DETECTIONS, BOXES_2D))


def test_the_player_sends_what_to_bag_writes(made):
    _, bag = to_bag(*made, '-q', '--iou', '0.5')
    settings = make_play_settings({'predictions': str(made.results), 'iou': 0.5})
    program = open_program(made.root, settings)
    assert any('no result file for frames 4' in loss for loss in program.losses)
    topics = [each.topic for each in program.channels]
    played = {
        (topics[each.channel], each.stamp_ns, each.data)
        for index in range(len(program.stamps_ns))
        for each in program.fetch(index, range(len(topics)))[0]
        if 'predictions' in topics[each.channel]
    }
    with open_messages(bag, {MARKERS, DETECTIONS, BOXES_2D}) as messages:
        assert {(each.topic, each.stamp_ns, bytes(each.data)) for each in messages} == played


def test_a_bag_takes_no_result_files(made):
    _, bag = to_bag(*made, '-q')
    with pytest.raises(UsageError, match='predictions are for KITTI folders, and this is a bag'):
        open_program(bag, make_play_settings({'predictions': str(made.results)}))


def test_results_that_are_none_leave_nothing_behind(made, capsys):
    code, out = to_bag(made.root, made.root / 'training/calib/nothing')
    assert code == 2
    assert 'no such file or folder' in capsys.readouterr().err
    assert not out.exists()


def test_an_iou_needs_predictions(made, capsys):
    out = made.root.parent / 'out.mcap'
    assert main(['to-bag', str(made.root), str(out), '--iou', '0.5']) == 2
    assert '--iou is for --predictions; give both' in capsys.readouterr().err


def test_more_results_than_frames(made, capsys):
    write_results(made.root.parent / 'more', RESULTS | {4: [], 12: []})
    code, _ = to_bag(made.root, made.root.parent / 'more')
    assert code == 1
    assert 'results of frames 12, which training does not have' in capsys.readouterr().err
