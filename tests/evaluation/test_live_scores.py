# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What cannot be scored is refused before it is played; only frames that were played are scored."""

import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from builders import convert_recording

from kitti_ros2.evaluation import live, track_metrics, trajectories
from kitti_ros2.evaluation.live import LiveRun
from kitti_ros2.evaluation.track_metrics import TrackBox, TrackBoxes
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.bag_formats import DETECTIONS_3D, ODOMETRY
from kitti_ros2.model.errors import KittiRos2Error, Loss, UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.evaluation import Alignment, make_live_options
from kitti_ros2.player.playback import Answers

from result_bag import TOPIC, answers, write_bag  # isort: skip


@pytest.fixture
def refusal(monkeypatch):
    """A function that returns the error of a run, which ends before anything is started."""
    monkeypatch.setattr(live, 'check_installed', lambda: None)
    monkeypatch.setattr(live, 'record_run', pytest.fail)
    for module in (live, trajectories):
        monkeypatch.setattr(module, 'check_evo', lambda: None)
    monkeypatch.setattr(live, 'check_trackeval', lambda: None)

    def refusal(source, **options):
        with pytest.raises(KittiRos2Error) as error:
            live.evaluate_live(source, topic='/boxes', node='no-such-program', **options)
        return str(error.value)

    return refusal


@pytest.mark.parametrize(
    ('layout', 'options', 'complaint'),
    [
        (Layout.ODOMETRY, {'task': 'detection'}, 'odometry 00 has no labels'),
        (Layout.ODOMETRY, {'type': DETECTIONS_3D}, 'odometry 00 has no labels'),
        (Layout.OBJECT, {'task': 'odometry'}, 'training has no poses'),
        (Layout.OBJECT, {'type': ODOMETRY}, 'training has no poses'),
        (Layout.RAW, {'task': 'tracking'}, 'no tracking recording; it is layout raw'),
    ],
)
def test_a_source_without_ground_truth_is_refused(layout, options, complaint, refusal, recordings):
    assert complaint in refusal(recordings[layout], **options)


def test_tracks_in_a_bag_are_no_ground_truth(refusal, recordings, tmp_path):
    bag = tmp_path / 'drive.mcap'
    convert_recording(recordings[Layout.RAW], bag)
    said = 'drive.mcap: is a bag, whose tracks are not read as ground truth; give the KITTI folder'
    assert said in refusal(bag, task='tracking')


def test_tracks_are_of_one_sequence(refusal, recordings, tmp_path):
    root = tmp_path / 'tracking'
    shutil.copytree(recordings[Layout.TRACKING], root)
    for path in [*root.glob('training/*/0000*')]:
        other = path.with_name(path.name.replace('0000', '0001'))
        shutil.copytree(path, other) if path.is_dir() else shutil.copy(path, other)
    said = refusal(root, task='tracking')
    assert said.endswith('choose what is played with --sequence (0000, 0001)')


@pytest.mark.parametrize(
    ('task', 'module', 'package'),
    [('odometry', trajectories, 'evo'), ('tracking', track_metrics, 'trackeval')],
)
def test_what_is_not_installed_is_named_first(task, module, package, monkeypatch, recordings):
    monkeypatch.setattr(live, 'check_installed', lambda: None)
    monkeypatch.setattr(live, 'record_run', pytest.fail)
    monkeypatch.setattr(module, 'find_spec', lambda _: None)
    complaint = f"needs {package}, which is not installed; run pip install 'kitti_ros2[eval]'"
    with pytest.raises(KittiRos2Error, match=re.escape(complaint)):
        live.evaluate_live(recordings[Layout.OBJECT], topic='/boxes', task=task)


@pytest.mark.parametrize(
    ('msgtype', 'complaint'),
    [
        (DETECTIONS_3D, 'odometry 00 has no labels'),
        ('sensor_msgs/msg/Imu', '/boxes is sensor_msgs/msg/Imu, which cannot be scored'),
    ],
)
def test_the_type_of_the_topic_is_checked_as_soon_as_it_is_known(
    msgtype, complaint, monkeypatch, recordings
):
    monkeypatch.setattr(live, 'check_installed', lambda: None)
    monkeypatch.setattr(live, 'record_run', lambda *given: given[4](msgtype))
    with pytest.raises(KittiRos2Error, match=re.escape(complaint)):
        live.evaluate_live(recordings[Layout.ODOMETRY], topic='/boxes')


@pytest.mark.parametrize(
    ('name', 'complaint'),
    [
        ('taken.mcap', 'taken.mcap: exists already; choose another name, or pass --overwrite'),
        ('boxes.db3', 'boxes.db3: results are written as MCAP or ROS 1; give /'),
        ('file/boxes.mcap', 'boxes.mcap: cannot be written (Not a directory)'),
    ],
)
def test_a_bag_that_cannot_be_written_is_refused(
    name, complaint, monkeypatch, recordings, tmp_path
):
    pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')
    monkeypatch.setattr(live, 'NodeProcess', pytest.fail)
    for taken in ('taken.mcap', 'file'):
        (tmp_path / taken).touch()
    with pytest.raises(KittiRos2Error, match=re.escape(complaint)):
        live.evaluate_live(recordings[Layout.RAW], topic='/boxes', out=tmp_path / name)


def run_of(recording, played, answered):
    """A run in which some frames were sent, and some of these answered."""
    run_answers = Answers(10**12)
    for frame in recording:
        if frame.number in played:
            run_answers.sent(frame.number, frame.number, scan=True)
        if frame.number in answered:
            run_answers.received(frame.number)
    return LiveRun(run_answers, TOPIC, DETECTIONS_3D)


def test_frames_without_an_answer_are_lost_once_and_others_not(recordings, tmp_path):
    source = recordings[Layout.RAW]
    recording = open_recording(source)
    messages = answers(recording)
    bag = write_bag(tmp_path / 'boxes.mcap', [messages[1], messages[3]])
    frames = [SimpleNamespace(number=number) for number in range(5)]
    run = run_of(frames, played={1, 2, 3}, answered={1, 3})
    scores = live.score_results('detection', source, bag, {}, run)
    assert scores.frames == 2
    assert scores.losses == ()
    assert run.missing == (2,)


def test_a_result_in_an_unknown_frame_says_why_nothing_is_scored(recordings, tmp_path):
    source = recordings[Layout.RAW]
    bag = write_bag(tmp_path / 'boxes.mcap', answers(open_recording(source), 'nowhere'))
    frames = [SimpleNamespace(number=number) for number in range(5)]
    run = run_of(frames, played={*range(5)}, answered={*range(5)})
    with pytest.raises(KittiRos2Error, match="no transform at its stamp joins frame 'nowhere'"):
        live.score_results('detection', source, bag, {}, run)


def test_tracks_of_frames_that_were_not_played_are_not_scored():
    every = [TrackBox('car', frame, 7, None) for frame in range(4)]
    tracks = TrackBoxes(every, (Loss('tracks', 1, 'line 9'),), 3)
    assert tracks.among(None) == tracks
    assert tracks.among({1, 3}) == TrackBoxes([every[1], every[3]], tracks.losses, 3)


def test_tracking_scores_the_frames_that_were_played(recordings, tmp_path):
    pytest.importorskip('trackeval', reason="needs trackeval (pip install 'kitti_ros2[eval]')")
    source = recordings[Layout.TRACKING]
    recording = open_recording(source)
    bag = write_bag(tmp_path / 'boxes.mcap', answers(recording)[1:4])
    frames = [SimpleNamespace(number=number) for number in range(5)]
    run = run_of(frames, played={1, 2, 3}, answered={1, 2, 3})
    scores = live.score_results('tracking', source, bag, {}, run)
    assert (scores.frames, scores.losses) == (3, ())
    assert scores.classes['car']['MOTA'] == 100


def test_the_evaluation_is_known_from_the_task_or_the_type():
    for given, task in [
        ({}, None),
        ({'task': 'tracking'}, 'tracking'),
        ({'type': ODOMETRY}, 'odometry'),
        ({'type': DETECTIONS_3D, 'task': 'tracking'}, 'tracking'),
    ]:
        assert make_live_options({'topic': '/boxes', **given})[0].known_task() == task


def test_poses_are_aligned_as_the_options_say(monkeypatch):
    options, _ = make_live_options({'topic': '/odom', 'type': ODOMETRY, 'align': 'sim3'})
    assert options.known_task() == 'odometry'
    aligned = []

    def score(_source, _bag, _read, chosen, _frames):
        aligned.append(chosen.align)
        raise UsageError('scored')

    monkeypatch.setattr(live, 'score_odometry', score)
    for align in (None, options.align.value):
        run = run_of([], played=set(), answered=set())
        with pytest.raises(UsageError, match='scored'):
            live.score_results('odometry', Path('gt'), Path('bag'), {}, run, align)
    assert aligned == [Alignment.FIRST, Alignment.SIM3]


def test_boxes_cannot_be_aligned():
    options, _ = make_live_options({'topic': '/boxes', 'align': 'scale'})
    with pytest.raises(UsageError, match='--align is for poses; /boxes is scored as detection'):
        options.task_of(DETECTIONS_3D)
