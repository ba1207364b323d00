# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels from files to messages: every layout that has them, and files with mistakes in them."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from functools import cache
from math import pi
from typing import TYPE_CHECKING

import numpy as np
import pytest

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.tracklet_file import format_tracklets, parse_tracklets
from kitti_ros2.messages.camera_info import decode_static
from kitti_ros2.messages.cdr import deserialize, join, serialize, stamp_ns_of, transform_of
from kitti_ros2.messages.detections import cuboids_of_detections
from kitti_ros2.messages.markers import encode_markers
from kitti_ros2.messages.naming import FrameNames
from kitti_ros2.messages.source_texts import decode_text
from kitti_ros2.model.boxes import Box, box_of, box_rotations
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.samples import FrameLabels, Trails, cuboids_of, identified, rect_from_velo
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MarkerOptions, MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions
from kitti_ros2.synthetic.sensors import ELEVATIONS, MAX_RANGE, cast_scan

from builders import SMALL, boxes_2d_in, convert_recording, parse_boxes  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

    from kitti_ros2.model.boxes import Cuboid
    from kitti_ros2.own_bags.to_bag import ExportReport

POINTS = '/kitti/velo/points'
DETECTIONS = '/kitti/labels/detections'
BOXES_2D = '/kitti/labels/boxes_2d'
MARKERS = '/kitti/labels/markers'
SOURCE = '/kitti/source/labels'
GRID_M = 1e-3
"""Of the points of scans; half of it is how far rounding moves a coordinate."""
LABELS = (DETECTIONS, BOXES_2D, MARKERS, SOURCE)
LABELLED = [Layout.RAW, Layout.OBJECT, Layout.TRACKING, Layout.KITTI_360]
KIND_NAMES = ('box', 'edges', 'heading', 'text')


def run(path: Path, out: Path, *topics: str, markers: MarkerOptions | None = None) -> ExportReport:
    """Convert the labels, the scans, and what tells where they are."""
    selection = SelectionOptions(topics=(*LABELS, POINTS, '/tf_static', *topics))
    messages = MessageOptions(markers=markers or MarkerOptions())
    return convert_recording(path, out, messages, selection)


def copy(path: Path, folder: Path) -> Path:
    """A recording of one's own to break, without its images."""
    return shutil.copytree(path, folder / 'own', ignore=shutil.ignore_patterns('image_*'))


def read(out: Path) -> dict[str, dict[int, object]]:
    """Messages by topic and log time."""
    found: dict[str, dict[int, object]] = {}
    with open_messages(out) as messages:
        for item in messages:
            message = deserialize(item.data, item.msgtype)
            assert item.stamp_ns not in found.setdefault(item.topic, {}), item.topic
            found[item.topic][item.stamp_ns] = message
    return found


def raw_bytes(out: Path) -> dict[str, dict[int, bytes]]:
    """The same as CDR."""
    found: dict[str, dict[int, bytes]] = {}
    with open_messages(out) as messages:
        for item in messages:
            found.setdefault(item.topic, {})[item.stamp_ns] = bytes(item.data)
    return found


read_once = cache(read)
raw_bytes_once = cache(raw_bytes)
"""For bags that several tests look at, and none changes."""


def cubes(message):
    """The boxes of a MarkerArray: id to (place, size)."""
    return {
        marker.id: (
            transform_of(marker.pose),
            np.array([marker.scale.x, marker.scale.y, marker.scale.z]),
        )
        for marker in message.markers
        if marker.ns == 'box'
    }


def marker_names(message) -> set[tuple[str, int]]:
    return {(marker.ns, marker.id) for marker in message.markers if marker.ns in KIND_NAMES}


def rect_t_velo_of(static) -> Transform:
    """The rectified camera 0 in velo_link, as /tf_static tells it."""
    for parent, child, transform in decode_static(static):
        if (parent, child) == ('velo_link', 'camera_gray_left_optical_frame'):
            return transform.inverse()
    raise AssertionError('velo_link has no camera')


@dataclass(frozen=True)
class Told:
    """What detections and boxes_2d tell of a label; no 3D numbers for a 2D box."""

    class_name: str
    box_2d: tuple[float, ...]
    size_hwl: tuple[float, ...] | None = None
    location: tuple[float, ...] | None = None
    rotation_y: float | None = None


def cuboids_in(message) -> list[Cuboid]:
    """The boxes of a Detection3DArray in velo_link."""
    cuboids, skipped = cuboids_of_detections(message, {'velo_link': Transform.identity()})
    assert not skipped
    return cuboids


def told_without_source(found) -> dict[int, dict[str, Told]]:
    """By log time and id, from detections, boxes_2d and tf_static alone."""
    frames: dict[int, dict[str, Told]] = {}
    rect_t_velo = None
    for stamp, message in found[BOXES_2D].items():
        if stamp in found['/tf_static']:
            rect_t_velo = rect_t_velo_of(found['/tf_static'][stamp])
        frame = {identity: Told(kind, box) for identity, kind, box in boxes_2d_in(message)}
        assert len(frame) == len(message.detections)
        for cuboid in cuboids_in(found[DETECTIONS][stamp]):
            location, size, rotation_y = box_of(cuboid, rect_t_velo)
            told = frame[cuboid.identity]
            assert told.class_name == cuboid.class_name
            frame[cuboid.identity] = Told(
                told.class_name, told.box_2d, size, tuple(location), rotation_y
            )
        frames[stamp] = frame
    return frames


def assert_told(told: dict[str, Told], lines: list[list[str]]):
    """That the messages tell each number of label lines (words from the class on) to 0.005."""
    assert len(told) == len(lines)
    for one, words in zip(told.values(), lines, strict=True):
        assert one.class_name == words[0]
        numbers = [float(word) for word in words[1:]]
        np.testing.assert_allclose(one.box_2d, numbers[3:7], rtol=0, atol=0.005)
        if words[0] == 'DontCare':
            assert one.location is None
            continue
        np.testing.assert_allclose(one.size_hwl, numbers[7:10], rtol=0, atol=0.005)
        np.testing.assert_allclose(one.location, numbers[10:13], rtol=0, atol=0.005)
        turn = (one.rotation_y - numbers[13] + pi) % (2 * pi) - pi
        assert abs(turn) <= 0.005


@pytest.fixture(scope='module')
def bags(recordings, tmp_path_factory) -> dict[Layout, Path]:
    """The labels of each unbroken recording."""
    folder = tmp_path_factory.mktemp('bags')
    return {one: run(recordings[one], folder / f'{one.value}.mcap').path for one in LABELLED}


# The values.


def box(kind='Car', size=(1.5, 1.6, 4.0), track_id=None, **values) -> Box:
    frame = None if track_id is None else 0
    return Box(
        **{'class_name': kind, 'truncated': 0.0, 'occluded': 0, 'alpha': 0.0,
           'box_2d': (0.0, 0.0, 9.0, 9.0), 'size_hwl': size, 'location': (0.0, 1.6, 20.0),
           'rotation_y': -1.57, 'frame': frame, 'track_id': track_id} | values
    )  # fmt: skip


def test_ids_are_places_in_the_file_and_bad_lines_do_not_shift_them():
    labels = FrameLabels(boxes=[box(), None, box('DontCare'), box('Van')])
    assert [(name, one.class_name) for name, one in identified(labels)] == [
        ('0', 'Car'),
        ('2', 'DontCare'),
        ('3', 'Van'),
    ]


def test_ids_are_tracks_and_dont_care_regions_keep_apart():
    boxes = [box('DontCare', track_id=-1), box('DontCare', track_id=-1), box(track_id=0)]
    assert [name for name, _ in identified(FrameLabels(boxes=boxes))] == ['-1.0', '-1.1', '0']


def test_which_boxes_become_cuboids():
    calibration = SyntheticDrive(SMALL).calibration
    boxes = [
        box('DontCare', (-1.0, -1.0, -1.0)),
        box('Car', (-1.0, -1.0, -1.0)),
        box('Car', (0.0, 1.6, 4.0)),
        box('my-robot', (0.2, 0.3, 0.4)),
        None,
        box('Car', (1.5, 1.6, -4.0)),
        box('Van', score=0.5),
    ]
    found = cuboids_of(FrameLabels(boxes=boxes), calibration)
    assert [(one.identity, one.class_name, one.score) for one in found] == [
        ('3', 'my-robot', None),
        ('6', 'Van', 0.5),
    ]


def test_boxes_need_a_calibration_only_where_there_are_3d_boxes():
    calibration = SyntheticDrive(SMALL).calibration
    for lacking in ({'r0_rect': None}, {'cam0_T_velo': None}):
        poor = replace(calibration, **lacking)
        assert cuboids_of(FrameLabels(boxes=[box('DontCare')]), poor) == []
        with pytest.raises(ValueError, match='calibration'):
            cuboids_of(FrameLabels(boxes=[box()]), poor)


def test_trails_grow_with_the_frames_and_skip_what_has_no_pose():
    calibration = SyntheticDrive(SMALL).calibration
    [cuboid] = cuboids_of(FrameLabels(boxes=[box(track_id=4)]), calibration)
    frames = {number: [cuboid] for number in (0, 1, 2, 5)} | {3: []}
    poses = {n: Transform.from_translation((float(n), 0.0, 0.0)) for n in (0, 1, 3, 5)}
    trails = Trails(frames, poses.get)
    middle = cuboid.velo_T_box.translation
    for number, until in ((0, [0]), (1, [0, 1]), (5, [0, 1, 5])):
        [(track, places)] = trails.up_to(number).items()
        assert track == 4
        np.testing.assert_allclose(places - middle, [(n, 0, 0) for n in until])
    assert trails.up_to(3) == trails.up_to(2) == trails.up_to(9) == {}
    untracked = {0: [replace(cuboid, track_id=None)]}
    assert Trails(untracked, poses.get).up_to(0) == {}


# The synthetic street, whose points are known by the object they hit.


def hit_points(drive: SyntheticDrive, frame: int):
    """The scan's points, and for each the index into drive.placed of what it hit, -1 for none."""
    ranges, hits = cast_scan(drive.placed(frame), drive.options.lidar_columns)
    slant = np.sqrt(1 + np.tan(ELEVATIONS) ** 2)[:, None]
    return drive.scan(frame).points[:, :3], hits[ranges * slant <= MAX_RANGE]


def nearest_to(drive: SyntheticDrive, frame: int, velo_t_box: Transform) -> int:
    """Which of drive.placed has its middle where a box has it."""
    middles = [np.add(one.centre, (0, 0, one.solid.size[2] / 2)) for one in drive.placed(frame)]
    distances = np.linalg.norm(np.array(middles) - velo_t_box.translation, axis=1)
    assert distances.min() < 0.05
    return int(np.argmin(distances))


def solid_at(drive: SyntheticDrive, frame: int, velo_t_box: Transform):
    return drive.placed(frame)[nearest_to(drive, frame, velo_t_box)].solid


def assert_cubes_enclose_their_points(drive, frame, found, tolerance) -> int:
    """Each cube is of one labelled object, whose points it encloses; how many those are."""
    points, hits = hit_points(drive, frame)
    assert len(points) == len(hits)
    enclosed, met = 0, set()
    for cube, size in found.values():
        solid = solid_at(drive, frame, cube)
        np.testing.assert_allclose(size, solid.size, atol=tolerance)
        own = cube.inverse().apply(points[hits == nearest_to(drive, frame, cube)])
        assert (np.abs(own) <= size / 2 + tolerance + GRID_M).all()
        met.add(solid.track_id)
        enclosed += len(own)
    assert met == {one.track_id for one in drive.boxes(frame)}
    return enclosed


@pytest.mark.parametrize(
    ('layout', 'tolerance'),
    # Object labels have two decimals: half a centimetre, and 0.005 rad at half a car's length.
    [(Layout.RAW, 1e-3), (Layout.TRACKING, 1e-3), (Layout.OBJECT, 0.025)],
)
def test_every_marker_encloses_the_points_of_its_object(bags, layout, tolerance):
    drive = SyntheticDrive(SMALL)
    found = read_once(bags[layout])
    assert len(found[MARKERS]) == SMALL.frames
    enclosed = 0
    for frame, (stamp, message) in enumerate(found[MARKERS].items()):
        cloud = found[POINTS][stamp]
        np.testing.assert_array_equal(
            cloud.data.view('<f4').reshape(-1, 4), drive.scan(frame).points
        )
        of_objects = [marker for marker in message.markers if marker.ns in KIND_NAMES]
        assert {marker.header.frame_id for marker in of_objects} == {'velo_link'}
        assert {stamp_ns_of(marker.header) for marker in of_objects} == {stamp}
        enclosed += assert_cubes_enclose_their_points(drive, frame, cubes(message), tolerance)
    assert enclosed > 1000


def test_markers_enclose_their_points_over_a_whole_trajectory():
    """Twenty frames and a dense scan, without files."""
    options = SyntheticOptions(frames=20, image_size=(310, 94), lidar_columns=1000)
    drive = SyntheticDrive(options)
    for frame in range(len(drive)):
        labels = FrameLabels(boxes=drive.boxes(frame))
        cuboids = cuboids_of(labels, drive.calibration)
        parts = encode_markers(cuboids, {}, 0, FrameNames(), MarkerOptions())
        message = deserialize(join(parts), 'visualization_msgs/msg/MarkerArray')
        found = cubes(message)
        assert set(found) == {one.track_id for one in labels.boxes}
        assert assert_cubes_enclose_their_points(drive, frame, found, 1e-4) > 1000


@pytest.mark.parametrize('layout', LABELLED)
def test_stamps_and_frames_are_the_scan_s(bags, layout):
    found = read_once(bags[layout])
    # Frame 0 of KITTI-360 has no pose, and so no boxes.
    scans = list(found[POINTS])[int(layout.traits.world_boxes) :]
    for topic in (DETECTIONS, MARKERS) if layout in {Layout.RAW, Layout.KITTI_360} else LABELS:
        assert list(found[topic]) == scans, topic
    for stamp, message in found[DETECTIONS].items():
        assert (stamp_ns_of(message.header), message.header.frame_id) == (stamp, 'velo_link')
    for stamp, message in found.get(BOXES_2D, {}).items():
        frame_id = message.header.frame_id
        assert (stamp_ns_of(message.header), frame_id) == (
            stamp,
            'camera_color_left_optical_frame',
        )


@pytest.mark.parametrize('layout', LABELLED)
def test_markers_and_detections_are_of_the_same_boxes(bags, layout):
    found = read_once(bags[layout])
    for stamp, message in found[DETECTIONS].items():
        boxes = cubes(found[MARKERS][stamp])
        texts = [m.text for m in found[MARKERS][stamp].markers if m.ns == 'text']
        cuboids = cuboids_in(message)
        for cuboid, (place, size), text in zip(cuboids, boxes.values(), texts, strict=True):
            np.testing.assert_array_equal(place.matrix(), cuboid.velo_T_box.matrix())
            np.testing.assert_array_equal(size, cuboid.size_lwh)
            distance = np.linalg.norm(cuboid.velo_T_box.translation)
            assert text == f'{cuboid.class_name} {cuboid.identity}\n{distance:.1f} m'


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING, Layout.KITTI_360])
def test_a_track_keeps_its_id_class_and_size(bags, layout):
    found = read_once(bags[layout])
    sizes: dict[int, set] = {}
    names: dict[int, set] = {}
    for message in found[MARKERS].values():
        for number, (_, size) in cubes(message).items():
            sizes.setdefault(number, set()).add(tuple(np.round(size, 6)))
        for marker in message.markers:
            if marker.ns == 'text':
                names.setdefault(marker.id, set()).add(marker.text.split('\n')[0])
    assert len(sizes) > 10
    assert all(len(of_one) == 1 for of_one in (*sizes.values(), *names.values()))
    assert all(name.endswith(f' {n}') for n, of_one in names.items() for name in of_one)


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING])
def test_trails_stand_still_in_map_for_what_stands_still(recordings, bags, tmp_path, layout):
    """Each step is as long as the object's speed makes it, and the last place is the box's."""
    drive = SyntheticDrive(SMALL)
    out = tmp_path / 'out.mcap'
    found = read(run(recordings[layout], out, '/tf', markers=MarkerOptions(trails=True)).path)
    [static] = found['/tf_static'].values()
    up = {child: transform for _, child, transform in decode_static(static)}
    base_t_velo = up['imu_link'] @ up['velo_link']
    seen: dict[int, list[int]] = {}
    for frame, (message, tf) in enumerate(
        zip(found[MARKERS].values(), found['/tf'].values(), strict=True)
    ):
        [map_t_base] = [transform for _, _, transform in decode_static(tf)]
        trails = {marker.id: marker for marker in message.markers if marker.ns == 'trail'}
        assert {marker.header.frame_id for marker in trails.values()} <= {'map'}
        for number, (velo_t_box, _) in cubes(message).items():
            seen.setdefault(number, []).append(frame)
            if len(seen[number]) < 2:
                continue
            places = np.array([(p.x, p.y, p.z) for p in trails[number].points])
            here = (map_t_base @ base_t_velo @ velo_t_box).translation
            np.testing.assert_allclose(places[-1], here, atol=1e-6)
            solid = solid_at(drive, frame, velo_t_box)
            if not solid.leads:
                steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
                expected = abs(solid.speed) * 0.1 * np.diff(seen[number])
                np.testing.assert_allclose(steps, expected, atol=0.03)
    assert sum(len(frames) == SMALL.frames for frames in seen.values()) > 10
    for message in read_once(bags[layout])[MARKERS].values():
        assert not any(marker.ns == 'trail' for marker in message.markers)


# The way back.


def label_lines(layout: Layout, path: Path) -> list[list[list[str]]]:
    """Words of each label, from its class on, frame by frame."""
    if layout is Layout.OBJECT:
        files = sorted((path / 'training' / 'label_2').iterdir())
        return [[line.split() for line in file.read_text().splitlines()] for file in files]
    frames: dict[int, list[list[str]]] = {}
    for line in (path / 'training' / 'label_02' / '0000.txt').read_text().splitlines():
        frame, _, *words = line.split()
        frames.setdefault(int(frame), []).append(words)
    return list(frames.values())


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING])
def test_labels_come_back_without_their_source(recordings, bags, layout):
    told = told_without_source(read_once(bags[layout]))
    frames = label_lines(layout, recordings[layout])
    assert len(told) == len(frames) == SMALL.frames
    for one, lines in zip(told.values(), frames, strict=True):
        assert_told(one, lines)


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING])
def test_label_files_come_back_to_the_byte(recordings, bags, layout):
    texts: dict[str, str] = {}
    for message in read_once(bags[layout])[SOURCE].values():
        file = decode_text(message)
        texts[file.name] = texts.get(file.name, '') + file.text
    files = list(recordings[layout].rglob('label_*/*.txt'))
    assert len(texts) == len(files)
    for path in files:
        name = path.relative_to(recordings[layout]).as_posix()
        assert texts[name].encode() == path.read_bytes()


# Mistakes in label files: one line of frame 2 is edited.

LABEL_FILES = {
    Layout.OBJECT: 'training/label_2/000002.txt',
    Layout.TRACKING: 'training/label_02/0000.txt',
}
ROW = 3
"""Of the frame's lines, the one that is edited."""


@dataclass(frozen=True)
class Broken:
    """A recording with one line of frame 2 edited: what it gave, and what the whole one gives."""

    report: ExportReport
    found: dict
    whole: dict
    stamp: int
    where: str
    identity: str
    line: str

    def detected(self, found) -> set[str]:
        return {one.id for one in found[DETECTIONS][self.stamp].detections}

    def regions(self, found) -> set[str]:
        return {one.id for one in found[BOXES_2D][self.stamp].detections}


@pytest.fixture(params=list(LABEL_FILES), ids=[layout.value for layout in LABEL_FILES])
def break_line(request, recordings, bags, tmp_path):
    """A function that edits the words of a label's line, from the class on."""
    layout = request.param

    def edit(change) -> Broken:
        root = copy(recordings[layout], tmp_path)
        path = root / LABEL_FILES[layout]
        lines = path.read_text().splitlines(keepends=True)
        lead = 0 if layout is Layout.OBJECT else 2
        rows = [row for row, line in enumerate(lines) if not lead or line.startswith('2 ')]
        words = lines[rows[ROW]].split()
        lines[rows[ROW]] = ' '.join([*words[:lead], *change(words[lead:])]) + '\n'
        path.write_text(''.join(lines))
        whole = read_once(bags[layout])
        report = run(root, tmp_path / 'out.mcap')
        stamp = list(whole[POINTS])[2]
        identity = str(ROW) if layout is Layout.OBJECT else words[1]
        where = f'{path}:{rows[ROW] + 1}: '
        return Broken(report, read(report.path), whole, stamp, where, identity, lines[rows[ROW]])

    return edit


def assert_others_unchanged(broken: Broken):
    """No other frame, and no other object of the frame, is different or has moved."""
    for topic in (DETECTIONS, BOXES_2D):
        assert list(broken.found[topic]) == list(broken.whole[topic])
        for stamp, message in broken.found[topic].items():
            expected = {one.id: one for one in broken.whole[topic][stamp].detections}
            for one in message.detections:
                if (stamp, one.id) != (broken.stamp, broken.identity):
                    assert serialize(one) == serialize(expected[one.id])


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('change', 'said'),
    [
        (lambda w: w[:9], ' columns; expected 1'),
        (lambda w: w[:1], ' columns; expected'),
        (lambda w: [*w[:12], 'far', *w[13:]], "'far' is no number; expected"),
        (lambda w: [*w[:12], 'nan', *w[13:]], "'nan' is no finite number; expected"),
        (lambda w: [*w[:12], '1,5', *w[13:]], "'1,5' is no number; expected"),
    ],
)
def test_a_bad_line_costs_its_object_and_is_named(break_line, change, said):
    broken = break_line(change)
    [loss] = broken.report.losses
    assert (loss.stream, loss.count) == ('labels', 1)
    assert loss.message.startswith(broken.where)
    assert said in loss.message
    assert '\n' not in loss.message
    for ids in (broken.detected, broken.regions):
        assert ids(broken.whole) - ids(broken.found) == {broken.identity}
    assert broken.line in broken.found[SOURCE][broken.stamp].data
    assert_others_unchanged(broken)


def test_an_unknown_class_is_kept(break_line):
    broken = break_line(lambda words: ['my-robot', *words[1:]])
    assert not broken.report.losses
    for topic in (DETECTIONS, BOXES_2D):
        kinds = {one.id: one.results[0].hypothesis.class_id
                 for one in broken.found[topic][broken.stamp].detections}  # fmt: skip
        assert kinds[broken.identity] == 'my-robot'
    texts = [m.text for m in broken.found[MARKERS][broken.stamp].markers if m.ns == 'text']
    assert any(text.startswith(f'my-robot {broken.identity}\n') for text in texts)
    assert broken.detected(broken.found) == broken.detected(broken.whole)
    assert_others_unchanged(broken)


def test_a_score_is_the_detection_s(break_line):
    broken = break_line(lambda words: [*words, '0.625'])
    assert not broken.report.losses
    scores = {one.id: one.results[0].hypothesis.score
              for one in broken.found[DETECTIONS][broken.stamp].detections}  # fmt: skip
    assert scores.pop(broken.identity) == 0.625
    assert set(scores.values()) == {1.0}
    assert broken.line in broken.found[SOURCE][broken.stamp].data


@pytest.mark.parametrize(('column', 'value'), [(8, '0.00'), (9, '-1.60'), (10, '-1')])
def test_an_absurd_box_has_no_marker_and_no_3d_detection(break_line, column, value):
    broken = break_line(lambda words: [*words[:column], value, *words[column + 1 :]])
    [loss] = broken.report.losses
    assert (loss.stream, loss.count) == ('labels', 1)
    assert loss.message.startswith(broken.where)
    assert 'no marker and no 3D detection' in loss.message
    assert broken.detected(broken.whole) - broken.detected(broken.found) == {broken.identity}
    assert broken.regions(broken.found) == broken.regions(broken.whole)
    assert broken.line in broken.found[SOURCE][broken.stamp].data
    drawn = [marker_names(found[MARKERS][broken.stamp]) for found in (broken.found, broken.whole)]
    assert len(drawn[1]) - len(drawn[0]) == len(KIND_NAMES)
    assert_others_unchanged(broken)


def test_a_2d_detection_is_no_3d_one_and_no_loss(break_line):
    unset = ['-1', '-1', '-1', '-1000', '-1000', '-1000', '-10']
    broken = break_line(lambda words: [*words[:8], *unset])
    assert not broken.report.losses
    assert broken.detected(broken.whole) - broken.detected(broken.found) == {broken.identity}
    assert broken.regions(broken.found) == broken.regions(broken.whole)


def test_a_row_without_a_frame_number_is_named(recordings, tmp_path):
    root = copy(recordings[Layout.TRACKING], tmp_path)
    path = root / LABEL_FILES[Layout.TRACKING]
    lines = path.read_text().splitlines()
    lines[4] = ' '.join(['Car', *lines[4].split()[3:]])
    path.write_text('\n'.join(lines) + '\n')
    report = run(root, tmp_path / 'out.mcap')
    assert any(f"{path}:5: 'Car' is no frame number" in loss.message for loss in report.losses)
    assert report.counts[DETECTIONS] == SMALL.frames


def test_labels_without_calibration_keep_what_needs_none(recordings, tmp_path):
    root = copy(recordings[Layout.OBJECT], tmp_path)
    path = root / 'training' / 'calib' / '000002.txt'
    path.unlink()
    report = run(root, tmp_path / 'out.mcap')
    lost = {loss.stream: loss for loss in report.losses}
    for topic in (DETECTIONS, MARKERS):
        assert lost[topic].message.startswith(str(path))
        assert report.counts[topic] == SMALL.frames - 1
    for topic in (BOXES_2D, SOURCE):
        assert report.counts[topic] == SMALL.frames


# Labels and scans that do not come together.


def assert_labels_kept(found, whole, *numbers: int):
    """The label messages of these frames are there, to the byte, and no others."""
    for topic in LABELS:
        if topic in whole:
            stamps = list(whole[topic])
            expected = {stamps[n]: whole[topic][stamps[n]] for n in numbers}
            assert found[topic] == expected, topic


def test_object_labels_without_scan_and_scans_without_labels(recordings, bags, tmp_path):
    whole = raw_bytes_once(bags[Layout.OBJECT])
    root = copy(recordings[Layout.OBJECT], tmp_path)
    (root / 'training' / 'velodyne' / '000001.bin').unlink()
    (root / 'training' / 'label_2' / '000003.txt').unlink()
    found = raw_bytes(run(root, tmp_path / 'out.mcap').path)
    assert_labels_kept(found, whole, 0, 1, 2, 4)
    stamps = list(whole[POINTS])
    assert list(found[POINTS]) == [stamps[n] for n in (0, 2, 3, 4)]


def test_tracking_labels_without_scan_and_scans_without_labels(recordings, bags, tmp_path):
    whole = raw_bytes_once(bags[Layout.TRACKING])
    root = copy(recordings[Layout.TRACKING], tmp_path)
    (root / 'training' / 'velodyne' / '0000' / '000001.bin').unlink()
    path = root / LABEL_FILES[Layout.TRACKING]
    lines = path.read_text().splitlines(keepends=True)
    path.write_text(''.join(line for line in lines if not line.startswith('3 ')))
    found = raw_bytes(run(root, tmp_path / 'out.mcap').path)
    assert_labels_kept(found, whole, 0, 1, 2, 4)
    stamps = list(whole[POINTS])
    assert list(found[POINTS]) == [stamps[n] for n in (0, 2, 3, 4)]


def test_tracklets_without_scan_and_scans_without_tracklets(drive, bags, tmp_path):
    whole = raw_bytes_once(bags[Layout.RAW])
    (drive / 'velodyne_points' / 'data' / '0000000002.bin').unlink()
    path = drive / 'tracklet_labels.xml'
    later = [
        replace(one, first_frame=1, poses=one.poses[1:]) if one.first_frame == 0 else one
        for one in parse_tracklets(path.read_bytes(), path)
    ]
    path.write_text(format_tracklets(later))
    found = raw_bytes(run(drive, tmp_path / 'out.mcap').path)
    assert_labels_kept(found, whole, 1, 2, 3, 4)
    stamps = list(whole[POINTS])
    assert list(found[POINTS]) == [stamps[n] for n in (0, 1, 3, 4)]


def test_tracklets_beyond_the_drive_are_named(drive, bags, tmp_path):
    whole = raw_bytes_once(bags[Layout.RAW])
    path = drive / 'tracklet_labels.xml'
    tracklets = parse_tracklets(path.read_bytes(), path)
    beyond = replace(tracklets[0], first_frame=7, poses=tracklets[0].poses[:2])
    path.write_text(format_tracklets([*tracklets, beyond]))
    report = run(drive, tmp_path / 'out.mcap')
    [loss] = report.losses
    assert (loss.stream, loss.count) == ('labels', 2)
    assert 'no stamp for the tracklets of frames 7-8' in loss.message
    assert_labels_kept(raw_bytes(report.path), whole, *range(SMALL.frames))


@pytest.mark.parametrize(
    'data',
    [b'', b'<tracklets><item>', b'<html/>', b'<!DOCTYPE a [<!ENTITY x "y">]><a>&x;</a>'],
    ids=['empty', 'cut', 'not tracklets', 'entities'],
)
def test_bad_tracklets_cost_the_labels_alone(drive, tmp_path, data):
    (drive / 'tracklet_labels.xml').write_bytes(data)
    report = run(drive, tmp_path / 'out.mcap')
    [loss] = report.losses
    assert loss.stream == 'labels'
    assert loss.message.startswith(str(drive / 'tracklet_labels.xml'))
    assert report.counts[POINTS] == SMALL.frames
    assert not any(report.counts.get(topic) for topic in LABELS)


def test_tracklets_are_where_the_tracking_labels_are(recordings):
    """The same street, once in the scanner's frame and once in the camera's."""
    raw, tracking = (open_recording(recordings[kind]) for kind in (Layout.RAW, Layout.TRACKING))
    rect_t_velo = rect_from_velo(tracking.calibration(0))
    path = recordings[Layout.TRACKING] / LABEL_FILES[Layout.TRACKING]
    labels = parse_boxes(path.read_text(), path)
    for number in range(SMALL.frames):
        cuboids = raw.read(Stream.LABELS, number).cuboids
        boxes = [one for one in labels if one.frame == number]
        assert len(boxes) == len(cuboids)
        for one in cuboids:
            location, size, rotation_y = box_of(one, rect_t_velo)
            nearest = min(boxes, key=lambda b, at=location: np.linalg.norm(b.location - at))
            assert nearest.class_name == one.class_name
            np.testing.assert_allclose(location, nearest.location, atol=1e-4)
            np.testing.assert_allclose(size, nearest.size_hwl, atol=1e-5)
            np.testing.assert_allclose(
                box_rotations(rotation_y), box_rotations(nearest.rotation_y), atol=1e-4
            )
