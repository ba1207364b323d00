# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Plans and bags that cannot be meant: one line, an exit code, nothing half-written."""

from __future__ import annotations

import time
from pathlib import Path

import detector_robot
import numpy as np
import pytest
import robot_bags as bags
import velodyne_unit
import yaml

from kitti_ros2.cli import main

PLAN = {
    'layout': 'object',
    'name': 'training',
    'reference': 'scan',
    'tolerance_s': 0.05,
    'scan': {'topic': '/points', 'frame': 'lidar'},
    'cameras': {2: {'topic': '/camera/image', 'info': '/camera/camera_info'}},
    'labels': {'topic': '/boxes', 'boxes_2d': '/boxes_2d'},
}
TF_MESSAGE = 'tf2_msgs/msg/TFMessage'


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    said = detector_robot.said({'solid', 'flat'})
    return bags.write(tmp_path_factory.mktemp('bag') / 'drive', said)


def convert(bag, out, *options):
    return main(['to-kitti', str(bag), str(out), *map(str, options)])


def changed(tmp_path, *keys, value):
    """The file of the plan with another value."""
    plan = yaml.safe_load(yaml.safe_dump(PLAN))
    part = plan
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    path = tmp_path / 'plan.yaml'
    path.write_text(yaml.safe_dump(plan))
    return path


def refusal(bag, tmp_path, capfd, path):
    """The only line of a conversion that is refused and leaves nothing behind."""
    out = tmp_path / 'made' / 'set'
    assert convert(bag, out, '--plan-file', path) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert 'internal error' not in line
    assert not out.parent.exists()
    return line


@pytest.mark.parametrize(
    ('keys', 'value', 'said'),
    [
        (('scan', 'offset_s'), 1e10, 'scan: offset_s: 10000000000.0; expected seconds from -4'),
        (('scan', 'offset_s'), 10**29, 'scan: offset_s: 1e+29; expected seconds'),
        (('scan', 'offset_s'), 10**400, 'scan: offset_s: inf; expected a finite number'),
        (('cameras', 2, 'offset_s'), -1e300, 'cameras: 2: offset_s: -1e+300; expected seconds'),
        (('labels', 'offset_s'), 9.2e9, 'labels: offset_s: 9200000000.0; expected seconds'),
        (('imu_offset_s',), 1e10, 'imu_offset_s: 10000000000.0; expected seconds'),
        (('tolerance_s',), -1, 'tolerance_s: -1.0; expected seconds from 0'),
        (('tolerance_s',), 1e300, 'tolerance_s: 1e+300; expected seconds from 0'),
        (('scan', 'intensity_scale'), 0.0, 'intensity_scale: 0.0; expected more than 0'),
        (('scan', 'intensity_scale'), -1.0, 'intensity_scale: -1.0; expected more than 0'),
        (('scan', 'minimum_range_m'), -1.0, 'minimum_range_m: -1.0; expected 0 or more'),
        (('cameras',), {True: PLAN['cameras'][2]}, 'cameras: expected KITTI camera numbers'),
        (('labels', 'camera'), 3, 'no calibration; expected 2'),
        (('reference',), 'pose', 'it must be one of image_2, scan, labels'),
        (('imu',), '/points', 'imu: /points is of type sensor_msgs/msg/PointCloud2; expected'),
        (('fix',), '/points', 'fix: /points is of type'),
        (('velocity',), '/points', 'velocity: /points is of type'),
        (('labels', 'topic'), '/points', 'labels.topic: /points is of type'),
        (('cameras', 2, 'topic'), '/points', 'cameras.2.topic: /points is of type'),
        (('calibration',), '/none', "calibration: '/none': no such file or folder; expected tf"),
        (('calibration',), '', "calibration: '': no such file or folder; expected tf"),
        (('scan', 'topic'), '', 'the plan names an empty topic'),
    ],
)
def test_a_value_that_cannot_be_meant_is_refused_by_its_key(
    bag, tmp_path, capfd, keys, value, said
):
    path = changed(tmp_path, *keys, value=value)
    assert said in refusal(bag, tmp_path, capfd, path)


@pytest.mark.parametrize(
    ('keys', 'value'),
    [
        (('scan', 'topic'), '/none'),
        (('cameras', 2, 'topic'), '/none'),
        (('cameras', 2, 'info'), '/none'),
        (('labels', 'topic'), '/none'),
        (('labels', 'boxes_2d'), '/none'),
        (('labels',), {'topic': '/none'}),
        (('imu',), '/none'),
        (('fix',), '/none'),
        (('velocity',), '/none'),
    ],
)
def test_a_topic_that_is_not_in_the_bag_is_named(bag, tmp_path, capfd, keys, value):
    path = changed(tmp_path, *keys, value=value)
    assert 'the plan names /none, of which the bag has no' in refusal(bag, tmp_path, capfd, path)


def test_a_class_has_characters_that_can_be_printed(bag, tmp_path, capfd):
    labels = PLAN['labels'] | {'classes': {'Car': 'a\x00b'}, 'keep_classes': True}
    path = changed(tmp_path, 'labels', value=labels)
    assert 'labels: classes: Car' in refusal(bag, tmp_path, capfd, path)


def test_a_missing_calibration_of_a_scanner_is_not_blamed_on_the_output(tmp_path, capfd):
    packets, _ = velodyne_unit.encode(velodyne_unit.UNITS['VLP-16'], sequences=240)
    bag = velodyne_unit.write(tmp_path / 'packets', packets)
    plan = {key: PLAN[key] for key in ('layout', 'name', 'reference', 'tolerance_s')}
    scan = {'topic': '/velodyne_packets', 'frame': 'velodyne', 'calibration': '/none.yaml'}
    path = tmp_path / 'plan.yaml'
    path.write_text(yaml.safe_dump(plan | {'scan': scan, 'calibration': 'none'}))
    line = refusal(bag, tmp_path, capfd, path)
    assert 'scan.calibration: /none.yaml: no such file' in line


def test_2d_boxes_of_another_time_are_lost_aloud(tmp_path, capfd):
    said = detector_robot.said({'solid', 'flat'})
    for each in said:
        if each.topic == '/boxes_2d':
            each.values['header']['stamp']['sec'] += 1000
    bag = bags.write(tmp_path / 'drive', said)
    path = tmp_path / 'plan.yaml'
    path.write_text(yaml.safe_dump(PLAN))
    assert convert(bag, tmp_path / 'set', '--plan-file', path) == 1
    assert 'skipped /boxes_2d (4): /boxes_2d: no message within 50 ms' in capfd.readouterr().err


def test_impossible_2d_boxes_are_losses_of_their_own_topic(tmp_path, capfd):
    said = detector_robot.said({'solid', 'flat'})
    for each in said:
        if each.topic == '/boxes_2d':
            each.values['detections'][0]['bbox']['size_x'] = float('nan')
    bag = bags.write(tmp_path / 'drive', said)
    assert convert(bag, tmp_path / 'set', '--layout', 'object') == 1
    error = capfd.readouterr().err
    assert 'skipped /boxes_2d (4)' in error
    assert 'skipped /boxes (' not in error


def test_log_times_beyond_the_year_2262_do_not_matter_beside_header_stamps(tmp_path, capfd):
    said = detector_robot.said({'solid'})
    late = [each._replace(log_ns=2**63 + number) for number, each in enumerate(said)]
    bag = bags.write(tmp_path / 'drive', late)
    assert convert(bag, tmp_path / 'set', '--layout', 'object') == 0
    assert not capfd.readouterr().err
    assert len(list((tmp_path / 'set').rglob('*.bin'))) == detector_robot.FRAMES


@pytest.mark.parametrize('chained', [True, False])
def test_thousands_of_transforms_take_seconds(tmp_path, chained):
    near = np.eye(4)
    links = [
        bags.transform(f'f{n}' if chained else 'lidar', f'f{n + 1}', near) for n in range(2000)
    ]
    links += [bags.transform('f2000', 'lidar', near)] if chained else []
    start_ns = detector_robot.START_NS - 2
    said = [bags.Said(bags.TF_STATIC, start_ns, TF_MESSAGE, {'transforms': links})]
    bag = bags.write(Path(tmp_path / 'drive'), [*said, *detector_robot.said({'solid'})])
    started = time.process_time()
    assert convert(bag, tmp_path / 'set', '--layout', 'object') == 0
    assert time.process_time() - started < 15


def repeated(levels):
    """A text whose last alias is 9 to the power of levels values."""
    return 'x0: &x0 [a, a, a, a, a, a, a, a, a]\n' + ''.join(
        f'x{n}: &x{n} [{", ".join([f"*x{n - 1}"] * 9)}]\n' for n in range(1, levels)
    )


BOMB = repeated(9)
MUCH = repeated(4)


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('tolerance_s: ' + '9' * 5000, 'is not valid YAML'),
        ('name: 2023-99-99', 'is not valid YAML'),
        ('[' * 20000, 'is not valid YAML'),
        (f'{BOMB}layout: *x8', 'its aliases repeat too much'),
        (f'{MUCH}layout: *x3', 'layout: '),
        (f'{MUCH}layout: object\ncameras: *x3', 'cameras: expected'),
        (f'{MUCH}layout: object\nlabels: {{topic: a, classes: *x3}}', 'labels: classes: '),
        (f'{MUCH}layout: object\nscan: {{topic: a, frame: a, offset_s: *x3}}', 'scan: offset_s: '),
        (f'{MUCH}layout: object\nstamps: *x3', 'stamps: '),
    ],
    ids=['digits', 'date', 'deep', 'bomb', 'layout', 'cameras', 'classes', 'offset_s', 'stamps'],
)
def test_a_plan_that_is_no_yaml_or_repeats_itself_is_refused_in_a_line(
    bag, tmp_path, capfd, text, said
):
    path = tmp_path / 'plan.yaml'
    path.write_text(text)
    line = refusal(bag, tmp_path, capfd, path)
    assert said in line
    assert len(line) < 4000
