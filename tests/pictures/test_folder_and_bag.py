# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A folder and the bag of it tell the same: in pictures and in reports, layout by layout."""

from __future__ import annotations

import shutil
from dataclasses import replace

import foreign
import numpy as np
import pytest
from folder_and_bag import BAGS, OBJECT_NUMBERS, make_bag, make_holes

from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.recording import BY_POSITION
from kitti_ros2.model.streams import Clock, Layout, Stream
from kitti_ros2.options.messages import Images
from kitti_ros2.options.outputs import PictureOptions
from kitti_ros2.options.read import Bound, ReadOptions, SelectionOptions
from kitti_ros2.pictures.panel import MODES, draw_panel, facts_of
from kitti_ros2.pictures.recording_frames import open_frames
from kitti_ros2.report.contents import Severity
from kitti_ros2.report.gather import gather

ANY = ReadOptions()
LINE = 'Car 0.00 0 -1.57 100.00 50.00 200.00 90.00 1.50 1.60 3.90 1.00 1.60 12.00 -1.57 0.91\n'


@pytest.fixture(scope='module', params=list(Layout), ids=[layout.value for layout in Layout])
def holed(request, recordings, tmp_path_factory):
    """A recording with holes, one layout after the other."""
    folder = tmp_path_factory.mktemp('holed')
    return make_holes(recordings[request.param], request.param, folder)


@pytest.fixture(scope='module')
def told(holed):
    """Its report."""
    return gather(holed, ANY)


@pytest.fixture(params=[*BAGS])
def bag(request, holed, tmp_path):
    return make_bag(holed, tmp_path / 'bag', request.param)


def assert_same_report(there, here):
    """Hold what the report of a bag shows against that of its folder."""
    assert there.frames == here.frames
    assert there.clock is here.clock
    assert there.overview.duration_ns == here.overview.duration_ns
    assert (there.route is None) == (here.route is None)
    if here.route is not None:
        np.testing.assert_array_equal(there.route.stamps_ns, here.route.stamps_ns)
        for name in ('positions', 'speeds_m_s', 'yaws_rad'):
            ours, theirs = getattr(there.route, name), getattr(here.route, name)
            np.testing.assert_allclose(ours, theirs, atol=1e-6, err_msg=name)
        assert there.route.altitude_m == pytest.approx(here.route.altitude_m, abs=1e-6)
        assert there.route.jumps == here.route.jumps
        assert there.route.length_m == pytest.approx(here.route.length_m, abs=1e-6)
    assert_same_classes(there.classes, here.classes)
    assert [scene.number for scene in there.scenes] == [scene.number for scene in here.scenes]
    assert there.scenes == here.scenes
    assert there.projections == here.projections


def absent_in(report):
    """The frames of which a recording has no file, by stream, as its report names them."""
    losses = report.overview.losses
    return {(loss.stream, loss.numbers, loss.text().partition(': ')[2]) for loss in losses}


@pytest.mark.one_in(3)
def test_a_bag_tells_which_frames_its_folder_has_no_files_of(bag, told):
    assert absent_in(told)
    assert absent_in(gather(bag, ANY)) == absent_in(told)


def test_a_bag_of_a_part_tells_what_is_absent_from_that_part(holed, told, tmp_path):
    numbers = [number for _, absent, _ in absent_in(told) for number in absent]
    last = SelectionOptions(end=Bound(frame=min(numbers)))
    losses = absent_in(gather(make_bag(holed, tmp_path / 'part', selection=last), ANY))
    assert {number for _, few, _ in losses for number in few} <= {min(numbers)}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('leave_folder', [True, False])
@pytest.mark.parametrize(
    ('layout', 'gone'),
    [
        (Layout.RAW, 'image_03/data'),
        (Layout.RAW, 'velodyne_points/data'),
        (Layout.ODOMETRY, 'sequences/00/image_3'),
        (Layout.ODOMETRY, 'sequences/00/velodyne'),
    ],
)
def test_a_stream_without_any_file_is_absent_from_both(
    layout, gone, leave_folder, recordings, tmp_path
):
    source = make_holes(recordings[layout], layout, tmp_path)
    data = source / gone
    shutil.rmtree(data)
    if leave_folder:
        data.mkdir()
    told = absent_in(gather(source, ANY))
    assert absent_in(gather(make_bag(source, tmp_path / 'bag'), ANY)) == told


def assert_same_classes(there, here):
    assert (there is None) == (here is None)
    if here is None:
        return
    counts = [(side.frames, side.labelled, side.dont_care, side.count) for side in (there, here)]
    assert counts[0] == counts[1]
    for mine, own in zip(there.classes, here.classes, strict=True):
        np.testing.assert_allclose(mine.distances_m, own.distances_m, atol=1e-9)
        nothing = np.zeros(0)
        assert replace(mine, distances_m=nothing).__dict__.keys() == own.__dict__.keys()
        for name in ('class_name', 'count', 'frames', 'most', 'tracks', 'occlusions', 'truncated'):
            assert getattr(mine, name) == getattr(own, name), name


def assert_same_frames(there, here, *, one_map=True):
    """Every frame: its number and time, the words of the panel, its pose and what is drawn.

    Without one_map the origin of map is at different places of the car.
    """
    assert there.numbers.tolist() == here.numbers.tolist()
    assert there.stamps_ns.tolist() == here.stamps_ns.tolist()
    assert there.cameras == here.cameras
    options, apart = PictureOptions(), None
    for number in here.numbers.tolist():
        mine, own = there.frame(number), here.frame(number)
        assert facts_of(mine, options) == facts_of(own, options)
        assert (mine.pose is None) == (own.pose is None)
        if own.pose is not None:
            # The matrices of odometry are rotations to six digits only.
            moved = mine.pose.world_T_imu.matrix() - own.pose.world_T_imu.matrix()
            apart = moved if apart is None and not one_map else apart
            np.testing.assert_allclose(moved, 0 if one_map else apart, atol=2e-6)
        named = replace(mine, source=own.source)
        np.testing.assert_array_equal(draw_panel(named, options), draw_panel(own, options))


@pytest.mark.one_in(3)
def test_the_reports_of_a_folder_and_of_its_bag_agree(told, bag):
    assert told.frames
    assert_same_report(gather(bag, ANY), told)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('images', [Images.COMPRESSED, Images.RAW])
def test_the_frames_of_a_folder_and_of_its_bag_agree(holed, tmp_path, images):
    bag = make_bag(holed, tmp_path / 'bag', images=images)
    assert_same_frames(open_frames(bag, ANY), open_frames(holed, ANY))


def test_a_bag_of_a_part_has_the_frames_of_that_part(holed, tmp_path):
    whole = open_frames(holed, ANY)
    first = int(whole.numbers[2])
    chosen = SelectionOptions(start=Bound(frame=first))
    part = open_frames(make_bag(holed, tmp_path / 'bag', selection=chosen), ANY)
    assert part.numbers.tolist() == [n for n in whole.numbers.tolist() if n >= first]
    for number in part.numbers.tolist():
        assert facts_of(part.frame(number), PictureOptions()) == facts_of(
            whole.frame(number), PictureOptions()
        )


def test_kitti2bag_names_change_nothing(recordings, tmp_path):
    holed = make_holes(recordings[Layout.RAW], Layout.RAW, tmp_path)
    bag = tmp_path / 'bag.mcap'
    main(['to-bag', str(holed), str(bag), '--preset', 'kitti2bag', '-q'])
    # The preset has another place of imu_link on the car, so map begins elsewhere.
    assert_same_frames(open_frames(bag, ANY), open_frames(holed, ANY), one_map=False)


def test_an_extract_agrees_with_its_bag(recordings, tmp_path):
    holed = make_holes(recordings[Layout.RAW], Layout.RAW, tmp_path)
    drive = holed.rename(holed.with_name(holed.name.replace('sync', 'extract')))
    bag = make_bag(drive, tmp_path / 'bag')
    assert_same_frames(open_frames(bag, ANY), open_frames(drive, ANY))
    assert_same_report(gather(bag, ANY), gather(drive, ANY))


@pytest.fixture
def object_bag(recordings, tmp_path):
    return make_bag(make_holes(recordings[Layout.OBJECT], Layout.OBJECT, tmp_path), tmp_path / 'b')


def test_predictions_are_drawn_on_the_frame_of_their_number(object_bag, tmp_path, capsys):
    (tmp_path / 'found').mkdir()
    (tmp_path / 'found' / '000010.txt').write_text(LINE)
    words = ['view', str(object_bag), '--mode', 'boxes', '--predictions', str(tmp_path / 'found')]
    assert main([*words, '--frame', '10', '-o', str(tmp_path / 'a.png')]) == 0
    assert main([*words, '--frame', '8', '-o', str(tmp_path / 'b.png')]) == 1
    assert 'no result file for frames 8' in capsys.readouterr().err


def test_pictures_are_named_and_asked_for_by_number(object_bag, tmp_path, capsys):
    assert main(['view', str(object_bag), '-o', str(tmp_path / 'out'), '--frames', '9:20']) == 1
    assert 'training/image_2: no image_2 for frames 16, which' in capsys.readouterr().err
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == [
        '000010.png', '000015.png', '000016.png'
    ]  # fmt: skip
    assert main(['view', str(object_bag), '-o', str(tmp_path / 'b.png'), '--frame', '10']) == 0
    assert BY_POSITION not in capsys.readouterr().out
    assert main(['view', str(object_bag), '-o', str(tmp_path / 'a.png'), '--frame', '0']) == 2
    assert 'has no frame 0; it has 5 frames, 8 to 30 with gaps' in capsys.readouterr().err


def test_the_days_of_an_object_set_are_no_issues_in_its_bag(object_bag):
    report = gather(object_bag, ANY)
    assert [(loss.severity, loss.where) for loss in report.issues] == [(Severity.LOSS, 'image_2')]
    assert report.clock is Clock.NOMINAL
    assert [scene.number for scene in report.scenes][:2] == list(OBJECT_NUMBERS[:2])


def test_a_bag_of_others_says_that_its_frames_are_numbered_by_position(tmp_path, capsys):
    path = foreign.write_foreign(tmp_path / 'bag.mcap', foreign.make_truth())
    assert main(['view', str(path), '-o', str(tmp_path / 'a.png'), '--frame', '2']) == 0
    assert f'note: {BY_POSITION}' in capsys.readouterr().out
    assert [issue.text for issue in gather(path, ANY).issues].count(BY_POSITION) == 1


def test_the_route_of_another_bag_is_whole_though_its_images_are_few(tmp_path):
    truth = foreign.make_truth()
    whole, few = (
        gather(foreign.write_foreign(tmp_path / f'{count}.mcap', truth[:count]), ANY)
        for count in (len(truth), 2)
    )
    assert (whole.frames, few.frames) == (len(truth), 2)
    assert few.route.length_m == pytest.approx(whole.route.length_m)
    assert few.route.length_m > 5.0 * 0.1 * (len(truth) - 1) * 0.9  # 5 m/s, 0.1 s a frame


def test_the_path_of_another_bag_is_that_up_to_the_frame(tmp_path):
    source = open_frames(foreign.write_foreign(tmp_path / 'bag.mcap', foreign.make_truth()), ANY)
    wanted = MODES['panel'].streams((), PictureOptions())
    first, last = (source.frame(int(number), wanted) for number in source.numbers[[0, -1]])
    assert first.path is None or len(first.path) < len(last.path)
    apart = last.path[-1] - last.pose.world_T_imu.translation
    assert np.linalg.norm(apart) < 1.0  # 5 m/s, at 10 Hz or more
    assert (first.imaged, first.scanned) == (True, True)
    assert source.frame(0).path is None


class TestRealKitti:
    def test_a_drive_is_as_long_in_its_bag(self, real_kitti, tmp_path):
        """README of the samples: 106.96 m by Mercator, from the packets of drive 0001."""
        drive = real_kitti / 'raw/2011_09_26/2011_09_26_drive_0001_sync'
        if not drive.is_dir():
            pytest.skip(f'no {drive}')
        bag = make_bag(drive, tmp_path / 'bag')
        there, here = gather(bag, ANY), gather(drive, ANY)
        assert_same_report(there, here)
        assert there.route.length_m == pytest.approx(106.96, abs=0.01)
        facts = dict(facts_of(open_frames(bag, ANY).frame(0), PictureOptions()))
        assert facts['latitude'] == '49.015004 deg'
        assert facts['longitude'] == '8.434297 deg'

    def test_the_route_of_an_odometry_bag_is_that_of_all_poses(self, real_kitti, tmp_path):
        source = real_kitti / 'odometry/dataset'
        there, here = gather(make_bag(source, tmp_path / 'bag'), ANY), gather(source, ANY)
        assert len(there.route.positions) == 4541
        assert_same_report(there, here)

    def test_a_tracking_bag_with_few_images_counts_all_labels(self, real_kitti, tmp_path):
        """Sequence 0000 has 154 frames of labels and packets; here it has images of two of them."""
        shutil.copytree(real_kitti / 'tracking', tmp_path / 'set')
        images = tmp_path / 'set/training/image_02/0000'
        images.mkdir(parents=True)
        frame = real_kitti / 'raw/2011_09_26/2011_09_26_drive_0005_sync/image_02/data'
        for number in (0, 77):
            shutil.copy(frame / '0000000000.png', images / f'{number:06d}.png')
        bag = make_bag(tmp_path / 'set', tmp_path / 'bag')
        there, here = gather(bag, ANY), gather(tmp_path / 'set', ANY)
        assert_same_report(there, here)
        assert there.frames == 154
        assert there.classes.count == 711
        assert there.route.length_m == pytest.approx(69.4, abs=0.05)
        assert [scene.number for scene in there.scenes] == [0, 77]
        assert len(open_recording(tmp_path / 'set').streams[Stream.IMAGE_2]) == 2
