# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval odometry: files, bags, frames, missing poses, plots and mistakes."""

from __future__ import annotations

import json
from importlib.util import find_spec

import numpy as np
import pytest
from builders import convert_recording, one_line
from drives import (
    drifted,
    drive,
    link,
    odometry,
    offsets_ns,
    path_of,
    shaken,
    stamped,
    stamps_of,
    static,
    write_bag,
    write_poses,
    write_sequence,
    write_tum,
)

from kitti_ros2 import KittiRos2Warning
from kitti_ros2.cli import main
from kitti_ros2.drawing import labelled_objects
from kitti_ros2.evaluation import evaluate_odometry
from kitti_ros2.kitti.calib_file import parse_calibration
from kitti_ros2.kitti.kitti_recording import rect_from_imu
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import make_header
from kitti_ros2.messages.naming import base_t_imu
from kitti_ros2.messages.ros_types import Path as PathMessage
from kitti_ros2.model.errors import KittiRos2Error, UsageError
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.read import SelectionOptions

pytestmark = pytest.mark.skipif(find_spec('evo') is None, reason='evo is not installed')
needs_matplotlib = pytest.mark.skipif(
    find_spec('matplotlib') is None, reason='matplotlib is not installed'
)
KEYS = ['t_err_percent', 'r_err_deg_per_m', 'segments', 'ape_m', 'rpe_m']
FRAMES = 400
TRUTH = drive(FRAMES)
RESULT = shaken(TRUTH)


@pytest.fixture(autouse=True)
def columns(monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    monkeypatch.setattr(labelled_objects, '_DPI', 60)


@pytest.fixture
def root(tmp_path):
    """An odometry set of one sequence, 07, without images and scans."""
    return write_sequence(tmp_path / 'odometry', TRUTH)


@pytest.fixture
def run(capsys):
    """A function that runs the command, and returns its exit code, output and errors."""

    def call(*words):
        code = main(['eval', 'odometry', *map(str, words)])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def scores_of(run):
    """A function that returns the figures of the only trajectory."""

    def call(*words, code=0):
        exit_code, out, err = run(*words, '--json')
        assert exit_code == code, err
        (scores,) = json.loads(out)['odometry'].values()
        return scores

    return call


def gt(root):
    return root / 'poses' / '07.txt'


def body_poses(root, frame, result=RESULT):
    """The result as poses of base_link or velo_link in a fixed frame of their own."""
    path = root / 'sequences/07/calib.txt'
    calibration = parse_calibration(path.read_text(), path, 'calib.txt')
    imu_t_cam0 = rect_from_imu(calibration).inverse()
    mounts = {
        'velo_link': calibration.velo_T_imu @ imu_t_cam0,
        'base_link': base_t_imu(MessageOptions()) @ imu_t_cam0,
    }
    mount = mounts[frame].matrix()
    world = Transform(rotation_from_rpy(0.1, -0.2, 2.0), np.array([500.0, -20, 7])).matrix()
    return world @ result @ np.linalg.inv(mount)


def test_the_json_has_these_keys_only(root, tmp_path, run):
    code, out, err = run(gt(root), write_poses(tmp_path / 'r.txt', RESULT), '--json')
    assert (code, err) == (0, '')
    values = json.loads(out)
    assert [*values] == ['odometry']
    assert [*values['odometry']] == ['07']
    assert [*values['odometry']['07']] == KEYS
    assert all(value > 0 for value in values['odometry']['07'].values())


def test_a_known_drift_is_in_the_table(root, tmp_path, run):
    turned = write_poses(tmp_path / 'r.txt', drifted(TRUTH, 0, 0.01))
    code, out, err = run(gt(root), turned)
    assert (code, err) == (0, '')
    rows = {line.split()[0]: line.split() for line in out.splitlines() if line.strip()}
    assert rows['all'][-1].startswith('0.0100')
    assert [line.split()[0] for line in out.splitlines() if ' m ' in line[:6]] == [
        '100',
        '200',
        '300',
    ]
    shown = [line for line in out.splitlines() if str(tmp_path) not in line]
    assert max(map(len, shown)) <= 80
    assert 'first pose aligned' in out


def test_the_figures_do_not_depend_on_the_kind_of_file(root, tmp_path, scores_of):
    plain = scores_of(gt(root), write_poses(tmp_path / 'a.txt', RESULT))
    numbered = write_poses(tmp_path / 'b.txt', RESULT, range(FRAMES))
    assert scores_of(gt(root), numbered) == plain
    absolute = write_tum(tmp_path / 'c.tum', (f'{ns}e-9' for ns in stamps_of(FRAMES)), RESULT)
    relative = write_tum(tmp_path / 'd.tum', (f'{ns}e-9' for ns in offsets_ns(FRAMES)), RESULT)
    for source in (gt(root), root):
        for result in (absolute, relative):
            assert scores_of(source, result) == pytest.approx(plain, rel=1e-4)


def test_a_trajectory_against_itself_has_no_error(root, scores_of):
    figures = scores_of(root, gt(root), '--sequence', '07')
    assert figures.pop('segments') > 40
    assert [*figures.values()] == pytest.approx([0] * 4, abs=1e-6)


def test_a_result_that_begins_late_and_lacks_frames(root, tmp_path, run):
    numbers = np.setdiff1d(np.arange(20, FRAMES), [100, 101, 250])
    late = np.linalg.inv(RESULT[20]) @ RESULT[numbers]
    path = write_poses(tmp_path / '09.txt', late, numbers)
    code, out, err = run(gt(root), path, '--json')
    score = json.loads(out)['odometry']['07']
    whole = evaluate_odometry(gt(root), write_poses(tmp_path / 'all.txt', RESULT))
    kept = np.isin(whole.segments.first, numbers) & np.isin(whole.segments.last, numbers)
    assert 0 < score['segments'] == kept.sum() < len(kept)
    assert score['t_err_percent'] == pytest.approx(whole.segments.chosen(kept).t_err_percent, 1e-5)
    assert code == 1
    assert err.splitlines()[0] == (
        f'skipped result (23): {path} (poses file with frame numbers): no pose of frames 0-19,'
        f' 100-101, 250'
    )
    assert run(gt(root), path, '-q') == (1, '', err)


def test_frames_that_the_ground_truth_does_not_have_are_named(root, tmp_path, run):
    longer = write_poses(tmp_path / 'r.txt', drive(FRAMES + 3))
    code, _, err = run(gt(root), longer)
    assert code == 1
    assert f'the ground truth has no frames {FRAMES}-{FRAMES + 2}' in err


def test_steps_over_missing_frames_are_not_in_rpe(root, tmp_path):
    numbers = np.setdiff1d(np.arange(FRAMES), range(50, 200))
    path = write_poses(tmp_path / 'r.txt', RESULT[numbers], numbers)
    with pytest.warns(KittiRos2Warning, match='no pose of frames 50-199'):
        scores = evaluate_odometry(gt(root), path)
    assert len(scores.errors.rpe_m) == len(numbers) - 2
    assert scores.errors.rpe_m.max() < 0.2


@pytest.mark.parametrize('by_stamp', [False, True])
def test_frames_that_were_not_played_are_not_missing(by_stamp, root, tmp_path):
    """As of `play --start --end`: the part is scored like a ground truth that is no longer."""
    part = range(40, 340)
    given = [number for number in part if number not in {100, 101}]
    if by_stamp:
        stamps = np.array(stamps_of(FRAMES))[given]
        path = write_tum(tmp_path / 'r.tum', (f'{ns}e-9' for ns in stamps), RESULT[given])
    else:
        path = write_poses(tmp_path / 'r.txt', RESULT[given], given)
    with pytest.warns(KittiRos2Warning, match='no pose of frames 100-101$') as warned:
        scores = evaluate_odometry(gt(root), path, frames=part)
    assert len(warned) == len(scores.losses) == 1
    assert scores.losses[0].numbers == (100, 101)
    assert scores.numbers.tolist() == [*part]
    assert 'scored are frames 40-339 only' in scores.notes
    truth = write_poses(tmp_path / 'gt.txt', TRUTH[40:340])
    cut = write_poses(tmp_path / 'cut.txt', RESULT[given], [n - 40 for n in given])
    with pytest.warns(KittiRos2Warning, match='no pose of frames 60-61'):
        expected = evaluate_odometry(truth, cut)
    assert scores.t_err_percent == pytest.approx(expected.t_err_percent, 1e-4)
    assert scores.ape_m == pytest.approx(expected.ape_m, 1e-6)


def test_a_result_without_the_frames_to_score_is_an_error(root, tmp_path):
    path = write_poses(tmp_path / 'r.txt', RESULT[:30])
    for frames, shown in ((range(30, 40), '30-39'), (range(500, 510), 'none of the ground truth')):
        with pytest.raises(UsageError, match=f'no pose of the frames to score, {shown}'):
            evaluate_odometry(gt(root), path, frames=frames)


def test_errors_are_those_of_definition(root, tmp_path):
    """APE and RPE computed without evo."""
    scores = evaluate_odometry(gt(root), write_poses(tmp_path / 'r.txt', RESULT), align='none')
    far = np.linalg.norm(RESULT[:, :3, 3] - TRUTH[:, :3, 3], axis=1)
    assert scores.ape_m == pytest.approx(np.sqrt(np.mean(far**2)), rel=1e-6)
    steps = [np.linalg.inv(poses[:-1]) @ poses[1:] for poses in (TRUTH, RESULT)]
    wrong = (np.linalg.inv(steps[0]) @ steps[1])[:, :3, 3]
    assert scores.rpe_m == pytest.approx(np.sqrt(np.mean(np.sum(wrong**2, axis=1))), rel=1e-5)


def test_alignments(root, tmp_path, scores_of):
    moved = Transform(rotation_from_rpy(0.3, 0.1, 1.0), np.array([9.0, 3, 1])).matrix() @ TRUTH
    moved[:, :3, 3] *= 2
    path = write_poses(tmp_path / 'r.txt', moved)
    ape = {kind: scores_of(gt(root), path, '--align', kind)['ape_m']
           for kind in ('none', 'first', 'se3', 'sim3', 'scale')}  # fmt: skip
    assert ape['none'] > ape['first'] > ape['se3'] > 1
    assert ape['sim3'] == pytest.approx(0, abs=1e-5)
    assert ape['scale'] == pytest.approx(0, abs=1e-5)
    assert scores_of(gt(root), path)['ape_m'] == ape['first']


@pytest.mark.parametrize(
    ('align', 'said'),
    [
        ('none', 'not aligned for APE and RPE; segments do not depend on it'),
        ('first', 'first pose aligned for APE and RPE; segments do not depend on it'),
        ('se3', 'all positions aligned, SE(3) for APE and RPE; segments do not depend on it'),
        ('sim3', 'all positions aligned, Sim(3), scale 20 for APE, RPE and segments'),
        ('scale', 'first pose aligned, scale 20 for APE, RPE and segments'),
    ],
)
def test_a_scale_is_also_that_of_the_segments(align, said, root, tmp_path, run, scores_of):
    small = TRUTH.copy()
    small[:, :3, 3] *= 0.05
    path = write_poses(tmp_path / 'r.txt', small)
    assert f'\n{said}\n' in run(gt(root), path, '--align', align)[1]
    figures = scores_of(gt(root), path, '--align', align)
    if align in {'sim3', 'scale'}:
        assert figures['scale'] == pytest.approx(20)
        assert figures['t_err_percent'] == pytest.approx(0, abs=1e-3)
    else:
        assert 'scale' not in figures
        assert 90 < figures['t_err_percent'] < 96


@pytest.mark.parametrize('align', ['sim3', 'scale'])
def test_scaled_figures_are_those_of_the_result_times_the_scale(align, root, tmp_path, scores_of):
    """As kitti-odom-eval's 7dof and scale; on its example_0 both agree with it to four digits."""
    small = RESULT.copy()
    small[:, :3, 3] *= 0.05
    scaled = scores_of(gt(root), write_poses(tmp_path / 'r.txt', small), '--align', align)
    if align == 'scale':
        true, estimate = ((np.linalg.inv(path[0]) @ path)[:, :3, 3] for path in (TRUTH, small))
        assert scaled['scale'] == pytest.approx((true * estimate).sum() / (estimate**2).sum())
    small[:, :3, 3] *= scaled['scale']
    plain = scores_of(gt(root), write_poses(tmp_path / 's.txt', small), '--align', 'first')
    assert scaled['t_err_percent'] == pytest.approx(plain['t_err_percent'], rel=1e-4)
    assert scaled['r_err_deg_per_m'] == pytest.approx(plain['r_err_deg_per_m'], rel=1e-4)


@pytest.mark.parametrize('align', ['sim3', 'scale'])
def test_the_way_from_a_frame_to_camera_0_is_not_scaled(align, root, tmp_path, scores_of):
    poses = body_poses(root, 'base_link', TRUTH)
    poses[:, :3, 3] *= 0.05
    path = write_poses(tmp_path / 'r.txt', poses)
    figures = scores_of(gt(root), path, '--align', align, '--frame', 'base_link')
    assert figures['scale'] == pytest.approx(20, rel=1e-5)
    assert figures['ape_m'] < 1e-3


def test_a_scale_of_a_result_that_stays_is_refused(root, tmp_path, run):
    path = write_poses(tmp_path / 'r.txt', np.tile(np.eye(4), (FRAMES, 1, 1)))
    code, _, err = run(gt(root), path, '--align', 'scale')
    assert code == 2
    assert err.startswith('kitti-ros2: --align scale is not possible (the result does not move')


@pytest.mark.parametrize(('align', 'other'), [('se3', 'first'), ('sim3', 'scale')])
def test_an_alignment_of_a_straight_way_is_refused(align, other, tmp_path, run):
    straight = write_poses(tmp_path / '01.txt', drive(300, bend=0))
    code, _, err = run(straight, straight, '--align', align)
    assert code == 2
    assert err.startswith(f'kitti-ros2: --align {align} is not possible (positions on a line')
    assert one_line(err).endswith(f'give --align {other}')
    assert run(straight, straight, '--align', other)[0] == 0


def test_a_short_way_has_null(tmp_path, run):
    path = write_poses(tmp_path / '03.txt', drive(30, 1.0))
    code, out, err = run(path, path)
    assert (code, err) == (0, '')
    assert "note: there are no segments of KITTI's: the ground truth is 30.7 m long" in out
    code, out, err = run(path, path, '--json')
    assert json.loads(out)['odometry']['03'] == {
        't_err_percent': None,
        'r_err_deg_per_m': None,
        'segments': 0,
        'ape_m': pytest.approx(0, abs=1e-9),
        'rpe_m': pytest.approx(0, abs=1e-9),
    }


def test_a_single_pose_has_no_step(tmp_path, scores_of):
    path = write_poses(tmp_path / '03.txt', drive(1))
    assert scores_of(path, path)['rpe_m'] is None


def bag_of(root, path, *, child='base_link', topic='/odom'):
    poses = body_poses(root, child)
    times = stamps_of(FRAMES)
    return write_bag(path, *(
        (topic, ns, odometry(ns, pose, child)) for ns, pose in zip(times, poses, strict=True)
    ))  # fmt: skip


@pytest.mark.parametrize('child', ['base_link', 'velo_link'])
def test_poses_of_other_frames_are_brought_to_camera_0(child, root, tmp_path, scores_of):
    expected = scores_of(gt(root), write_poses(tmp_path / 'r.txt', RESULT))
    bag = bag_of(root, tmp_path / 'run.mcap', child=child)
    assert scores_of(root, bag) == pytest.approx(expected, rel=1e-3)
    assert scores_of(gt(root), bag, '--topic', '/odom') == pytest.approx(expected, rel=1e-3)
    file = write_poses(tmp_path / 'f.txt', body_poses(root, child))
    assert scores_of(root, file, '--frame', child) == pytest.approx(expected, rel=1e-3)
    assert scores_of(root, file)['t_err_percent'] > 2 * expected['t_err_percent']


def test_every_kind_of_message_has_the_same_figures(root, tmp_path, scores_of):
    poses, times = body_poses(root, 'base_link'), stamps_of(FRAMES)
    pairs = [*zip(times, poses, strict=True)]
    bag = write_bag(
        tmp_path / 'run.mcap',
        *(('/odom', ns, odometry(ns, pose)) for ns, pose in pairs),
        *(('/pose', ns, stamped(ns, pose)) for ns, pose in pairs),
        *(('/tf', ns, link(ns, pose)) for ns, pose in pairs),
        ('/path', times[200], path_of(times[:200], poses[:200])),
        ('/path', times[-1], path_of(times, poses)),
    )
    figures = [scores_of(root, bag, '--topic', topic) for topic in ('/odom', '/pose', '/path')]
    figures.append(scores_of(root, bag, '--tf', 'odom', 'base_link'))
    assert figures[1:] == [pytest.approx(figures[0], rel=1e-6)] * 3


def test_a_frame_of_the_bag_is_resolved_by_its_static_transforms(root, tmp_path, scores_of):
    expected = scores_of(gt(root), write_poses(tmp_path / 'r.txt', RESULT))
    mount = Transform(rotation_from_rpy(0.2, 0.1, -0.4), np.array([1.0, 0.3, 0.8]))
    poses = body_poses(root, 'velo_link') @ mount.matrix()
    times = stamps_of(FRAMES)
    bag = write_bag(
        tmp_path / 'run.mcap',
        ('/tf_static', times[0], static(('velo_link', 'gnss', mount))),
        *(('/odom', ns, odometry(ns, pose, 'gnss')) for ns, pose in zip(times, poses, strict=True)),
    )
    assert scores_of(root, bag) == pytest.approx(expected, rel=1e-3)


def test_the_bag_of_the_sequence_is_the_same_ground_truth(root, tmp_path, scores_of):
    bag = tmp_path / 'gt.mcap'
    selection = SelectionOptions(('pose', 'calibration', 'recording'))
    convert_recording(root / 'sequences' / '07', bag, selection=selection, storage='mcap')
    result = bag_of(root, tmp_path / 'run.mcap')
    assert scores_of(bag, result) == pytest.approx(scores_of(root, result), rel=1e-3)
    file = write_poses(tmp_path / 'r.txt', RESULT)
    assert scores_of(bag, file) == pytest.approx(scores_of(root, file), rel=1e-3)


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING, Layout.KITTI_360])
def test_recordings_and_their_bags_agree(layout, recordings, tmp_path, run):
    source, bag = recordings[layout], tmp_path / 'own.mcap'
    streams = ('pose', 'oxts', 'calibration', 'recording', 'scan')
    convert_recording(source, bag, selection=SelectionOptions(streams), storage='mcap')
    code, out, _ = run(source, bag, '--topic', '/kitti/ground_truth/odometry', '--json')
    assert code == 0
    (named,) = json.loads(out)['odometry'].items()
    assert named[0] == open_recording(source).name
    assert named[1]['ape_m'] == pytest.approx(0, abs=1e-5)
    assert run(bag, bag, '--topic', '/kitti/ground_truth/odometry')[0] == 0


def test_a_bag_of_others_is_a_ground_truth(tmp_path, scores_of):
    """Camera 0 is not known in it: both are at its nominal place on the body."""
    times, still = stamps_of(FRAMES), Transform.from_translation([0.0, 0, 1])
    bag = write_bag(
        tmp_path / 'both.mcap',
        ('/tf_static', times[0], static(('base_link', 'lidar', still))),
        *(('/gt', ns, odometry(ns, pose)) for ns, pose in zip(times, TRUTH, strict=True)),
        *(('/odom', ns, odometry(ns, pose)) for ns, pose in zip(times, RESULT, strict=True)),
    )
    figures = scores_of(bag, bag, '--gt-topic', '/gt', '--topic', '/odom')
    assert figures['segments'] > 40
    assert figures['t_err_percent'] > 0.1
    same = scores_of(bag, bag, '--gt-topic', '/gt', '--topic', '/gt')
    assert same['ape_m'] == pytest.approx(0, abs=1e-9)


def test_stamps_match_within_a_tolerance_only(root, tmp_path, run):
    times = [f'{ns + 30_000_000}e-9' for ns in stamps_of(FRAMES)]
    late = write_tum(tmp_path / 'late.tum', times, RESULT)
    code, out, _ = run(root, late)
    assert code == 0
    assert 'by stamp, at most 30.0 ms apart' in out
    code, _, err = run(root, late, '--tolerance', '0.02')
    assert code == 2
    assert 'no pose within 0.020 s of a frame; its stamps are 2011-09-26 00:00:00.03' in err


def test_two_poses_of_one_stamp_are_counted(root, tmp_path, run):
    times = stamps_of(FRAMES)
    pairs = [*zip(times, body_poses(root, 'base_link'), strict=True)]
    bag = write_bag(tmp_path / 'run.mcap', *(
        ('/odom', ns, odometry(ns, pose)) for ns, pose in [*pairs, pairs[7]]
    ))  # fmt: skip
    code, _, err = run(root, bag)
    assert code == 1
    assert err.startswith('skipped /odom (1): /odom: a second pose of the same stamp\n')


def test_a_pose_of_another_frame_costs_its_message(root, tmp_path, run):
    times, poses = stamps_of(FRAMES), body_poses(root, 'base_link')
    bag = write_bag(tmp_path / 'run.mcap', *(
        ('/odom', ns, odometry(ns, pose, 'velo_link' if n in {5, 6} else '/base_link'))
        for n, (ns, pose) in enumerate(zip(times, poses, strict=True))
    ))  # fmt: skip
    code, _, err = run(root, bag)
    assert code == 1
    assert 'skipped /odom (2): ' in err
    assert 'no pose (of velo_link, not of base_link)' in err
    assert 'no pose of frames 5-6\n' in err


def test_a_topic_without_a_valid_pose_is_an_error(root, tmp_path, run):
    empty = write_bag(
        tmp_path / 'empty.mcap', ('/path', 1, PathMessage(make_header(1, 'odom'), []))
    )
    zero = odometry(1, np.eye(4))
    zero.pose.pose.orientation.w = 0.0
    zeros = write_bag(tmp_path / 'zeros.mcap', ('/odom', 1, zero))
    for bag, complaint in (
        (empty, ': /path: holds no pose; it needs an Odometry, a PoseStamped, a Path or a moving'),
        (zeros, ': /odom: holds no pose of base_link (a pose of NaN, of an impossible place or of'),
    ):
        code, _, err = run(root, bag)
        assert code == 2
        assert one_line(err).startswith(f'kitti-ros2: {bag}{complaint}')


def test_an_invalid_message_costs_its_frame(root, tmp_path, run):
    times, poses = stamps_of(FRAMES), body_poses(root, 'base_link')
    poses[5, 0, 3] = np.nan
    bag = write_bag(tmp_path / 'run.mcap', *(
        ('/odom', ns, odometry(ns, pose)) for ns, pose in zip(times, poses, strict=True)
    ))  # fmt: skip
    code, _, err = run(root, bag)
    assert code == 1
    assert 'no pose of frames 5\n' in err
    assert 'no pose (a pose of NaN' in err


@pytest.fixture
def busy(tmp_path):
    """A bag with two topics and a link that have poses."""
    times = stamps_of(3)
    pose = np.eye(4)
    return write_bag(tmp_path / 'run.mcap', *(
        (topic, ns, make(ns, np.array(pose) + n * np.eye(4, k=3)))
        for n, ns in enumerate(times)
        for topic, make in (('/odom', odometry), ('/pose', stamped), ('/tf', link))
    ))  # fmt: skip


USABLE = (
    '--topic takes /odom (nav_msgs/msg/Odometry), /pose (geometry_msgs/msg/PoseStamped); --tf takes'
    ' odom base_link'
)


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        ((), f'has several topics with poses; {USABLE}'),
        (('--topic', '/odometry'), f'has no poses on /odometry; {USABLE}'),
        (('--topic', '/odm'), f'has no poses on /odm; did you mean /odom; {USABLE}'),
        (('--topic', '/tf'), f'has no poses on /tf; {USABLE}'),
        (('--tf', 'map', 'base_link'), f'has no moving link map -> base_link; {USABLE}'),
        (('--tf', 'odom', 'base_link', '--topic', '/odom'), '--topic and --tf exclude each other'),
        (('--tf', 'odom'), 'takes the parent and the child of a link'),
        (('--topic', '/pose', '--frame', 'lidar'), 'no static transform from lidar to camera 0'),
    ],
)
def test_a_result_that_is_not_there_is_an_error_that_lists_what_is(
    words, complaint, root, busy, run
):
    code, out, err = run(root, busy, *words)
    assert (code, out) == (2, '')
    assert complaint in one_line(err)


def test_a_bag_without_poses_is_an_error(root, tmp_path, run):
    still = Transform.from_translation([0.0, 0, 1])
    bag = write_bag(tmp_path / 'run.mcap', ('/tf_static', 1, static(('base_link', 'a', still))))
    code, _, err = run(root, bag)
    assert code == 2
    assert 'has no topic with poses; it needs an Odometry, a PoseStamped, a Path' in one_line(err)


def test_mistakes_are_one_line(root, recordings, tmp_path, run):
    file = write_poses(tmp_path / 'r.txt', RESULT)
    tum = write_tum(tmp_path / 'r.tum', (f'{ns}e-9' for ns in stamps_of(FRAMES)), RESULT)
    alone = write_poses(tmp_path / '07.txt', TRUTH)
    far = write_poses(tmp_path / 'far.txt', RESULT[:2], [7000, 7001])
    (tmp_path / 'empty.txt').touch()
    for words, complaint in (
        ((tmp_path / 'absent.txt', file), 'absent.txt'),
        ((gt(root), tmp_path / 'absent.txt'), 'absent.txt: no such file or folder'),
        (
            (gt(root), tmp_path / 'empty.txt'),
            'empty.txt: is empty; expected a bag, or 12 numbers a line',
        ),
        ((tum, file), 'is a TUM file; as ground truth give a poses file'),
        ((alone, tum), 'has no time stamps'),
        ((alone, file, '--frame', 'velo_link'), 'neither the ground truth nor the result has'),
        ((gt(root), file, '--topic', '/odom'), '--topic is for a bag'),
        ((gt(root), file, '--gt-topic', '/gt'), '--gt-topic is for a bag'),
        ((gt(root), file, '--align', 'se2'), 'align'),
        ((gt(root), far), 'has 2 frames, 7000 to 7001; the ground truth has 400 frames, 0 to 399'),
        ((recordings[Layout.OBJECT], file), 'has no poses'),
        (
            (tmp_path / 'empty.txt', file),
            'empty.txt: is empty; expected a bag, or 12 numbers a line',
        ),
        ((gt(root), '/dev/null'), 'is no regular file; a result is a poses file'),
        ((gt(root), recordings[Layout.OBJECT]), 'is a folder without a bag; a result is a poses'),
        ((file, root), 'is a KITTI folder with poses; give GT first, then RESULT'),
        ((gt(root), file, '-o', tmp_path / 'a.jpg'), 'a plot ends in .png, .pdf or .svg'),
    ):
        code, out, err = run(*words)
        assert (code, out) == (2, ''), words
        assert complaint in one_line(err)


def test_a_wrong_line_of_the_ground_truth_is_a_loss(root, tmp_path, run):
    lines = gt(root).read_text().splitlines()
    lines[33] = 'nan' + lines[33]
    gt(root).write_text('\n'.join(lines))
    code, _, err = run(gt(root), write_poses(tmp_path / 'r.txt', RESULT))
    assert code == 1
    assert f'{gt(root)}:34: ' in err


@needs_matplotlib
@pytest.mark.parametrize('ending', ['png', 'pdf', 'svg'])
def test_the_plot_is_drawn(ending, root, tmp_path, run):
    numbers = np.setdiff1d(np.arange(FRAMES), range(50, 90))
    path = write_poses(tmp_path / 'r.txt', RESULT[numbers], numbers)
    out = tmp_path / f'07.{ending}'
    assert run(gt(root), path, '-o', out)[0] == 1
    assert out.stat().st_size > 5000
    code, _, err = run(gt(root), path, '-o', out)
    assert code == 2
    assert 'exists already' in err


@needs_matplotlib
def test_a_short_way_has_a_plot_which_overwrite_replaces(tmp_path, run):
    path, out = write_poses(tmp_path / '03.txt', drive(3)), tmp_path / 'a.svg'
    out.write_text('<?xml')
    assert run(path, path, '-o', out, '--overwrite')[0] == 0
    assert out.stat().st_size > 5000


def test_without_evo_the_error_says_how_to_install_it(root, monkeypatch, run):
    monkeypatch.setattr('kitti_ros2.evaluation.trajectories.find_spec', lambda _: None)
    code, _, err = run(gt(root), gt(root))
    assert code == 2
    assert "pip install 'kitti_ros2[eval]'" in err


def test_the_function_raises_what_the_command_prints(root, tmp_path):
    with pytest.raises(UsageError, match='unknown option'):
        evaluate_odometry(gt(root), gt(root), alignment='se3')
    with pytest.raises(KittiRos2Error, match=r'absent\.txt'):
        evaluate_odometry(gt(root), tmp_path / 'absent.txt')
