# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot with a scanner and cameras whose images are packets of a video, encoded by PyAV.

All pixels of frame n have the blue of `blue(n)`, so that the files show which frame they are.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from typing import NamedTuple

import av
import detector_robot as base
import numpy as np
import robot_bags as bags

START_NS = 1_710_000_000_000_000_000
PERIOD_NS = 100_000_000
FRAMES = 12
GROUP = 4
"""Frames from a key frame to the next."""
SIZE = (96, 64)
K = np.array([[80.0, 0, 48.0], [0, 80.0, 32.0], [0, 0, 1]])
FOXGLOVE = 'foxglove_msgs/msg/CompressedVideo'
FFMPEG = 'ffmpeg_image_transport_msgs/msg/FFMPEGPacket'
IMAGE = 'sensor_msgs/msg/CompressedImage'
ENCODERS = {
    'h264': ('libx264', {'preset': 'veryfast', 'crf': '8', 'sc_threshold': '0'}),
    'h265': (
        'libx265',
        {'preset': 'ultrafast', 'crf': '8', 'x265-params': 'log-level=none:scenecut=0'},
    ),
    'av1': ('libsvtav1', {'preset': '10', 'crf': '10', 'svtav1-params': 'pred-struct=1'}),
    'av1 of PyAV 14': ('libaom-av1', {'cpu-used': '8', 'crf': '10', 'lag-in-frames': '0'}),
    'vp9': ('libvpx-vp9', {'deadline': 'realtime', 'crf': '8'}),
}


class Packet(NamedTuple):
    """The frame that a packet is of, and its bytes."""

    frame: int
    data: bytes


def blue(frame: int) -> int:
    return 24 + 16 * frame


def grey(frame: int) -> float:
    return 0.114 * blue(frame) + 0.587 * 100 + 0.299 * 160


def frame_of(pixels: np.ndarray) -> int:
    """The frame that an image shows, (H, W, 3) BGR."""
    number = (float(np.median(pixels[..., 0])) - 24) / 16
    assert abs(number - round(number)) < 0.4
    return round(number)


@cache
def packets(
    codec: str = 'h264', held_back: int = 0, size: tuple[int, int] = SIZE, pixel: str = 'yuv420p'
) -> tuple[Packet, ...]:
    """The packets in their order; held_back: number of B-frames in a row."""
    name, options = ENCODERS[codec]
    if name not in av.codecs_available:
        name, options = ENCODERS[f'{codec} of PyAV 14']
    context = av.CodecContext.create(name, 'w')
    context.width, context.height, context.pix_fmt = *size, pixel
    context.time_base, context.gop_size = Fraction(1, 10), GROUP
    context.max_b_frames, context.thread_count = held_back, 1
    extra = {'tune': 'zerolatency'} if codec in {'h264', 'h265'} and not held_back else {}
    context.options = {**options, **extra}
    found = []
    for number in range(FRAMES):
        pixels = np.zeros((size[1], size[0], 3), np.uint8)
        pixels[..., 0], pixels[..., 1], pixels[..., 2] = blue(number), 100, 160
        frame = av.VideoFrame.from_ndarray(pixels, format='bgr24')
        frame.pts, frame.time_base = number, context.time_base
        found += context.encode(frame)
    found += context.encode(None)
    return tuple(Packet(packet.pts, bytes(packet)) for packet in found)


def luma_packets(left: int, right: int) -> tuple[Packet, ...]:
    """Packets without a flag of their range; luma of the left and of the right half."""
    context = av.CodecContext.create('libx264', 'w')
    context.width, context.height, context.pix_fmt = *SIZE, 'yuv420p'
    context.time_base, context.thread_count = Fraction(1, 10), 1
    context.options = {'preset': 'veryfast', 'tune': 'zerolatency'}
    planes = np.full((SIZE[1] * 3 // 2, SIZE[0]), 128, np.uint8)
    planes[: SIZE[1], : SIZE[0] // 2], planes[: SIZE[1], SIZE[0] // 2 :] = left, right
    found = []
    for number in range(FRAMES):
        frame = av.VideoFrame.from_ndarray(planes, format='yuv420p')
        frame.pts, frame.time_base = number, context.time_base
        found += context.encode(frame)
    return tuple(Packet(packet.pts, bytes(packet)) for packet in found + context.encode(None))


def x264(parameters: str) -> list[bytes]:
    """80 packets of noise by parameters of x264."""
    context = av.CodecContext.create('libx264', 'w')
    context.width, context.height, context.pix_fmt = *SIZE, 'yuv420p'
    context.time_base, context.thread_count = Fraction(1, 10), 1
    context.options = {'preset': 'veryfast', 'x264-params': f'{parameters}:scenecut=0'}
    noise = np.random.default_rng(5).integers(0, 255, (SIZE[1], SIZE[0] + 160, 3), np.uint8)
    found = []
    for number in range(80):
        pixels = np.ascontiguousarray(noise[:, 2 * number : 2 * number + SIZE[0]])
        frame = av.VideoFrame.from_ndarray(pixels, format='bgr24')
        frame.pts, frame.time_base = number, context.time_base
        found += context.encode(frame)
    return [bytes(packet) for packet in found + context.encode(None)]


def message(packet: Packet, msgtype: str, codec: str, frame_id: str = 'camera_optical') -> dict:
    """The values of a message with a packet; codec as its field names it."""
    stamp_ns = START_NS + packet.frame * PERIOD_NS
    head = bags.header(stamp_ns, frame_id)
    data = np.frombuffer(packet.data, np.uint8)
    if msgtype == FOXGLOVE:
        return {'timestamp': head['stamp'], 'frame_id': frame_id, 'data': data, 'format': codec}
    if msgtype == IMAGE:
        return {'header': head, 'format': codec, 'data': data}
    size = {'width': SIZE[0], 'height': SIZE[1]}
    return {'header': head, **size, 'encoding': codec, 'pts': packet.frame, 'data': data}


def said(
    found: tuple[Packet, ...] | None = None,
    msgtype: str = FOXGLOVE,
    codec: str = 'h264',
    topic: str = '/camera/image',
    size: tuple[int, int] = SIZE,
) -> list[bags.Said]:
    """All messages; packets are recorded 5 ms apart after the stamp, in their order."""
    link = bags.transform('lidar', 'camera_optical', base.LIDAR_T_CAMERA)
    every = [
        bags.Said(bags.TF_STATIC, START_NS - 1, 'tf2_msgs/msg/TFMessage', {'transforms': [link]})
    ]
    for frame in range(FRAMES):
        stamp = START_NS + frame * PERIOD_NS
        info = bags.camera_info(stamp, 'camera_optical', size, K)
        every += [
            bags.Said('/points', stamp, 'sensor_msgs/msg/PointCloud2', base.cloud(stamp)),
            bags.Said('/camera/camera_info', stamp, 'sensor_msgs/msg/CameraInfo', info),
        ]
    every += [
        bags.Said(
            topic, START_NS + place * PERIOD_NS + 5_000_000, msgtype, message(each, msgtype, codec)
        )
        for place, each in enumerate(packets() if found is None else found)
    ]
    return every


def without(found: tuple[Packet, ...], *places: int) -> tuple[Packet, ...]:
    return tuple(each for place, each in enumerate(found) if place not in places)


def damaged(found: tuple[Packet, ...], place: int) -> tuple[Packet, ...]:
    """The packet at a place cut after a few bytes, so that its slice cannot be read."""
    packet = found[place]
    return (*found[:place], packet._replace(data=packet.data[:7]), *found[place + 1 :])
