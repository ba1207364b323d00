# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags whose images are video: every image is that of its stamp, and what is lost is named."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from contextlib import closing
from random import Random

import av
import cv2
import detector_robot as base
import foxglove_robot as foxglove
import numpy as np
import pytest
import robot_bags as bags
import video_robot as robot
from rosbags.typesys import Stores

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.datasets import validate
from kitti_ros2.files.image_files import decode_png
from kitti_ros2.importer.apply_plan import guess
from kitti_ros2.importer.kitti_frames import Excerpt
from kitti_ros2.importer.planned_recording import PlannedRecording
from kitti_ros2.importer.set_builder import Target, build
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.h264_frames import FrameNumbers
from kitti_ros2.messages.images import decode_pixels
from kitti_ros2.messages.videos import VideoDecoder
from kitti_ros2.model.errors import KittiRos2Error, UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program


def shown(out, camera=2):
    """By file number the frame that its image shows."""
    recording = open_recording(out, ReadOptions(layout=Layout.OBJECT))
    stream = Stream(f'image_{camera}')
    return {
        int(number): robot.frame_of(decode_png(recording.read(stream, int(number))))
        for number in (recording.streams[stream].numbers if stream in recording.streams else ())
    }


def convert(tmp_path, said, *options, container='mcap', bare=False):
    """(exit code, images shown)."""
    bag = bags.write(tmp_path / 'bag', said, container, bare=bare)
    out = tmp_path / 'out'
    code = main(['to-kitti', str(bag), str(out), '--layout', 'object', *options])
    return code, shown(out)


IN_PLACE = {number: number for number in range(robot.FRAMES)}

KINDS = {
    'CompressedVideo h264': ('h264', robot.FOXGLOVE, 'h264', '/camera/image'),
    'CompressedVideo h265': ('h265', robot.FOXGLOVE, 'h265', '/camera/image'),
    'CompressedVideo av1': ('av1', robot.FOXGLOVE, 'av1', '/camera/image/foxglove'),
    'CompressedVideo vp9': ('vp9', robot.FOXGLOVE, 'vp9', '/camera/image'),
    'libx264': ('h264', robot.FFMPEG, 'libx264', '/camera/image/ffmpeg'),
    'hevc_nvenc': ('h265', robot.FFMPEG, 'hevc_nvenc', '/camera/image/ffmpeg'),
    'tokens': ('av1', robot.FFMPEG, 'av1;yuv420p;bgr8;bgr8', '/camera/image/ffmpeg'),
    'DepthAI': ('h265', 'depthai_ros_msgs/msg/FFMPEGPacket', 'libx265', '/camera/image'),
    'Isaac ROS': ('h264', robot.IMAGE, 'h264', '/camera/image_compressed'),
}


@pytest.mark.parametrize(('codec', 'msgtype', 'named', 'topic'), KINDS.values(), ids=KINDS)
def test_each_image_is_that_of_its_stamp(codec, msgtype, named, topic, tmp_path, capsys):
    said = robot.said(robot.packets(codec), msgtype, named, topic)
    assert convert(tmp_path, said) == (0, IN_PLACE)
    printed = ''.join(capsys.readouterr())
    title = {'h264': 'H.264', 'h265': 'H.265', 'av1': 'AV1', 'vp9': 'VP9'}[codec]
    assert f'{topic}: images are decoded from video ({title}), which is lossy' in printed


@pytest.mark.parametrize('msgtype', [robot.FOXGLOVE, robot.FFMPEG])
@pytest.mark.parametrize('bare', [False, True], ids=['defined', 'bare'])
@pytest.mark.parametrize('container', ['mcap', 'sqlite3', 'ros1'])
def test_containers(container, bare, msgtype, tmp_path):
    said = robot.said(msgtype=msgtype)
    assert convert(tmp_path, said, container=container, bare=bare) == (0, IN_PLACE)


HELD_BACK = {'h264': 2, 'h265': 2}


@pytest.mark.parametrize('codec', HELD_BACK)
def test_frames_that_are_held_back_keep_their_stamps(codec, tmp_path):
    packets = robot.packets(codec, HELD_BACK[codec])
    assert [packet.frame for packet in packets] != sorted(packet.frame for packet in packets)
    said = robot.said(packets, robot.FFMPEG, f'{codec};yuv420p;bgr8;bgr8')
    assert convert(tmp_path, said) == (0, IN_PLACE)


# By case: what remains of the packets, the frames that are lost, and the lines that say why.
NO_KEY = 'no key frame precedes it'
DEPENDS = 'it depends on a damaged one before'
LOSSES = {
    'cut': (lambda packets: packets[2:], [2, 3], [f'skipped /camera/image (2): .*{NO_KEY}']),
    'damaged': (
        lambda packets: robot.damaged(packets, 5),
        [5, 6, 7],
        ['skipped /camera/image (1): .*the packet is damaged', f'/camera/image (2): .*{DEPENDS}'],
    ),
    'damaged key frame': (
        lambda packets: robot.damaged(packets, 4),
        [4, 5, 6, 7],
        ['/camera/image (1): .*the packet is damaged', f'/camera/image (3): .*{DEPENDS}'],
    ),
    'not recorded': (
        lambda packets: robot.without(packets, 5),
        [6, 7],
        ['/camera/image (.): .*is missing'],
    ),
    'damaged at the end': (
        lambda packets: robot.damaged(packets, 11),
        [11],
        ['skipped /camera/image (1): .*the packet is damaged'],
    ),
}


# FFmpeg does not notice a missing packet of AV1; of H.265 from version 8 on.
UNNOTICED = {'av1', 'h265'} if av.library_versions['libavcodec'][0] < 62 else {'av1'}
CODECS = [
    pytest.param(codec, *case, id=f'{name}, {codec}')
    for codec in ('h264', 'h265', 'av1')
    for name, case in LOSSES.items()
    if name != 'not recorded' or codec not in UNNOTICED
]


@pytest.mark.parametrize(('codec', 'change', 'lost', 'lines'), CODECS)
def test_lost_frames_are_counted_up_to_the_next_key_frame(
    codec, change, lost, lines, tmp_path, capsys
):
    packets = change(robot.packets(codec))
    code, images = convert(tmp_path, robot.said(packets, codec=codec))
    assert code == 1
    assert set(images.values()) == {packet.frame for packet in packets} - set(lost)
    error = capsys.readouterr().err
    for line in lines:
        assert re.search(line.replace('(', r'\(').replace(')', r'\)'), error)


@pytest.mark.parametrize('codec', ['h264', 'h265', 'av1', 'vp9'])
@pytest.mark.parametrize('held_back', [0, 2])
def test_images_read_in_any_order_are_those_of_their_frames(codec, held_back, tmp_path):
    packets = robot.packets(codec, held_back if codec in HELD_BACK else 0)
    bag = bags.write(tmp_path / 'bag', robot.said(packets, codec=codec))
    recording = open_bag(bag)
    order = [7, 6, 11, 0, 5, 9, 10, 1, 2, 8, 3, 4, 7]
    try:
        images = [recording.pixels(2, number) for number in order]
    finally:
        recording.close()
    assert [robot.frame_of(image) for image in images] == order


def open_bag(path):
    return PlannedRecording(path, survey_bags([path]))


def test_images_of_a_damaged_video_read_one_by_one(tmp_path):
    packets = robot.damaged(robot.packets(), 5)
    recording = open_bag(bags.write(tmp_path / 'bag', robot.said(packets)))
    try:
        for number, reason in ((6, DEPENDS), (5, 'the packet is damaged'), (7, DEPENDS)):
            with pytest.raises(KittiRos2Error, match=reason):
                recording.read(Stream.IMAGE_2, number)
        assert robot.frame_of(recording.pixels(2, 8)) == 8
    finally:
        recording.close()


def test_two_cameras_do_not_mix(tmp_path):
    said = robot.said()
    later = robot.packets('h265')
    stamped = robot.said(later, robot.FFMPEG, 'libx265', '/back/image/ffmpeg')
    more = [
        each._replace(topic=each.topic.replace('/camera/camera_info', '/back/camera_info'))
        for each in stamped
        if each.topic in {'/back/image/ffmpeg', '/camera/camera_info'}
    ]
    bag = bags.write(tmp_path / 'bag', [*said, *more])
    out = tmp_path / 'out'
    code = main(['to-kitti', str(bag), str(out), '--layout', 'object', '--all-cameras'])
    assert code == 0
    for name in ('camera', 'back'):
        files = sorted((out / f'training_{name}' / 'image_2').glob('*.png'))
        assert [robot.frame_of(cv2.imread(str(path))) for path in files] == list(IN_PLACE)


GREY = {
    'by its tokens': ('h264', 'yuv420p', 'libx264;gray;mono8;mono8'),
    'by its format': ('h265', 'gray', 'libx265'),
}


@pytest.mark.parametrize(('levels', 'is_full'), [((16, 235), False), ((0, 255), True)])
def test_luma_beyond_its_range_is_noted(levels, is_full, tmp_path, capsys):
    bag = bags.write(tmp_path / 'bag', robot.said(robot.luma_packets(*levels)))
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'object']) == 0
    note = '/camera/image: 12 images have luma beyond the limited range of video'
    assert (note in ''.join(capsys.readouterr())) == is_full


@pytest.mark.parametrize(('codec', 'pixel', 'named'), GREY.values(), ids=GREY)
def test_grey_video_becomes_grey_images(codec, pixel, named, tmp_path):
    said = robot.said(robot.packets(codec, pixel=pixel), robot.FFMPEG, named)
    bag = bags.write(tmp_path / 'bag', said)
    out = tmp_path / 'out'
    assert main(['to-kitti', str(bag), str(out), '--layout', 'object']) == 0
    for number in range(robot.FRAMES):
        file = out / 'training' / 'image_2' / f'{number:06}.png'
        pixels = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert pixels.shape == robot.SIZE[::-1]
        assert abs(int(pixels[10, 10]) - robot.grey(number)) < 4


def test_an_odd_size_that_an_encoder_made_even_is_restored(tmp_path, capsys):
    said = robot.said(size=(97, 65))
    assert convert(tmp_path, said) == (0, IN_PLACE)
    assert '12 images are scaled by a pixel to 97x65' in ''.join(capsys.readouterr())
    image = cv2.imread(str(tmp_path / 'out' / 'training' / 'image_2' / '000003.png'))
    assert image.shape == (65, 97, 3)


def test_another_size_than_that_of_the_calibration_is_a_loss(tmp_path, capsys):
    code, images = convert(tmp_path, robot.said(size=(192, 128)))
    assert (code, images) == (1, {})
    assert 'the image is 96x64; expected 192x128' in capsys.readouterr().err


def test_a_part_is_decoded_from_the_key_frame_before(tmp_path):
    packets = robot.packets()
    code, images = convert(tmp_path, robot.said(packets), '--start', '6', '--end', '8')
    assert (code, images) == (0, {0: 6, 1: 7, 2: 8})


def test_a_preview_shows_frames_of_a_video(tmp_path):
    bag = bags.write(tmp_path / 'bag', robot.said())
    options = ImportOptions(layout=Layout.OBJECT)
    survey = survey_bags([bag])
    plan = guess([bag], survey, options).plan
    excerpt = Excerpt(3)
    build([bag], plan, survey, Target(tmp_path / 'out', excerpt=excerpt), options)
    assert shown(tmp_path / 'out') == dict(enumerate(excerpt.numbers.tolist()))


def test_without_pyav_one_line_says_what_to_install(tmp_path, monkeypatch, capsys):
    said = robot.said()
    monkeypatch.setitem(sys.modules, 'av', None)
    code, images = convert(tmp_path, said)
    assert (code, images) == (1, {})
    lines = [line for line in capsys.readouterr().err.splitlines() if 'PyAV' in line]
    assert len(lines) == 1
    assert '/camera/image (12)' in lines[0]
    assert lines[0].endswith("run pip install 'kitti_ros2[video]'")


def test_without_pyav_validation_notes_what_it_does_not_check(tmp_path, monkeypatch):
    bag = bags.write(tmp_path / 'bag', robot.said())
    monkeypatch.setitem(sys.modules, 'av', None)
    (finding,) = validate(bag, decode=True).findings
    assert (finding.rule, finding.severity) == ('bag-note', 'note')
    assert '/camera/image: frames are not checked: decoding video needs PyAV' in finding.message


def test_a_codec_that_is_not_known_is_named(tmp_path, capsys):
    said = robot.said(codec='theora')
    bag = bags.write(tmp_path / 'bag', said)
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'object']) == 1
    error = capsys.readouterr().err
    assert "an unsupported codec, 'theora'; expected h264, h265, av1 or vp9" in error


@pytest.mark.parametrize('write', [foxglove.write_protobuf, foxglove.write_json])
def test_schemas_of_foxglove(write, tmp_path):
    """Made by their own libraries; all other topics are those of the robot of Foxglove."""
    world = foxglove.make_world()
    packets = robot.packets(size=foxglove.SIZE)
    records = []
    for topic, stamp_ns, schema, fields in foxglove.records(world):
        if schema == 'CompressedImage':
            number = world.index(next(frame for frame in world if frame.stamp_ns == stamp_ns))
            data = packets[number].data
            records.append(
                (topic, stamp_ns, 'CompressedVideo', {**fields, 'format': 'h264', 'data': data})
            )
        else:
            records.append((topic, stamp_ns, schema, fields))
    bag = write(tmp_path / 'bag.mcap', records)
    out = tmp_path / 'out'
    assert main(['to-kitti', str(bag), str(out), '--layout', 'object']) == 0
    assert shown(out) == {number: number for number in range(foxglove.FRAMES)}


def test_video_is_played_as_it_is(tmp_path):
    """Frames depend on those before them, so no topic is decoded or annotated."""
    bag = bags.write(tmp_path / 'bag', robot.said())
    with closing(open_program(bag, make_play_settings({'images': 'both'}))) as program:
        channels = {channel.topic: index for index, channel in enumerate(program.channels)}
        assert set(channels) == {'/camera/image', '/camera/camera_info', '/points', '/tf_static'}
        assert program.losses == ()
        played = [
            message.data
            for index in range(len(program.stamps_ns))
            for message in program.fetch(index, range(len(channels)))[0]
            if message.channel == channels['/camera/image']
        ]
    with open_messages(bag, {'/camera/image'}) as messages:
        stored = [bytes(message.data) for message in messages]
    assert [data[: len(whole)] for data, whole in zip(played, stored, strict=True)] == stored


def test_annotated_images_need_pictures(tmp_path):
    boxes = base.said({'solid'})
    said = [each for each in boxes if each.topic != '/camera/image']
    packets = robot.packets(size=base.SIZE)[: base.FRAMES]
    said += [
        bags.Said(
            '/camera/image',
            each.log_ns,
            robot.FOXGLOVE,
            robot.message(packet, robot.FOXGLOVE, 'h264'),
        )
        for each, packet in zip(
            (each for each in boxes if each.topic == '/points'), packets, strict=True
        )
    ]
    bag = bags.write(tmp_path / 'bag', said)
    with pytest.raises(UsageError, match='its images are video, which is played as it is'):
        open_program(bag, make_play_settings({'annotated': True}))


FINDINGS = {
    'whole': (lambda packets: packets, []),
    'cut': (lambda packets: packets[2:], ['video-start: 2 of 10 packets are before a key frame']),
    'damaged': (
        lambda packets: robot.damaged(packets, 5),
        [
            'video-decode: 1 packet, the first at 1710000000505000000: the packet is damaged',
            'video-decode: 2 packets, the first at 1710000000605000000: the frame',
        ],
    ),
}


@pytest.mark.parametrize('msgtype', [robot.FOXGLOVE, robot.FFMPEG, robot.IMAGE])
@pytest.mark.parametrize(('change', 'lines'), FINDINGS.values(), ids=FINDINGS)
def test_validation_of_video(change, lines, msgtype, tmp_path):
    said = robot.said(change(robot.packets()), msgtype, topic='/camera/image')
    report = validate(bags.write(tmp_path / 'bag', said), decode=True)
    found = [f'{finding.rule}: {finding.message}' for finding in report.findings]
    assert len(found) == len(lines)
    for line in lines:
        rule, text = line.split(': ', 1)
        assert any(each.startswith(rule) and text in each for each in found), found


STREAMS = {
    'no B-frames': 'keyint=15:bframes=0',
    'pyramid': 'keyint=30:bframes=4:b-pyramid=normal:ref=4',
    'open groups': 'keyint=20:bframes=2:open-gop=1',
    'intra refresh': 'keyint=20:bframes=0:intra-refresh=1',
    'interlaced': 'keyint=30:bframes=1:tff=1',
    'slices': 'keyint=40:slices=4',
}


@pytest.mark.parametrize('parameters', STREAMS.values(), ids=STREAMS)
def test_a_missing_packet_of_h264_is_noticed_if_others_refer_to_it(parameters):
    packets = robot.x264(parameters)
    assert all(map(FrameNumbers().follows, packets))
    for missing, packet in enumerate(packets[:-1]):
        types = [unit[0] for unit in re.findall(rb'\x00\x00\x01(.)', packet, re.DOTALL)]
        is_reference = any(each & 31 in {1, 5} and each >> 5 for each in types)
        numbers = FrameNumbers()
        found = [numbers.follows(each) for place, each in enumerate(packets) if place != missing]
        is_before_key = b'\0\0\1\x65' in packets[missing + 1]
        expected = missing > 0 and is_reference and not is_before_key
        assert (False in found) == expected, missing


@pytest.mark.parametrize('codec', ['h264', 'h265', 'av1', 'vp9'])
def test_every_packet_has_one_answer_whatever_its_bytes(codec):
    random = Random(codec)
    for _ in range(60):
        decoder = VideoDecoder()
        answers = []
        for number, packet in enumerate(robot.packets(codec)):
            data = bytearray(packet.data)
            for _ in range(random.choice((0, 0, 3))):
                data[random.randrange(min(len(data), 40))] ^= 1 << random.randrange(8)
            cut = random.choice((len(data), len(data), len(data), random.randrange(len(data))))
            message = robot.message(packet._replace(data=bytes(data[:cut])), robot.FOXGLOVE, codec)
            store = bags.types_of(Stores.ROS2_JAZZY)
            answers += decoder.feed(number, bags.made(store, robot.FOXGLOVE, message))
        answers += decoder.rest()
        assert sorted(number for number, _ in answers) == list(range(robot.FRAMES))
        for _, image in answers:
            assert isinstance(image, ValueError) or decode_pixels(image).size


@pytest.mark.skipif(not shutil.which('pymcap-cli'), reason='no pymcap-cli on the path')
@pytest.mark.parametrize('codec', ['h264', 'h265', 'av1', 'vp9'])
def test_images_that_pymcap_cli_compressed(codec, tmp_path):
    """Of raw images; luma of PNG and JPEG is wrong in its version 0.34: see findings/."""
    whole = bags.write(tmp_path / 'whole', base.said(set(), 'bgr8'))
    packed = tmp_path / 'packed.mcap'
    words = ['pymcap-cli', '--quiet', 'roscompress', whole, '-o', packed, '--codec', codec]
    done = subprocess.run(words, capture_output=True, check=False)
    if b"'video'" in done.stderr + done.stdout:
        pytest.skip('pymcap-cli has not its extra video')
    for bag in (whole, packed):
        out = tmp_path / f'{bag.stem}_set'
        assert main(['to-kitti', str(bag), str(out), '--layout', 'object']) == 0
    for number in range(base.FRAMES):
        before, after = (
            cv2.imread(str(tmp_path / f'{name}_set/training/image_2/{number:06}.png')).astype(int)
            for name in ('whole', 'packed')
        )
        assert np.abs(before - after).mean() < 5
