# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Frames that move, and raw drives without GPS: what is written is what was true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import wanderer
from wanderer import BASE_T_CAMERA, BASE_T_IMU, BASE_T_LIDAR, MS, PERIOD_NS, START_NS, Robot

from kitti_ros2.bags.open_source import open_bag_source
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.labelled_images import LabelledImages
from kitti_ros2.importer.plan import PosePlan, format_plan, parse_plan
from kitti_ros2.importer.planned_recording import PlannedRecording
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.kitti_recording import MercatorWorld
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.text_file import parse_packet
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.options.table import make_import_options
from kitti_ros2.pictures.recording_frames import RecordingFrames

ODOMETRY = ('odom', 'base_link')


def convert(path, out, layout, change=lambda plan: plan, **options):
    """The plan with its notes, and the report."""
    chosen = ImportOptions(layout=layout, **options)
    survey = survey_bags([path])
    guessed = guess([path], survey, chosen)
    plan = change(guessed.plan)
    return guessed, convert_by_plan([path], plan, survey, out, chosen)


def numbers(path):
    return np.loadtxt(path, ndmin=2)


def relative(world_t_body, frames, body_t_sensor):
    poses = [world_t_body(frame.stamp_ns) @ body_t_sensor for frame in frames]
    return np.linalg.inv(poses[0]) @ poses


def calibration(path):
    found = {}
    for line in path.read_text().splitlines():
        key, _, values = line.partition(':')
        if values.strip():
            found[key] = np.array(values.split(), float)
    tr = np.vstack([found['Tr_velo_to_cam'].reshape(3, 4), [0, 0, 0, 1]])
    turn = np.eye(4)
    turn[:3, :3] = found['R0_rect'].reshape(3, 3)
    return turn @ tr


def check_boxes(out, frames, written):
    """Each label's box holds exactly the points that are in the box, by KITTI's own formulas."""
    folder = out / 'training'
    assert len(list((folder / 'label_2').iterdir())) == len(written)
    for number, frame in enumerate(frames[place] for place in written):
        rect_t_velo = calibration(folder / 'calib' / f'{number:06d}.txt')
        points = np.fromfile(folder / 'velodyne' / f'{number:06d}.bin', np.float32).reshape(-1, 4)
        assert len(points) == len(frame.points)
        places = points[:, :3] @ rect_t_velo[:3, :3].T + rect_t_velo[:3, 3]
        labels = (folder / 'label_2' / f'{number:06d}.txt').read_text().splitlines()
        assert len(labels) == len(frame.boxes)
        for line in labels:
            height, width, length, x, y, z, ry = (float(word) for word in line.split()[8:15])
            turned = (places - [x, y, z]) @ np.array(
                [[np.cos(ry), 0, np.sin(ry)], [0, 1, 0], [-np.sin(ry), 0, np.cos(ry)]]
            )
            within = (np.abs(turned[:, 0]) <= length / 2) & (np.abs(turned[:, 2]) <= width / 2)
            within &= (turned[:, 1] <= 0) & (turned[:, 1] >= -height)
            holding = [set(np.flatnonzero(frame.inside == place)) for place in (0, 1)]
            assert set(np.flatnonzero(within)) in holding


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'robot',
    [
        Robot(),
        Robot(markers=True),
        Robot(boxes='odom'),
        Robot(odom_tf=False, odometry=('odom', 'base_link')),
        Robot(cloud='map'),
        Robot(cloud='odom', map_tf=False, boxes='odom', odometry=('odom', 'base_link')),
        Robot(
            cloud='odom',
            map_tf=False,
            odom_tf=False,
            boxes='odom',
            odometry=('odom', 'base_link'),
        ),
    ],
)
def test_boxes_and_clouds_in_frames_that_move_are_where_they_were(robot, tmp_path):
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT)
    assert report.losses == ()
    assert guessed.plan.scan.frame == 'lidar'
    check_boxes(tmp_path / 'out', frames, range(len(frames)))
    if robot.cloud != 'lidar':
        assert any('in which the vehicle moves' in note for note in guessed.notes)


STANDING = {
    'in map': Robot(),
    'markers': Robot(markers=True),
    'in odom': Robot(boxes='odom'),
    'in odom of an Odometry': Robot(
        boxes='odom', map_tf=False, odom_tf=False, odometry=('odom', 'base_link')
    ),
    'in odom below the body': Robot(map_tf=False, boxes='odom', inverted=True),
    'in map by a PoseStamped': Robot(map_tf=False, odom_tf=False, posed=True),
    'with clouds in map': Robot(cloud='map'),
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('after_ms', [40, 20, -30])
@pytest.mark.parametrize('name', STANDING)
def test_a_parked_car_lies_on_its_points_whatever_the_stamp_of_its_box(name, after_ms, tmp_path):
    robot = replace(STANDING[name], boxes_after_ns=after_ms * MS)
    frames = wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT)
    assert report.losses == ()
    check_boxes(tmp_path / 'out', frames, range(len(frames)))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING, Layout.RAW])
@pytest.mark.parametrize('timed', [False, True])
def test_labels_of_standing_boxes_are_the_same_whatever_their_stamp(layout, timed, tmp_path):
    """Of scans with times those of the moment at which scans are stamped: the middle of turns."""
    found = []
    for after_ns in (0 if not timed else wanderer.TURN_NS // 2, 20 * MS):
        name = f'{after_ns}'
        robot = Robot(timed=timed, boxes_after_ns=after_ns, odometry=('odom', 'base_link'))
        wanderer.write(tmp_path / name, robot)
        convert(tmp_path / name, tmp_path / 'out' / name, layout)
        texts = {
            path.relative_to(tmp_path / 'out' / name): path.read_text()
            for path in (tmp_path / 'out' / name).rglob('*')
            if 'label' in str(path.relative_to(tmp_path)) or path.name == 'tracklet_labels.xml'
            if path.is_file()
        }
        found.append(texts)
    assert found[0]
    assert found[0] == found[1]


@pytest.mark.parametrize('cloud', ['lidar', 'map'])
def test_poses_that_alone_join_boxes_to_the_scans_are_in_the_plan(cloud, tmp_path):
    robot = Robot(map_tf=False, odom_tf=False, posed=True, cloud=cloud)
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT)
    assert report.losses == ()
    assert guessed.plan.pose == PosePlan('/pose', 'base_link', 'map')
    assert 'poses: /pose, which alone joins map to base_link' in guessed.notes
    check_boxes(tmp_path / 'out', frames, range(len(frames)))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('boxes', ['odom', 'base_link'])
@pytest.mark.parametrize(
    ('timed', 'after_ns'),
    [
        (False, 0),
        (False, 20 * MS),
        (False, -20 * MS),
        (True, 0),
        (True, 20 * MS),
        (True, -3 * MS // 2),
    ],
)
@pytest.mark.parametrize('markers', [False, True])
def test_boxes_lie_on_clouds_in_a_frame_that_moves_whatever_the_stamps_of_both(
    boxes, after_ns, timed, markers, tmp_path
):
    robot = Robot(cloud='odom', map_tf=False, odometry=('odom', 'base_link'), odom_tf=False)
    robot = replace(robot, boxes=boxes, boxes_after_ns=after_ns, timed=timed, markers=markers)
    frames = wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT)
    assert report.losses == ()
    assert timed == any('paired and stamped in the middle' in note for note in report.notes)
    check_boxes(tmp_path / 'out', frames, range(len(frames)))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('ahead_s', [37, -3600])
@pytest.mark.parametrize(
    'robot', [Robot(), Robot(boxes='odom'), Robot(cloud='map'), Robot(boxes=None, cloud='odom')]
)
@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.TRACKING])
def test_boxes_and_clouds_are_where_they_were_if_tf_has_a_clock_of_its_own(
    layout, robot, ahead_s, tmp_path
):
    robot = replace(robot, tf_ahead_ns=ahead_s * 10**9)
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', layout)
    assert report.losses == ()
    assert guessed.plan.pose.offset_s == -ahead_s
    assert any('its clock is' in note for note in guessed.notes)
    if layout is Layout.OBJECT and robot.boxes:
        check_boxes(tmp_path / 'out', frames, range(len(frames)))


def test_a_chain_up_to_map_beats_odometry_and_the_plan_says_so(tmp_path):
    frames = wanderer.write(tmp_path / 'bag', Robot(odometry=('odom', 'base_link')))
    guessed, _ = convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY)
    pose = guessed.plan.pose
    assert (pose.topic, pose.world, pose.body) == ('/tf', 'map', 'base_link')
    assert 'poses: map -> odom -> base_link of /tf; poses in odom would drift' in guessed.notes
    assert 'passed over for poses: /odom' in guessed.notes
    found = numbers(tmp_path / 'out' / 'poses' / '00.txt').reshape(-1, 3, 4)
    true = relative(wanderer.map_t_base, frames, BASE_T_CAMERA)[:, :3]
    assert np.abs(found - true).max() < 1e-4


@pytest.mark.parametrize(
    ('robot', 'topic', 'world', 'truth'),
    [
        (Robot(map_tf=False), '/tf', 'odom', wanderer.odom_t_base),
        (
            Robot(map_tf=False, odom_tf=False, odometry=('odom', 'base_link')),
            '/odom',
            'odom',
            wanderer.odom_t_base,
        ),
        (
            Robot(odom_tf=False, odometry=('odom', 'base_link')),
            '/odom',
            'map',
            wanderer.map_t_base,
        ),
    ],
)
def test_poses_of_every_kind_of_chain(robot, topic, world, truth, tmp_path):
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY)
    assert (guessed.plan.pose.topic, guessed.plan.pose.world) == (topic, world)
    assert report.losses == ()
    found = numbers(tmp_path / 'out' / 'poses' / '00.txt').reshape(-1, 3, 4)
    assert np.abs(found - relative(truth, frames, BASE_T_CAMERA)[:, :3]).max() < 1e-4


def test_world_and_body_of_the_plan_are_honoured(tmp_path):
    frames = wanderer.write(tmp_path / 'bag', Robot(odometry=('odom', 'base_link')))
    for topic, world, truth in (
        ('/odom', 'odom', wanderer.odom_t_base),
        ('/odom', 'map', wanderer.map_t_base),
        ('/tf', 'odom', wanderer.odom_t_base),
    ):
        for body in ('base_link', 'imu'):
            out = tmp_path / f'{topic[1:]}_{world}_{body}'

            def change(plan, named=(topic, world, body)):
                place, fixed, moved = named
                return replace(plan, pose=replace(plan.pose, topic=place, world=fixed, body=moved))

            convert(tmp_path / 'bag', out, Layout.ODOMETRY, change)
            found = numbers(out / 'poses' / '00.txt').reshape(-1, 3, 4)
            assert np.abs(found - relative(truth, frames, BASE_T_CAMERA)[:, :3]).max() < 1e-4


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'world': 'mapp'}, 'pose: world: mapp, which is no frame of the bag; .*did you mean map'),
        ({'body': 'base_lnk'}, 'pose: body: base_lnk, which is no frame.*did you mean base_link'),
        ({'topic': '/odom', 'world': 'mop'}, 'pose: world: mop, which is no frame'),
    ],
)
def test_frames_that_are_not_in_the_tree_are_refused(changes, said, tmp_path):
    wanderer.write(tmp_path / 'bag', Robot(odometry=('odom', 'base_link')))

    def change(plan):
        return replace(plan, pose=replace(plan.pose, **changes))

    with pytest.raises(UsageError, match=said):
        convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY, change)
    assert not (tmp_path / 'out').exists()


@pytest.mark.one_in(3)
@pytest.mark.parametrize('shift_ns', [3 * 10**9, -3 * 10**9, -1000 * 10**9])
@pytest.mark.parametrize(
    'robot',
    [Robot(map_tf=False), Robot(map_tf=False, odom_tf=False, odometry=('odom', 'base_link'))],
)
def test_log_times_that_lie_elsewhere_say_nothing_about_clocks(robot, shift_ns, tmp_path):
    """Stamps agree: a simulator's time is recorded by the wall clock, a bag was played again."""
    robot = replace(robot, boxes=None, log=lambda _, stamp_ns: stamp_ns + shift_ns)
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY)
    assert (guessed.plan.pose.offset_s, report.losses) == (0.0, ())
    found = numbers(tmp_path / 'out' / 'poses' / '00.txt').reshape(-1, 3, 4)
    true = relative(wanderer.odom_t_base, frames, BASE_T_CAMERA)[:, :3]
    assert np.abs(found - true).max() < 1e-4


@pytest.mark.parametrize('late', ['/points', '/objects', '/odom', '/camera/image_rect'])
def test_messages_that_were_delivered_late_are_taken_by_their_stamps(late, tmp_path):
    """One is recorded after the one that follows it."""
    stamps = {START_NS + 5 * PERIOD_NS, START_NS - 203 * MS + 700 * MS}

    def log(topic, stamp_ns):
        waits = topic == late and stamp_ns in stamps
        return stamp_ns + 60 * MS + waits * (PERIOD_NS + 40 * MS)

    robot = Robot(
        map_tf=False, odom_tf=False, boxes='odom', odometry=('odom', 'base_link'), log=log
    )
    frames = wanderer.write(tmp_path / 'bag', robot)
    notes = []
    for layout in (Layout.ODOMETRY, Layout.OBJECT):
        _, report = convert(tmp_path / 'bag', tmp_path / layout.value, layout)
        assert report.losses == ()
        notes += [note for note in report.notes if 'in the order of their stamps' in note]
    assert notes
    assert all(note.startswith(f'{late}: messages whose stamps are before') for note in notes)
    check_boxes(tmp_path / 'object', frames, range(len(frames)))
    found = numbers(tmp_path / 'odometry' / 'poses' / '00.txt').reshape(-1, 3, 4)
    true = relative(wanderer.odom_t_base, frames, BASE_T_CAMERA)[:, :3]
    assert np.abs(found - true).max() < 1e-4


@pytest.mark.parametrize('late', ['/imu', '/odom', '/points'])
def test_packets_are_the_same_where_a_message_was_delivered_late(late, tmp_path):
    stamps = {START_NS + 5 * PERIOD_NS, START_NS - 203 * MS + 700 * MS}
    written = []
    for wait_ns in (0, PERIOD_NS + 40 * MS):
        robot = Robot(
            map_tf=False, odom_tf=False, boxes=None, odometry=('odom', 'base_link'), imu=True,
            log=lambda topic, ns, wait_ns=wait_ns: ns + (topic == late and ns in stamps) * wait_ns,
        )  # fmt: skip
        wanderer.write(tmp_path / f'bag{wait_ns}', robot)
        _, report = convert(tmp_path / f'bag{wait_ns}', tmp_path / f'out{wait_ns}', Layout.RAW)
        assert report.losses == ()
        packets = sorted((tmp_path / f'out{wait_ns}').rglob('oxts/data/*.txt'))
        written.append([path.read_text() for path in packets])
    assert len(written[0]) == 30
    assert written[0] == written[1]


def test_transforms_without_stamps_have_the_times_of_recording(tmp_path):
    robot = Robot(map_tf=False, boxes=None, stamped=False, log=lambda _, stamp_ns: stamp_ns)
    frames = wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY)
    assert report.losses == ()
    found = numbers(tmp_path / 'out' / 'poses' / '00.txt').reshape(-1, 3, 4)
    true = relative(wanderer.odom_t_base, frames, BASE_T_CAMERA)[:, :3]
    assert np.abs(found - true).max() < 1e-4


def test_transforms_of_the_same_frames_as_an_odometry_are_named(tmp_path):
    wanderer.write(tmp_path / 'bag', Robot(map_tf=False, odometry=('odom', 'base_link')))
    survey = survey_bags([tmp_path / 'bag'])
    guessed = guess([tmp_path / 'bag'], survey, ImportOptions(layout=Layout.ODOMETRY))
    assert guessed.plan.pose.topic == '/odom'
    assert 'passed over for poses: /tf, which joins odom to base_link, too' in guessed.notes


def test_a_body_above_its_fixed_frame_has_poses(tmp_path):
    frames = wanderer.write(tmp_path / 'bag', Robot(map_tf=False, boxes='odom', inverted=True))
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY)
    assert report.losses == ()
    assert (guessed.plan.pose.world, guessed.plan.pose.body) == ('odom', 'base_link')
    found = numbers(tmp_path / 'out' / 'poses' / '00.txt').reshape(-1, 3, 4)
    true = relative(wanderer.odom_t_base, frames, BASE_T_CAMERA)[:, :3]
    assert np.abs(found - true).max() < 1e-4
    _, report = convert(tmp_path / 'bag', tmp_path / 'object', Layout.OBJECT)
    assert report.losses == ()
    check_boxes(tmp_path / 'object', frames, range(len(frames)))


def in_gap(stamp_ns):
    """From 0.65 s to 2.45 s: scans 7 to 24."""
    return START_NS + 650 * MS < stamp_ns < START_NS + 2450 * MS


def test_a_gap_costs_the_samples_in_it_alone(tmp_path):
    robot = Robot(keep=lambda child, stamp: child != 'odom' or not in_gap(stamp))
    wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT)
    (loss,) = report.losses
    first = START_NS + 7 * PERIOD_NS
    assert (loss.stream, loss.count) == ('/objects', 18)
    assert f'/objects at {first}: no transform from map to lidar' in loss.text()
    assert 'map -> odom has none before and after it' in loss.text()
    labels = sorted((tmp_path / 'out/training/label_2').iterdir())
    assert [int(label.stem) for label in labels] == [*range(7), *range(25, 30)]


def test_a_gap_costs_the_clouds_in_it_which_are_named_by_their_stamp(tmp_path):
    robot = Robot(keep=lambda child, stamp: child != 'odom' or not in_gap(stamp), cloud='map')
    wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT)
    (loss,) = [loss for loss in report.losses if loss.stream == '/points']
    assert loss.count == 18
    assert f'/points at {START_NS + 7 * PERIOD_NS}: no transform' in loss.text()


def test_a_gap_of_the_poses_is_a_loss(tmp_path):
    robot = Robot(boxes=None, keep=lambda child, stamp: child != 'odom' or not in_gap(stamp))
    wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY)
    (loss,) = report.losses
    assert (loss.stream, loss.count) == ('/tf', 18)
    assert f'/tf at {START_NS + 7 * PERIOD_NS}: no frame' in loss.text()
    assert report.frames == wanderer.FRAMES - 18


def test_a_gap_of_the_poses_costs_the_packets_in_it(tmp_path):
    robot = Robot(boxes=None, keep=lambda child, stamp: child != 'odom' or not in_gap(stamp))
    wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    (loss,) = report.losses
    assert (loss.stream, loss.count) == ('/tf', 18)
    assert 'no oxts is written here' in loss.text()
    assert (report.counts['scan'], report.counts['oxts']) == (wanderer.FRAMES, 12)


def test_boxes_in_a_frame_that_nothing_joins_are_lost_and_named(tmp_path):
    wanderer.write(tmp_path / 'bag', Robot(map_tf=False))
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT)
    (loss,) = report.losses
    assert loss.count == wanderer.FRAMES
    assert "a box in frame 'map'" in loss.text()


def oxts_poses(folder):
    packets = [parse_packet(path.read_text(), path) for path in sorted(folder.iterdir())]
    world = MercatorWorld.at(packets[0])
    return packets, np.array([world.pose(packet).matrix() for packet in packets])


def moved_to_start(poses):
    moved = poses.copy()
    moved[:, :3, 3] -= poses[0, :3, 3]
    return moved


@pytest.mark.one_in(3)
@pytest.mark.parametrize('origin', [None, '49.0,8.4,110', '-33.9,151.2,20'])
@pytest.mark.parametrize(
    ('robot', 'truth'),
    [
        (Robot(map_tf=False, odom_tf=False, odometry=('odom', 'base_link')), wanderer.odom_t_base),
        (Robot(imu=True, boxes=None), wanderer.map_t_base),
    ],
)
def test_raw_without_gps_has_the_poses(robot, truth, origin, tmp_path):
    frames = wanderer.write(tmp_path / 'bag', replace(robot, boxes=None))
    options = {} if origin is None else {'origin': origin}
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW, **options)
    assert report.losses == ()
    (drive,) = (tmp_path / 'out').glob('*/*_sync')
    packets, poses = oxts_poses(drive / 'oxts' / 'data')
    assert len(packets) == len(frames)
    unit = np.array([truth(frame.stamp_ns) for frame in frames])
    assert guessed.plan.imu_frame == ('imu' if robot.imu else 'base_link')
    velo_t_imu = rigid(drive.parent / 'calib_imu_to_velo.txt')
    base_t_imu = BASE_T_IMU if robot.imu else np.eye(4)
    assert np.abs(BASE_T_LIDAR @ velo_t_imu - base_t_imu).max() < 1e-6
    unit = unit @ base_t_imu
    true = moved_to_start(unit)
    assert np.abs(poses[:, :3, 3] - true[:, :3, 3]).max() < 1e-4
    assert np.abs(poses[:, :3, :3] - true[:, :3, :3]).max() < 1e-6
    place = origin or '0,0,0'
    assert any(f'at {place.replace(".0,", ",")}' in note for note in report.notes)
    latitude = float(place.split(',')[0])
    assert packets[0].lat == pytest.approx(latitude, abs=1e-3)
    if robot.odometry is not None:
        assert packets[3].wz == pytest.approx(wanderer.RATE)
        assert np.hypot(packets[3].ve, packets[3].vn) == pytest.approx(packets[3].vf, rel=0.2)
    if robot.imu:
        assert packets[3].az == pytest.approx(9.81)


def rigid(path):
    found = {}
    for line in path.read_text().splitlines():
        key, _, values = line.partition(':')
        found[key] = values
    made = np.eye(4)
    made[:3, :3] = np.array(found['R'].split(), float).reshape(3, 3)
    made[:3, 3] = np.array(found['T'].split(), float)
    return made


def test_velocities_are_those_of_the_unit(tmp_path):
    """v + w x r at the unit, in the axes of the world; vl is positive to the right."""
    robot = Robot(map_tf=False, odom_tf=False, odometry=('odom', 'base_link'), boxes=None, imu=True)
    frames = wanderer.write(tmp_path / 'bag', robot)
    convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    (drive,) = (tmp_path / 'out').glob('*/*_sync')
    packets, _ = oxts_poses(drive / 'oxts' / 'data')
    step = MS
    for packet, frame in zip(packets, frames, strict=True):
        before, after = (
            (wanderer.odom_t_base(frame.stamp_ns + sign * step) @ BASE_T_IMU)[:3, 3]
            for sign in (-1, 1)
        )
        east, north, up = (after - before) / (2 * step / 1e9)
        assert [packet.ve, packet.vn, packet.vu] == pytest.approx([east, north, up], abs=1e-3)


def test_raw_of_an_imu_alone_has_its_attitude(tmp_path):
    robot = Robot(map_tf=False, odom_tf=False, boxes=None, imu=True)
    frames = wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW, origin='49,8.4,110')
    (drive,) = (tmp_path / 'out').glob('*/*_sync')
    packets, poses = oxts_poses(drive / 'oxts' / 'data')
    true = [(wanderer.map_t_base(frame.stamp_ns) @ BASE_T_IMU)[:3, :3] for frame in frames]
    assert np.abs(poses[:, :3, :3] - true).max() < 1e-6
    assert {(packet.lat, packet.lon, packet.alt) for packet in packets} == {(49.0, 8.4, 110.0)}
    assert any('no NavSatFix and no poses' in note for note in report.notes)


@pytest.mark.parametrize(
    ('turn', 'said'),
    [
        (wanderer.matrix(yaw=np.pi / 2), 'whose x looks 90 degrees to the left (forward is x of'),
        (np.diag([1.0, -1, -1, 1]), 'whose x looks forward and z not up (forward is x of'),
        (wanderer.matrix(yaw=0.1), ''),
    ],
)
def test_an_imu_that_is_turned_tells_of_the_body(turn, said, tmp_path):
    robot = Robot(map_tf=False, odom_tf=False, boxes=None, imu=True, base_t_imu=BASE_T_IMU @ turn)
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, _ = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    assert guessed.plan.imu_frame == ('base_link' if said else 'imu')
    assert said in ' '.join(note for note in guessed.notes if 'the Imu is in imu' in note)
    (drive,) = (tmp_path / 'out').glob('*/*_sync')
    packets, poses = oxts_poses(drive / 'oxts' / 'data')
    base_t_unit = np.eye(4) if said else robot.base_t_imu
    true = [(wanderer.map_t_base(frame.stamp_ns) @ base_t_unit)[:3, :3] for frame in frames]
    assert np.abs(poses[:, :3, :3] - true).max() < 1e-6
    sensed = base_t_unit[:3, :3].T @ (0.1, wanderer.SPEED * wanderer.RATE, 9.81)
    for packet in packets:
        assert (packet.ax, packet.ay, packet.az) == pytest.approx(tuple(sensed))
        assert (packet.wx, packet.wy, packet.wz) == pytest.approx((0, 0, wanderer.RATE))


@pytest.mark.parametrize(
    ('frame', 'said'),
    [
        (
            '',
            '/vel: its frame is antenna, that of /fix, so it is taken as along east, north and up',
        ),
        ('map', '/vel: its frame is map, which does not move, so it is taken as along east,'),
    ],
)
def test_velocities_of_a_receiver_are_along_east_and_north(frame, said, tmp_path):
    robot = Robot(
        map_tf=False, odom_tf=False, boxes=None, imu=True, receiver='antenna', velocity_frame=frame
    )
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, _ = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    assert said in ' '.join(guessed.notes)
    assert parse_plan(format_plan(guessed.plan), 'plan') == guessed.plan
    (drive,) = (tmp_path / 'out').glob('*/*_sync')
    packets, poses = oxts_poses(drive / 'oxts' / 'data')
    true = [(wanderer.map_t_base(frame.stamp_ns) @ BASE_T_IMU)[:3, 3] for frame in frames]
    assert np.abs(poses[:, :3, 3] - (true - true[0])).max() < 2e-4
    for packet, each in zip(packets, frames, strict=True):
        # Of one in map the place on the robot is not known.
        place = wanderer.BASE_T_ANTENNA if frame else BASE_T_IMU
        moving = wanderer.velocity(each.stamp_ns, place)
        assert (packet.ve, packet.vn, packet.vu) == pytest.approx(tuple(moving), abs=1e-4)


@pytest.mark.parametrize(
    ('parts', 'taken', 'said'),
    [
        (
            {'receiver': 'antenna', 'velocity_frame': 'elsewhere', 'odometry': ODOMETRY},
            {'fix': '/fix', 'velocity': '/odom', 'imu': '/imu', 'imu_frame': 'imu'},
            'passed over for velocity: /vel',
        ),
        (
            {'bare_imu': True, 'imu_frame': 'elsewhere'},
            {'imu': '/camera/imu', 'imu_frame': 'base_link'},
            'passed over for imu: /imu',
        ),
        (
            {'imu_frame': 'elsewhere', 'receiver': 'antenna', 'velocity_frame': 'somewhere'},
            {'imu': '/imu', 'imu_frame': '', 'velocity': '/vel'},
            'missing: a static transform from elsewhere',
        ),
    ],
)
def test_parts_of_a_unit_that_nothing_joins_give_way_to_those_that_are_joined(
    parts, taken, said, tmp_path
):
    robot = Robot(map_tf=False, odom_tf=False, boxes=None, imu=True, **parts)
    wanderer.write(tmp_path / 'bag', robot)
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    assert {name: getattr(guessed.plan, name) for name in taken} == taken
    assert report.frames == wanderer.FRAMES
    assert any(said in note for note in guessed.notes)


def test_the_twist_of_an_odometry_is_the_velocity_beside_a_fix(tmp_path):
    robot = Robot(
        map_tf=False, odom_tf=False, boxes=None, imu=True, receiver='antenna', with_velocity=False,
        odometry=('odom', 'base_link'),
    )  # fmt: skip
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, _ = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    assert (guessed.plan.fix, guessed.plan.velocity) == ('/fix', '/odom')
    (drive,) = (tmp_path / 'out').glob('*/*_sync')
    packets, _ = oxts_poses(drive / 'oxts' / 'data')
    for packet, each in zip(packets, frames, strict=True):
        moving = wanderer.velocity(each.stamp_ns, BASE_T_IMU)
        assert (packet.ve, packet.vn, packet.vu) == pytest.approx(tuple(moving), abs=1e-6)


def test_an_odometry_of_a_body_in_the_tree_is_taken(tmp_path):
    robot = Robot(map_tf=False, boxes=None, odometry=('odom', 'base_link'), leader=True)
    wanderer.write(tmp_path / 'bag', robot)
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY)
    assert guessed.plan.pose.topic == '/odom'
    assert report.frames == wanderer.FRAMES


def test_an_imu_with_an_orientation_is_taken(tmp_path):
    robot = Robot(map_tf=False, odom_tf=False, boxes=None, imu=True, bare_imu=True)
    wanderer.write(tmp_path / 'bag', robot)
    guessed, _ = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    assert (guessed.plan.imu, guessed.plan.imu_frame) == ('/imu', 'imu')
    assert any('passed over for imu: /camera/imu' in note for note in guessed.notes)


def test_poses_take_the_place_of_a_receiver_that_never_has_a_fix(tmp_path):
    robot = Robot(
        map_tf=False, odom_tf=False, boxes=None, imu=True, receiver='antenna', indoors=True,
        odometry=('odom', 'base_link'),
    )  # fmt: skip
    frames = wanderer.write(tmp_path / 'bag', robot)
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    assert any('passed over for fix: /fix' in note for note in guessed.notes)
    assert (guessed.plan.fix, guessed.plan.pose.topic) == ('', '/odom')
    assert report.counts['oxts'] == len(frames)


def test_pykitti_opens_a_raw_drive_without_gps(tmp_path):
    pykitti = pytest.importorskip('pykitti', reason='pykitti is not installed')
    robot = Robot(odometry=('odom', 'base_link'), imu=True, boxes=None)
    wanderer.write(tmp_path / 'bag', robot)
    convert(tmp_path / 'bag', tmp_path / 'raw', Layout.RAW)
    convert(tmp_path / 'bag', tmp_path / 'odometry', Layout.ODOMETRY)
    (drive,) = (tmp_path / 'raw').glob('*/*_sync')
    raw = pykitti.raw(str(tmp_path / 'raw'), drive.parent.name, '0001')
    poses = np.array([packet.T_w_imu for packet in raw.oxts]) @ np.linalg.inv(raw.calib.T_cam0_imu)
    found = np.linalg.inv(poses[0]) @ poses
    expected = numbers(tmp_path / 'odometry' / 'poses' / '00.txt').reshape(-1, 3, 4)
    assert np.abs(found[:, :3] - expected).max() < 1e-4


def test_tracking_has_oxts_of_the_poses(tmp_path):
    frames = wanderer.write(tmp_path / 'bag', Robot(odometry=('odom', 'base_link')))
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.TRACKING)
    assert report.counts['oxts'] == len(frames)
    lines = (tmp_path / 'out/training/oxts/0000.txt').read_text().splitlines()
    packets = [parse_packet(line, 'oxts') for line in lines]
    world = MercatorWorld.at(packets[0])
    found = np.array([world.pose(packet).matrix() for packet in packets])
    true = np.array([wanderer.map_t_base(frame.stamp_ns) for frame in frames])
    assert np.abs(found - moved_to_start(true)).max() < 1e-4


def test_our_reader_gives_back_the_poses_of_the_track(tmp_path):
    frames = wanderer.write(tmp_path / 'bag', Robot(boxes=None))
    convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    (drive,) = (tmp_path / 'out').glob('*/*_sync')
    recording = open_recording(drive, ReadOptions(layout=Layout.RAW))
    numbers_read = recording.streams['pose'].numbers
    assert len(numbers_read) == len(frames)
    read = [recording.read(Stream.POSE, number).world_T_imu.matrix() for number in numbers_read]
    true = np.array([wanderer.map_t_base(frame.stamp_ns) for frame in frames])
    assert np.abs(np.array(read) - moved_to_start(true)).max() < 1e-4


@pytest.mark.parametrize(
    ('text', 'said'),
    [('91,0,0', 'expected LAT,LON,ALT'), ('nan,0,0', 'expected LAT'), ('1,2', 'expected LAT')],
)
def test_an_origin_that_cannot_be_meant_is_refused(text, said, tmp_path):
    plan = f"layout: raw\nname: a\nreference: scan\ntolerance_s: 0.1\norigin: '{text}'\n"
    with pytest.raises(UsageError, match=said):
        parse_plan(plan, tmp_path / 'plan.yaml')
    with pytest.raises(UsageError, match=said):
        make_import_options({'origin': text})


def lio(path):
    """A LIO program's output alone: registered clouds in camera_init, Odometry of body, no /tf."""
    robot = Robot(
        map_tf=False,
        odom_tf=False,
        boxes=None,
        camera=False,
        static=False,
        cloud='odom',
        odometry=('odom', 'body'),
    )
    return wanderer.write(path, robot)


def test_output_of_lio_becomes_scans_of_its_body(tmp_path):
    frames = lio(tmp_path / 'bag')
    guessed, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.ODOMETRY)
    assert report.losses == ()
    assert guessed.plan.scan.frame == 'body'
    assert (guessed.plan.pose.topic, guessed.plan.pose.body) == ('/odom', 'body')
    for number, frame in enumerate(frames):
        path = tmp_path / 'out/sequences/00/velodyne' / f'{number:06d}.bin'
        points = np.fromfile(path, np.float32).reshape(-1, 4)[:, :3]
        true = frame.points @ BASE_T_LIDAR[:3, :3].T + BASE_T_LIDAR[:3, 3]
        assert np.abs(points - true).max() < 1e-4
    found = numbers(tmp_path / 'out/poses/00.txt').reshape(-1, 3, 4)
    # Camera 0 is at KITTI's nominal place: its poses are those of the body, seen from there.
    moved = relative(wanderer.odom_t_base, frames, np.eye(4))
    angle = [np.arccos(np.clip((np.trace(m[:3, :3]) - 1) / 2, -1, 1)) for m in moved]
    seen = [np.arccos(np.clip((np.trace(m[:, :3]) - 1) / 2, -1, 1)) for m in found]
    assert np.abs(np.array(seen) - angle).max() < 1e-6


@pytest.mark.parametrize(
    ('layout', 'changes', 'said'),
    [
        (Layout.ODOMETRY, {}, 'pose: of camera 0 at its nominal place on the scanner'),
        (
            Layout.ODOMETRY,
            {'scan': None, 'reference': 'pose'},
            'pose: of camera 0 at the origin of base_link',
        ),
        (Layout.RAW, {'imu_frame': ''}, 'oxts: of the imu at its nominal place on the scanner'),
        (
            Layout.TRACKING,
            {'imu_frame': ''},
            'oxts: of the imu at its nominal place on the scanner',
        ),
        (Layout.RAW, {}, None),
        (Layout.OBJECT, {}, None),
    ],
)
def test_what_the_poses_are_of_is_said_where_no_calibration_tells(layout, changes, said, tmp_path):
    robot = Robot(boxes=None, camera=False)
    wanderer.write(tmp_path / 'bag', robot)
    change = lambda plan: replace(plan, **changes)  # noqa: E731
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', layout, change)
    notes = [note for note in report.notes if note.endswith(', since there is no calibration')]
    assert notes == ([f'{said}, since there is no calibration'] if said else [])


def test_a_plan_may_say_what_the_body_of_odometry_is(tmp_path):
    """Its child frame is in no tree: the plan's body is taken, and that is said."""
    robot = Robot(map_tf=False, odom_tf=False, boxes='odom', odometry=('odom', 'ego'))
    frames = wanderer.write(tmp_path / 'bag', robot)

    def change(plan):
        return replace(plan, pose=PosePlan('/odom', 'base_link', 'odom'))

    _, report = convert(tmp_path / 'bag', tmp_path / 'poses', Layout.ODOMETRY, change)
    assert any('its poses are of ego, which no transform names' in note for note in report.notes)
    found = numbers(tmp_path / 'poses/poses/00.txt').reshape(-1, 3, 4)
    assert np.abs(found - relative(wanderer.odom_t_base, frames, BASE_T_CAMERA)[:, :3]).max() < 1e-4
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT, change)
    assert report.losses == ()
    check_boxes(tmp_path / 'out', frames, range(len(frames)))


def test_invalid_transforms_are_lost_and_the_rest_is_used(tmp_path):
    def keep(child, stamp):
        return child != 'base_link' or stamp % (70 * MS) > 30 * MS

    frames = wanderer.write(tmp_path / 'bag', Robot(keep=keep, broken=5))
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.OBJECT)
    (loss,) = report.losses
    assert (loss.stream, loss.count) == ('/tf', 5)
    assert 'NaN' in loss.text()
    assert len(list((tmp_path / 'out/training/label_2').iterdir())) == len(frames)


def test_an_odometry_of_zeros_costs_the_oxts_alone(tmp_path):
    robot = Robot(
        map_tf=False, odom_tf=False, boxes=None, odometry=('odom', 'base_link'), broken=1000
    )
    frames = wanderer.write(tmp_path / 'bag', robot)
    _, report = convert(tmp_path / 'bag', tmp_path / 'out', Layout.RAW)
    assert report.counts['scan'] == len(frames)
    assert 'oxts' not in report.counts
    assert report.losses


def test_pictures_of_a_bag_have_its_clouds_and_boxes_in_map(tmp_path):
    frames = wanderer.write(tmp_path / 'bag', Robot(cloud='map'))
    with open_bag_source(tmp_path / 'bag') as bag:
        shown = RecordingFrames(PlannedRecording(bag, survey_bags([bag]))).frame(4)
    assert np.abs(shown.points[:, :3] - frames[4].points).max() < 1e-4
    assert len(shown.objects) == 2


def test_pictures_have_standing_boxes_on_their_points_whatever_their_stamp(tmp_path):
    boxes = []
    for after_ns in (0, 40 * MS):
        path = tmp_path / f'{after_ns}'
        wanderer.write(path, Robot(boxes_after_ns=after_ns))
        with open_bag_source(path) as bag:
            boxes.append(
                RecordingFrames(PlannedRecording(bag, survey_bags([bag]))).frame(4).objects
            )
    places = [[each.cuboid.velo_T_box.translation for each in found] for found in boxes]
    np.testing.assert_allclose(*places, atol=1e-9)


def test_boxes_in_map_are_drawn_on_the_images(tmp_path):
    wanderer.write(tmp_path / 'bag', Robot())
    with open_bag_source(tmp_path / 'bag') as bag:
        images = LabelledImages(bag)
        message = wanderer.image(START_NS)
        plain = np.full((*wanderer.SIZE[::-1], 3), 90, np.uint8)
        drawn = images.draw('/camera/image_rect', message, plain, START_NS, START_NS + MS)
        images.close()
    assert (drawn != 90).any(axis=2).sum() > 500


def test_standing_boxes_are_drawn_where_they_are_at_the_image(tmp_path):
    drawn = []
    for after_ns in (0, 40 * MS):
        wanderer.write(tmp_path / f'{after_ns}', Robot(boxes_after_ns=after_ns))
        with open_bag_source(tmp_path / f'{after_ns}') as bag:
            images, image_ns = LabelledImages(bag), START_NS + 4 * PERIOD_NS
            message = wanderer.image(image_ns)
            plain = np.full((*wanderer.SIZE[::-1], 3), 90, np.uint8)
            made = images.draw('/camera/image_rect', message, plain, image_ns, image_ns + MS)
            drawn.append(made)
            images.close()
    assert (drawn[0] != 90).any()
    np.testing.assert_array_equal(*drawn)


@pytest.mark.parametrize('cloud', ['lidar', 'odom'])
def test_odometry_that_joins_frames_is_used(tmp_path, cloud):
    """Object sets have no poses: the Odometry serves points in odom, or nothing."""
    robot = Robot(odom_tf=False, map_tf=False, cloud=cloud, odometry=('odom', 'base_link'))
    wanderer.write(tmp_path / 'bag', robot)
    path = tmp_path / 'bag'
    notes = guess([path], survey_bags([path]), ImportOptions(layout=Layout.OBJECT)).notes
    unused = [note for note in notes if note.startswith('not used') and '/odom ' in note]
    assert len(unused) == (cloud == 'lidar')
