# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI-360's boxes in the world and packets: files by the documented form, for none is at hand."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kitti_ros2
from kitti_ros2.datasets import crop
from kitti_ros2.kitti.extract_oxts import add_extract
from kitti_ros2.kitti.kitti360_boxes import (
    LEAST_POINTS,
    BoxIndex,
    WorldBox,
    format_world_boxes,
    label_of,
    parse_world_boxes,
)
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.text_file import format_packet, parse_packet
from kitti_ros2.messages.naming import make_rig
from kitti_ros2.model.boxes import count_points, cuboid_of
from kitti_ros2.model.classes import KITTI_360_LABELS
from kitti_ros2.model.errors import BadFileError, UsageError
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.samples import rect_from_velo
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MarkerOptions, MessageOptions, Objects
from kitti_ros2.options.read import ImuOptions, ReadOptions
from kitti_ros2.synthetic import SyntheticDrive
from kitti_ros2.synthetic.drive import write_extract

from builders import SMALL, convert_recording  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

    from kitti_ros2.model.boxes import Cuboid

DRIVE = Layout.KITTI_360.traits.default_name
CUBE = np.array([
    [0.5, 0.5, 0.5], [0.5, 0.5, -0.5], [0.5, -0.5, 0.5], [0.5, -0.5, -0.5],
    [-0.5, 0.5, -0.5], [-0.5, 0.5, 0.5], [-0.5, -0.5, -0.5], [-0.5, -0.5, 0.5],
])  # fmt: skip
"""As the authors print it, in kitti360Scripts issue 135."""
KITTI_IDS = {name: number for number, (_, name) in KITTI_360_LABELS.items()}


@dataclass(frozen=True)
class Item:
    """An object of a file: its transform has the size as a scale."""

    transform: np.ndarray
    instance: int = 1
    label: str = 'car'
    window: tuple[int, int] = (0, 100)
    timestamp: int = -1
    vertices: np.ndarray | None = None


def scaled(place: Transform, size_lwh) -> np.ndarray:
    matrix = place.matrix()
    matrix[:3, :3] *= size_lwh
    return matrix


def matrix_xml(name: str, values: np.ndarray) -> str:
    """Numbers over several lines, a line of its own for neither the first nor a row."""
    words = [f'{value:.12e}' for value in values.ravel()]
    data = '\n      '.join(' '.join(words[at : at + 4]) for at in range(0, len(words), 4))
    rows, cols = values.shape
    return (
        f'  <{name} type_id="opencv-matrix">\n    <rows>{rows}</rows>\n    <cols>{cols}</cols>\n'
        f'    <dt>f</dt>\n    <data>\n      {data}</data></{name}>\n'
    )


def boxes_xml(items) -> str:
    text = '<?xml version="1.0"?>\n<opencv_storage>\n'
    for index, item in enumerate(items):
        text += f'<object{index}>\n  <index>{index}</index>\n  <label>{item.label}</label>\n'
        text += f'  <semanticId>{KITTI_IDS[item.label]}</semanticId>\n'
        text += f'  <instanceId>{item.instance}</instanceId>\n  <category>1</category>\n'
        text += f'  <start_frame>{item.window[0]}</start_frame>\n'
        text += f'  <end_frame>{item.window[1]}</end_frame>\n'
        text += f'  <timestamp>{item.timestamp}</timestamp>\n'
        text += matrix_xml('transform', item.transform)
        text += matrix_xml('vertices', CUBE if item.vertices is None else item.vertices)
        text += f'</object{index}>\n'
    return f'{text}</opencv_storage>\n'


def write_boxes(root: Path, items, part: str = 'train', drive: str = DRIVE) -> Path:
    path = root / 'data_3d_bboxes' / part / f'{drive}.xml'
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(boxes_xml(items))
    return path


LABELS_OF = {
    'Car': ('Car', 26),
    'Van': ('Car', 26),
    'Truck': ('Truck', 27),
    'Pedestrian': ('Pedestrian', 24),
    'Cyclist': ('rider', 25),
}
"""By KITTI's class that of the label in the file, and the id of the label."""


def truth(recording) -> dict[int, list[Cuboid]]:
    """By frame the boxes that it has, in the order of the file; classes and sizes as in it."""
    drive = SyntheticDrive(SMALL, Layout.KITTI_360)
    rect_t_velo = rect_from_velo(drive.calibration)
    boxes = [box for number in sorted(drive.posed) for box in drive.boxes(number)]
    tracks: dict[int, set[int]] = {}
    for box in boxes:
        tracks.setdefault(LABELS_OF[box.class_name][1], set()).add(box.track_id)
    frames: dict[int, list[Cuboid]] = {}
    for box in boxes:
        cuboid = cuboid_of(box, '', rect_t_velo)
        class_name, label = LABELS_OF[box.class_name]
        track = label * 1000 + 1 + sorted(tracks[label]).index(box.track_id)
        grown = tuple(size + 0.002 for size in cuboid.size_lwh)
        cuboid = replace(cuboid, class_name=class_name, size_lwh=grown, track_id=track)
        frames.setdefault(box.frame, []).append(cuboid)
    counts = {
        number: count_points(cuboids, recording.read(Stream.SCAN, number).points)
        for number, cuboids in frames.items()
    }
    return {
        number: [c for c, count in zip(cuboids, counts[number], strict=True) if count >= 5]
        for number, cuboids in frames.items()
    }


@pytest.fixture
def labelled(recordings) -> Path:
    """The synthetic recording, which has boxes and packets; not to be changed."""
    return recordings[Layout.KITTI_360]


def same(cuboid, expected, *, atol=5e-4):
    assert (cuboid.class_name, cuboid.track_id) == (expected.class_name, expected.track_id)
    assert cuboid.size_lwh == pytest.approx(expected.size_lwh, abs=atol)
    np.testing.assert_allclose(cuboid.velo_T_box.matrix(), expected.velo_T_box.matrix(), atol=atol)


def test_a_frame_has_the_boxes_with_points_of_its_scan(labelled):
    recording = open_recording(labelled)
    expected = truth(recording)
    assert not recording.losses
    assert recording.streams[Stream.LABELS].numbers.tolist() == [*expected] == [1, 2, 3, 4]
    for number, boxes in expected.items():
        cuboids = recording.read(Stream.LABELS, number).cuboids
        for cuboid, box in zip(cuboids, boxes, strict=True):
            same(cuboid, box)
        assert {'Car', 'Pedestrian', 'rider'} <= {cuboid.class_name for cuboid in cuboids}
        behind = [c for c in cuboids if c.velo_T_box.translation[0] < 0]
        assert 2 < len(behind) < len(cuboids) - 2
    scans = recording.streams[Stream.SCAN]
    stamps = recording.streams[Stream.LABELS].stamps_ns
    np.testing.assert_array_equal(stamps, scans.stamps_ns[1:])


def test_what_stands_has_one_box_and_what_moves_one_a_frame(labelled):
    boxes = kitti_ros2.read_world_boxes(labelled / f'data_3d_bboxes/train/{DRIVE}.xml')
    frames: dict[int, list[int | None]] = {}
    for box in boxes:
        assert box.window[0] >= 1
        assert box.window[1] <= 4
        frames.setdefault(box.track_id, []).append(box.frame)
    kinds = {frames[box.track_id][0] is None for box in boxes}
    assert kinds == {False, True}
    for numbers in frames.values():
        assert numbers == [None] or numbers == sorted({*numbers})


def test_boxes_are_those_of_other_layouts(recordings):
    """As far as the file can hold them, which is of frames with a pose, with a millimetre more."""
    raw, with_boxes = (open_recording(recordings[each]) for each in (Layout.RAW, Layout.KITTI_360))
    matched = 0
    for number in with_boxes.streams[Stream.LABELS].numbers.tolist():
        found = with_boxes.read(Stream.LABELS, number).cuboids
        cuboids = [
            replace(cuboid, size_lwh=tuple(size + 0.002 for size in cuboid.size_lwh))
            for cuboid in raw.read(Stream.LABELS, number).cuboids
        ]
        counts = count_points(cuboids, with_boxes.read(Stream.SCAN, number).points)
        for cuboid, count in zip(cuboids, counts, strict=True):
            if count < 2 * LEAST_POINTS:
                continue
            place = cuboid.velo_T_box.matrix()
            (box,) = (f for f in found if np.allclose(f.velo_T_box.matrix(), place, atol=2e-3))
            assert box.size_lwh == pytest.approx(cuboid.size_lwh, abs=2e-3)
            assert box.class_name == LABELS_OF[cuboid.class_name][0]
            matched += 1
    assert matched > 10


def test_labels_and_packets_in_a_bag(labelled, tmp_path):
    trails = MessageOptions(markers=replace(MarkerOptions(), trails=True))
    report = convert_recording(labelled, tmp_path / 'bag.mcap', trails)
    assert not report.losses
    with_bag, folder = kitti_ros2.open(tmp_path / 'bag.mcap'), kitti_ros2.open(labelled)
    assert {name: [*numbers] for name, numbers in with_bag.streams.items()} == {
        name: [*numbers] for name, numbers in folder.streams.items()
    }
    for frame in folder:
        again = with_bag.frame(frame.number)
        assert again.oxts == frame.oxts
        assert [o.track for o in again.objects] == [o.track for o in frame.objects]
        for one, other in zip(again.objects, frame.objects, strict=True):
            np.testing.assert_allclose(one.corners('map'), other.corners('map'), atol=1e-3)
    kitti_ros2.to_kitti(tmp_path / 'bag.mcap', tmp_path / 'again')
    for path in [*labelled.glob('data_3d_bboxes/*/*.xml'), *labelled.rglob('oxts/**/*.txt')]:
        assert (tmp_path / 'again' / path.relative_to(labelled)).read_bytes() == path.read_bytes()


def test_labels_in_other_messages_are_not_read_in_silence(labelled, tmp_path):
    convert_recording(labelled, tmp_path / 'bag.mcap', MessageOptions(objects=Objects.AUTOWARE))
    recording = kitti_ros2.open(tmp_path / 'bag.mcap')
    assert 'labels' not in recording.streams
    (note,) = (note for note in recording.notes if 'labels in' in note)
    assert '/kitti/labels/markers, /kitti/labels/tracked_objects are not read' in note


def test_packets_have_stamps_of_their_own(labelled):
    recording, drive = open_recording(labelled), SyntheticDrive(SMALL, Layout.KITTI_360)
    index = recording.streams[Stream.OXTS]
    assert index.stamps_ns.tolist() == [drive.packet_stamp(n) for n in range(len(drive))]
    text = format_packet(drive.packet(3))
    assert recording.read(Stream.OXTS, 3) == parse_packet(text, 'oxts')
    scans = recording.streams[Stream.SCAN]
    np.testing.assert_array_equal(recording.streams[Stream.POSE].stamps_ns, scans.stamps_ns[1:])


def test_packets_of_the_unsynchronised_drive(labelled, tmp_path):
    """data_poses_oxts_extract.zip, taken to be as the same of raw drives."""
    options = replace(SMALL, extract=True)
    write_extract(tmp_path, SyntheticDrive(options))
    (extract,) = tmp_path.glob('*/*_extract')
    there = tmp_path / f'{DRIVE.removesuffix("sync")}extract'
    extract.rename(there)
    drive = SyntheticDrive(options)
    recording = open_recording(labelled)
    add_extract(recording, ImuOptions(there))
    index = recording.streams[Stream.OXTS_EXTRACT]
    assert len(index) > 5 * len(drive)
    number = int(index.numbers[7])
    text = format_packet(drive.arrived(number))
    assert recording.read(Stream.OXTS_EXTRACT, number) == parse_packet(text, 'oxts')


def test_boxes_become_labels_of_other_layouts(labelled, tmp_path):
    convert_recording(labelled, tmp_path / 'bag.mcap')
    (report,) = kitti_ros2.to_kitti(tmp_path / 'bag.mcap', tmp_path / 'set', layout='object')
    assert not report.losses
    width, height = SMALL.image_size
    recording = open_recording(labelled)
    assert any('dropped 1 of 5 frames: no labels' in note for note in report.notes)
    for line, number in enumerate(recording.streams[Stream.LABELS].numbers.tolist()):
        made = kitti_ros2.read_labels(tmp_path / f'set/training/label_2/{line:06d}.txt')
        sizes = [cuboid.size_lwh for cuboid in recording.read(Stream.LABELS, number).cuboids]
        assert made
        for box in made:
            left, top, right, bottom = box.box_2d
            assert 0 <= left < right <= width - 1
            assert 0 <= top < bottom <= height - 1
            assert any(np.allclose(size, box.size_hwl[::-1], atol=1e-3) for size in sizes)


def test_no_frame_of_camera_2_is_invented(labelled, tmp_path):
    """2D boxes of KITTI's labels are of camera 2, here a fisheye."""
    shutil.copytree(labelled, tmp_path / 'set', ignore=shutil.ignore_patterns('image_0[23]*'))
    assert make_rig(open_recording(tmp_path / 'set'), MessageOptions()).cameras == {0, 1}


def test_empty_labels_are_not_dropped_from_the_file_of_a_drive(labelled, tmp_path):
    with pytest.raises(UsageError, match='objects over several frames'):
        crop(labelled, tmp_path / 'out', range=':40', empty_labels='drop')


COURSE = (3554, 2570, 837, 57, 4816, 3775, 1774, 7)
"""Points of the scan in 12 cars, of which 4 have none; README.md beside the real files."""


@pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')
def test_cars_in_a_real_scan(real_360, tmp_path):
    """The corners are not the data set's file, but made of it, in the order of its cube."""
    real, drive = real_360, '2013_05_28_drive_0000_sync'
    shutil.copytree(real, tmp_path / 'set', copy_function=os.symlink)
    rows = np.loadtxt(real / f'data_poses/{drive}/poses.txt')
    (pose,) = rows[rows[:, 0] == 1134, 1:].reshape(-1, 3, 4)
    lines = (real / 'calibration/calib_cam_to_pose.txt').read_text().splitlines()
    mount = np.array(lines[0].split()[1:], float).reshape(3, 4)
    rectified = next(
        np.array(line.split()[1:], float).reshape(3, 3)
        for line in (real / 'calibration/perspective.txt').read_text().splitlines()
        if line.startswith('R_rect_00:')
    )
    items = []
    for index, car in enumerate(
        json.loads((real / 'extra/course_boxes/BBoxes_1134.json').read_text())
    ):
        in_imu = np.array(car['corners_cam0']) @ rectified @ mount[:, :3].T + mount[:, 3]
        corners = in_imu @ pose[:, :3].T + pose[:, 3]
        solved = np.linalg.lstsq(np.c_[CUBE, np.ones(8)], corners, rcond=None)[0]
        assert np.abs(np.c_[CUBE, np.ones(8)] @ solved - corners).max() < 1e-5
        items.append(Item(np.vstack([solved.T, [0, 0, 0, 1]]), index + 1, window=(1100, 1120)))
    write_boxes(tmp_path / 'set', items, drive=drive)
    recording = open_recording(tmp_path / 'set', ReadOptions(sequence='0000'))
    assert recording.streams[Stream.LABELS].numbers.tolist() == [1134]
    cuboids = recording.read(Stream.LABELS, 1134).cuboids
    points = recording.read(Stream.SCAN, 1134).points
    assert tuple(count_points(cuboids, points)) == COURSE
    for cuboid in cuboids:
        length, width, height = cuboid.size_lwh
        assert length > width >= height  # as of a car: x is ahead, z is up
        assert cuboid.velo_T_box.rotation[2, 2] > 0.97


@pytest.mark.parametrize(
    ('label', 'class_name', 'track'),
    [
        ('car', 'Car', 26007),
        ('truck', 'Truck', 27007),
        ('person', 'Pedestrian', 24007),
        ('train', 'Tram', 31007),
        ('rider', 'rider', 25007),
        ('bicycle', 'bicycle', 33007),
        ('traffic sign', 'traffic sign', 20007),
        ('building', 'building', 11007),
    ],
)
def test_classes_and_ids_of_instance_images(label, class_name, track):
    (box,) = parse_world_boxes(boxes_xml([Item(np.eye(4), 7, label)]).encode(), 'x.xml').boxes
    assert (box.label, box.class_name, box.track_id) == (label, class_name, track)
    assert box.window == (0, 100)
    assert box.frame is None


def turned(yaw: float, pitch: float = 0.0) -> np.ndarray:
    c, s, d, t = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ [[d, 0, t], [0, 1, 0], [-t, 0, d]]


numbers = st.integers(0, 10_000)
coordinates = st.floats(-1e4, 1e4)
angles = st.floats(-3.1, 3.1)
written_boxes = st.builds(
    lambda label, track, angles, place, size, window, frame: WorldBox(
        label, label, track, Transform(turned(*angles), np.array(place)), size,
        (min(window), max(window)), frame,
    ),
    st.sampled_from(sorted(KITTI_IDS)),
    st.integers(1, 10**6),
    st.tuples(angles, angles),
    st.tuples(coordinates, coordinates, coordinates),
    st.tuples(*[st.floats(0.1, 30)] * 3),
    st.tuples(numbers, numbers),
    st.one_of(st.none(), numbers),
)  # fmt: skip


@given(st.lists(written_boxes, max_size=6, unique_by=lambda box: (box.label, box.track_id)))
def test_a_written_file_is_read_again(boxes):
    text = format_world_boxes(boxes)
    again, errors, shapes = parse_world_boxes(text.encode(), 'x.xml')
    assert not errors
    assert not shapes
    seen: dict[str, int] = {}
    for box, read in zip(boxes, again, strict=True):
        seen[box.label] = seen.get(box.label, 0) + 1
        assert read.track_id == KITTI_360_LABELS[KITTI_IDS[box.label]][0] * 1000 + seen[box.label]
        assert (read.label, read.window, read.frame) == (box.label, box.window, box.frame)
        assert read.size_lwh == pytest.approx(box.size_lwh, rel=1e-6)
        place = box.world_T_box.matrix()
        np.testing.assert_allclose(read.world_T_box.matrix(), place, atol=1e-4)


def test_labels_of_no_class_of_the_data_set_are_refused():
    assert [label_of(name) for name in ('Car', 'Van', 'Tram', 'rider')] == [
        'car', 'car', 'train', 'rider',
    ]  # fmt: skip
    box = WorldBox('Robot', label_of('Robot'), 1, Transform.identity(), (1.0, 1.0, 1.0))
    with pytest.raises(ValueError, match=r"'Robot' is no label of KITTI-360"):
        format_world_boxes([box])


def test_ids_are_unique_in_a_frame():
    items = [
        Item(np.eye(4), 7),
        Item(np.eye(4), 7),
        Item(np.eye(4), 0),
        Item(np.eye(4), 8, timestamp=3),
        Item(np.eye(4), 8, timestamp=4),
        Item(np.eye(4), 8, timestamp=4),
        Item(np.eye(4), 7, timestamp=4),
    ]
    boxes = parse_world_boxes(boxes_xml(items).encode(), 'x.xml').boxes
    tracks = [box.track_id for box in boxes]
    assert tracks == [26007, 1000002, 1000003, 26008, 26008, 1000006, 1000007]
    assert [box.frame for box in boxes] == [None, None, None, 3, 4, 4, 4]


def test_the_dialect_of_drive_0004():
    text = boxes_xml([Item(np.eye(4)), Item(np.eye(4)), Item(np.eye(4))])
    first, second, third = text.split('<object')[1:]
    out = f'<opencv_storage><object{first}<object{second}<object{third}'
    for index, dynamic in enumerate((0, 1, 1)):
        given = f'<semanticId>{KITTI_IDS["car"]}</semanticId>\n  <instanceId>1</instanceId>'
        said = f'<dynamic>{dynamic}</dynamic><dynamicSeq>{index}</dynamicSeq>'
        out = out.replace(given, said, 1)
    boxes = parse_world_boxes(out.encode(), 'x.xml').boxes
    assert [box.track_id for box in boxes] == [1000001, 2000001, 2000002]
    assert {box.class_name for box in boxes} == {'Car'}


@pytest.mark.parametrize(
    ('vertices', 'size', 'middle'),
    [(CUBE, (4, 2, 1.5), (0, 0, 0)), (CUBE[::-1], (4, 2, 1.5), (0, 0, 0)),
     (CUBE * [60, 34, 19] + [0, 0, 3], (240, 68, 28.5), (0, 0, 4.5))],
)  # fmt: skip
@pytest.mark.parametrize('mirrored', [False, True])
def test_size_and_place_are_in_the_transform(vertices, size, middle, mirrored):
    place = Transform(turned(2.5, 0.1), np.array([1000.0, -2000.0, 115.0]))
    matrix = scaled(place, (4, -2 if mirrored else 2, 1.5))
    text = boxes_xml([Item(matrix, vertices=vertices)])
    (box,) = parse_world_boxes(text.encode(), 'x.xml').boxes
    assert box.size_lwh == pytest.approx(size)
    np.testing.assert_allclose(box.world_T_box.rotation, place.rotation, atol=1e-9)
    np.testing.assert_allclose(box.world_T_box.translation, place.apply([middle])[0], atol=1e-6)


def test_shapes_that_are_no_boxes_are_counted(labelled, tmp_path):
    shutil.copytree(labelled, tmp_path / 'set')
    flat = np.array([[0.0, 0, 0], [4, 0, 0], [4, 9, 0], [0, 9, 0]])
    prism = np.vstack([CUBE[:7], [[-0.5, -0.2, 0.5]]])
    road = [Item(np.eye(4), 0, 'road', vertices=v) for v in (flat, prism)]
    path = write_boxes(tmp_path / 'set', [Item(np.eye(4)), *road])
    bare = '<object99><index>3</index><label>sky</label></object99></opencv_storage>'
    path.write_text(path.read_text().replace('</opencv_storage>', bare))
    recording = open_recording(tmp_path / 'set')
    assert not recording.losses
    (note,) = (note for note in recording.notes if 'are no boxes' in note)
    assert '3 objects are no boxes (2 road, 1 without a transform); they are left out' in note


@pytest.mark.parametrize(
    ('old', 'new', 'reason'),
    [
        ('<semanticId>13<', '<semanticId>99<', 'object1: semanticId 99'),
        ('<semanticId>13<', '<semanticId>car<', "object1: 'car' is no number"),
        ('<timestamp>-1<', '<timestamp>1.5<', 'object1: timestamp 1.5'),
        ('<timestamp>-1<', '<timestamp>1e300<', 'object1: timestamp 1e300'),
        ('<end_frame>100<', '<end_frame>-1<', 'start_frame 0 after end_frame -1'),
        ('1.000000000000e+00 0.0', '1e200 0.0', 'a coordinate beyond a million kilometres'),
        ('<rows>4</rows>', '<rows>3</rows>', 'transform of 3 rows, 4 columns, 16 values'),
        ('1.000000000000e+00 0.0', 'nan 0.0', 'object1: '),
        ('1.000000000000e+00 0.0', '0 0.0', 'a transform that has no scale'),
        ('0.000000000000e+00 1.0', '0.5 1.0', 'axes are not at right angles'),
    ],
)
def test_an_invalid_object_costs_itself_alone(old, new, reason):
    head, first, second = boxes_xml([Item(np.eye(4)), Item(np.eye(4), 2)]).partition('<object1')
    assert old in second
    text = head + first + second.replace(old, new, 1)
    boxes, (error,), _ = parse_world_boxes(text.encode(), 'x.xml')
    assert [box.track_id for box in boxes] == [26001]
    assert reason in str(error)
    assert str(error).startswith('x.xml:')


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('<opencv_storage><object1>', 'no whole XML'),
        ('<html></html>', "a root 'html'"),
        (
            '<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage>&b;</opencv_storage>',
            "XML with entities ('b')",
        ),
        ('<opencv_storage>' + '<a>' * 200, 'more than 100 levels'),
    ],
)
def test_another_file_is_refused(text, reason):
    with pytest.raises(BadFileError, match='XML of KITTI-360') as raised:
        parse_world_boxes(text.encode(), 'x.xml')
    assert reason in str(raised.value)


def test_a_damaged_file_is_a_loss_of_labels(labelled, tmp_path):
    shutil.copytree(labelled, tmp_path / 'set')
    path = tmp_path / 'set/data_3d_bboxes/train' / f'{DRIVE}.xml'
    path.write_text(path.read_text()[:-40])
    recording = open_recording(tmp_path / 'set')
    assert Stream.LABELS not in recording.streams
    assert [loss.stream for loss in recording.losses] == ['labels']
    assert 'no whole XML' in recording.losses[0].message


@pytest.mark.parametrize('without', ['calibration', 'data_poses', 'data_3d_raw'])
def test_boxes_need_poses_scans_and_calibration(labelled, tmp_path, without):
    shutil.copytree(labelled, tmp_path / 'set')
    path = tmp_path / 'set' / without
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    recording = open_recording(tmp_path / 'set')
    assert Stream.LABELS not in recording.streams
    assert any('a frame needs a scan, a pose' in loss.message for loss in recording.losses)


def test_instances_alone_are_read_before_everything(labelled, tmp_path):
    shutil.copytree(labelled, tmp_path / 'set')
    write_boxes(tmp_path / 'set', [], 'train_full')
    assert len(open_recording(tmp_path / 'set').streams[Stream.LABELS]) == SMALL.frames - 1
    (tmp_path / 'set/data_3d_bboxes/train' / f'{DRIVE}.xml').unlink()
    assert Stream.LABELS not in open_recording(tmp_path / 'set').streams


def test_a_standing_object_is_looked_for_around_its_window():
    """The car drives 1 m a frame, turns back at frame 500, and passes the object again."""
    numbers = np.arange(1, 1000, 2)
    x = np.where(numbers < 500, numbers, 1000 - numbers).astype(float)
    positions = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    place = Transform.from_translation([200.0, 3.0, 0.0])
    moving = Transform.from_translation([30.0, 3.0, 0.0])
    items = [
        Item(place.matrix(), window=(150, 180)),
        Item(moving.matrix(), 2, window=(0, 180), timestamp=41),
    ]
    boxes = parse_world_boxes(boxes_xml(items).encode(), 'x.xml').boxes
    index = BoxIndex(boxes, numbers, positions)
    points = np.array([[x, 3.0, 0.1, 0] for x in (-11.0, 159.0)] * LEAST_POINTS, np.float32)
    assert index.frames(numbers).tolist() == [41, *range(115, 287, 2)]
    at = Transform.from_translation([-41.0, 0.0, 0.0])
    assert [c.track_id for c in index.of_frame(41, at, points)] == [26002]
    near = np.array([[0.0, 3.0, 0.1, 0]] * LEAST_POINTS, np.float32)
    beside = Transform.from_translation([-200.0, 0.0, 0.0])
    assert [c.track_id for c in index.of_frame(199, beside, near)] == [26001]
    assert not index.of_frame(199, beside, near[1:])
    assert not index.of_frame(801, beside, near)  # the way back
    assert [*index.moving()] == [41]


def test_world_boxes_of_a_file(tmp_path):
    path = write_boxes(tmp_path, [Item(scaled(Transform.identity(), (4, 2, 1.5)))])
    (box,) = kitti_ros2.read_world_boxes(path)
    assert (box.class_name, box.size_lwh) == ('Car', (4.0, 2.0, 1.5))
    path.write_text(path.read_text().replace('<cols>4</cols>', '<cols>5</cols>'))
    with pytest.raises(kitti_ros2.KittiRos2Error, match='transform of 4 rows, 5 columns'):
        kitti_ros2.read_world_boxes(path)
