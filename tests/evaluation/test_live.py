# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A stack is played to, recorded, scored and stopped; what goes wrong is said in one line."""

import re
import shlex
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

import kitti_ros2
from kitti_ros2.bags.reader import open_messages, summarize_bag
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.evaluation import live
from kitti_ros2.evaluation.live import NodeProcess, StackError
from kitti_ros2.messages.cdr import deserialize, peek_header
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import CLOUD, DETECTIONS_3D, TF, Channel
from kitti_ros2.model.errors import Loss, UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.evaluation import make_live_options
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.player.playback import Answers

pytestmark = pytest.mark.programs

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

TOPIC = '/answering/boxes'
FRAMES = 5


def node(behaviour):
    program = Path(__file__).with_name('answering_node.py')
    return shlex.join([sys.executable, str(program), behaviour])


@dataclass(frozen=True)
class NoScores:
    """What scoring returns; the tests here are about the run."""

    losses: tuple = ()
    notes: tuple = ()


@pytest.fixture
def run(recordings, monkeypatch):
    """Run a node on the synthetic drive."""
    scored = []

    def score(task, source, bag, _, live_run, align):
        scored.append((task, source, bag, live_run.topic))
        assert align == 'first'
        return NoScores()

    def run(behaviour, **options):
        scored.clear()
        monkeypatch.setattr(live, 'check_task', lambda *_: None)
        monkeypatch.setattr(live, 'score_results', score)
        return live.evaluate_live(
            recordings[Layout.RAW],
            **{'topic': TOPIC, 'node': node(behaviour), 'timeout': 3, **options},
        ), scored

    return run


def test_every_frame_is_answered_and_recorded(run, tmp_path, recordings):
    out = tmp_path / 'boxes.mcap'
    scores, ((task, source, bag, topic),) = run('all', out=out, timeout=60)
    assert (task, source, bag, topic) == ('detection', recordings[Layout.RAW], out, TOPIC)
    assert (scores.frames, scores.missing, scores.stragglers) == (FRAMES, (), 0)
    assert [*scores.latencies_ns] == [0, 1, 2, 3, 4]
    assert 0 < scores.latency.median_ms <= scores.latency.p95_ms <= scores.latency.max_ms
    assert scores.losses == ()
    assert scores.notes == ()
    with open_messages(out, {TOPIC, '/tf_static'}) as messages:
        by_topic = {}
        for message in messages:
            by_topic.setdefault(message.topic, []).append(message)
    scans = [frame.stamp_ns for frame in kitti_ros2.open(recordings[Layout.RAW])]
    assert [peek_header(message.data)[0] for message in by_topic[TOPIC]] == scans
    assert [message.stamp_ns for message in by_topic[TOPIC]] == scans
    (box,) = deserialize(by_topic[TOPIC][0].data, DETECTIONS_3D).detections
    assert box.results[0].hypothesis.class_id == 'Car'
    assert by_topic['/tf_static']
    assert summarize_bag(out).complete


def test_a_node_that_runs_already_is_noted(run):
    with NodeProcess(node('all'), lambda _: None):
        scores, _ = run('all', timeout=60, wait_for=2)
    assert scores.notes[0] == f'{TOPIC} has 2 publishers: their results are mixed'


def test_a_node_that_answers_late_gets_the_next_frame(run):
    scores, _ = run('late')
    assert scores.missing == (FRAMES - 1,)
    assert scores.losses == (Loss(TOPIC, 1, 'no answer to frames {}', (FRAMES - 1,)),)
    assert scores.stragglers == 0
    assert 'up to 2 frames were on their way at once' in scores.notes[0]


def test_a_node_that_crashes_costs_the_frames_that_follow(run):
    scores, _ = run('crash', timeout=60)
    assert [*scores.latencies_ns] == [0, 1]
    first, second = (loss.text() for loss in scores.losses)
    assert first == (
        'the node ended early: killed by SIGABRT; its last line: out of memory;'
        ' 3 of 5 frames were sent'
    )
    assert second == 'no answer to frames 2'


@pytest.mark.parametrize(
    ('behaviour', 'complaint'),
    [
        ('exit', r'the node ended before the first frame: exit code 1; its last line: no module'),
        ('silent', r'no frame was answered \(\d frames? sent\); no answer within 1 s$'),
    ],
)
def test_a_node_without_answers_is_an_error(behaviour, complaint, run, tmp_path):
    with pytest.raises(StackError, match=complaint):
        run(behaviour, timeout=1, out=tmp_path / 'a.mcap')
    assert [*tmp_path.iterdir()] == []


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        ({'topic': '/kitti/labels/detections'}, '/kitti/labels/detections is played itself'),
        ({'task': 'odometry'}, 'Detection3DArray, which cannot be scored as odometry'),
        ({'type': 'nav_msgs/msg/Odometry', 'task': 'tracking'}, 'cannot be scored as tracking'),
        ({'type': 'nav_msgs/msg/Odometry'}, 'is vision_msgs/msg/Detection3DArray; give --type'),
        ({'type': 'sensor_msgs/msg/Imu'}, 'which cannot be scored; expected one of vision_msgs'),
        ({'topic': 'boxes'}, "'boxes' is no full name of a topic"),
        ({'topic': '/my boxes'}, "'/my boxes' is no full name of a topic"),
        ({'topic': ''}, '--topic is missing'),
        ({'node': ''}, '--node is empty; give the command that starts the node'),
        ({'timeout': 0}, 'timeout 0 is not within 1 to 3600'),
        ({'wait_for': 0}, 'wait_for 0 is not within 1 to 1000'),
        ({'task': 'detecting'}, "task takes detection, tracking or odometry, not 'detecting'"),
    ],
)
def test_what_cannot_be_scored_is_refused_before_it_is_played(options, complaint, run):
    with pytest.raises(UsageError, match=re.escape(complaint)):
        run('all', **options)


class Waiting:
    """A player to which nobody has subscribed, in a graph with a misspelt topic."""

    def __init__(self, heard):
        self._heard = heard
        self.session = self.program = self.playback = self
        self.channels = [Channel('/kitti/velo/points', CLOUD), Channel('/tf', TF)]
        self.stamps_ns = [0]
        self.waiting = True

    def state(self):
        return self

    def notes(self):
        return ()

    def types_of(self, _):
        return [DETECTIONS_3D] if self._heard else []

    def hear(self, topic, msgtype, receive):
        pass

    def hears(self, _):
        return self._heard

    def others(self):
        return [TOPIC, '/tf']


@pytest.mark.parametrize(
    ('heard', 'complaint'),
    [
        (False, '/answering/bxes has no publisher after 1 s; did you mean /answering/boxes?'),
        (
            True,
            'no node subscribed to the player within 1 s; it offers /kitti/velo/points',
        ),
    ],
)
def test_what_keeps_it_from_beginning_is_named(heard, complaint, tmp_path, monkeypatch):
    clock = SimpleNamespace(monotonic=count().__next__, sleep=lambda _: None)
    monkeypatch.setattr(live, 'time', clock)
    named = pytest.raises(StackError, match=re.escape(complaint))
    shown = []
    with new_stage(tmp_path, Waiting(heard), Answers(1)) as stage, named:
        stage.wait_until_ready(shown.append)
    assert shown == []


def test_a_long_start_is_explained_once_and_early(tmp_path, monkeypatch):
    clock = SimpleNamespace(monotonic=count().__next__, sleep=lambda _: None)
    monkeypatch.setattr(live, 'time', clock)
    shown = []
    stage = new_stage(tmp_path, Waiting(heard=False), Answers(1), start_timeout=60)
    with stage as session, pytest.raises(StackError, match='no publisher after 60 s'):
        session.wait_until_ready(lambda line: shown.append((clock.monotonic(), line)))
    ((seconds, line),) = shown
    assert seconds <= 7  # each look at this clock takes a second
    assert line == (
        b'note: waiting for 60 s: /answering/bxes has no publisher after 4 s; did you mean'
        b' /answering/boxes?\n'
    )


@contextmanager
def new_stage(folder, player, answers, start_timeout=1):
    options, _ = make_live_options({'topic': '/answering/bxes', 'start_timeout': start_timeout})
    with open_bag(folder / 'a.mcap', BagOptions(), TYPESTORE) as bag:
        yield live._LiveSession(player, None, options, bag, answers, options.task_of)


def test_a_flood_is_stopped(tmp_path):
    answers = Answers(10**12)
    answers.sent(0, 1, scan=True)
    with new_stage(tmp_path, Waiting(True), answers) as stage:
        for _ in range(1100):
            answers.received(1)
        assert stage._problem() == ''
        answers.received(1)
        problem = '1101 messages for 1 frame; a node answers each frame once'
        assert stage._problem() == problem


def test_answers_with_the_current_time_are_explained(tmp_path):
    answers = Answers(10**12)
    answers.sent(0, 1_317_000_000 * 10**9, scan=True)
    answers.received(1_700_000_000 * 10**9)
    with new_stage(tmp_path, Waiting(True), answers) as stage:
        assert live.describe_no_answer(stage.run, 'no answer within 30 s') == (
            '/answering/bxes: no frame was answered (1 frame sent); no answer within 30 s; 1'
            ' message with the stamp of no frame, the first 2023-11-14 22:13:20.000000000; a result'
            ' must have the stamp of the scan or image that it was made from'
        )
