# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of data sets: all layouts, bags, sets with holes, and files that are damaged."""

from __future__ import annotations

import gc
import math
import re
import shutil
import weakref
from itertools import count

import foreign
import numpy as np
import pytest
from folder_and_bag import make_bag, make_holes

from kitti_ros2 import KittiRos2Error, KittiRos2Warning, datasets, to_bag
from kitti_ros2.datasets import recording_statistics
from kitti_ros2.datasets.set_statistics import find_sources
from kitti_ros2.files.threads import worker_count
from kitti_ros2.kitti.label_file import parse_box
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.tracklet_file import Tracklet, TrackletPose, format_tracklets
from kitti_ros2.model.boxes import DONT_CARE
from kitti_ros2.model.samples import Scan
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.read import ReadOptions

CAR = 'Car 0.00 0 -1.5 600 100 650 150 1.5 1.6 4.0 3.0 1.7 4.0 0.0\n'
FAR = 'Car 0.30 2 -1.5 600 100 650 130 1.7 1.6 4.2 0.0 1.7 60.0 0.0\n'
REGION = 'DontCare -1 -1 -10 500 100 520 120 -1 -1 -1 -1000 -1000 -1000 -10\n'


def plain(found):
    """The figures of a set, without its names."""
    total = found.total
    classes = {name: vars(each) for name, each in total.classes.items()}
    return total.frames, total.labelled, total.samples, classes, total.objects_a_frame, total.route


def object_set(split, *frames):
    (split / 'label_2').mkdir(parents=True)
    for number, text in frames:
        (split / 'label_2' / f'{number:06d}.txt').write_text(text)
    return split


def test_distributions_of_a_few_labels(tmp_path):
    split = object_set(
        tmp_path / 'training', (3, CAR + CAR + REGION), (7, FAR), (20, ''), (21, REGION)
    )
    total = datasets.statistics(split).total
    car, region = total.classes['Car'], total.classes[DONT_CARE]
    assert (car.count, car.frames, car.most) == (3, 2, 2)
    assert car.difficulty == {'easy': 2, 'moderate': 0, 'hard': 1, 'beyond': 0}
    assert car.occlusion == {
        'visible': 2, 'partly occluded': 0, 'largely occluded': 1, 'unknown': 0
    }  # fmt: skip
    assert +car.truncation == {'none': 2, 'to 0.30': 1}
    assert (car.distance_m.least, car.distance_m.greatest) == (5, 60)  # over the ground
    assert car.length_m.mean == pytest.approx((4.0 + 4.0 + 4.2) / 3)
    assert car.height_m.greatest == 1.7
    assert car.points.count == car.tracks.count == 0
    assert (region.count, region.frames, region.most) == (2, 2, 1)
    assert not region.difficulty.total() + region.occlusion.total() + region.distance_m.count
    assert total.objects_a_frame.counts[:3] == [2, 1, 1]
    assert total.route is None


def test_unknown_values_are_in_no_distribution(tmp_path):
    unknown = 'Car -1 -1 -10 600 100 650 150 -1 -1 -1 -1000 -1000 -1000 -10 0.9\n'
    car = datasets.statistics(object_set(tmp_path / 'a', (0, unknown))).total.classes['Car']
    assert car.count == 1
    assert car.occlusion.total() == car.truncation.total() == 0
    assert car.distance_m.count == car.length_m.count == 0
    assert car.difficulty['easy'] == 1


def test_every_layout(recording_path):
    """The same street in each layout: the same objects, the same route."""
    found = datasets.statistics(recording_path)
    recording = open_recording(recording_path)
    total = found.total
    assert [part.kind for part in found.recordings] == [recording.layout.value]
    assert total.frames == 5
    assert total.losses == ()
    assert total.samples['scan'] == len(recording.streams[Stream.SCAN])
    if Stream.LABELS in recording.streams:
        assert total.objects > 0
        assert total.labelled == len(recording.streams[Stream.LABELS]) >= 4
    if Stream.POSE not in recording.streams:
        assert total.route is None
    else:
        seconds = 0.1 * (len(recording.streams[Stream.POSE]) - 1)
        speed = total.route.length_m / seconds
        assert total.route.speed_m_s.mean == pytest.approx(speed, rel=0.1)
        assert total.route.speed_m_s.deviation < 1


def test_tracks_are_counted_in_frames(recordings):
    for layout in (Layout.RAW, Layout.TRACKING):
        total = datasets.statistics(recordings[layout]).total
        for each in total.classes.values():
            if each.tracks.count:
                assert each.tracks.mean * each.tracks.count == pytest.approx(each.count)
        assert sum(each.tracks.count for each in total.classes.values()) > 1


def test_tracklets_have_frames_without_objects(drive):
    pose = TrackletPose((6.0, 8.0, -1.7), 0.0)
    tracks = [Tracklet('Van', (2.0, 1.9, 5.0), 1, [pose, pose])]
    (drive / 'tracklet_labels.xml').write_text(format_tracklets(tracks))
    total = datasets.statistics(drive).total
    van = total.classes['Van']
    assert (van.count, van.frames, van.tracks.mean, van.distance_m.mean) == (2, 2, 2, 10)
    assert van.occlusion.total() == van.difficulty.total() == 0  # tracklets have no 2D box
    assert total.objects_a_frame.counts[:2] == [3, 2]


@pytest.mark.parametrize('layout', list(Layout), ids=[each.value for each in Layout])
def test_a_bag_is_its_folder(recordings, tmp_path, layout):
    """With holes in the numbers, and with points."""
    source = make_holes(recordings[layout], layout, tmp_path)
    bag = make_bag(source, tmp_path / 'bags')
    with pytest.warns(KittiRos2Warning, match='no file|no scan|no image'):
        folder = datasets.statistics(source, points=True)
    packed = datasets.statistics(bag, points=True)
    for one, other in zip(plain(folder), plain(packed), strict=True):
        if one is None or not hasattr(one, 'length_m'):
            assert repr(one) == repr(other)  # nan is not equal to itself
            continue
        assert other.length_m == pytest.approx(one.length_m, abs=1e-4)
        assert other.speed_m_s.mean == pytest.approx(one.speed_m_s.mean, abs=1e-3)
    assert packed.recordings[0].kind == 'bag'


def test_a_bag_of_another_recorder(tmp_path):
    """Every frame has the same car; the robot drives at 5 m/s and turns by 0.2 rad/s."""
    truth = foreign.make_truth()
    total = datasets.statistics(foreign.write_foreign(tmp_path / 'b.mcap', truth)).total
    car = total.classes['Car']
    places = [frame.cuboid.velo_T_box.translation for frame in truth]
    assert (total.kind, total.frames, total.labelled) == ('bag', len(truth), len(truth))
    assert (car.count, car.tracks.count, car.tracks.mean) == (len(truth), 1, len(truth))
    assert car.distance_m.mean == pytest.approx(np.mean([np.hypot(x, y) for x, y, _ in places]))
    assert car.length_m.mean == pytest.approx(4.1)
    assert total.samples['scan'] == len(truth)
    assert total.route.speed_m_s.mean == pytest.approx(5, abs=0.1)
    assert total.route.turn_rate_deg_s.mean == pytest.approx(np.degrees(0.2), abs=0.1)


def test_points_in_boxes_are_those_of_the_geometry(recordings):
    found = datasets.statistics(recordings[Layout.OBJECT], points=True)
    total = found.total
    boxes = sum(each.length_m.count for each in total.classes.values())
    assert sum(each.points.count for each in total.classes.values()) == boxes > 0
    assert sum(each.points.mean * each.points.count for each in total.classes.values()) > 10
    assert total.points_a_scan.count == 5
    without = datasets.statistics(recordings[Layout.OBJECT]).total
    assert without.points_a_scan.count == 0
    assert not any(each.points.count for each in without.classes.values())


def test_scans_are_not_kept(recordings, monkeypatch):
    """At most those of the workers, and of the results that wait for their turn."""
    split = recordings[Layout.OBJECT]
    (source,) = find_sources(split, ReadOptions())
    frames = source.open()
    alive = weakref.WeakSet()
    most = 0
    original = frames.read

    def read(stream, number):
        nonlocal most
        sample = original(stream, frames.numbers[number % 5])
        if isinstance(sample, Scan):
            alive.add(sample)
            gc.collect(0)
            most = max(most, len(alive))
        return sample

    monkeypatch.setattr(frames, 'read', read)
    monkeypatch.setattr(frames, 'numbers', np.arange(40))
    monkeypatch.setattr(frames, 'stamps_ns', np.arange(40))
    monkeypatch.setattr(frames, 'calibration', lambda _: None)
    steps = count()
    recording_statistics.count_recording(
        frames, 'a', 'object', scans=True, step=lambda: next(steps)
    )
    assert next(steps) == 40
    assert 1 <= most <= worker_count() + 1


def test_point_classes_are_counted_where_labels_exist(recordings, tmp_path):
    source = tmp_path / 'odometry'
    shutil.copytree(recordings[Layout.ODOMETRY], source)
    (sequence,) = (source / 'sequences').iterdir()
    (sequence / 'labels').mkdir()
    sizes = {}
    for scan in sorted((sequence / 'velodyne').iterdir()):
        labels = np.full(scan.stat().st_size // 16, 10 | 7 << 16, '<u4')
        labels[:100] = 777
        sizes[scan.stem] = len(labels)
        labels.tofile(sequence / 'labels' / f'{scan.stem}.label')
    total = datasets.statistics(source).total
    assert total.point_classes == {'car': sum(sizes.values()) - 500, 'class 777': 500}
    bag = tmp_path / 'bag.mcap'
    to_bag(source, bag, semantic=True)
    assert datasets.statistics(bag, points=True).total.point_classes == total.point_classes
    first, second, *_ = sorted((sequence / 'labels').iterdir())
    first.unlink()
    second.write_bytes(b'123')
    with pytest.warns(KittiRos2Warning):
        total = datasets.statistics(source).total
    assert total.point_classes['class 777'] == 300  # points without labels are of no class
    assert [(loss.stream, loss.count) for loss in total.losses] == [('scan', 1), ('scan', 1)]
    assert first.name in total.losses[0].text()
    assert f'{second}: 3 bytes' in total.losses[1].text()


# Sets with many recordings.


def test_all_recordings_below_a_folder(recordings, tmp_path):
    for layout in (Layout.OBJECT, Layout.TRACKING, Layout.RAW):
        path = recordings[layout]
        whole = path.parent if layout is Layout.RAW else path
        shutil.copytree(whole, tmp_path / layout.value)
    found = datasets.statistics(tmp_path)
    names = [part.name for part in found.recordings]
    assert len(names) == 3
    assert any(name.startswith('raw/') and name.endswith('_sync') for name in names)
    assert {'object/training', 'tracking/0000'} < {*names}
    assert found.total.frames == sum(part.frames for part in found.recordings) == 15
    assert found.total.kind == 'object, raw, tracking'
    for name, each in found.total.classes.items():
        parts = [part.classes[name] for part in found.recordings if name in part.classes]
        assert each.count == sum(part.count for part in parts)
        assert each.most == max(part.most for part in parts)
    length = sum(part.route.length_m for part in found.recordings if part.route)
    assert found.total.route.length_m == pytest.approx(length)


def test_all_bags_in_a_folder(recordings, tmp_path):
    for name in ('first', 'second'):
        bag = make_bag(recordings[Layout.OBJECT], tmp_path / 'made', 'sqlite3')
        bag.rename(tmp_path / name)
    (tmp_path / 'made').rmdir()
    (tmp_path / 'notes.txt').write_text('')
    found = datasets.statistics(tmp_path)
    assert [(part.name, part.kind) for part in found.recordings] == [
        ('first', 'bag'), ('second', 'bag')
    ]  # fmt: skip
    assert found.total.frames == 10


def test_one_recording_of_many_is_chosen(recordings, tmp_path):
    for name in ('0001', '0002'):
        source = recordings[Layout.RAW]
        copy = tmp_path / source.parent.name / source.name.replace('drive_0001', f'drive_{name}')
        shutil.copytree(source, copy)
    assert len(datasets.statistics(tmp_path).recordings) == 2
    (part,) = datasets.statistics(tmp_path, sequence='2').recordings
    assert '0002' in part.name
    with pytest.raises(KittiRos2Error, match="no sequence '3'"):
        datasets.statistics(tmp_path, sequence='3')


def test_a_recording_that_does_not_open_is_a_loss(recordings, tmp_path):
    source = recordings[Layout.RAW]
    good = tmp_path / source.parent.name / source.name
    shutil.copytree(source, good)
    bad = good.with_name(source.name.replace('drive_0001', 'drive_0002'))
    (bad / 'oxts').mkdir(parents=True)
    (bad / 'oxts' / 'timestamps.txt').write_text('')
    with pytest.warns(KittiRos2Warning, match='drive_0002'):
        found = datasets.statistics(tmp_path)
    assert found.total.frames == 5
    assert [loss.stream for loss in found.total.losses] == ['recording']
    with pytest.raises(KittiRos2Error, match='can be used'):
        datasets.statistics(bad)


# Damage.


def test_bad_labels_are_named_and_the_rest_is_counted(tmp_path):
    split = object_set(
        tmp_path / 'training', (0, CAR + 'Car 1 2\n' + CAR), (1, '\x00'), (4, CAR), (5, CAR)
    )
    (split / 'label_2' / '000004.txt').write_bytes(b'\xff\xfe')
    (split / 'label_2' / '000005.txt').unlink()
    (split / 'label_2' / '000005.txt').mkdir()
    with pytest.warns(KittiRos2Warning):
        total = datasets.statistics(split).total
    assert total.classes['Car'].count == 2
    assert total.labelled == 2
    texts = [loss.text() for loss in total.losses]
    assert len(texts) == 4
    for text, place in zip(texts, ('0.txt:2', '1.txt:1', '4.txt', '5.txt'), strict=True):
        assert f'00000{place}: ' in text


def test_labels_lost_with_the_end_of_a_bag_are_no_frames_without_objects(recordings, tmp_path):
    bag = make_bag(recordings[Layout.TRACKING], tmp_path)
    data = bag.read_bytes()
    bag.write_bytes(data[: len(data) * 3 // 5])
    with pytest.warns(KittiRos2Warning, match='cut off'):
        total = datasets.statistics(bag).total
    assert 0 < total.labelled < 5
    assert total.objects_a_frame.counts[0] == 0


def test_a_box_of_invalid_size_is_counted_without_size(tmp_path):
    flat = CAR.replace('1.5 1.6 4.0', '1.5 0.0 4.0')
    with pytest.warns(KittiRos2Warning, match='positive sizes'):
        total = datasets.statistics(object_set(tmp_path / 'a', (0, flat + CAR))).total
    assert (total.classes['Car'].count, total.classes['Car'].width_m.count) == (2, 1)


def test_missing_and_truncated_scans_are_named(recordings, tmp_path):
    split = tmp_path / 'training'
    shutil.copytree(recordings[Layout.OBJECT] / 'training', split)
    (split / 'velodyne' / '000001.bin').unlink()
    (split / 'velodyne' / '000003.bin').write_bytes(b'0' * 17)
    (split / 'calib' / '000004.txt').write_text('P2: 1\n')
    with pytest.warns(KittiRos2Warning):
        total = datasets.statistics(split, points=True).total
    assert total.points_a_scan.count == 3
    found = {loss.stream: loss for loss in total.losses}
    assert found['scan'].count == 1
    assert any('no scan for frames 1,' in loss.text() for loss in total.losses)
    assert any('000003.bin: ' in loss.text() for loss in total.losses)
    assert found['calibration'].numbers == (4,)
    assert re.search(r'000004.txt.*points in boxes are not', found['calibration'].text())


# Routes.


def test_holes_in_the_poses_make_no_jumps(recordings, tmp_path):
    source = tmp_path / 'odometry'
    shutil.copytree(recordings[Layout.ODOMETRY], source)
    whole = datasets.statistics(source).total.route
    (poses,) = (source / 'poses').iterdir()
    lines = poses.read_text().splitlines()
    lines[2] = 'damaged'
    poses.write_text('\n'.join(lines) + '\n')
    with pytest.warns(KittiRos2Warning, match='txt:3'):
        holed = datasets.statistics(source).total.route
    assert (whole.poses, holed.poses) == (5, 4)
    assert holed.speed_m_s.mean == pytest.approx(whole.speed_m_s.mean, rel=0.02)
    assert holed.speed_m_s.greatest < 1.1 * whole.speed_m_s.greatest
    assert holed.length_m == pytest.approx(whole.length_m, rel=0.01)


def test_without_times_there_is_no_speed_but_a_length(recordings, tmp_path):
    source = tmp_path / 'odometry'
    shutil.copytree(recordings[Layout.ODOMETRY], source)
    (times,) = source.rglob('times.txt')
    times.unlink()
    route = datasets.statistics(source).total.route
    assert route.length_m > 1
    assert (route.duration_s, route.speed_m_s.count, route.turn_rate_deg_s.count) == (0, 0, 0)
    assert math.isnan(route.speed_m_s.mean)


# The library, and real files.


def test_an_unknown_keyword_is_answered_with_a_known_one():
    assert datasets.__all__ == sorted(datasets.__all__)
    with pytest.raises(KittiRos2Error, match='did you mean points'):
        datasets.statistics('.', point=True)


def test_progress_ends_with_all_frames(recordings):
    seen = []
    datasets.statistics(recordings[Layout.RAW], progress=lambda *done: seen.append(done))
    assert seen == [(number, 5) for number in range(1, 6)]


@pytest.mark.parametrize(
    ('folder', 'sequence', 'length'),
    [('raw', '0001', '106.96'), ('raw', '0005', '69.40'), ('odometry', '00', '3724.19'),
     ('tracking', '0000', '69.40')],
)  # fmt: skip
@pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')  # few files of the sequences
def test_real_routes_have_their_known_lengths(real_kitti, folder, sequence, length):
    route = datasets.statistics(real_kitti / folder, sequence=sequence).total.route
    assert f'{route.length_m:.2f}' == length
    assert route.jumps == 0
    assert 4 < route.speed_m_s.mean < 10


def test_real_boxes_have_their_known_points(real_kitti):
    total = datasets.statistics(real_kitti / 'object', points=True).total
    points = {name: each.points for name, each in total.classes.items() if each.points.count}
    assert {name: found.greatest for name, found in points.items()} == {
        'Pedestrian': 376, 'Truck': 70, 'Cyclist': 18, 'Misc': 1351, 'Car': 67
    }  # fmt: skip
    assert points['Car'].least == 9


def test_real_tracking_has_its_known_rows(real_kitti):
    total = datasets.statistics(real_kitti / 'tracking').total
    assert sum(each.count for each in total.classes.values()) == 1089
    assert sum(each.tracks.count for each in total.classes.values()) == 15
    assert total.frames == 154


def test_labels_of_the_set_parse():
    assert parse_box(CAR).class_name == 'Car'
