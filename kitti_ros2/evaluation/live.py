# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores a running stack: its results on a recording that is played to it, and its latency."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import threading
import time
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..api.arguments import by_name, warn_of
from ..bags.locate import looks_like_bag
from ..bags.writer import guess_storage, open_bag
from ..files.remote import as_path
from ..files.staging import refuse_inside
from ..messages.cdr import deserialize, peek_header, stamp_ns_of
from ..messages.ros_types import TYPESTORE
from ..model.bag_formats import MARKERS, TF, Channel
from ..model.errors import (
    KittiRos2Error,
    Loss,
    UsageError,
    describe_error,
    did_you_mean,
    format_count,
    one_line,
    some_of,
)
from ..model.streams import NS_PER_S, format_stamp
from ..options.evaluation import (
    LIVE,
    make_detection_options,
    make_live_options,
    make_odometry_options,
    make_tracking_options,
)
from ..options.outputs import BagOptions
from ..player.playback import Answers
from ..player.ros_installation import check_installed
from .detection import score_detection
from .ground_truth import read_ground_truth
from .odometry import open_truth, score_odometry
from .track_metrics import check_trackeval
from .tracking import find_sequences, score_tracking
from .trajectories import check_evo

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from typing_extensions import Self, Unpack

    from ..bags.writer import BagWriter
    from ..options.evaluation import LiveOptions
    from ..options.keywords import LiveKeywords
    from ..player.run import LivePlayer


# Scores of a run: checks before it, and the evaluation of its results after it.

if TYPE_CHECKING:
    OptionValues = Mapping[str, object]


def check_task(task: str, source: Path, played: OptionValues) -> None:
    """Check that results can be scored: ground truth exists, and required packages are installed.

    Args:
        task: The evaluation.
        source: The ground truth.
        played: The options of the player.

    Raises:
        KittiRos2Error: They cannot.
    """
    _TASKS[task].check(source, _truth_options(task, played))


def score_results(
    task: str, source: Path, bag: Path, played: OptionValues, run: LiveRun, align: str | None = None
) -> Any:  # noqa: ANN401 - DetectionScores, TrackingScores or OdometryScores
    """Score the results in a bag with the ground truth of a source.

    Losses of frames without an answer are left out: the run has them already.

    Args:
        task: The evaluation.
        source: The ground truth.
        bag: The results.
        played: The options of the player.
        run: The run, whose frames are scored.
        align: Alignment of poses; None is the default.
    """
    values = {**_truth_options(task, played), 'topic': run.topic}
    if task == 'odometry':
        values['align'] = align
    scores = _TASKS[task].score(source, bag, values, run)
    answered = run.answers.latencies_ns
    losses = (loss.among(answered) for loss in scores.losses)
    return replace(scores, losses=tuple(loss for loss in losses if loss is not None))


def _truth_options(task: str, played: OptionValues) -> OptionValues:
    """Select the options of the player that also apply to the ground truth."""
    names = {'sequence'} if task == 'tracking' else {'layout', 'sequence'}
    return {name: value for name, value in played.items() if name in names}


def _check_detection(source: Path, values: OptionValues) -> None:
    read, _, _ = make_detection_options(values)
    read_ground_truth(source, read)


def _score_detection(source: Path, bag: Path, values: OptionValues, _: LiveRun) -> Any:  # noqa: ANN401
    return score_detection(source, bag, *make_detection_options(values))


def _check_tracking(source: Path, values: OptionValues) -> None:
    check_trackeval()
    if looks_like_bag(source):
        raise UsageError(
            f'{source}: is a bag, whose tracks are not read as ground truth; give the KITTI folder'
            f' that it was made from'
        )
    read, _ = make_tracking_options(values)
    names = [sequence.name for sequence in find_sequences(source, read)]
    if len(names) > 1:
        raise UsageError(f'{source}: choose what is played with --sequence ({some_of(names)})')


def _score_tracking(source: Path, bag: Path, values: OptionValues, run: LiveRun) -> Any:  # noqa: ANN401
    options = make_tracking_options(values)
    return score_tracking(
        source, bag, *options, lambda _done, _total: None, {*run.answers.frames()}
    )


def _check_odometry(source: Path, values: OptionValues) -> None:
    check_evo()
    open_truth(source, *make_odometry_options(values))


def _score_odometry(source: Path, bag: Path, values: OptionValues, run: LiveRun) -> Any:  # noqa: ANN401
    return score_odometry(source, bag, *make_odometry_options(values), {*run.answers.frames()})


class _Task(NamedTuple):
    check: Callable[[Path, OptionValues], None]
    score: Callable[[Path, Path, OptionValues, LiveRun], Any]


_TASKS = {
    'detection': _Task(_check_detection, _score_detection),
    'tracking': _Task(_check_tracking, _score_tracking),
    'odometry': _Task(_check_odometry, _score_odometry),
}


# A run of a stack: its answers; frames without an answer, as losses and notes.


@dataclass
class LiveRun:
    """The course of a run.

    Attributes:
        answers: The answers of the stack.
        topic: The topic with its results.
        msgtype: The type of the topic.
        losses: Frames without an answer, and data that could not be played.
        notes: One line each.
    """

    answers: Answers
    topic: str
    msgtype: str = ''
    losses: list[Loss] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def missing(self) -> tuple[int, ...]:
        """The frames that were sent and not answered."""
        answered = self.answers.latencies_ns
        return tuple(number for number in self.answers.frames() if number not in answered)


def describe_no_answer(run: LiveRun, problem: str) -> str:
    """Describe why no frame was answered; problem is the reason of an early end, or empty."""
    answers = run.answers
    frames = format_count(len(answers.frames()), 'frame')
    text = f'{run.topic}: no frame was answered ({frames} sent)'
    if problem:
        text += f'; {problem}'
    if answers.between:
        text += f'; {format_count(answers.between, "message")} with a stamp between two frames'
    return f'{text}; {_describe_strays(answers)}' if answers.strays else text


def add_losses(run: LiveRun, problem: str, total: int) -> None:
    """Add unsent and unanswered frames to the losses and notes of a run.

    Args:
        run: The run.
        problem: The reason of an early end, empty without one.
        total: Number of frames to send.
    """
    answers = run.answers
    sent = len(answers.frames())
    missing = run.missing
    if problem and (missing or sent < total):
        reason = f'{problem}; {sent} of {total} frames were sent'
        run.losses.append(Loss(run.topic, max(1, total - sent), reason))
    elif sent < total:
        count = format_count(total - sent, 'frame')
        run.notes.append(f'{count} of {total} have nothing that the node subscribes to')
    if missing:
        run.losses.append(Loss(run.topic, len(missing), 'no answer to frames {}', missing))
    if answers.strays:
        run.losses.append(Loss(run.topic, answers.strays, _describe_strays(answers)))
    if answers.repeated:
        run.notes.append(f'{answers.repeated} more messages for frames answered before')
    if answers.between:
        run.notes.append(f'{answers.between} more messages with a stamp between two frames')
    if answers.on_the_way > 1:
        run.notes.append(
            f'up to {answers.on_the_way} frames were on their way at once, because an answer came'
            f' late or not at all; latencies include the wait'
        )


def _describe_strays(answers: Answers) -> str:
    first = answers.first_stray_ns
    shown = 'none' if first is None or first < 0 else format_stamp(first)
    return (
        f'{format_count(answers.strays, "message")} with the stamp of no frame, the first'
        f' {shown}; a result must have the stamp of the scan or image that it was made from'
    )


# The process of a node under test, in a process group of its own.

_STOPS = ((signal.SIGINT, 8.0), (signal.SIGTERM, 4.0), (signal.SIGKILL, 2.0))
"""Signals that stop a node, each with the seconds until the next one."""
_SHELL = re.compile(r'^\s*(source|export|cd|\.|\w+=\S*)\s|[;&|<>]')
_SHELL_HINT = '; no shell interprets it: for what a shell does, give "bash -c \'...\'"'
_NO_SIGNAL = 0  # only checks whether there is a process
_POLL_S = 0.02
_SAY_AFTER_S = 4.0
_LAST_OUTPUT_S = 0.5


class StackError(KittiRos2Error):
    """The stack under test does not start, or gives no answer."""


class NodeProcess:
    """A command that runs until it is stopped; as a context manager it is stopped at the end.

    Args:
        command: Its words as for a shell; no shell interprets it.
        show: Called with each line of output, from another thread.

    Raises:
        UsageError: The command is invalid, or cannot be started.
    """

    def __init__(self, command: str, show: Callable[[bytes], object]) -> None:
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise UsageError(f'--node {command!r} cannot be split into words: {error}') from None
        if not words:
            raise UsageError('--node is empty; give the command that starts the node')
        try:
            self._process = subprocess.Popen(  # noqa: S603 - the user's own command
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env={'PYTHONUNBUFFERED': '1', **os.environ},
            )
        except OSError as error:
            hint = _SHELL_HINT if _SHELL.search(command) else ''
            raise UsageError(f'--node cannot be started: {describe_error(error)}{hint}') from None
        self._show = show
        self._last_line = b''
        self._reader = threading.Thread(target=self._read, name='node-output', daemon=True)
        self._reader.start()
        self.killed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def ended(self) -> str:
        """Describe the exit and the last line of output; empty while it runs."""
        code = self._process.poll()
        if code is None:
            return ''
        self._reader.join(_LAST_OUTPUT_S)  # other processes of the group may keep the pipe open
        how = f'exit code {code}' if code >= 0 else f'killed by {signal.Signals(-code).name}'
        line = one_line(self._last_line.decode(errors='replace').strip())
        return f'{how}; its last line: {line}' if line else how

    def stop(self) -> None:
        """Stop all processes of the group: SIGINT, then SIGTERM, then SIGKILL."""
        try:
            for number, seconds in _STOPS:
                self.killed = self._signal(number) and number is signal.SIGKILL
                if self._is_gone_within(seconds):
                    break
        except (KeyboardInterrupt, SystemExit):  # a second Ctrl-C or SIGTERM
            self._signal(signal.SIGKILL)
            raise
        self._reader.join(_LAST_OUTPUT_S)

    def _is_gone_within(self, seconds: float) -> bool:
        end = time.monotonic() + seconds
        while self._signal(_NO_SIGNAL):
            if time.monotonic() > end:
                return False
            time.sleep(_POLL_S)
        return True

    def _signal(self, number: int) -> bool:
        """Send a signal to the group; return whether it has a process."""
        self._process.poll()  # a process that has ended counts until its code is read
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)
            return True
        return False

    def _read(self) -> None:
        assert self._process.stdout is not None  # noqa: S101 - PIPE
        with self._process.stdout as output:
            for line in output:
                self._last_line = line if line.strip() else self._last_line
                with suppress(OSError):  # a node blocks if nobody reads its output
                    self._show(line)


# One run of a stack: it is started, played to, recorded and stopped.

if TYPE_CHECKING:
    Progress = Callable[[int, int], None]

__all__ = ['Latency', 'LiveScores', 'evaluate_live']

_TRANSFORMS = (Channel('/tf', TF, depth=100), Channel('/tf_static', TF, latched=True, depth=100))


def record_run(
    source: Path,
    options: LiveOptions,
    played: Mapping[str, object],
    bag: Path,
    accept: Callable[[str], None],
    show: Callable[[bytes], object],
    progress: Progress,
) -> LiveRun:
    """Play a source to a stack and write its results to a bag, with the transforms.

    Args:
        source: A KITTI folder or a bag.
        options: Options of the run.
        played: Options of the player, by name.
        bag: The bag to write.
        accept: Called with the type of the topic; raises if it cannot be scored.
        show: Called with each line of the node's output, and with a note if the start takes long.
        progress: Called with the numbers of answered frames and of all.

    Raises:
        KittiRos2Error: The source cannot be played, or the stack does not start or answer.
    """
    from ..player.run import open_live_player  # noqa: PLC0415 - needs rclpy

    answers = Answers(options.timeout_ns)
    storage = BagOptions(storage=guess_storage(bag), overwrite=options.overwrite)
    with (
        open_bag(bag, storage, TYPESTORE) as writer,
        open_live_player(source, played, options.wait_for, answers) as player,
        nullcontext() if options.node is None else NodeProcess(options.node, show) as node,
    ):
        session = _LiveSession(player, node, options, writer, answers, accept)
        try:
            session.wait_until_ready(show)
            session.play(progress)
        finally:
            session.end_recording()
    if node is not None and node.killed:
        session.run.notes.append('the node was killed: it ended neither by SIGINT nor by SIGTERM')
    return session.run


class _LiveSession:
    """The player, the node and the bag of a run."""

    def __init__(
        self,
        player: LivePlayer,
        node: NodeProcess | None,
        options: LiveOptions,
        bag: BagWriter,
        answers: Answers,
        accept: Callable[[str], None],
    ) -> None:
        self._player = player
        self._node = node
        self._options = options
        self._bag = bag
        self._answers = answers
        self._accept = accept
        self._begin_ns = int(player.session.program.stamps_ns[0])
        self._error: KittiRos2Error | None = None
        self._writing = threading.Lock()
        self._recording = True
        self.run = LiveRun(answers, options.topic, notes=[*player.session.program.notes()])

    def wait_until_ready(self, show: Callable[[bytes], object]) -> None:
        """Wait until the topic has a publisher, and enough nodes subscribe.

        Args:
            show: Called with a line, once, if it takes longer than _SAY_AFTER_S.

        Raises:
            StackError: The node has ended, or the time is up.
            KittiRos2Error: Results of the topic's type cannot be scored.
        """
        self._refuse_own_topic()
        limit_s = self._options.start_timeout_ns / NS_PER_S
        begin_s, said = time.monotonic(), False
        while not (self._connect_topic() and not self._player.playback.state().waiting):
            if self._node is not None and (how := self._node.ended()):
                raise StackError(f'the node ended before the first frame: {how}')
            waited_s = time.monotonic() - begin_s
            if waited_s > limit_s:
                raise StackError(self._describe_missing(limit_s))
            if waited_s > _SAY_AFTER_S and not said:
                said = True
                missing = self._describe_missing(_SAY_AFTER_S)
                show(f'note: waiting for {limit_s:g} s: {missing}\n'.encode())
            time.sleep(_POLL_S)
        topic = self._options.topic
        if (publishers := self._player.count_publishers(topic)) > 1:
            self.run.notes.append(f'{topic} has {publishers} publishers: their results are mixed')
        for channel in _TRANSFORMS:
            self._record(channel)

    def play(self, progress: Progress) -> None:
        """Play everything and wait for the last answer; problems become losses.

        Raises:
            StackError: The stack has answered no frame.
            KittiRos2Error: The player or the bag failed.
        """
        player, answers = self._player, self._answers
        total = len({*player.session.program.frames.tolist()})
        player.playback.resume()
        problem = ''
        while not (problem or player.error or (player.ended.is_set() and answers.all_in())):
            time.sleep(_POLL_S)
            progress(len(answers.latencies_ns), total)
            problem = self._problem()
        player.playback.stop()
        player.ended.wait()
        if player.error is not None:
            raise player.error
        if not answers.latencies_ns:
            raise StackError(describe_no_answer(self.run, problem))
        add_losses(self.run, problem, total)
        for reason, lost in player.session.counts.dropped.items():
            self.run.losses.append(Loss('player', max(1, lost), reason))

    def _connect_topic(self) -> bool:
        """Subscribe to the topic once it has a publisher; return whether it is connected."""
        topic = self._options.topic
        msgtypes = [] if self.run.msgtype else self._player.types_of(topic)
        if msgtypes:
            self.run.msgtype = self._choose(msgtypes)
            self._record(Channel(topic, self.run.msgtype))
        return self._player.hears(topic)

    def _choose(self, msgtypes: list[str]) -> str:
        """Return the type to subscribe to, of those that the topic has.

        Raises:
            KittiRos2Error: It is not the one requested, one of several, or none that can be scored.
        """
        chosen = self._options.msgtype or msgtypes[0]
        if chosen not in msgtypes or (len(msgtypes) > 1 and self._options.msgtype is None):
            raise UsageError(f'{self._options.topic} is {" and ".join(msgtypes)}; give --type')
        self._accept(chosen)
        return chosen

    def _record(self, channel: Channel) -> None:
        """Subscribe to a topic, and write its messages to the bag."""
        with self._writing:
            number = self._bag.add_channel(channel)
        is_result = channel.topic == self._options.topic

        def receive(data: bytes) -> None:
            try:
                if is_result:
                    self._answers.received(stamp_of(data, channel.msgtype))
                with self._writing:
                    if self._recording:
                        stamp_ns = self._answers.newest_ns or self._begin_ns
                        self._bag.write(number, stamp_ns, (data,))
            except KittiRos2Error as error:
                self._error = self._error or error

        self._player.hear(channel.topic, channel.msgtype, receive)

    def end_recording(self) -> None:
        """Ignore what is received from now on: a player that closes slowly still receives."""
        with self._writing:
            self._recording = False

    def _problem(self) -> str:
        """Describe why the run cannot continue; empty if it can."""
        answers = self._answers
        if self._error is not None:
            raise self._error
        if self._node is not None and (how := self._node.ended()):
            return f'the node ended early: {how}'
        if answers.flooded():
            frames = format_count(len(answers.frames()), 'frame')
            return f'{answers.messages} messages for {frames}; a node answers each frame once'
        if answers.silent():
            return f'no answer within {self._options.timeout_ns / NS_PER_S:g} s'
        return ''

    def _refuse_own_topic(self) -> None:
        topics = [channel.topic for channel in self._player.session.program.channels]
        if self._options.topic in topics:
            raise UsageError(f'{self._options.topic} is played itself; give a topic of the node')

    def _describe_missing(self, seconds: float) -> str:
        topic = self._options.topic
        if not self._player.hears(topic):
            others = self._player.others()
            hint = did_you_mean(topic, others) or (
                f'; others publish {some_of(others)}' if others else '; nobody publishes anything'
            )
            return f'{topic} has no publisher after {seconds:g} s{hint}'
        channels = self._player.session.program.channels
        offered = some_of([channel.topic for channel in channels if channel.on_demand])
        needed = self._options.wait_for
        few = 'no node' if needed == 1 else f'fewer than {needed} nodes'
        return f'{few} subscribed to the player within {seconds:g} s; it offers {offered}'


def stamp_of(data: bytes, msgtype: str) -> int | None:
    """Return the stamp of a serialised result, nanoseconds; None if it has none.

    That of a MarkerArray is the latest of its markers: the first may only delete the others.
    """
    try:
        if msgtype != MARKERS:
            return peek_header(data)[0]
        markers = deserialize(data, MARKERS).markers
    except Exception:  # noqa: BLE001 - a damaged message may raise anything
        return -1
    return max((stamp_ns_of(marker.header) for marker in markers), default=0) or None


@dataclass(frozen=True)
class Latency:
    """Time from publishing a scan to receiving the answer with its stamp, milliseconds.

    Attributes:
        median_ms, p95_ms, max_ms: Median, 95th percentile and maximum over the answered frames.
    """

    median_ms: float
    p95_ms: float
    max_ms: float


@dataclass(frozen=True)
class LiveScores:
    """The scores of a running stack.

    Attributes:
        task: The evaluation: detection, odometry or tracking.
        scores: The result of that evaluation, such as DetectionScores.
        frames: Number of frames sent.
        missing: Numbers of the frames without an answer.
        stragglers: Number of answers received after the answer to a later frame.
        latency: Latency of the answers.
        latencies_ns: By frame, nanoseconds.
        bag: The bag of the results, if it is kept.
        losses: Frames without an answer, and data that was not played or scored.
        notes: One line each.
    """

    task: str
    scores: Any
    frames: int
    missing: tuple[int, ...]
    stragglers: int
    latency: Latency
    latencies_ns: Mapping[int, int]
    bag: Path | None
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def evaluate_live(source: str | os.PathLike[str], **options: Unpack[LiveKeywords]) -> LiveScores:
    """Play a recording to a stack, score its results, and measure its latency.

    The player is lossless: it sends a frame when the one before is answered, with /clock. The
    command of `node` runs in a process group of its own and is stopped at the end.

    Args:
        source: A KITTI folder or a bag, with ground truth.
        options: Options of `kitti-ros2 eval live --help-all`, same defaults; topic is required.

    Returns:
        The scores. Each loss is also a KittiRos2Warning.

    Raises:
        KittiRos2Error: The source cannot be played, the stack does not start or answers no frame,
            or its results cannot be scored.
    """
    scores = run_live(as_path(source), *make_live_options(by_name(options, LIVE)))
    warn_of(scores.losses)
    return scores


def run_live(
    source: Path,
    options: LiveOptions,
    played: Mapping[str, object],
    show: Callable[[bytes], object] = lambda _: None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> LiveScores:
    """Run evaluate_live with parsed options.

    Args:
        source: A KITTI folder or a bag.
        options: Options of the run.
        played: Options of the player, by name.
        show: Called with each line of the node's output, from another thread, and with a note if
            the start takes long.
        progress: Called with the numbers of answered frames and of all.
    """
    check_installed()
    requested_task = options.known_task()
    if requested_task is not None:
        check_task(requested_task, source, played)

    def accept(msgtype: str) -> None:
        task = options.task_of(msgtype)
        if task != requested_task:
            check_task(task, source, played)

    with ExitStack() as exit_stack:
        if options.out is None:
            folder = exit_stack.enter_context(TemporaryDirectory(prefix='kitti_ros2_'))
            bag = Path(folder) / 'results.mcap'
        else:
            bag = options.out
            refuse_inside(source, bag)
        run = record_run(source, options, played, bag, accept, show, progress)
        task = options.task_of(run.msgtype)
        scores = score_results(task, source, bag, played, run, options.align.value)
    return LiveScores(
        task=task,
        scores=scores,
        frames=len(run.answers.frames()),
        missing=run.missing,
        stragglers=run.answers.stragglers,
        latency=_latency(run.answers.latencies_ns),
        latencies_ns=dict(run.answers.latencies_ns),
        bag=options.out,
        losses=(*run.losses, *scores.losses),
        notes=(*run.notes, *scores.notes),
    )


def _latency(latencies_ns: Mapping[int, int]) -> Latency:
    median, p95, most = np.percentile([*latencies_ns.values()], [50, 95, 100]) / 1e6
    return Latency(float(median), float(p95), float(most))
