# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parameter files hold the drive's extrinsics as each stack reads them; launch files load."""

from __future__ import annotations

import json
import os
import shlex
import sys
from types import ModuleType

import numpy as np
import pytest
import yaml

from kitti_ros2.api.setup_files import commands_of, write_setup
from kitti_ros2.cli.app import find_command
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import BASE_T_IMU
from kitti_ros2.options.stack_catalogue import STACKS
from kitti_ros2.options.table import make_settings
from kitti_ros2.synthetic.drive import extract_of

from extract_drive import fast_drive  # isort: skip

PLACES = np.array([[10.0, -3.0, 0.5], [-4.0, 7.0, -1.5]])
"""Points in the frame of the scanner."""


@pytest.fixture(scope='module')
def written(recordings, tmp_path_factory):
    """The folder with the files of each stack, by its name."""
    drive = recordings[Layout.RAW]
    folders = {}
    for name, stack in STACKS.items():
        folders[name] = tmp_path_factory.mktemp(name)
        options = {'settings': make_settings({}), 'source': {}, 'overwrite': False}
        setup = write_setup(stack, drive, folders[name], **options)
        assert {path.name for path in setup.files} == {
            path.name for path in folders[name].iterdir()
        }
    return folders


@pytest.fixture(scope='module')
def imu_places(recordings):
    """The points in the frame of the Imu, by the numbers of calib_imu_to_velo.txt."""
    lines = (recordings[Layout.RAW].parent / 'calib_imu_to_velo.txt').read_text('utf-8')
    values = dict(line.split(':', 1) for line in lines.splitlines() if ':' in line)
    rotation = np.array(values['R'].split(), float).reshape(3, 3)
    offset = np.array(values['T'].split(), float)
    # p_velo = R p_imu + T, as the devkit says.
    return np.linalg.solve(rotation, (PLACES - offset).T).T


def parameters_of(folder, name):
    (values,) = yaml.safe_load((folder / f'{name}.yaml').read_text('utf-8')).values()
    return values['ros__parameters']


def matrix(values):
    return np.array(values).reshape(3, 3)


def test_fast_lio_maps_points_of_the_scanner_to_the_imu(written, imu_places):
    mapping = parameters_of(written['fast-lio2'], 'fast-lio2')['mapping']
    rotation, offset = matrix(mapping['extrinsic_R']), np.array(mapping['extrinsic_T'])
    np.testing.assert_allclose(PLACES @ rotation.T + offset, imu_places, atol=1e-6)


def test_lio_sam_turns_the_imu_to_the_scanner(written, imu_places):
    values = parameters_of(written['lio-sam'], 'lio-sam')
    rotation, offset = matrix(values['extrinsicRot']), np.array(values['extrinsicTrans'])
    np.testing.assert_allclose(imu_places @ rotation.T + offset, PLACES, atol=1e-6)
    # Its orientation of the scanner is that of the Imu times extrinsicRPY.
    world_r_imu = rotation_from_rpy(0.1, -0.2, 2.0)
    world_r_velo = world_r_imu @ matrix(values['extrinsicRPY'])
    in_velo, in_imu = PLACES[0] - PLACES[1], imu_places[0] - imu_places[1]
    np.testing.assert_allclose(world_r_velo @ in_velo, world_r_imu @ in_imu, atol=1e-6)


def test_dlio_maps_both_sensors_to_base_link(written, imu_places):
    values = parameters_of(written['dlio'], 'dlio')
    found = [
        places @ matrix(values[f'extrinsics/baselink2{sensor}/R']).T
        + np.array(values[f'extrinsics/baselink2{sensor}/t'])
        for sensor, places in (('imu', imu_places), ('lidar', PLACES))
    ]
    np.testing.assert_allclose(*found, atol=1e-6)
    np.testing.assert_allclose(found[0], imu_places + BASE_T_IMU, atol=1e-6)


def test_glim_maps_the_imu_to_the_scanner(written, imu_places):
    text = (written['glim'] / 'config_sensors.json').read_text('utf-8')
    values = json.loads(text)['sensors']['T_lidar_imu']
    lidar_t_imu = Transform.from_quaternion(values[3:], values[:3])
    np.testing.assert_allclose(lidar_t_imu.apply(imu_places), PLACES, atol=1e-6)


def test_rko_lio_maps_both_sensors_to_base_link(written, imu_places):
    values = yaml.safe_load((written['rko_lio'] / 'rko_lio.yaml').read_text('utf-8'))
    found = []
    for sensor, places in (('imu', imu_places), ('lidar', PLACES)):
        numbers = values[f'extrinsic_{sensor}2base_quat_xyzw_xyz']
        found.append(Transform.from_quaternion(numbers[:4], numbers[4:]).apply(places))
    np.testing.assert_allclose(*found, atol=1e-6)
    np.testing.assert_allclose(found[0], imu_places + BASE_T_IMU, atol=1e-6)


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.ODOMETRY])
def test_genz_icp_deskews_scans_with_times_only(layout, recordings, tmp_path):
    options = {'settings': make_settings({}), 'source': {}, 'overwrite': False}
    write_setup(STACKS['genz-icp'], recordings[layout], tmp_path, **options)
    assert parameters_of(tmp_path, 'genz-icp')['deskew'] is (layout is Layout.RAW)


def test_orb_slam3_has_the_rectified_grey_pair(written, recordings):
    text = (written['orb-slam3'] / 'orb-slam3.yaml').read_text('utf-8')
    assert text.startswith('%YAML:1.0\n---\n')
    values = yaml.safe_load(text.partition('---\n')[2])
    lines = (recordings[Layout.RAW].parent / 'calib_cam_to_cam.txt').read_text('utf-8')
    found = dict(line.split(':', 1) for line in lines.splitlines() if ':' in line)
    left, right = (np.array(found[f'P_rect_0{i}'].split(), float) for i in (0, 1))
    assert values['Camera1.fx'] == pytest.approx(left[0])
    assert values['Camera1.cx'] == pytest.approx(left[2])
    assert values['Stereo.b'] * right[0] == pytest.approx(left[3] - right[3])
    width, height = map(float, found['S_rect_00'].split())
    assert (values['Camera.width'], values['Camera.height']) == (width, height)


def test_the_scanner_is_an_hdl_64(written, recordings):
    assert parameters_of(written['lio-sam'], 'lio-sam')['N_SCAN'] == 64
    assert parameters_of(written['fast-lio2'], 'fast-lio2')['preprocess']['scan_line'] == 64
    nvblox = parameters_of(written['nvblox'], 'nvblox')
    lowest = -nvblox['min_angle_below_zero_elevation_rad']
    highest = nvblox['max_angle_above_zero_elevation_rad']
    assert lowest < np.deg2rad(-24.8) < np.deg2rad(2.0) < highest
    for path in (recordings[Layout.RAW] / 'velodyne_points' / 'data').glob('*.bin'):
        x, y, z, _ = np.fromfile(path, '<f4').reshape(-1, 4).T
        up = np.arctan2(z, np.hypot(x, y))
        assert lowest < up.min() <= up.max() < highest


class Called:
    """Any call of a launch file: arguments, with the name of what was called."""

    def __init__(self, name, values, words):
        self.name, self.values, self.words = name, values, words


def stand_in(module):
    made = ModuleType(module)
    made.__getattr__ = lambda name: lambda *values, **words: Called(name, values, words)
    return made


MODULES = (
    'launch', 'launch.actions', 'launch.event_handlers', 'launch.launch_description_sources',
    'launch.substitutions', 'launch_ros', 'launch_ros.actions', 'launch_ros.descriptions',
    'launch_ros.substitutions',
)  # fmt: skip


@pytest.mark.parametrize('name', STACKS)
def test_a_launch_file_starts_the_stack_and_plays_the_drive(name, written, recordings, monkeypatch):
    for module in MODULES:
        monkeypatch.setitem(sys.modules, module, stand_in(module))
    path = written[name] / f'{name}.launch.py'
    values = {'__file__': str(path)}
    exec(compile(path.read_text('utf-8'), path, 'exec'), values)
    (actions,) = values['generate_launch_description']().values
    player = next(each for each in actions if each.name == 'ExecuteProcess')
    drive = str(recordings[Layout.RAW])
    assert player.words['cmd'][:5] == ['kitti-ros2', 'play', drive, '--for', name]
    files = [
        value
        for each in actions
        for value in each.words.get('parameters', ())
        if isinstance(value, str)
    ]
    own = {str(each) for each in written[name].glob('*.yaml')}
    assert set(files) <= own
    started = [each for each in actions if each.name in {'Node', 'ComposableNodeContainer'}]
    included = [each for each in actions if each.name == 'IncludeLaunchDescription']
    assert len(started) + len(included) == len(STACKS[name].launch)


def test_launch_files_load_in_ros(written):
    launch = pytest.importorskip('launch.actions')
    pytest.importorskip('launch_ros.actions')
    for name, folder in written.items():
        path = folder / f'{name}.launch.py'
        values = {'__file__': str(path)}
        exec(path.read_text('utf-8'), values)
        found = values['generate_launch_description']().entities
        assert any(isinstance(each, launch.ExecuteProcess) for each in found)


@pytest.mark.parametrize('name', STACKS)
def test_our_commands_of_a_run_are_valid(name):
    commands = commands_of(STACKS[name], 'a drive', {'sequence': '00', 'imu_from': 'an extract'})
    for line in (commands.run, commands.score):
        if not line:
            continue
        words = shlex.split(line)[1:]
        found, command = find_command(words)
        context = command.make_context(found, words[len(found.split()) :])
        assert context.params['sequence'] == '00'
    if STACKS[name].result.topics:
        assert commands.record.endswith(' /tf /tf_static')
        assert commands.record.startswith(f'ros2 bag record -o {name}_run --use-sim-time /')


def test_existing_files_are_kept(recordings, tmp_path):
    options = {'settings': make_settings({}), 'source': {}}
    drive, stack = recordings[Layout.RAW], STACKS['glim']
    (tmp_path / 'config.json').write_text('{}', 'utf-8')
    write_setup(stack, drive, tmp_path, **options, overwrite=False)
    with pytest.raises(KittiRos2Error, match='pass --overwrite'):
        write_setup(stack, drive, tmp_path, **options, overwrite=False)
    write_setup(stack, drive, tmp_path, **options, overwrite=True)
    assert len([*tmp_path.iterdir()]) == 4
    (tmp_path / 'glim.launch.py').write_text('# mine\n', 'utf-8')
    (tmp_path / 'config_ros.json').unlink()
    with pytest.raises(KittiRos2Error, match=r'glim\.launch\.py'):
        write_setup(stack, drive, tmp_path, **options, overwrite=True)
    assert not (tmp_path / 'config_ros.json').exists()


def test_other_layouts_have_what_their_calibration_holds(recordings, tmp_path):
    options = {'settings': make_settings({}), 'source': {}, 'overwrite': False}
    setup = write_setup(STACKS['orb-slam3'], recordings[Layout.ODOMETRY], tmp_path, **options)
    text = (tmp_path / 'orb-slam3.yaml').read_text('utf-8')
    assert 'Camera.width: 0' not in text
    assert any('velo_T_imu is nominal' in each for each in setup.notes)


def test_the_imu_is_that_of_the_packets_that_are_played(tmp_path_factory, tmp_path):
    drive = fast_drive(tmp_path_factory)
    extract = os.path.relpath(extract_of(drive))
    source = {'imu_from': extract}
    with_packets, without = (
        write_setup(
            STACKS['lio-sam'], drive, tmp_path / name, make_settings(given), given, overwrite=False
        )
        for name, given in (('with', source), ('without', {}))
    )
    launch = (tmp_path / 'with/lio-sam.launch.py').read_text('utf-8')
    assert f"'--imu-from', '{extract_of(drive).resolve()}'" in ' '.join(launch.split())
    assert not any('needs /imu/data' in note for note in with_packets.notes)
    (note,) = (note for note in without.notes if 'needs' in note)
    assert note.startswith('lio-sam needs /imu/data at 100 Hz, it has 10 Hz')
    assert '--imu-from' not in with_packets.commands.score


def test_a_recording_without_packets_is_not_said_to_have_slow_ones(recordings, tmp_path):
    options = {'settings': make_settings({}), 'source': {}, 'overwrite': False}
    setup = write_setup(STACKS['lio-sam'], recordings[Layout.ODOMETRY], tmp_path, **options)
    assert not any('Hz' in each for each in setup.notes)
    assert 'lio-sam reads /imu/data: 00 has no packets of the GPS/IMU unit' in setup.notes
