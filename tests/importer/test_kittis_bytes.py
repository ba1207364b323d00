# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which files of KITTI come back from bags of others, byte for byte: the table of docs/howto."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from folder_and_bag import rerecord

from kitti_ros2.cli import main
from kitti_ros2.files.image_files import decode_png, encode_depth_map, parse_png
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.set_builder import make_depth_map
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.calib_file import parse_raw_calibration
from kitti_ros2.kitti.scan_grid import on_grid
from kitti_ros2.messages.camera_info import decode_static
from kitti_ros2.messages.cdr import deserialize, join, serialize
from kitti_ros2.messages.clouds import read_points
from kitti_ros2.messages.ros_types import PointField
from kitti_ros2.model.bag_formats import CLOUD
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.samples import rect_from_velo
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

from builders import files_of  # isort: skip

KITTI2BAG = ['--images', 'raw', '--preset', 'kitti2bag', '--exclude-topics', '/kitti/source/*']
SNAPPED = "5 of 5 scans are within 0.02 mm of a grid of 1 mm, as KITTI's are exactly"
base_T_velo = Transform(rotation_from_rpy(0.02, -0.03, 2.1), np.array([1.3, -0.2, 1.7]))


def round_scans(root):
    """Scans of the folder become KITTI's: 1 mm and 0.01."""
    for path in root.rglob('*.bin'):
        points = np.fromfile(path, '<f4').reshape(-1, 4)
        points[:, :3] = on_grid(points[:, :3])
        points[:, 3] = np.rint(points[:, 3].astype(np.float64) * 100) / 100
        points.tofile(path)


@pytest.fixture(scope='module')
def drive(recordings, tmp_path_factory):
    source = recordings[Layout.RAW]
    root = tmp_path_factory.mktemp('drive') / 'kitti'
    shutil.copytree(source.parent, root / source.parent.name)
    round_scans(root)
    return root / source.parent.name / source.name


@pytest.fixture(scope='module')
def bag(drive, tmp_path_factory):
    """As kitti2bag writes it: nothing of ours is in it."""
    path = tmp_path_factory.mktemp('bag') / 'bag.mcap'
    assert main(['to-bag', str(drive), str(path), '-q', *KITTI2BAG]) == 0
    return path


def kinds(root):
    """The files of a folder by kind: the name with numbers left out, and that of the drive."""
    sets = {}
    for name, data in files_of(root).items():
        file = re.sub(r'.*_sync/|^[\d_]+/', '', name)
        kind = re.sub(r'\d{10}', 'N', re.sub(r'image_0\d', 'image_0C', file))
        sets.setdefault(kind, {})[file] = data
    return sets


def same_kinds(made, true):
    return {kind for kind, files in kinds(true).items() if kinds(made).get(kind) == files}


def noisy(points):
    """A codec with an error of 0.01 mm, and of 0.0005 in reflectance."""
    noise = np.random.default_rng(1).uniform(-1, 1, points.shape) * [1e-5, 1e-5, 1e-5, 5e-4]
    return (points + noise).astype(np.float32)


def turned_back(points):
    """To another frame and back, in float32, as transformPointCloud of PCL does it."""
    there = base_T_velo.apply(points[:, :3].astype(np.float64)).astype(np.float32)
    back = base_T_velo.inverse().apply(there.astype(np.float64))
    return np.column_stack([back, points[:, 3]]).astype(np.float32)


def of_another_scanner(points):
    noise = np.random.default_rng(2).uniform(-4e-4, 4e-4, points.shape)
    return (points + noise * [1, 1, 1, 0]).astype(np.float32)


def through(change, columns=np.float32):
    """A change of messages: clouds pass a function, others stay."""

    def changed(message):
        if message.msgtype != CLOUD:
            return bytes(message.data)
        cloud = deserialize(bytes(message.data), CLOUD)
        points = change(read_points(cloud, None)).astype(columns)
        return join(serialize(with_points(cloud, points)))

    return changed


def with_points(cloud, points):
    """The cloud with other points, of float32 or float64."""
    kind = PointField.FLOAT64 if points.itemsize == 8 else PointField.FLOAT32
    fields = [
        replace(field, offset=column * points.itemsize, datatype=kind)
        for column, field in enumerate(cloud.fields)
    ]
    step = 4 * points.itemsize
    data = np.ascontiguousarray(points).view(np.uint8).reshape(-1)
    return replace(cloud, fields=fields, point_step=step, row_step=step * len(points), data=data)


def scans_of(root):
    return {
        path.name: np.fromfile(path, '<f4').reshape(-1, 4)
        for path in root.rglob('velodyne_points/data/*.bin')
    }


SCANS, PNG, STAMPS = (
    'velodyne_points/data/N.bin',
    'image_0C/data/N.png',
    {'velodyne_points/timestamps.txt', 'image_0C/timestamps.txt', 'oxts/timestamps.txt'},
)
SYNTHETIC = {'calib_imu_to_velo.txt', 'oxts/dataformat.txt'}
"""Not of real drives: there R has no turn that a quaternion rounds, and the words are ours."""
TABLE = {
    'as it is': (None, {SCANS, PNG, *STAMPS}, ''),
    'float64': (through(lambda points: points, np.float64), {SCANS, PNG, *STAMPS}, ''),
    'codec': (through(noisy), {PNG, *STAMPS}, SNAPPED),
    'turned back': (through(turned_back), {PNG, *STAMPS}, SNAPPED),
    'another scanner': (through(of_another_scanner), {PNG, *STAMPS}, ''),
}
"""By kind of bag: what changes clouds, the kinds of files that come back, and what is said."""


@pytest.mark.parametrize('name', TABLE)
def test_what_comes_back_of_a_bag_of_kitti2bag(drive, bag, tmp_path, capsys, name):
    change, same, said = TABLE[name]
    path = bag if change is None else rerecord(bag, tmp_path / 'bag.mcap', 0, change)
    assert main(['to-kitti', str(path), str(tmp_path / 'out'), '--layout', 'raw']) == 0
    assert same_kinds(tmp_path / 'out', drive.parent.parent) == same | SYNTHETIC
    notes = capsys.readouterr().out
    assert said in notes
    assert ('--no-snap' in notes) is bool(said)
    true, made = scans_of(drive), scans_of(tmp_path / 'out')
    # A zero may have lost its sign.
    equal = [np.array_equal(made[file], true[file]) for file in true]
    assert equal == [name != 'another scanner'] * 5


def test_scans_stay_as_they_are_on_request(bag, tmp_path, capsys):
    rerecord(bag, tmp_path / 'bag.mcap', 0, through(noisy))
    words = ['to-kitti', str(tmp_path / 'bag.mcap'), str(tmp_path / 'out'), '--layout', 'raw']
    assert main([*words, '--no-snap']) == 0
    assert 'grid' not in capsys.readouterr().out
    points = np.concatenate([*scans_of(tmp_path / 'out').values()])
    assert (np.abs(points[:, :3] - on_grid(points[:, :3])) > 1e-6).any()


def test_scans_off_the_grid_are_counted(bag, tmp_path, capsys):
    seen = []

    def some(points):
        seen.append(len(points))
        return of_another_scanner(points) if len(seen) == 2 else noisy(points)

    rerecord(bag, tmp_path / 'bag.mcap', 0, through(some))
    words = ['to-kitti', str(tmp_path / 'bag.mcap'), str(tmp_path / 'out'), '--layout', 'raw']
    assert main(words) == 0
    notes = capsys.readouterr().out
    assert '4 of 5 scans are within 0.02 mm' in notes
    assert '1 scan off it stay' in notes


def test_clouds_of_another_frame_are_brought_to_the_scanner_in_float64(drive, bag, tmp_path):
    """Of the frame velo_link that the plan asks for: float32 of another frame is near enough."""
    velo_T_base = []

    def changed(message):
        if message.msgtype == 'tf2_msgs/msg/TFMessage' and message.topic == '/tf_static':
            links = decode_static(deserialize(bytes(message.data), message.msgtype))
            pose = {(parent, child): pose for parent, child, pose in links}
            velo_T_base[:] = [(pose['base_link', 'imu_link'] @ pose['imu_link', 'velo_link'])]
            return bytes(message.data)
        if message.msgtype != CLOUD:
            return bytes(message.data)
        cloud = deserialize(bytes(message.data), CLOUD)
        points = read_points(cloud, None).copy()
        points[:, :3] = velo_T_base[0].apply(points[:, :3].astype(np.float64))
        header = replace(cloud.header, frame_id='base_link')
        return join(serialize(replace(with_points(cloud, points), header=header)))

    path = rerecord(bag, tmp_path / 'bag.mcap', 0, changed)
    options = ImportOptions(layout=Layout.RAW)
    survey = survey_bags([path])
    plan = guess([path], survey, options).plan
    plan = replace(plan, scan=replace(plan.scan, frame='velo_link', forward=''))
    report = convert_by_plan([path], plan, survey, tmp_path / 'out', options)
    assert any(SNAPPED in note for note in report.notes)
    true, made = scans_of(drive), scans_of(tmp_path / 'out')
    assert all(np.array_equal(made[file], true[file]) for file in true)


def encoded(suffix):
    """A program that encodes the images of a bag anew, such as cv2.imencode without parameters."""

    def changed(message):
        if message.msgtype != 'sensor_msgs/msg/CompressedImage':
            return bytes(message.data)
        image = deserialize(bytes(message.data), message.msgtype)
        pixels = cv2.imdecode(image.data, cv2.IMREAD_UNCHANGED)
        return join(serialize(replace(image, data=cv2.imencode(suffix, pixels)[1].reshape(-1))))

    return changed


def coloured(message):
    """Grey images of three equal channels, as rgb8."""
    if message.msgtype != 'sensor_msgs/msg/Image' or 'gray' not in message.topic:
        return bytes(message.data)
    image = deserialize(bytes(message.data), message.msgtype)
    data = np.repeat(image.data, 3)
    return join(serialize(replace(image, encoding='rgb8', step=3 * image.width, data=data)))


IMAGES = {
    'encoded anew': ('compressed', encoded('.png'), True, '5 images encoded anew, from PNG'),
    'grey in three channels': ('raw', coloured, True, ''),
    'JPEG': ('compressed', encoded('.jpg'), False, '5 images decoded from JPEG'),
}
"""By kind of images: to-bag's, what another program does, whether PNG come back, what is said."""


@pytest.mark.parametrize('name', IMAGES)
def test_images_are_kittis_files_if_their_pixels_are(drive, tmp_path, capsys, name):
    images, change, same, said = IMAGES[name]
    bag, path, out = (tmp_path / file for file in ('bag.mcap', 'changed.mcap', 'out'))
    assert main(['to-bag', str(drive), str(bag), '-q', *KITTI2BAG, '--images', images]) == 0
    rerecord(bag, path, 0, change)
    capsys.readouterr()
    assert main(['to-kitti', str(path), str(out), '--layout', 'raw']) == 0
    assert (PNG in same_kinds(out, drive.parent.parent)) is same
    notes = capsys.readouterr().out
    assert said in notes
    assert ('5 images ' in notes) is bool(said)


COLUMNS = (*range(8), *range(11, 14), *range(17, 20), 23)
"""Of oxts that kitti2bag's messages have: lat to ve, ax to az, wx to wz, pos_accuracy."""


def test_packets_of_whole_messages_have_their_numbers(drive, bag, tmp_path):
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'raw', '-q']) == 0
    for path in sorted((drive / 'oxts/data').iterdir()):
        [made] = (tmp_path / 'out').rglob(f'oxts/data/{path.name}')
        true, words = path.read_text().split(), made.read_text().split()
        assert [words[at] for at in COLUMNS] == [true[at] for at in COLUMNS]


def test_objects_have_the_places_and_projections_of_kitti(recordings, tmp_path):
    """Of camera 0, of which an object set has no image."""
    source, path = recordings[Layout.OBJECT] / 'training', tmp_path / 'bag.mcap'
    assert main(['to-bag', str(source), str(path), '-q', *KITTI2BAG]) == 0
    assert main(['to-kitti', str(path), str(tmp_path / 'out'), '--layout', 'object', '-q']) == 0
    for file in sorted((source / 'label_2').iterdir()):
        made = (tmp_path / 'out/training/label_2' / file.name).read_text().splitlines()
        cared = [line for line in file.read_text().splitlines() if 'DontCare' not in line]
        assert [line.split()[8:] for line in made] == [line.split()[8:15] for line in cared]
        calibration = f'calib/{file.name}'
        true, own = (
            (folder / calibration).read_text().splitlines()
            for folder in (source, tmp_path / 'out/training')
        )
        assert own[:4] == true[:4], 'P0 to P3'


SHARED = Path(__file__).parents[3] / 'shared/kitti'


@pytest.mark.skipif(not (SHARED / 'more').is_dir(), reason='needs real KITTI files in ../shared')
@pytest.mark.parametrize('kind', ['groundtruth', 'velodyne_raw'])
def test_depth_maps_are_kittis_files_if_their_depths_are(kind):
    """Of the points that the pixels of a depth image in metres become, in float32."""
    [path] = SHARED.glob(f'more/depth/train/*/proj_depth/{kind}/image_02/*.png')
    png = path.read_bytes()
    levels = decode_png(parse_png(png, path))
    folder = SHARED / 'raw/2011_09_26'
    texts = {file.name: file.read_text() for file in folder.glob('calib_*.txt')}
    calibration = parse_raw_calibration(texts, folder, rectified=True)
    p_rect = calibration.cameras[2].p_rect
    row, column = np.nonzero(levels)
    depth = levels[row, column] / 256
    pixels = np.column_stack([column, row, np.ones(len(row))]) * depth[:, None]
    seen = np.linalg.solve(p_rect[:, :3], (pixels - p_rect[:, 3]).T).T
    points = rect_from_velo(calibration).inverse().apply(seen)
    points = np.column_stack([points, np.zeros(len(points))]).astype(np.float32)
    made = make_depth_map(points, calibration, 2, levels.shape[::-1])
    assert encode_depth_map(made) == png
