# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels of real KITTI through real bags: the expected values of the samples' own description."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.kitti.tracklet_file import cuboids_by_frame, format_tracklets, parse_tracklets
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.messages.source_texts import decode_text
from kitti_ros2.model.boxes import clip_bounds, project_corners, unit_corners
from kitti_ros2.options.read import SelectionOptions

from builders import boxes_2d_in, convert_recording, seen_by  # isort: skip
from test_labels import (  # isort: skip
    BOXES_2D,
    DETECTIONS,
    LABELS,
    MARKERS,
    POINTS,
    SOURCE,
    assert_told,
    cubes,
    cuboids_in,
    read,
    told_without_source,
)

if TYPE_CHECKING:
    from pathlib import Path

INFO = '/kitti/camera_color_left/camera_info'
TOPICS = (*LABELS, POINTS, INFO, '/tf_static')
OBJECTS = [
    [('0', 'Pedestrian', 376, 0.889)],
    [('0', 'Truck', 70, 0.938), ('1', 'Car', 9, 0.981), ('2', 'Cyclist', 18, 0.960)],
    [('0', 'Misc', 1351, 0.969), ('1', 'Car', 67, 0.973)],
]
"""By frame: id, class, points inside, and IoU of the projected box with the 2D label."""

STREET = {'0': ('Van', 1093), '1': ('Cyclist', 883), '2': ('Pedestrian', 309)}
"""Of drive 0005's first scan with tracking label 0000: id to class and points inside."""


def run(path: Path, out: Path) -> Path:
    selection = SelectionOptions(topics=TOPICS)
    return convert_recording(path, out, selection=selection).path


@pytest.fixture(scope='module')
def objects(real_kitti, tmp_path_factory):
    return read(run(real_kitti / 'object', tmp_path_factory.mktemp('bag') / 'object.mcap'))


@pytest.fixture(scope='module')
def tracks(real_kitti, tmp_path_factory):
    return read(run(real_kitti / 'tracking', tmp_path_factory.mktemp('bag') / 'tracking.mcap'))


@pytest.fixture(scope='module')
def street(real_kitti, tmp_path_factory):
    """Tracking sequence 0000 with the first scan and image of raw drive 0005, the same drive."""
    root = tmp_path_factory.mktemp('tracking')
    shutil.copytree(real_kitti / 'tracking' / 'training', root / 'training')
    drive = real_kitti / 'raw' / '2011_09_26' / '2011_09_26_drive_0005_sync'
    for source, target in (
        ('velodyne_points/data/0000000000.bin', 'velodyne/0000/000000.bin'),
        ('image_02/data/0000000000.png', 'image_02/0000/000000.png'),
    ):
        (root / 'training' / target).parent.mkdir(parents=True)
        shutil.copyfile(drive / source, root / 'training' / target)
    return read(run(root, tmp_path_factory.mktemp('bag') / 'street.mcap'))


def points_inside(message, cloud) -> dict[str, int]:
    """Points in each box, by the decoded Detection3DArray alone."""
    points = cloud.data.view('<f4').reshape(-1, 4)[:, :3].astype(np.float64)
    return {
        cuboid.identity: int(
            (
                np.abs(cuboid.velo_T_box.inverse().apply(points)) <= np.array(cuboid.size_lwh) / 2
            ).all(axis=1).sum()
        )
        for cuboid in cuboids_in(message)
    }  # fmt: skip


def overlaps(detections, boxes_2d, static, info) -> dict[str, float]:
    """IoU of each projected box with its 2D box, by the decoded messages alone."""
    p = info.p.reshape(3, 4)
    labels = {identity: np.array(bounds) for identity, _, bounds in boxes_2d_in(boxes_2d)}
    found = {}
    for cuboid in cuboids_in(detections):
        corners = cuboid.velo_T_box.apply(unit_corners() * cuboid.size_lwh)
        seen = seen_by(static, info, corners)
        bounds, _ = clip_bounds(project_corners(seen[None], p), (info.width, info.height))
        found[cuboid.identity] = iou(bounds[0], labels[cuboid.identity])
    return found


def iou(one, other) -> float:
    def area(box):
        return max(box[2] - box[0], 0) * max(box[3] - box[1], 0)

    common = area([*np.maximum(one[:2], other[:2]), *np.minimum(one[2:], other[2:])])
    return common / (area(one) + area(other) - common)


def test_points_inside_the_boxes_of_objects(objects):
    for stamp, expected in zip(objects[DETECTIONS], OBJECTS, strict=True):
        message = objects[DETECTIONS][stamp]
        kinds = [one.results[0].hypothesis.class_id for one in message.detections]
        inside = points_inside(message, objects[POINTS][stamp])
        assert [(name, kind, count) for (name, count), kind in zip(inside.items(), kinds,
                                                                   strict=True)] == [
            one[:3] for one in expected
        ]  # fmt: skip


def test_projected_boxes_are_the_2d_labels(objects):
    static = None
    for stamp, expected in zip(objects[DETECTIONS], OBJECTS, strict=True):
        static = objects['/tf_static'].get(stamp, static)
        info = objects[INFO][stamp]
        found = overlaps(objects[DETECTIONS][stamp], objects[BOXES_2D][stamp], static, info)
        assert found == {name: pytest.approx(value, abs=0.01) for name, _, _, value in expected}


def test_points_inside_the_boxes_of_tracks(street):
    [(stamp, cloud)] = street[POINTS].items()
    message = street[DETECTIONS][stamp]
    kinds = {one.id: one.results[0].hypothesis.class_id for one in message.detections}
    inside = points_inside(message, cloud)
    assert {name: (kinds[name], count) for name, count in inside.items()} == STREET
    [static] = street['/tf_static'].values()
    found = overlaps(message, street[BOXES_2D][stamp], static, street[INFO][stamp])
    assert set(found) == set(STREET)
    assert min(found.values()) > 0.7


def test_markers_are_the_detections(street):
    assert len(street[MARKERS]) == 154
    for stamp, message in street[MARKERS].items():
        boxes = cubes(message)
        for cuboid in cuboids_in(street[DETECTIONS][stamp]):
            place, size = boxes[int(cuboid.identity)]
            np.testing.assert_array_equal(place.matrix(), cuboid.velo_T_box.matrix())
            np.testing.assert_array_equal(size, cuboid.size_lwh)


def test_tracking_has_its_fifteen_tracks(tracks):
    assert len(tracks[DETECTIONS]) == 154
    ids = {one.id for message in tracks[DETECTIONS].values() for one in message.detections}
    assert len(ids) == 15
    assert sum(len(message.detections) for message in tracks[BOXES_2D].values()) == 1089


def test_object_files_come_back_to_the_byte(real_kitti, objects):
    folder = real_kitti / 'object' / 'training' / 'label_2'
    files = [decode_text(message) for message in objects[SOURCE].values()]
    assert {file.name: file.text.encode() for file in files} == {
        f'training/label_2/{path.name}': path.read_bytes() for path in folder.iterdir()
    }


def test_the_tracking_file_comes_back_to_the_byte(real_kitti, tracks):
    files = [decode_text(message) for message in tracks[SOURCE].values()]
    name = 'training/label_02/0000.txt'
    assert {file.name for file in files} == {name}
    text = ''.join(file.text for file in files)
    assert text.encode() == (real_kitti / 'tracking' / name).read_bytes()


def test_object_labels_come_back_without_their_source(real_kitti, objects):
    folder = real_kitti / 'object' / 'training' / 'label_2'
    told = told_without_source(objects)
    for frame, path in zip(told.values(), sorted(folder.iterdir()), strict=True):
        assert_told(frame, [line.split() for line in path.read_text().splitlines()])


def test_tracking_labels_come_back_without_their_source(real_kitti, tracks):
    path = real_kitti / 'tracking' / 'training' / 'label_02' / '0000.txt'
    lines = [line.split() for line in path.read_text().splitlines()]
    told = told_without_source(tracks)
    assert len(told) == 154
    for number, frame in enumerate(told.values()):
        rows = [words for words in lines if words[0] == str(number)]
        assert_told(frame, [words[2:] for words in rows])
        ids = [words[1] for words in rows if words[1] != '-1']
        assert [name for name in frame if not name.startswith('-1')] == ids


def test_real_tracklets(real_kitti):
    path = real_kitti / 'devkit' / 'raw' / 'matlab' / 'test_labels.xml'
    tracklets = parse_tracklets(path.read_bytes(), path)
    assert (len(tracklets), sum(len(one.poses) for one in tracklets)) == (20, 2315)
    assert parse_tracklets(format_tracklets(tracklets).encode(), path) == tracklets
    frames = cuboids_by_frame(tracklets)
    assert sorted(frames) == list(range(173))
    first = frames[0][0]
    assert (first.class_name, first.size_lwh) == ('Car', (3.3603947, 1.5138891, 1.4631295))
    middle = (24.46635836520133, -13.904731988596636, -1.8675297769587202 + 1.4631295 / 2)
    np.testing.assert_allclose(first.velo_T_box.translation, middle)


def test_a_drive_takes_real_tracklets(make_drive, real_kitti, tmp_path):
    """As many frames as the drive has stamps; the rest are named."""
    drive = make_drive(8)
    source = real_kitti / 'devkit' / 'raw' / 'matlab' / 'test_labels.xml'
    shutil.copyfile(source, drive / 'tracklet_labels.xml')
    report = convert_recording(
        drive, tmp_path / 'out.mcap', selection=SelectionOptions(topics=TOPICS)
    )
    with open_messages(report.path, (DETECTIONS, POINTS)) as messages:
        found = [(item.topic, item.stamp_ns, bytes(item.data), item.msgtype) for item in messages]
    scans = [stamp for topic, stamp, *_ in found if topic == POINTS]
    labelled = [stamp for topic, stamp, *_ in found if topic == DETECTIONS]
    assert labelled == scans
    tracklets = cuboids_by_frame(parse_tracklets(source.read_bytes(), source))
    arrays = [deserialize(data, kind) for topic, _, data, kind in found if topic == DETECTIONS]
    for number, message in enumerate(arrays):
        expected = [(one.identity, one.class_name) for one in tracklets[number]]
        assert [(one.identity, one.class_name) for one in cuboids_in(message)] == expected
    assert any('no stamp for the tracklets' in loss.message for loss in report.losses)
