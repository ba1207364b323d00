# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: KITTI's own files."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from kitti_ros2.kitti.calib_file import parse_calibration, parse_raw_calibration
from kitti_ros2.kitti.kitti360 import parse_kitti360_poses
from kitti_ros2.kitti.kitti360_boxes import BoxIndex, parse_world_boxes
from kitti_ros2.kitti.kitti360_calib import format_kitti360_calibration, parse_kitti360_calibration
from kitti_ros2.kitti.kitti_recording import MercatorWorld, pose_from_odometry, pose_from_packet
from kitti_ros2.kitti.label_file import TrackFile, labels_of_text
from kitti_ros2.kitti.names import KITTI_360_CALIB, KITTI_360_POSES, parse_image_set
from kitti_ros2.kitti.object_set import parse_journal, parse_mapping, parse_rand
from kitti_ros2.kitti.scan_file import parse_point_labels, parse_scan, parse_scan_text
from kitti_ros2.kitti.store import decode_text
from kitti_ros2.kitti.text_file import (
    packet_lines,
    parse_packet,
    parse_poses,
    parse_times,
    parse_timestamps,
)
from kitti_ros2.kitti.tracklet_file import cuboids_by_frame, labels_of_tracklets, parse_tracklets
from kitti_ros2.messages.cdr import serialize
from kitti_ros2.messages.oxts import encode_fix, encode_imu, encode_odometry, encode_velocity
from kitti_ros2.model.errors import BadFileError
from kitti_ros2.model.geometry import NOMINAL_VELO_T_IMU, Transform
from kitti_ros2.model.samples import Calibration, TextFile
from kitti_ros2.model.streams import Layout

from .inputs import SEPARATOR, files, joined, parted, samples
from .target import Target

PATH = Path('folder/file.txt')
_RAW = ('calib_cam_to_cam.txt', 'calib_velo_to_cam.txt', 'calib_imu_to_velo.txt')
_TEXT_FILE = 'kitti/text_file.py'
_CUBE = ' '.join(f'{x} {y} {z}' for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5))
_WORLD_BOXES = f"""<opencv_storage>
<object1><label>car</label><semanticId>13</semanticId><instanceId>3</instanceId>
<start_frame>0</start_frame><end_frame>2</end_frame><timestamp>-1</timestamp>
<transform><rows>4</rows><cols>4</cols><data>4 0 0 1 0 2 0 2 0 0 1.5 0 0 0 0 1</data></transform>
<vertices><rows>8</rows><cols>3</cols><data>{_CUBE}</data></vertices></object1>
<object2><label>pedestrian</label><dynamic>1</dynamic><dynamicSeq>4</dynamicSeq><timestamp>1</timestamp>
<transform><rows>4</rows><cols>4</cols><data>1 0 0 1 0 1 0 2 0 0 1 0 0 0 0 1</data></transform>
<vertices><rows>8</rows><cols>3</cols><data>{_CUBE}</data></vertices></object2>
</opencv_storage>
""".encode()


def _calibration(data: bytes) -> None:
    parse_calibration(decode_text(data, PATH), PATH, 'calib/000000.txt')


def _raw_calibration(data: bytes) -> None:
    texts = {
        name: decode_text(part, PATH)
        for name, part in zip(_RAW, parted(data, 3), strict=True)
        if part
    }
    for rectified in (True, False):
        parse_raw_calibration(texts, PATH.parent, rectified=rectified)


def _calibration_360(data: bytes) -> None:
    """Parse the files, project with the cameras, and format what can be."""
    parts = zip(KITTI_360_CALIB, parted(data, len(KITTI_360_CALIB)), strict=True)
    texts = {name: decode_text(part, PATH) for name, part in parts if part}
    calibration = parse_kitti360_calibration(texts, PATH.parent)
    for camera in calibration.cameras.values():
        if camera.lens is not None:
            camera.lens.rays(camera.lens.bent(_SEEN))
    with suppress(ValueError):  # without camera 0
        format_kitti360_calibration(calibration)


def _poses_360(data: bytes) -> None:
    for name, part in zip(KITTI_360_POSES, parted(data, 2), strict=True):
        lines, numbers = parse_kitti360_poses(decode_text(part, PATH), PATH.with_name(name))
        for line, matrix in lines.sound().items():
            assert numbers[line] >= 0
            Transform.from_matrix(matrix)


def _labels(data: bytes) -> None:
    labels_of_text(TextFile('label_2/000000.txt', decode_text(data, PATH)))


def _tracks(data: bytes) -> None:
    tracks = TrackFile(decode_text(data, PATH), PATH)
    for number in (*tracks.rows, 10**6):
        tracks.boxes(number)
        tracks.labels(number, 'label_02/0000.txt')


def _point_labels(data: bytes) -> None:
    parse_point_labels(data, 8, PATH)


def _tracklets(data: bytes) -> None:
    for cuboids in cuboids_by_frame(parse_tracklets(data, PATH)).values():
        labels_of_tracklets(cuboids, PATH)


def _world_boxes(data: bytes) -> None:
    boxes = parse_world_boxes(data, PATH).boxes
    numbers = np.arange(3)
    index = BoxIndex(boxes, numbers, np.zeros((3, 3)))
    for number in index.frames(numbers).tolist():
        index.of_frame(number, Transform.identity(), np.zeros((9, 4), np.float32))


def _oxts(data: bytes) -> None:
    packets = []
    for line, text in enumerate(packet_lines(decode_text(data, PATH), PATH), 1):
        with suppress(BadFileError):  # costs its own packet
            packets.append(parse_packet(text, PATH, line))
    if packets:
        world = MercatorWorld.at(packets[0])
        for packet in packets:
            pose = pose_from_packet(packet, world)
            for encode in (encode_imu, encode_fix, encode_velocity):
                serialize(encode(packet, 1, 'imu_link'))
            serialize(encode_odometry(pose, Transform.identity(), 1, ('map', 'base_link')))


def _timestamps(data: bytes) -> None:
    parse_timestamps(decode_text(data, PATH), PATH).sound()


def _times(data: bytes) -> None:
    parse_times(decode_text(data, PATH), PATH).sound()


def _poses(data: bytes) -> None:
    for matrix in parse_poses(decode_text(data, PATH), PATH).sound().values():
        pose_from_odometry(matrix, Calibration({}, None, None, NOMINAL_VELO_T_IMU))


def _scan(data: bytes) -> None:
    parse_scan(data, PATH).sum()


def _scan_text(data: bytes) -> None:
    parse_scan_text(data, PATH).sum()


def _image_set(data: bytes) -> None:
    text = decode_text(data, PATH)
    for frames in (True, False):
        parse_image_set(text, PATH, frames=frames)


def _mapping(data: bytes) -> None:
    first, second = parted(data, 2)
    lines = parse_mapping(decode_text(first, PATH), PATH)
    parse_rand(decode_text(second, PATH), PATH, len(lines))


def _journal(data: bytes) -> None:
    _ = parse_journal(decode_text(data, PATH), PATH).numbers


def _journals() -> list[bytes]:
    values = {
        'version': 1,
        'split': 'training',
        'files': ['training/image_2/000001.png'],
        'lists': ['ImageSets/train.txt'],
        'folders': ['training/image_2'],
    }
    return [json.dumps(values).encode()]


def _mappings() -> list[bytes]:
    lines = [f'2011_09_26 2011_09_26_drive_0005_sync {n:010d}\n' for n in range(4)]
    return [joined([''.join(lines).encode(), b'2,4,1,3'])]


_SEEN = np.array([[1.0, 0.0, 2.0], [3.0, 1.0, -0.1], [0.0, 0.0, -1.0]])
_FISHEYE = b"""%YAML:1.0
model_type: MEI
camera_name: image_02
image_width: 1400
image_height: 1400
mirror_parameters:
   xi: 2.2
distortion_parameters:
   k1: 1.6e-02
   k2: 1.6
   p1: 4e-04
   p2: 2e-04
projection_parameters:
   gamma1: 1336
   gamma2: 1335
   u0: 716.9
   v0: 705.7
"""
_ODOMETRY = b"""P0: 1 0 0 0 0 1 0 0 0 0 1 0
P2: 700 0 600 45 0 700 170 -0.3 0 0 1 0.005
Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0
"""
_WAYMO = b"""P4: 1 0 0 0 0 1 0 0 0 0 1 0
Tr_velo_to_cam_0: 0 -1 0 0 0 0 -1 0 1 0 0 0
Tr_velo_to_cam_4: 0 -1 0 0 0 0 -1 0 1 0 0 0
"""
_TRACKING = b"""R_rect 1 0 0 0 1 0 0 0 1
Tr_velo_cam 0 -1 0 0 0 0 -1 0 1 0 0 0
Tr_imu_velo 1 0 0 0 0 1 0 0 0 0 1 0
"""
_LABEL = b'Car 0.00 0 1.5 10 20 30 40 1.5 1.6 4.0 1.0 1.7 20.0 0.3\n'
_NO_DATE = b'2011-99-26 13:02:25.000000000\n'
_MANY = 100_000


def _object_calibrations() -> list[bytes]:
    made = files('calib/*.txt') + files('calib.txt', Layout.ODOMETRY)
    real = samples('kitti/*/training/calib/*.txt')
    return [*made, _ODOMETRY, _WAYMO, _TRACKING, b'', *real]


def _other_tracklets() -> list[bytes]:
    """XML of other kinds, and boxes of sizes that no object has."""
    made = files('tracklet_labels.xml', Layout.RAW)[0]
    none = re.sub(rb'<h>[^<]*</h>', b'<h>0</h>', made)
    entity = b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>'
    edits = {b'w': b'<w>x</w>', b'l': b'', b'first_frame': b'<first_frame>1.5</first_frame>',
             b'objectType': b'', b'occlusion': b'<occlusion>9</occlusion>',
             b'tx': b'<tx>nan</tx>'}  # fmt: skip
    others = [re.sub(rb'<%s>[^<]*</%s>' % (name, name), edit, made) for name, edit in edits.items()]
    return [*others, none, entity, b'<?xml version="1.0" encoding="x"?><a/>', b'<a/>', b' ' * 300]


def _raw_calibrations() -> list[bytes]:
    made = [files(name, Layout.RAW)[0] for name in _RAW]
    real = [samples(f'kitti/raw/2011_09_26/{name}') for name in _RAW]
    return [joined(made), *([joined([each[0] for each in real])] if all(real) else [])]


def _calibrations_360() -> list[bytes]:
    made = [b''.join(files(name, Layout.KITTI_360)) for name in KITTI_360_CALIB]
    real = [b''.join(samples(f'kitti360/calibration/{name}')) for name in KITTI_360_CALIB]
    made[3:5] = [_FISHEYE, _FISHEYE.replace(b'_02', b'_03')]
    return [joined(made), *([joined(real)] if all(real) else [])]


def _poses_of_360() -> list[bytes]:
    drives = ('0000', '0004', '0010')
    real = [
        joined(
            [
                samples(f'kitti360/data_poses/*_{drive}_sync/{name}', lines=3)[0]
                for name in KITTI_360_POSES
            ]
        )
        for drive in drives
        if samples(f'kitti360/data_poses/*_{drive}_sync/*.txt')
    ]
    made = [files(name, Layout.KITTI_360)[0] for name in KITTI_360_POSES]
    return [joined(made), joined([made[0] * 2, made[1]]), *real]


TARGETS = (
    Target('calibration', _calibration, _object_calibrations,
           ('kitti/calib_file.py', _TEXT_FILE),
           (b'P2:', b'Tr:', b'R0_rect:', b'R_rect ', b'Tr_velo_to_cam_0:', b'Tr_imu_to_velo:'),
           is_text=True, long=_MANY),
    Target('calibration_raw', _raw_calibration, _raw_calibrations,
           ('kitti/calib_file.py', _TEXT_FILE),
           (b'K_00:', b'D_02:', b'S_rect_02:', b'P_rect_00:', b'R:', b'T:', SEPARATOR),
           is_text=True, long=_MANY),
    Target('calibration_360', _calibration_360, _calibrations_360,
           ('kitti/kitti360_calib.py', 'model/lenses.py', _TEXT_FILE),
           (b'image_00:', b'R_rect_00:', b'K_00:', b'xi:', b'gamma1:', b'image_width:', b'MEI',
            SEPARATOR), is_text=True, long=_MANY),
    Target('poses_360', _poses_360, _poses_of_360, ('kitti/kitti360.py', _TEXT_FILE),
           (b'0 0 0 1', b'-1', b'99999999999', SEPARATOR), is_text=True, long=_MANY),
    Target('labels', _labels,
           lambda: [*files('label_2/*.txt'), _LABEL,
                    _LABEL.replace(b'4.0', b'-4.0'), *samples('kitti/object/*/label_2/*.txt')],
           ('kitti/label_file.py', _TEXT_FILE), (b'DontCare', b'-1', b'-1000'),
           is_text=True, long=_MANY),
    Target('tracks', _tracks,
           lambda: [*files('label_02/*.txt'), b'0 1 ' + _LABEL, b'1.0 2 ' + _LABEL,
                    b'0 99999999999999999999 ' + _LABEL,
                    *samples('kitti/tracking/*/label_02/*.txt')],
           ('kitti/label_file.py', _TEXT_FILE), (b'DontCare', b'-1'),
           is_text=True, long=_MANY),
    Target('semantic', _point_labels, lambda: [bytes(32), bytes(range(32))],
           ('kitti/scan_file.py',), long=_MANY),
    Target('tracklets', _tracklets,
           lambda: [*files('tracklet_labels.xml', Layout.RAW),
                    *_other_tracklets(), *samples('kitti/devkit/*tracklet*.xml', lines=90)],
           ('kitti/tracklet_file.py',),
           (b'<item>', b'</item>', b'<!ENTITY a "b">', b'<tracklets>', b'<poses>', b'<h>'),
           is_text=True, long=_MANY),
    Target('world boxes', _world_boxes, lambda: [_WORLD_BOXES],
           ('kitti/kitti360_boxes.py', 'kitti/tracklet_file.py'),
           (b'<object2>', b'</object1>', b'<transform>', b'<data>', b'<timestamp>', b'-1'),
           is_text=True, long=_MANY),
    Target('oxts', _oxts,
           lambda: [*files('oxts/data/*.txt', Layout.RAW), *files('oxts/*.txt', Layout.TRACKING),
                    *samples('kitti/tracking/*/oxts/*.txt', lines=3)],
           ('kitti/text_file.py', _TEXT_FILE), is_text=True, long=_MANY),
    Target('stamps', _timestamps,
           lambda: [*files('timestamps.txt', Layout.RAW, most=1), _NO_DATE,
                    *samples('kitti/raw/*/*/image_02/timestamps.txt', lines=9)],
           ('kitti/text_file.py', 'model/streams.py', _TEXT_FILE),
           (b'2011-09-26 13:02:25.951199337', b'1969-12-31', b'9999-99-99', b'2262-04-11'),
           is_text=True, long=_MANY),
    Target('times', _times, lambda: [*files('times.txt', Layout.ODOMETRY), b'0.0\n1.037359e-01\n'],
           ('kitti/text_file.py', 'model/streams.py', _TEXT_FILE), is_text=True, long=_MANY),
    Target('poses', _poses,
           lambda: [*files('poses/*.txt', Layout.ODOMETRY), b'1 0 0 0 0 1 0 0 0 0 1 0\n' * 2,
                    *samples('kitti/odometry/dataset/poses/*.txt', lines=3)],
           ('kitti/text_file.py', _TEXT_FILE), is_text=True, long=_MANY),
    Target('scan', _scan, lambda: [*files('velodyne/*.bin', Layout.OBJECT, most=1), b''],
           ('kitti/scan_file.py',), long=_MANY),
    Target('scan_text', _scan_text,
           lambda: [b'1.000 2.000 3.000 0.50\n4.0 5.0 6.0 0.1\n', b'nan inf -1e30 0\n'],
           ('kitti/scan_file.py',), is_text=True, long=_MANY),
    Target('image_set', _image_set,
           lambda: [*files('ImageSets/*.txt', Layout.OBJECT), b'000000\n000001\n', b'a\r\nb\r\n',
                    b'\xef\xbb\xbf000000\n', b'1\n1\n', b''],
           ('kitti/names.py',), is_text=True, long=_MANY),
    Target('mapping', _mapping, _mappings, ('kitti/object_set.py',), (SEPARATOR,),
           is_text=True, long=_MANY),
    Target('journal', _journal, _journals, ('kitti/object_set.py',),
           (b'..', b'"\\ud800"', b'null', b'[]', b'{}', b'NaN'), is_text=True, long=_MANY),
)  # fmt: skip
"""All of them."""
