# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player over the real middleware, heard by a second process."""

import itertools
import re
import signal
import subprocess
import sys
from contextlib import ExitStack

import numpy as np
import pytest
from mcap.writer import Writer

from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Images, MessageOptions

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import live

from builders import convert_recording, files_of  # isort: skip
from waiting import PATIENCE_S  # isort: skip

pytestmark = pytest.mark.programs

SCAN = '/kitti/velo/points'
TF = 'tf2_msgs/msg/TFMessage'
MARKERS = '/kitti/labels/markers'
OXTS = '/kitti/oxts/imu'
IMU = {OXTS: 'sensor_msgs/msg/Imu'}
POINTS = {SCAN: 'sensor_msgs/msg/PointCloud2'}
CLOCK = '/clock'
CLOCK_HZ = 40
TICKS = {CLOCK: 'rosgraph_msgs/msg/Clock'}
GOOD = {'/good': 'std_msgs/msg/String'}
FRAMES = 5  # of the small synthetic recordings


def write_texts(path, *topics):
    """A bag of five texts on each topic."""
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'test')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        for topic in topics:
            channel = writer.register_channel(topic, 'cdr', schema)
            for n in range(5):
                at = 10**9 + n * 10**8
                writer.add_message(channel, at, b'\0\1\0\0\3\0\0\0hi\0', at)
        writer.finish()


@pytest.fixture
def player():
    """Starts players, and sees to it that none is left."""
    started = []

    def start(*words, **more):
        started.append(live.play(*words, **more))
        return started[-1]

    yield start
    for process in started:
        live.stop(process)


@pytest.fixture
def listen():
    """Starts listeners."""
    started = []

    def start(topics):
        started.append(live.Listening(topics))
        return started[-1]

    yield start
    for listener in started:
        live.stop(listener.process)


@pytest.fixture
def record():
    """Starts recorders."""
    started = []

    def start(*out):
        started.append(live.Recording(*out))
        return started[-1]

    yield start
    for recorder in started:
        live.stop(recorder.process)


def to_bag(path, out, storage='mcap'):
    convert_recording(path, out, MessageOptions(images=Images.BOTH), storage=storage)
    return out


def hear_all(player, listen, src, bag, *options, without=()):
    """What a bag holds, and what is heard when something is played: digests by topic."""
    expected = {key: found for key, found in live.bag_digests(bag).items() if key[0] not in without}
    process = player(src, '--start-paused', '--wait-for', '1', *options)
    listener = listen(dict(expected.keys()))
    listener.wait_for_publishers(process)
    assert listener.tell('call', 'resume')[0]
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == int(bool(without)), said
    heard = listener.heard()
    return (
        {topic: digests for (topic, _), digests in expected.items()},
        {topic: [digest for _, digest in found] for topic, found in heard.items()},
    )


def test_live_bytes_are_the_bags(player, listen, recording_path, tmp_path):
    """Every message of every topic, in every layout."""
    bag = to_bag(recording_path, tmp_path / 'o.mcap')
    expected, heard = hear_all(player, listen, recording_path, bag)
    assert heard == expected


@pytest.mark.parametrize(
    ('words', 'parameters'),
    [
        (['--ring-time'], ['ring_time:=true']),
        (['--points', 'ouster'], ['points:=ouster']),
        (['--scan-stamp', 'start', '--period', '0.2'], ['scan_stamp:=start', 'period:=0.2']),
    ],
)
def test_options_of_scans_are_the_converter_s(
    player, listen, recordings, tmp_path, words, parameters
):
    source, bag = recordings[Layout.TRACKING], tmp_path / 'o.mcap'
    assert main(['to-bag', str(source), str(bag), '-q', '--streams', 'scan', *words]) == 0
    given = itertools.chain.from_iterable(('-p', each) for each in parameters)
    options = ('--streams', 'scan', '--ros-args', *given)
    expected, heard = hear_all(player, listen, source, bag, *options)
    assert heard == expected


@pytest.mark.parametrize('played', ['folder', 'bag'])
def test_objects_and_annotations_are_the_converter_s(player, listen, recordings, tmp_path, played):
    """Their types are installed nowhere: they are built at run time."""
    source, bag = recordings[Layout.TRACKING], tmp_path / 'o.mcap'
    streams = ('--streams', 'labels,image,calibration')
    made = ('--objects', 'autoware', '--annotations', '--images', 'both', *streams)
    assert main(['to-bag', str(source), str(bag), '-q', *made]) == 0
    src, options = (source, made) if played == 'folder' else (bag, ())
    expected, heard = hear_all(player, listen, src, bag, *options)
    assert {'/kitti/labels/tracked_objects', '/kitti/camera_color_left/annotations'} <= set(heard)
    assert heard == expected


def test_live_bytes_for_a_stack_are_the_bags(player, listen, recordings, tmp_path):
    source, bag = recordings[Layout.RAW], tmp_path / 'o.mcap'
    words = ['--streams', 'scan', 'oxts', 'calibration']
    assert main(['to-bag', str(source), str(bag), '-q', '--for', 'lio-sam', *words]) == 0
    given = ['--ros-args', '-p', 'stack:=lio-sam']
    expected, heard = hear_all(player, listen, source, bag, *words, *given)
    assert {'/points', '/imu/data', '/tf_static'} <= expected.keys()
    assert heard == expected


@pytest.mark.parametrize(
    ('storage', 'name'), [('mcap', 'o.mcap'), ('sqlite3', 'o'), ('ros1', 'o.bag')]
)
def test_a_bag_is_played_as_it_is(player, listen, recordings, tmp_path, storage, name):
    bag = to_bag(recordings[Layout.TRACKING], tmp_path / name, storage)
    # The markers of ROS 1 have no textures: they are no markers of ROS 2, and are left out.
    left_out = [MARKERS] if storage == 'ros1' else []
    expected, heard = hear_all(player, listen, bag, bag, '--rate', '2', without=left_out)
    assert heard == expected


def paused(player, listen, recordings, *options, topics=IMU):
    source = recordings[Layout.RAW]
    process = player(source, '--start-paused', '--at-end', 'pause', *options)
    listener = listen(topics)
    listener.wait_for_publishers(process, len(set(topics) - {CLOCK}))
    return process, listener


def hear_ticks(listener, seconds):
    """Wait while a player's clock, which also ticks while time stands, counts some seconds."""
    count = listener.tell('count', CLOCK) + int(seconds * CLOCK_HZ)
    assert listener.tell('wait', CLOCK, count) >= count


def test_controls(player, listen, recordings):
    process, listener = paused(player, listen, recordings)
    assert listener.tell('count', OXTS) == 0
    assert listener.tell('call', 'play_next') == [True, 'paused, frame 0']
    assert listener.tell('wait', OXTS, 1) == 1
    assert listener.tell('set', 'step', 2)[0]
    assert listener.tell('call', 'play_next') == [True, 'paused, frame 2']
    assert listener.tell('wait', OXTS, 3) == 3
    assert listener.tell('call', 'toggle_paused')[1].startswith('playing')
    assert listener.tell('call', 'play_next') == [False, 'time runs; pause first']
    assert listener.tell('wait', OXTS, FRAMES) == FRAMES
    listener.last_state('finished', 'true')
    assert listener.tell('call', 'play_next') == [False, 'there is nothing left to play']
    assert listener.tell('set', 'position', 1)[0]
    assert listener.tell('call', 'play_next') == [True, 'paused, frame 2']
    assert listener.tell('set', 'burst', 5)[0]
    state = listener.last_state('paused', 'true')
    assert state['failures'] == '0'
    assert listener.tell('call', 'stop') == [True, 'stopped']
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, said


def test_pause_holds_within_a_frame(player, listen, recordings):
    options = ('--loop', '--clock', CLOCK_HZ)
    process, listener = paused(player, listen, recordings, *options, topics=IMU | TICKS)
    assert listener.tell('call', 'resume')[0]
    assert listener.tell('wait', OXTS, 12) >= 12
    paused_now, said = listener.tell('call', 'pause')
    assert paused_now
    hear_ticks(listener, 0.5)  # what was on its way has arrived
    count = listener.tell('count', OXTS)
    frame = int(said.removeprefix('paused, frame '))
    assert (count - 1 - frame) % FRAMES in {0, 1, FRAMES - 1}
    hear_ticks(listener, 0.5)
    assert listener.tell('count', OXTS) == count
    assert live.end(process)[0] == 0


def test_seek_lands_on_the_frame(player, listen, recordings, tmp_path):
    bag = to_bag(recordings[Layout.RAW], tmp_path / 'o.mcap')
    digests = live.bag_digests(bag)[OXTS, IMU[OXTS]]
    _, listener = paused(player, listen, recordings)
    for frame in (3, 2, 4, 0):
        assert listener.tell('set', 'position', frame)[0]
        assert listener.tell('call', 'play_next')[0]
    assert listener.tell('wait', OXTS, 4) == 4
    assert [digest for _, digest in listener.heard()[OXTS]] == [digests[f] for f in (3, 2, 4, 0)]


def test_three_rounds(player, listen, recordings, tmp_path):
    digests = live.bag_digests(to_bag(recordings[Layout.TRACKING], tmp_path / 'o.mcap'))
    process = player(recordings[Layout.TRACKING], '--start-paused', '--times', '3', '--rate', '2')
    listener = listen(dict(digests.keys()))
    listener.wait_for_publishers(process)
    assert listener.tell('call', 'resume')[0]
    process.communicate(timeout=PATIENCE_S)
    assert {topic: len(found) for topic, found in listener.heard().items()} == {
        topic: 3 * len(found) for (topic, _), found in digests.items()
    }


@pytest.mark.parametrize('rate', [0.5, 2.0, 10.0])
def test_rate(player, listen, recordings, rate):
    """By the stamps of when each message is due."""
    _, listener = paused(player, listen, recordings, '--stamps', 'now')
    assert listener.tell('set', 'rate', rate) == [True, '']
    assert listener.tell('call', 'resume')[0]
    assert listener.tell('wait', OXTS, FRAMES) == FRAMES
    due = [stamp_ns for stamp_ns, _ in listener.heard()[OXTS]]
    recorded = open_recording(recordings[Layout.RAW]).streams
    stamps = next(index.stamps_ns for stream, index in recorded.items() if stream.value == 'oxts')
    np.testing.assert_allclose(np.diff(due), np.diff(stamps) / rate, rtol=0, atol=2_000_000)


@pytest.fixture(scope='class')
def looping(recordings):
    """What listens to a player that plays without end."""
    words = '--start-paused', '--at-end', 'pause', '--loop'
    with ExitStack() as started:
        process = live.play(recordings[Layout.RAW], *words)
        started.callback(live.stop, process)
        listener = live.Listening(IMU)
        started.callback(live.stop, listener.process)
        listener.wait_for_publishers(process)
        yield listener


class TestWhileItLoops:
    """One player for all, which ends with them: other tests must not hear it."""

    @pytest.mark.one_in(3)
    @pytest.mark.parametrize(
        ('name', 'value', 'reason'),
        [
            ('rate', 200.0, 'rate'),
            ('rate', -1.0, 'rate'),
            ('rate', '"fast"', 'rate takes a number'),
            ('rate', 'true', 'rate takes a number'),
            ('rate', 101, 'rate'),
            ('step', -1, 'step'),
            ('loop', -1, 'loop'),
            ('position', 99, 'there is no frame 99; it has 5 frames, 0 to 4'),
            ('position', '"soon"', 'invalid start or end'),
            ('source', '"/nowhere"', '/nowhere: no such file or folder'),
            ('source', '""', 'SRC is missing'),
            ('layout', '"round"', 'layout takes raw, object, odometry, tracking or kitti360'),
            ('clock', 10.0, 'read-only'),
        ],
    )
    def test_what_cannot_be_is_refused(self, looping, name, value, reason):
        assert looping.tell('call', 'pause')[0]
        successful, said = looping.tell('set', name, value)
        assert not successful
        assert reason in said
        assert '\n' not in said
        count = looping.tell('count', OXTS)
        assert looping.tell('call', 'resume')[0]
        assert looping.tell('wait', OXTS, count + 3) >= count + 3


def test_another_source(player, listen, recordings):
    """A bad one leaves the old one playing; a good one takes over, with its topics."""
    _, listener = paused(player, listen, recordings, '--loop', topics=POINTS)
    assert listener.tell('call', 'resume')[0]
    assert listener.tell('wait', SCAN, 2) >= 2
    assert not listener.tell('set', 'source', f'"{recordings[Layout.RAW]}/image_00"')[0]
    count = listener.tell('count', SCAN)
    assert listener.tell('wait', SCAN, count + 3) >= count + 3
    assert listener.tell('set', 'source', f'"{recordings[Layout.OBJECT]}"') == [True, '']
    listener.last_state('source', 'object')
    assert listener.tell('call', 'resume')[0]
    count = listener.tell('count', SCAN)
    assert listener.tell('wait', SCAN, count + 3) >= count + 3


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'topic',
    ['/a b', '', '/', '/1x', '/a{b}', '/a\nb', '/rosout', '/parameter_events', '/' + 'a' * 500],
)
def test_a_topic_that_cannot_be_published_costs_itself(player, listen, tmp_path, topic):
    bag = tmp_path / 'strange.mcap'
    write_texts(bag, topic, '/good')
    process = player(bag, '--start-paused', '--at-end', 'pause')
    listener = listen(GOOD)
    listener.wait_for_publishers(process, 1)
    assert listener.tell('call', 'resume')[0]
    assert listener.tell('wait', '/good', 5) >= 5
    code, said = live.end(process)
    assert code == 0
    (line,) = [line for line in said.splitlines() if '[ERROR]' in line]
    assert 'cannot be published: ' in line
    assert 'Traceback' not in said


def test_what_fails_after_a_change_leaves_the_old_source(player, listen, recordings, tmp_path):
    """The file of QoS overrides goes, and a source is given with a position that is none."""
    qos = tmp_path / 'qos.yaml'
    qos.write_text('/tf: {depth: 5}\n')
    options = '--loop', '--qos-overrides-path', str(qos)
    process, listener = paused(player, listen, recordings, *options, topics=POINTS)
    assert listener.tell('call', 'resume')[0]
    qos.unlink()
    other = f'"{recordings[Layout.OBJECT]}"'
    done, reason = listener.tell('set', 'source', other)
    assert (done, 'qos.yaml' in reason) == (False, True)
    qos.write_text('/tf: {depth: 5}\n')
    count = listener.tell('count', SCAN)
    assert listener.tell('wait', SCAN, count + 3) >= count + 3
    assert listener.tell('set', 'source', other) == [True, '']
    listener.last_state('source', 'object')
    assert live.end(process)[0] == 0


def test_a_late_subscriber_gets_what_is_latched(player, listen, recordings):
    latched = {
        '/tf_static': TF,
        '/kitti/ground_truth/path': 'nav_msgs/msg/Path',
        '/kitti/source/calibration': 'std_msgs/msg/String',
    }
    _, first = paused(player, listen, recordings)
    assert first.tell('call', 'resume')[0]
    assert first.tell('wait', OXTS, FRAMES) >= FRAMES
    late = listen(latched)
    assert [late.tell('wait', topic, 1) >= 1 for topic in latched] == [True] * 3


def test_the_frames_resolve_for_a_late_subscriber(player, listen, recordings):
    """From map to each camera, by what /tf_static and /tf hold."""
    process, first = paused(player, listen, recordings)
    assert first.tell('call', 'resume')[0]
    assert first.tell('wait', OXTS, 2) >= 2
    assert first.tell('call', 'pause')[0]
    late = listen({'/tf_static': TF, '/tf': TF})
    late.wait_for_publishers(process, 1 + len(late.topics))
    assert late.tell('set', 'position', 1)[0]
    assert late.tell('call', 'play_next')[0]
    parents = {}
    for topic in late.topics:
        assert late.tell('wait', topic, 1) >= 1
        message = deserialize(bytes.fromhex(late.tell('last', topic)), TF)
        parents |= {each.child_frame_id: each.header.frame_id for each in message.transforms}
    for camera in ('gray_left', 'gray_right', 'color_left', 'color_right'):
        chain = [f'camera_{camera}_optical_frame']
        while chain[-1] in parents:
            chain.append(parents[chain[-1]])
        assert chain[-4:] == ['velo_link', 'imu_link', 'base_link', 'map'], camera


def test_the_player_describes_a_type_without_its_package(player, listen, recordings):
    _, listener = paused(player, listen, recordings)
    successful, fields, known = listener.tell('describe', TF, TYPESTORE.hash_rihs01(TF))
    assert successful
    assert fields == [['transforms', 'geometry_msgs/msg/TransformStamped']]
    assert known == [
        'builtin_interfaces/msg/Time',
        'geometry_msgs/msg/Quaternion',
        'geometry_msgs/msg/Transform',
        'geometry_msgs/msg/TransformStamped',
        'geometry_msgs/msg/Vector3',
        'std_msgs/msg/Header',
    ]


def test_a_file_that_fails_costs_its_message(player, listen, drive):
    scan = drive / 'velodyne_points' / 'data' / '0000000003.bin'
    scan.write_bytes(b'1234567')
    process = player(drive, '--start-paused')
    listener = listen({**POINTS, **IMU})
    listener.wait_for_publishers(process)
    assert listener.tell('call', 'resume')[0]
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert said.count('0000000003.bin') == 2  # when it fails, and in the summary
    assert re.search(r'\d dropped: .*0000000003.bin', said)
    assert int(listener.last_state('finished', 'true')['failures']) >= 1
    heard = listener.heard()
    assert (len(heard[SCAN]), len(heard[OXTS])) == (FRAMES - 1, FRAMES)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    'module', ['kitti_ros2.cli.command', 'rclpy', 'kitti_ros2.player.session', None]
)
def test_a_signal_ends_it_cleanly(player, recordings, number, module):
    """As soon as it imports a module, or plays."""
    program = (
        'import sys; sys.addaudithook(lambda event, args: print("now", flush=True)'
        f' if event == "import" and args[0] == {module!r} else None); {live.MAIN}'
    )
    process = player(recordings[Layout.RAW], '--loop', program=program)
    assert (process.stdout if module else process.stderr).readline()
    code, said = live.end(process, number)
    assert (code, 'Traceback' in said, 'Error' in said) == (0, False, False), said


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['/nowhere'], 'no such file or folder'),
        ([], 'SRC is missing (a KITTI folder'),
        (['.', '--rate', '101'], 'rate 101 is not within 0.01 to 100'),
        (['.', '--stamps', 'later'], 'stamps takes original or now'),
        (['.', '--ros-args', '-p', 'rate:=fast'], 'rate'),
        (['.', '--ros-args', '-p'], 'ROS cannot start'),
        (['.', '--qos-profile-overrides-path', '/nowhere.yaml'], '/nowhere.yaml'),
    ],
)
def test_wrong_usage_is_one_line(player, recordings, words, said):
    process = player(
        None, *(str(recordings[Layout.RAW]) if w == '.' else w for w in words), program=live.MAIN
    )
    _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    # rcl writes a line of its own before the exception.
    lines = [line for line in complaint.splitlines() if not line.startswith('[')]
    assert len(lines) == 1, complaint
    assert said in lines[0]


def test_stamps_of_the_moment(player, listen, recordings):
    """Not the recording's: the same bytes would be the recording's stamps."""
    process = player(recordings[Layout.RAW], '--stamps', 'now', '--start-paused')
    listener = listen(IMU)
    listener.wait_for_publishers(process)
    assert listener.tell('call', 'resume')[0]
    process.communicate(timeout=PATIENCE_S)
    digests = [digest for _, digest in listener.heard()[OXTS]]
    assert len(set(digests)) == FRAMES


def test_ros2_run_finds_the_player(recordings):
    """The executable player is the command play, and takes everything as parameters."""
    parameters = [f'source:={recordings[Layout.RAW]}', 'rate:=10.0']
    words = ['--ros-args', *itertools.chain(*(('-p', each) for each in parameters))]
    words += ['-r', '__node:=other']
    main = 'import sys; from kitti_ros2.cli import player; sys.exit(player())'
    process = subprocess.run(
        [sys.executable, '-c', main, *words], env=live.environment(), capture_output=True,
        text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert '[other]' in process.stderr


@pytest.mark.parametrize('late', [False, True])
@pytest.mark.parametrize('storage', ['mcap', None], ids=['bag', 'folder'])
def test_a_recorder_of_everything_gets_everything(
    player, record, recordings, tmp_path, storage, late
):
    source = recordings[Layout.RAW]
    bag = to_bag(source, tmp_path / 'o.mcap')
    process = player(bag if storage else source, '--lossless')
    waits = 'waiting for a subscriber'
    first = next(line for line in process.stderr if waits in line) if late else ''
    recorder = record()
    _, said = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, 'had no subscriber' in said) == (0, False), said
    assert (first + said).count(waits) == 1
    expected = {topic: len(found) for (topic, _), found in live.bag_digests(bag).items()}
    counts = recorder.counts()
    assert {topic: counts.get(topic) for topic in expected} == expected


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.OBJECT])
def test_what_was_recorded_of_the_player_becomes_the_files(
    player, record, recordings, layout, tmp_path
):
    source, bag = recordings[layout], tmp_path / 'recorded.mcap'
    process = player(source, '--lossless')
    recorder = record(bag)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, said
    assert recorder.counts()['/kitti/source/recording'] == 1
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '-q']) == 0
    root = source.parent.parent if layout is Layout.RAW else source
    assert files_of(tmp_path / 'out') == files_of(root)


def test_the_second_subscriber_is_waited_for(player, record, listen, recordings):
    options = ('--wait-for', '2', '--delay', '0.5', '--clock', CLOCK_HZ)
    process = player(recordings[Layout.RAW], *options)
    listener = listen(IMU | TICKS)
    listener.wait_for_publishers(process, len(IMU))
    hear_ticks(listener, 1.5)
    assert listener.tell('count', OXTS) == 0
    recorder = record()
    process.communicate(timeout=PATIENCE_S)
    assert len(listener.heard()[OXTS]) == FRAMES
    assert recorder.counts()[OXTS] == FRAMES


def test_a_signal_ends_the_wait(player, recordings):
    process = player(recordings[Layout.RAW], '--lossless')
    line = next(line for line in process.stderr if 'waiting for a subscriber' in line)
    assert '--wait-for 0' in line
    code, said = live.end(process)
    assert (code, said) == (0, '')


def test_messages_without_a_subscriber_are_told_at_the_end(player, recordings):
    process = player(recordings[Layout.RAW], '--lossless', '--wait-for', '0')
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    found = re.search(r'(\d+) of (\d+) messages had no subscriber', said)
    assert found, said
    assert found[1] == found[2]
    assert '[WARN]' in said


def test_lossless_loses_nothing(player, listen, recordings):
    process = player(recordings[Layout.RAW], '--lossless', '--times', '20', '--start-paused')
    listener = listen({**POINTS, **IMU})
    listener.wait_for_publishers(process)
    assert listener.tell('call', 'resume')[0]
    process.communicate(timeout=PATIENCE_S)
    heard = listener.heard()
    assert (len(heard[SCAN]), len(heard[OXTS])) == (20 * FRAMES, 20 * FRAMES)
    assert heard[SCAN] == 20 * heard[SCAN][:FRAMES]
