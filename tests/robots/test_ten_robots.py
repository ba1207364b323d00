# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Ten robots through the command line: the guessed plan, the set against the truth, the field."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import robot_bags as bags
import yaml
from camera_rigs import moved
from field_readers import (
    check_evo,
    check_kiss_icp,
    check_mmdet3d,
    check_openpcdet,
    check_pykitti,
    points_in_labels,
)
from ten_robots import ROBOTS
from written_sets import WrittenSet

from kitti_ros2.cli import main

LAYOUTS = ('object', 'odometry', 'raw', 'tracking')
PIXELS = 0.3
POSES_M = 1e-4
POINTS_M = 1e-4
PACKETS_M = 0.002
"""The resolution of a Velodyne's packets."""

SECTIONS = {
    'object': ('scan', 'cameras', 'labels'),
    'odometry': ('scan', 'cameras', 'pose'),
    'raw': ('scan', 'cameras', 'labels', 'pose'),
    'tracking': ('scan', 'cameras', 'labels', 'pose'),
}
"""What a plan is made of, by layout."""


@pytest.fixture(scope='module', params=ROBOTS, ids=lambda robot: robot.name)
def robot(request, tmp_path_factory):
    """A robot with its bags, its truth, and a place for sets."""
    made = request.param
    if made.name == 'foxglove':
        pytest.importorskip('mcap_protobuf')
        pytest.importorskip('foxglove_schemas_protobuf')
    folder = tmp_path_factory.mktemp(made.name)
    found = [str(path) for path in made.write(folder)]
    return SimpleNamespace(made=made, bags=found, truth=made.truth(), folder=folder, printed={})


@pytest.fixture
def write(robot, capsys):
    """Write a robot's set once, by `to-kitti BAG... OUT --layout LAYOUT`."""

    def run(layout):
        out = robot.folder / layout
        if layout not in robot.printed:
            capsys.readouterr()
            code = main(['to-kitti', *robot.bags, str(out), '--layout', layout])
            robot.printed[layout] = code, capsys.readouterr()
        return WrittenSet(out, layout)

    return run


@pytest.fixture(params=LAYOUTS)
def written(request, write):
    return write(request.param)


def value_at(plan, key):
    """The value of a dotted key, None where it is absent."""
    for word in key.split('.'):
        if not isinstance(plan, dict):
            return None
        plan = plan.get(int(word) if word.isdigit() else word)
    return plan


@pytest.mark.one_in(3)
@pytest.mark.parametrize('layout', LAYOUTS)
def test_the_guessed_plan(robot, layout, capsys):
    assert main(['to-kitti', *robot.bags, '--layout', layout, '--plan']) == 0
    text = capsys.readouterr().out
    plan = yaml.safe_load(text)
    sections = SECTIONS[layout]
    expected = {
        key: value for key, value in robot.made.plan.items() if key.split('.')[0] in sections
    }
    if layout == 'raw' and 'cameras.2.rectify' in expected:
        expected['cameras.2.rectify'] = False  # an extract has the images as they were taken
    assert {key: value_at(plan, key) for key in expected} == expected
    assert set(plan['cameras']) == set(robot.truth.eyes)
    for told in robot.made.told:
        assert told in text
    if layout == 'object':  # which has no poses: the advice is for other layouts
        assert text.count('poses: for the layouts odometry, raw and tracking') == text.count(
            'nav_msgs/Odometry'
        )


@pytest.mark.one_in(3)
def test_all_is_converted_and_what_is_dropped_is_told(robot, written):
    code, printed = robot.printed[written.layout]
    assert (code, printed.err) == (0, '')
    assert written.frames == len(robot.truth.moments)
    told = [line for line in printed.out.splitlines() if 'without a return were dropped' in line]
    assert told == ([robot.made.dropped] if robot.made.dropped else [])
    is_turned = robot.truth.turn_deg and written.layout == 'object'
    assert ('turn boxes by that angle' in printed.out) == bool(is_turned)


@cache
def nearest_of(points, expected):
    """(N,) the index of the expected point that is nearest to each."""
    points, expected = (np.frombuffer(each).reshape(-1, 3) for each in (points, expected))
    return np.array([np.square(expected - point).sum(axis=1).argmin() for point in points])


def order_of(truth, written, number):
    """(true points of the body, in the order of the written scan)."""
    moment = truth.moments[number]
    expected = moved(np.linalg.inv(truth.base_T_velo), moment.points)
    points = written.scan(number)[:, :3]
    assert points.shape == expected.shape
    if truth.ordered:
        assert np.abs(points - expected).max() < POINTS_M
        return moment.points
    nearest = nearest_of(points.tobytes(), expected.tobytes())
    assert len(set(nearest.tolist())) == len(points)
    assert np.abs(points - expected[nearest]).max() < PACKETS_M
    return moment.points[nearest]


def pixel_error(truth, written):
    """The worst distance of a point's pixel from the true one, over frames and cameras."""
    worst = 0.0
    for number in range(0, len(truth.moments), 3):
        points = order_of(truth, written, number)
        for index, eye in truth.eyes.items():
            true = eye.pixels(points)
            seen = np.isfinite(true[:, 0])
            assert seen.sum() > 20
            error = written.pixels(index, number)[seen] - true[seen]
            assert np.isfinite(error).all()
            worst = max(worst, float(np.linalg.norm(error, axis=1).max()))
    return worst


def test_points_lie_on_their_pixels(robot, written):
    error = pixel_error(robot.truth, written)
    print(f'{robot.made.name} {written.layout}: {error:.2g} px')
    assert error < PIXELS


def test_images_are_those_of_the_scans(robot, written):
    for index, eye in robot.truth.eyes.items():
        paths = written.images(index)
        assert len(paths) == len(robot.truth.moments)
        for number, path in enumerate(paths):
            image = cv2.imread(str(path))
            assert image.shape[1::-1] == eye.size
            pixel = image[eye.size[1] // 2, eye.size[0] // 2].astype(int)
            assert np.abs(pixel - robot.truth.grey(number)).max() <= 2


TILTED_M = 0.05
"""A tracklet turns about z of the scan alone: a box is that far off where the scanner leans by a
degree, as the field of small_rigs does."""


def test_boxes_hold_exactly_their_points(robot, written):
    if written.layout == 'odometry' or not robot.truth.labelled:
        pytest.skip('no labels')
    truth = robot.truth
    leans = written.layout == 'raw' and truth.base_T_velo[2, 2] < 0.9999
    margin = TILTED_M if leans else 0.0
    for number, moment in enumerate(truth.moments):
        points = order_of(truth, written, number)
        shown = [each for each in moment.solids if truth.eyes[2].sees(each)]
        labels = written.labels(number)
        assert sorted(label.name for label in labels) == sorted(each.name for each in shown)
        assert shown
        for solid in shown:
            most, least = solid.holds(points, margin), solid.holds(points, -margin)
            held = [label.points for label in labels if label.name == solid.name]
            assert least.sum() > 20
            assert any((least <= each).all() and (each <= most).all() for each in held)


def true_ways(truth):
    """(N, 4, 4) poses of camera 2, which is camera 0, from the first."""
    camera = truth.eyes[2].base_T_camera
    poses = np.array([moment.world_T_body @ camera for moment in truth.moments])
    return np.linalg.inv(poses[0]) @ poses


def pose_error(truth, found):
    return float(np.abs(found[:, :3] - true_ways(truth)[:, :3]).max())


def test_poses_are_true(robot, written):
    if written.layout == 'object':
        pytest.skip('an object set has no poses')
    if written.layout == 'odometry':
        found = np.loadtxt(written.root / 'poses/00.txt', ndmin=2).reshape(-1, 3, 4)
    else:
        found = oxts_ways(written)
    error = pose_error(robot.truth, found)
    print(f'{robot.made.name} {written.layout}: {error:.2g} m')
    assert error < POSES_M


def oxts_ways(written):
    """Poses of camera 0, as pykitti makes them of oxts; from the first."""
    utils = pytest.importorskip('pykitti.utils', reason='pykitti is not installed')
    if written.layout == 'raw':
        raw = pytest.importorskip('pykitti').raw
        date, kind = written.drive.parent.name, written.drive.name.rpartition('_')[2]
        loaded = raw(str(written.root), date, '0001', dataset=kind)
        unit_t_camera = np.linalg.inv(loaded.calib.T_cam0_imu)
        poses = np.array([packet.T_w_imu for packet in loaded.oxts])
    else:
        from written_sets import rigid, values_of  # noqa: PLC0415

        rows = values_of(written.root / 'training/calib/0000.txt')
        tr = rows['Tr_imu_velo'].reshape(3, 4)
        velo_t_unit = rigid(tr[:, :3], tr[:, 3])
        unit_t_camera = np.linalg.inv(written.calibration(0)[1] @ velo_t_unit)
        lines = (written.root / 'training/oxts/0000.txt').read_text().splitlines()
        poses = []
        for line in lines:
            packet = utils.OxtsPacket(*(float(word) for word in line.split()))
            scale = np.cos(np.radians(float(lines[0].split()[0])))
            poses.append(rigid(*utils.pose_from_oxts_packet(packet, scale)))
    poses = np.array(poses) @ unit_t_camera
    return np.linalg.inv(poses[0]) @ poses


def test_programs_open_the_sequence(robot, write):
    """Whichever of kiss-icp, evo and pykitti are installed; the sequence is right to all."""
    root, truth = write('odometry').root, robot.truth
    true = true_ways(truth)
    kiss = pytest.importorskip('kiss_icp.datasets.kitti', reason='kiss-icp is not installed')
    loaded = kiss.KITTIOdometryDataset(root, '00')
    assert len(loaded) == len(truth.moments)
    velo_t_camera = np.linalg.inv(truth.base_T_velo) @ truth.eyes[2].base_T_camera
    expected = velo_t_camera @ true @ np.linalg.inv(velo_t_camera)
    assert np.abs(loaded.gt_poses - expected).max() < POSES_M
    assert len(loaded[0][0]) == len(truth.moments[0].points)
    evo = pytest.importorskip('evo.tools.file_interface', reason='evo is not installed')
    path = evo.read_kitti_poses_file(str(root / 'poses/00.txt'))
    assert path.check()[0]
    assert np.abs(np.array(path.poses_se3) - true).max() < POSES_M
    pykitti = pytest.importorskip('pykitti', reason='pykitti is not installed')
    opened = pykitti.odometry(str(root), '00')
    assert np.abs(np.array(opened.poses) - true).max() < POSES_M
    assert len(list(opened.cam2)) == len(list(opened.velo)) == len(truth.moments)
    np.testing.assert_allclose(opened.calib.K_cam2, truth.eyes[2].k)
    assert np.abs(np.linalg.inv(opened.calib.T_cam2_velo) - velo_t_camera).max() < POSES_M


def test_the_field_accepts_the_set(robot, written):
    truth, root = robot.truth, written.root
    if written.layout == 'odometry':
        assert check_kiss_icp(root) == []
        assert check_evo(root / 'poses/00.txt') == []
    if written.layout != 'object':
        assert check_pykitti(root) == []
    elif truth.labelled:
        limit = {'axes_degrees': truth.turn_deg} if truth.turn_deg else {}
        assert check_mmdet3d(root, **limit) == []
        assert check_openpcdet(root, **limit) == []
    else:  # training needs labels
        assert not (root / 'training/label_2').exists()


SPOILT = 3
"""The number of the scan whose message is damaged."""


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'made', [each for each in ROBOTS if each.by_values], ids=lambda each: each.name
)
def test_a_damaged_scan_is_told_and_costs_itself_alone(made, tmp_path, monkeypatch, capsys):
    topic, truth, write = made.plan['scan.topic'], made.truth(), bags.write

    def spoil(path, said, *container):
        scans = sorted(each.log_ns for each in said if each.topic == topic)
        place = {each: n for n, each in enumerate(scans)}
        return write(
            path,
            [
                each._replace(values=damaged(each.values))
                if each.topic == topic and place[each.log_ns] == SPOILT
                else each
                for each in said
            ],
            *container,
        )

    monkeypatch.setattr(bags, 'write', spoil)
    found = [str(path) for path in made.write(tmp_path)]
    assert main(['to-kitti', *found, str(tmp_path / 'out'), '--layout', 'odometry']) == 1
    assert f'skipped {topic} (1): {topic} at ' in capsys.readouterr().err
    written = WrittenSet(tmp_path / 'out', 'odometry')
    assert written.frames == len(truth.moments) - 1
    kept = [moment for number, moment in enumerate(truth.moments) if number != SPOILT]
    assert len(order_of(replace(truth, moments=tuple(kept)), written, SPOILT)) > 0


def damaged(values):
    """The values of a message with too few bytes, or packets of zeros."""
    if 'packets' in values:
        packets = [{**each, 'data': np.zeros(1206, np.uint8)} for each in values['packets']]
        return {**values, 'packets': packets}
    return {**values, 'data': values['data'][:100]}


KEPT = 0.9
"""Of the points of a box, by programs that turn it by the few degrees between scan and camera."""


@pytest.mark.parametrize('forward', ['', 'base_link'])
def test_loaders_count_the_points_of_each_box(robot, write, forward, tmp_path, capsys):
    """As OpenPCDet and mmdetection3d move boxes into the scan, by its x alone.

    The scans of a robot that is turned are right with scan.forward, as the note says.
    """
    truth = robot.truth
    if not truth.labelled or bool(forward) != bool(truth.turn_deg):
        pytest.skip('no labels, or not turned')
    out = tmp_path / 'turned' if forward else write('object').root
    if forward:
        file = tmp_path / 'plan.yaml'
        words = ['to-kitti', *robot.bags]
        capsys.readouterr()
        assert main([*words, '--layout', 'object', '--plan']) == 0
        plan = yaml.safe_load(capsys.readouterr().out)
        plan['scan']['forward'] = forward
        file.write_text(yaml.safe_dump(plan))
        assert main([*words, str(out), '--plan-file', str(file)]) == 0
    counts = points_in_labels(out)
    for number, moment in enumerate(truth.moments):
        shown = [solid for solid in moment.solids if truth.eyes[2].sees(solid)]
        seen = np.isfinite(truth.eyes[2].pixels(moment.points)[:, 0])
        true = [int((each.holds(moment.points) & seen).sum()) for each in shown]
        found = counts[f'{number:06d}']
        assert len(found) == len(true)
        assert (np.array(sorted(found)) >= KEPT * np.array(sorted(true))).all()
