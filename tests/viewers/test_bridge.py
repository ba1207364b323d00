# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The server as a real WebSocket client meets it."""

import base64
import json
import re
import socket
import struct
import threading
from collections import defaultdict

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Images, MessageOptions, Objects
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program
from kitti_ros2.player.session import WARN

pytest.importorskip('foxglove', reason='needs foxglove-sdk (pip install kitti_ros2[test])')
pytest.importorskip('websockets', reason='needs websockets (pip install kitti_ros2[test])')

from kitti_ros2.viewers.foxglove_server import ViewerServer
from kitti_ros2.viewers.origin_check import OriginCheck

from viewer import ENDED, PAUSE, PAUSED, PLAY, PLAYING, Viewer  # isort: skip

from builders import convert_recording  # isort: skip
from waiting import PATIENCE_S  # isort: skip

pytestmark = pytest.mark.programs

STATE = '/kitti_player/state'
SCAN = '/kitti/velo/points'
OXTS = '/kitti/oxts/imu'
MARKERS = '/kitti/labels/markers'
LATCHED = ('/tf_static', '/kitti/ground_truth/path', '/kitti/source/calibration')
SECOND = 1_000_000_000
FRAMES = 5  # of the small synthetic recordings


@pytest.fixture
def serve():
    """Starts servers, and ends them."""
    servers = []

    def start(source, **values):
        settings = make_play_settings({'at_end': 'pause', 'clock': 20, **values})
        complaints = []
        program = open_program(str(source), settings)
        admission = OriginCheck('127.0.0.1')
        servers.append(ViewerServer(program, settings, 0, complaints.append, admission))
        servers[-1].complaints = complaints
        servers[-1].start()
        return servers[-1]

    yield start
    for server in servers:
        server.stop()


@pytest.fixture
def raw(serve, recordings):
    """Plays the raw drive."""
    return lambda **values: serve(recordings[Layout.RAW], **values)


def to_bag(path, out, storage='mcap'):
    convert_recording(path, out, MessageOptions(images=Images.BOTH), storage=storage)
    return out


def bag_bytes(path):
    """By topic the messages of a bag, in order, each filled up as in ROS 2."""
    found = defaultdict(list)
    with open_messages(path) as messages:
        for message in messages:
            data = bytes(message.data)
            found[message.topic].append(data + bytes(-len(data) % 4))
    return dict(found)


def heard_bytes(viewer):
    found = defaultdict(list)
    for message in viewer.messages:
        if message.topic != STATE:
            found[message.topic].append(message.data)
    return dict(found)


def status(viewer):
    return viewer.states[-1].status if viewer.states else None


def decode(viewer, message):
    """A message by the definition that its channel was advertised with."""
    channel = viewer.channels[message.topic]
    assert (channel['encoding'], channel['schemaEncoding']) == ('cdr', 'ros2msg')
    schema = Schema(id=1, name=channel['schemaName'], encoding='ros2msg',
                    data=channel['schema'].encode())  # fmt: skip
    return DecoderFactory().decoder_for('cdr', schema)(message.data)


def state_values(viewer):
    """The values of the last state message."""
    heard = viewer.of(STATE)
    return {each.key: each.value for each in decode(viewer, heard[-1]).status[0].values}


def play_through(server):
    """A viewer that has heard everything."""
    viewer = Viewer(server.url)
    viewer.subscribe()
    # The message follows all others; the status may overtake them.
    viewer.until(
        lambda: (
            status(viewer) == ENDED
            and viewer.of(STATE)
            and state_values(viewer)['finished'] == 'true'
        )
    )
    return viewer


def test_live_bytes_are_the_bags(serve, recording_path, tmp_path):
    """Every message of every topic in every layout, and each is what its channel says."""
    expected = bag_bytes(to_bag(recording_path, tmp_path / 'o.mcap'))
    with play_through(serve(recording_path)) as viewer:
        assert heard_bytes(viewer) == expected
        for message in viewer.messages:
            decoded = decode(viewer, message)
            msgtype = viewer.channels[message.topic]['schemaName']
            ours = TYPESTORE.deserialize_cdr(message.data, msgtype)
            if hasattr(ours, 'header'):
                assert decoded.header.stamp.nanosec == ours.header.stamp.nanosec
                assert decoded.header.frame_id == ours.header.frame_id
        stamps = [message.log_time for message in viewer.of(OXTS)]
        assert stamps == sorted(stamps)


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.OBJECT, Layout.TRACKING])
def test_objects_and_annotations_are_the_bags(serve, recordings, tmp_path, layout):
    options = MessageOptions(images=Images.BOTH, objects=Objects.BOTH, annotations=True)
    bag = tmp_path / 'o.mcap'
    convert_recording(recordings[layout], bag, options)
    values = {'objects': 'both', 'annotations': True}
    with play_through(serve(recordings[layout], **values)) as viewer:
        assert heard_bytes(viewer) == bag_bytes(bag)
        heard = viewer.of('/kitti/camera_color_left/annotations')
        assert len(heard) == FRAMES
        name = viewer.channels[heard[0].topic]['schemaName']
        assert name == 'foxglove_msgs/msg/ImageAnnotations'
        images = viewer.of('/kitti/camera_color_left/image_rect/compressed')
        for message, image in zip(heard, images, strict=True):
            stamp = decode(viewer, image).header.stamp
            loop = decode(viewer, message).points[0]
            assert (loop.timestamp.sec, loop.timestamp.nanosec) == (stamp.sec, stamp.nanosec)


@pytest.mark.parametrize(
    ('storage', 'name'), [('mcap', 'o.mcap'), ('sqlite3', 'o'), ('ros1', 'o.bag')]
)
def test_a_bag_is_played_as_it_is(serve, recordings, tmp_path, storage, name):
    bag = to_bag(recordings[Layout.TRACKING], tmp_path / name, storage)
    with play_through(serve(bag, rate=2)) as viewer:
        assert heard_bytes(viewer) == bag_bytes(bag)
        for topic in viewer.channels:
            assert decode(viewer, viewer.of(topic)[-1])


def test_raw_images_are_made_of_a_bags_compressed_ones(serve, recordings, tmp_path):
    expected = bag_bytes(to_bag(recordings[Layout.TRACKING], tmp_path / 'both.mcap'))
    bag = tmp_path / 'o.mcap'
    convert_recording(recordings[Layout.TRACKING], bag)
    annotated = '/kitti/camera_color_left/annotated'
    with play_through(serve(bag, annotated=True)) as viewer:
        heard = heard_bytes(viewer)
    assert len(heard.pop(annotated)) == len(heard.pop(annotated.replace('left', 'right'))) == FRAMES
    assert heard == expected


def test_it_says_what_it_plays(raw):
    server = raw(start_paused=True)
    with Viewer(server.url) as viewer:
        assert viewer.info['name'] == server.session.program.name
        assert set(viewer.info['capabilities']) == {'time', 'playbackControl'}
        stamps = server.session.program.stamps_ns
        assert viewer.range == (stamps[0], stamps[-1])
        assert server.url in server.web_url.replace('%3A', ':').replace('%2F', '/')


def test_it_waits_for_a_viewer(raw):
    server = raw()
    with Viewer(server.url) as viewer:
        viewer.hear_ticks(10)
        assert not viewer.messages
        assert set(viewer.times) == {viewer.range[0]}
        viewer.subscribe(OXTS)
        viewer.until(lambda: len(viewer.of(OXTS)) == FRAMES)


def test_start_paused_waits_for_the_button(raw):
    with Viewer(raw(start_paused=True).url) as viewer:
        viewer.subscribe(OXTS, STATE)
        viewer.hear_ticks(8)
        assert not viewer.of(OXTS)
        assert viewer.control(PLAY).status == PLAYING
        viewer.until(lambda: len(viewer.of(OXTS)) == FRAMES)


def test_pause_and_resume(raw):
    with Viewer(raw(loop=0).url) as viewer:
        viewer.subscribe(OXTS)
        viewer.until(lambda: len(viewer.of(OXTS)) == 3)
        assert viewer.control(PAUSE).status == PAUSED
        viewer.hear_ticks(4)  # and what was on its way
        count, times = len(viewer.messages), len(viewer.times)
        viewer.hear_ticks(10)
        assert len(viewer.messages) == count
        assert len(set(viewer.times[times:])) == 1
        assert viewer.control(PLAY).status == PLAYING
        viewer.until(lambda: len(viewer.messages) >= count + 2)


def test_seek_while_it_plays(raw):
    """Forwards and backwards; what comes next is not before the time asked for."""
    with Viewer(raw(rate=0.5).url) as viewer:
        viewer.subscribe(OXTS)
        viewer.until(lambda: len(viewer.of(OXTS)) == 2)
        first, last = viewer.range
        for target in (first + (last - first) * 3 // 4, first):
            # So slowly that the time of the answer hardly counts.
            answer = viewer.control(PLAY, rate=0.01, seek=target)
            assert (answer.status, answer.did_seek) == (PLAYING, True)
            assert target <= answer.time < target + SECOND // 20
            count = len(viewer.of(OXTS))
            viewer.control(PLAY, rate=0.5)
            viewer.until(lambda: len(viewer.of(OXTS)) > count)  # noqa: B023 - called at once
            heard = viewer.of(OXTS)[count]
            assert target <= heard.log_time < target + SECOND // 5


@pytest.mark.parametrize('frame', [3, 0, 4])
def test_seek_while_paused_shows_the_frame(raw, frame):
    server = raw(start_paused=True)
    program = server.session.program
    with Viewer(server.url) as viewer:
        viewer.subscribe(SCAN, OXTS)
        positions = np.flatnonzero(program.frames == frame)
        answer = viewer.control(PAUSE, seek=int(program.stamps_ns[positions[-1]]) + 1)
        assert (answer.status, answer.did_seek) == (PAUSED, True)
        viewer.until(lambda: viewer.of(SCAN) and viewer.of(OXTS))
        viewer.hear_ticks(6)
        assert [len(viewer.of(topic)) for topic in (SCAN, OXTS)] == [1, 1]
        stamps = program.stamps_ns[positions]
        assert all(stamps[0] <= each.log_time <= stamps[-1] for each in viewer.of(SCAN))


@pytest.mark.parametrize('rate', [0.5, 4.0])
def test_rate(raw, rate):
    """Messages are due at the rate, and none is sent before."""
    server = raw(start_paused=True)
    outlet = next(i for i, each in enumerate(server.session.program.channels) if each.topic == OXTS)
    sent = []
    server.session.on_publish = lambda *call: sent.append(call) if call[0] == outlet else None
    with Viewer(server.url) as viewer:
        viewer.subscribe(OXTS)
        assert viewer.control(PLAY, rate=rate).rate == rate
        viewer.until(lambda: len(viewer.of(OXTS)) == FRAMES)
        recorded = np.diff([message.log_time for message in viewer.of(OXTS)])
        _, due, published = np.transpose(sent)
        np.testing.assert_allclose(np.diff(due), recorded / rate, rtol=0, atol=2)
        assert np.all(published >= due)


@pytest.mark.parametrize(('asked', 'taken'), [(0.01, 0.01), (0.001, 0.01), (1000.0, 100.0)])
def test_a_rate_out_of_range_becomes_the_next_one(raw, asked, taken):
    with Viewer(raw(start_paused=True).url) as viewer:
        assert viewer.control(PAUSE, rate=asked).rate == taken


def test_it_rests_at_the_end_and_play_begins_anew(raw):
    with play_through(raw(rate=4)) as viewer:
        answer = viewer.control(PLAY, rate=4)
        assert (answer.status, answer.did_seek) == (PLAYING, True)
        viewer.until(lambda: len(viewer.of(OXTS)) == 2 * FRAMES)
        viewer.until(lambda: status(viewer) == ENDED)
        back = viewer.control(PAUSE, seek=viewer.range[0])
        assert (back.status, back.time) == (PAUSED, viewer.range[0])


def test_each_round_is_a_jump(raw):
    with Viewer(raw(loop=3, rate=4).url) as viewer:
        viewer.subscribe(OXTS)
        # The status may overtake messages.
        viewer.until(lambda: status(viewer) == ENDED and len(viewer.of(OXTS)) >= 3 * FRAMES)
        viewer.hear_ticks(2)
        assert len(viewer.of(OXTS)) == 3 * FRAMES
        assert [state.did_seek for state in viewer.states].count(True) == 2


def test_a_late_subscriber_gets_what_is_latched(raw):
    server = raw(rate=4)
    with play_through(server) as first, Viewer(server.url) as late:
        late.subscribe()
        expected = heard_bytes(first)
        late.until(lambda: all(len(late.of(t)) >= len(expected[t]) for t in LATCHED))
        for topic in LATCHED:
            assert [each.data for each in late.of(topic)] == expected[topic]
        late.until(lambda: late.of(STATE))
        values = state_values(late)
        assert (values['finished'], values['failures']) == ('true', '0')


def test_what_is_latched_is_renewed_after_a_seek(raw):
    """A viewer forgets all it has when time jumps; news of that may overtake messages."""
    with Viewer(raw(start_paused=True).url) as viewer:
        viewer.subscribe()
        for part in (0.9, 0.3):
            first, last = viewer.range
            before = {topic: len(viewer.of(topic)) for topic in LATCHED}
            viewer.control(PAUSE, seek=first + int(part * (last - first)))
            viewer.until(lambda: all(len(viewer.of(t)) > before[t] for t in LATCHED))  # noqa: B023


def hear_rounds(viewer, count):
    heard = len(viewer.of(OXTS))
    viewer.until(lambda: len(viewer.of(OXTS)) >= heard + count * FRAMES)


def test_large_messages_are_made_for_subscribers_only(raw):
    server = raw(loop=0, rate=4)
    program, wanted = server.session.program, []
    fetch = program.fetch
    program.fetch = lambda index, outlets: wanted.append(outlets) or fetch(index, outlets)
    scan = next(i for i, outlet in enumerate(program.channels) if outlet.topic == SCAN)
    with Viewer(server.url) as viewer:
        viewer.subscribe(OXTS)
        viewer.until(lambda: len(viewer.of(OXTS)) == FRAMES)
        assert set().union(*wanted) == set()
        viewer.subscribe(SCAN)
        viewer.until(lambda: len(viewer.of(SCAN)) == 2)
        assert set().union(*wanted) == {scan}
        viewer.unsubscribe(SCAN)
        hear_rounds(viewer, 3)
        wanted.clear()
        hear_rounds(viewer, 2)
        assert wanted
        assert set().union(*wanted) == set()


def test_two_viewers(raw):
    server = raw(loop=0, rate=2)
    with Viewer(server.url) as one:
        with Viewer(server.url) as two:
            one.subscribe(OXTS)
            two.subscribe(OXTS, SCAN)
            one.until(lambda: len(one.of(OXTS)) == FRAMES)
            two.until(lambda: len(two.of(OXTS)) == FRAMES)
            assert not one.of(SCAN)
            answer = one.control(PAUSE, seek=one.range[0])
            two.until(lambda: answer in two.states)
        count = len(one.messages)
        one.control(PLAY)
        one.until(lambda: len(one.messages) > count + 2)


def test_no_number_of_times_disconnects_a_viewer(raw):
    """The SDK disconnects a viewer for whom 64 controls wait, as on a machine that is busy."""
    server = raw(loop=0, clock=10)
    with Viewer(server.url) as viewer:
        viewer.subscribe(OXTS)
        for stamp_ns in range(1, 2001):
            server.publish_time(stamp_ns)
        # The clock may tell a newer one meanwhile.
        viewer.until(lambda: server.publish_time(2000) or 2000 in viewer.times)
        hear_rounds(viewer, 2)


def test_a_viewer_that_does_not_read_harms_nobody(raw, monkeypatch):
    """It loses its oldest messages, but no control; the other one misses nothing."""
    monkeypatch.setattr('kitti_ros2.viewers.foxglove_proxy.MESSAGE_LIMIT', 1 << 18)
    server = raw(loop=0, rate=20, clock=1000)  # so that much news waits for it
    with Viewer(server.url, queue=16) as asleep, Viewer(server.url) as awake:
        asleep.subscribe()
        awake.subscribe(OXTS)
        hear_rounds(awake, 60)  # until the other's buffers are full
        awake.hear_ticks(1000)
        paused = awake.control(PAUSE)
        stamps = [message.log_time for message in awake.of(OXTS)]
        assert all(stamps[i] == stamps[i - FRAMES] for i in range(FRAMES, len(stamps)))
        asleep.until(lambda: paused in asleep.states)
        asleep.hear_ticks(2)
        assert len(asleep.of(OXTS)) < len(stamps) / 2
        assert [each for each in server.complaints if 'too slowly' in each]


def test_a_viewer_that_sleeps_keeps_nobody_from_ending(raw):
    """Its socket is open, and nobody reads what comes: a closed laptop, a frozen tab."""
    server = raw(loop=0, rate=20)
    port = int(server.url.rpartition(':')[2])
    with socket.socket() as asleep:
        asleep.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        asleep.connect(('127.0.0.1', port))
        asleep.sendall(
            f'GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n'
            f'Connection: Upgrade\r\nSec-WebSocket-Key: {base64.b64encode(bytes(16)).decode()}\r\n'
            f'Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n'.encode()
        )
        heard = b''
        for _ in range(30):  # what there is comes first, then the time, again and again
            heard += asleep.recv(1 << 20)
        channels = sorted({int(each) for each in re.findall(rb'"id":(\d+)', heard)})
        wanted = [{'id': each, 'channelId': each} for each in channels]
        text = json.dumps({'op': 'subscribe', 'subscriptions': wanted}).encode()
        # A frame of text, masked with zeros (RFC 6455 section 5.2).
        asleep.sendall(struct.pack('>BBHI', 0x81, 0xFE, len(text), 0) + text)
        with Viewer(server.url) as awake:  # until the other's buffers are full
            awake.subscribe(OXTS)
            awake.until(lambda: len(awake.of(OXTS)) > 20 * FRAMES)
        ending = threading.Thread(target=server.stop, daemon=True)
        ending.start()
        ending.join(timeout=PATIENCE_S)
        assert not ending.is_alive()


def test_a_file_that_fails_is_told_to_viewers(serve, drive):
    (drive / 'velodyne_points' / 'data' / '0000000003.bin').write_bytes(b'1234567')
    server = serve(drive, rate=4)
    with play_through(server) as viewer:
        assert len(viewer.of(SCAN)) == FRAMES - 1
        (told,) = viewer.statuses
        assert '0000000003.bin' in told['message']
        assert server.complaints == [told['message']]
        state = decode(viewer, viewer.of(STATE)[-1]).status[0]
        assert state.level == WARN
        assert state.message == 'finished, frame 4; 2 messages could not be made'


def test_markers_of_another_time_are_deleted_after_a_jump(raw):
    """DELETEALL, should there be no markers where it went."""
    server = raw(start_paused=True, topics=f'{MARKERS} {OXTS}', streams='labels oxts')
    with Viewer(server.url) as viewer:
        viewer.subscribe()
        viewer.control(PAUSE, seek=viewer.range[1])
        viewer.until(lambda: viewer.of(MARKERS))
        assert decode(viewer, viewer.of(MARKERS)[0]).markers[0].action == 3
