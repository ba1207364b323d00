# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds in each format, read here by structs that are written down from the stacks' sources."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitti_ros2.messages.cdr import deserialize, join, serialize
from kitti_ros2.messages.clouds import decode_cloud
from kitti_ros2.messages.scan import (
    COLUMNS,
    ESTIMATED_LASERS,
    PointValues,
    assign_cells,
    decode_scan,
    encode_scan,
    rings,
)
from kitti_ros2.model.bag_formats import EXTRA, FORMATS, VALUES, Points
from kitti_ros2.model.samples import Scan, Turn

STAMP = 1317042272283701593
LENGTH = 103_272_338
TURN = Turn(STAMP, LENGTH)

XYZ = [('x', 'f4'), ('y', 'f4'), ('z', 'f4')]
XYZIRC = [*XYZ, ('intensity', 'u1'), ('return_type', 'u1'), ('channel', 'u2')]
AEDT = [('azimuth', 'f4'), ('elevation', 'f4'), ('distance', 'f4'), ('time_stamp', 'u4')]
PACKED = {
    Points.XYZI: [*XYZ, ('intensity', 'f4')],
    Points.XYZIRT: [
        *XYZ, ('intensity', 'f4'), ('ring', 'u2'), ('time', 'f4'), ('file_index', 'u4'),
    ],
    Points.XYZIRC: XYZIRC,
    Points.XYZIRCAEDT: XYZIRC + AEDT,
}  # fmt: skip
"""Structs without padding: of a file, of the Velodyne driver, of Autoware."""
_ALIGNED = np.dtype(
    [
        *XYZ, ('', 'f4'), ('intensity', 'f4'), ('t', 'u4'), ('reflectivity', 'u2'),
        ('ring', 'u2'), ('ambient', 'u2'), ('range', 'u4'),
    ],
    align=True,
)  # fmt: skip
OUSTER = np.dtype({
    'names': [name for name in _ALIGNED.names if name != 'f3'],
    'formats': [kind for name, (kind, _) in _ALIGNED.fields.items() if name != 'f3'],
    'offsets': [offset for name, (_, offset) in _ALIGNED.fields.items() if name != 'f3'],
    'itemsize': 48,
})  # fmt: skip
"""A struct of PCL, EIGEN_ALIGN16; the fourth float of a position is not a field."""
TYPES = {name: np.dtype(fields) for name, fields in PACKED.items()} | {Points.OUSTER: OUSTER}
KINDS = {2: 'u1', 4: 'u2', 6: 'u4', 7: 'f4'}
"""By the numbers of PointField."""

ANY = st.sampled_from([0.0, -0.0, 1.0, -1.0]) | st.floats(width=32)
# Subnormal metres, below 1e-38, have too few bits for an angle.
FINITE = st.sampled_from([0.0, -0.0, 1.0, -1.0]) | st.floats(
    -200, 200, width=32, allow_subnormal=False
)
TURNS = st.none() | st.builds(Turn, st.just(STAMP), st.integers(1, 10**9))


def points_of(elements):
    shapes = st.integers(0, 40).map(lambda count: (count, 4))
    return arrays.arrays(np.float32, shapes, elements=elements)


def encode(scan, points, stamp_ns=STAMP, **more):
    """The message after a trip through CDR."""
    message = encode_scan(scan, stamp_ns, 'velo_link', points, **more)
    return deserialize(join(serialize(message)), message.__msgtype__)


def cells_of(message, points):
    """The (height, width) cells of a cloud, read as a stack would: by its struct."""
    return np.frombuffer(message.data.tobytes(), TYPES[points]).reshape(
        message.height, message.width
    )


def hundredths(points):
    """The same with reflectances of two digits, as in KITTI's files."""
    points = points.copy()
    points[:, 3] = (np.abs(np.nan_to_num(points[:, 3])) % 1).round(2)
    return points


def sorted_rows(points):
    return sorted(map(bytes, np.ascontiguousarray(points)))


@pytest.mark.parametrize('points', Points)
def test_fields_types_and_offsets_are_those_of_the_stacks_structs(points):
    message = encode(Scan(np.ones((3, 4), np.float32), turn=TURN), points)
    expected = TYPES[points]
    assert [field.name for field in message.fields] == [*expected.names]
    for field in message.fields:
        kind, offset = expected.fields[field.name][:2]
        assert (KINDS[field.datatype], field.offset, field.count) == (kind.str[1:], offset, 1)
    assert message.point_step == expected.itemsize == FORMATS[points].point_step
    assert not message.is_bigendian


def test_sizes_of_the_structs():
    sizes = [TYPES[points].itemsize for points in Points]
    assert sizes == [16, 26, 16, 32, 48]


def test_each_value_is_described_and_computed():
    used = {field.value for row in FORMATS.values() for field in row.fields_of(timed=True)}
    used |= {field.value for field in FORMATS[Points.XYZI].fields_of(timed=True, labelled=True)}
    assert used | {EXTRA} == VALUES.keys()
    values = PointValues(np.ones((2, 4), np.float32), TURN, STAMP, np.ones(2, np.uint32))
    assert all(np.shape(getattr(values, name)) in {(), (2,)} for name in used)


@pytest.mark.parametrize('points', Points)
@settings(max_examples=40)
@given(file=points_of(ANY), turn=TURNS)
def test_any_scan_is_encoded_and_read_back_up_to_the_loss_of_its_format(points, file, turn):
    message = encode(Scan(file, turn=turn), points)
    assert message.row_step == message.width * message.point_step
    assert len(message.data) == message.row_step * message.height
    assert message.is_dense == (bool(np.isfinite(file).all()) and points is not Points.OUSTER)
    found = decode_scan(message)
    if not FORMATS[points].loss:
        assert not found.difference
        assert found.points.tobytes() == file.tobytes()
        return
    assert found.difference == f'in clouds of {points.value}, {FORMATS[points].loss}'
    if points is Points.OUSTER:
        here = file[~np.isnan(file[:, :3]).any(axis=1)]
        assert sorted_rows(found.points) == sorted_rows(here)
    else:
        assert sorted_rows(found.points[:, :3]) == sorted_rows(file[:, :3])
        nearest = np.clip(np.nan_to_num(file[:, 3]), 0, 1)
        np.testing.assert_allclose(
            np.sort(found.points[:, 3]), np.sort(nearest), atol=0.5 / 255 + 0.005
        )


@given(file=points_of(FINITE), turn=TURNS)
def test_two_digits_of_reflectance_are_restored_from_eight_bits(file, turn):
    file = hundredths(file)
    message = encode(Scan(file, turn=turn), Points.XYZIRC)
    assert decode_scan(message).points.tobytes() == file.tobytes()
    cloud = encode(Scan(file, turn=turn), Points.XYZIRCAEDT)
    assert sorted_rows(decode_scan(cloud).points) == sorted_rows(file)


@settings(max_examples=30)
@given(file=points_of(FINITE), length=st.integers(1, 10**9))
def test_angles_channels_and_times_of_autoware(file, length):
    [cloud] = cells_of(
        encode(Scan(file, turn=Turn(STAMP, length)), Points.XYZIRCAEDT), Points.XYZIRCAEDT
    )
    assert (np.diff(cloud['time_stamp'].astype(np.int64)) >= 0).all()
    assert (cloud['return_type'] == 1).all()
    assert sorted(cloud['channel'].tolist()) == sorted(rings(file).tolist())
    for point in cloud:
        x, y, z = (float(point[name]) for name in 'xyz')
        azimuth = math.atan2(y, x)
        assert math.remainder(point['azimuth'] + azimuth, 2 * math.pi) == pytest.approx(0, abs=1e-5)
        assert 0 <= point['azimuth'] <= np.float32(2 * math.pi)
        assert point['elevation'] == pytest.approx(math.atan2(z, math.hypot(x, y)), abs=1e-5)
        assert point['distance'] == pytest.approx(math.hypot(x, y, z), rel=1e-5, abs=1e-9)
        since = (0.5 - azimuth / (2 * math.pi)) * length
        assert point['time_stamp'] == pytest.approx(since, abs=1 + length * 1e-7)


NEBULA = [
    # x, y, z, azimuth, sine of the elevation, distance
    (2.06693983, -2.46328282, 0.16852181, 0.87266463, 0.05233596, 3.22000003),
    (-1.96807086, -1.43672097, -0.21318294, 2.51100516, -0.08715574, 2.44600010),
    (-2.63965392, 2.94194245, 1.05908751, 3.98109603, 0.25881904, 4.09200001),
    (1.03933012, 0.97667915, 0.22589140, 5.52885389, 0.15643448, 1.44400012),
]
"""Points of a VLP-16, one a quadrant, as the driver of Autoware decodes them: tier4/nebula 606ac41,
src/nebula_velodyne/nebula_velodyne/test_resources/decoder_ground_truth/vlp16/
1673400472138016708.pcd."""


def test_angles_and_distances_are_those_that_autowares_driver_recorded():
    file = np.array([(*each[:3], 0.25) for each in NEBULA], np.float32)
    [cloud] = cells_of(encode(Scan(file), Points.XYZIRCAEDT), Points.XYZIRCAEDT)
    azimuth, sine, distance = np.array(NEBULA).T[3:]
    np.testing.assert_allclose(cloud['azimuth'], azimuth, atol=2e-6)
    np.testing.assert_allclose(np.sin(cloud['elevation'].astype(float)), sine, atol=1e-6)
    np.testing.assert_allclose(cloud['distance'], distance, rtol=1e-6)


SIDES = {'front': (3.0, 0.1), 'left': (-0.1, 3.0), 'rear': (-3.0, -0.1), 'right': (0.1, -3.0)}
"""Directions in the order of KITTI's file; the scanner turns the other way."""
TURNED = {'rear': 0.995, 'left': 0.245, 'front': 0.495, 'right': 0.745}
"""The part of the turn at which each is passed: 0.1 of 3 m is 0.0053 of a turn."""


def test_each_field_has_the_meaning_that_its_driver_gives_it():
    """By hand: three lasers, at 4, 0 and -4 m, so 5, 3 and 5 m away; a turn of 0.1 s."""
    heights = (4.0, 0.0, -4.0)  # of the highest laser first
    file = np.array([(x, y, z, 0.2) for z in heights for x, y in SIDES.values()], np.float32)
    scan = Scan(file, turn=Turn(STAMP, 100_000_000))
    velodyne, autoware, ouster = (
        cells_of(encode(scan, points), points)
        for points in (Points.XYZIRT, Points.XYZIRCAEDT, Points.OUSTER)
    )
    for side, (x, y) in SIDES.items():
        for laser, z in zip((2, 1, 0), heights, strict=True):
            one, other, third = (
                cells[
                    (cells['x'] == np.float32(x))
                    & (cells['y'] == np.float32(y))
                    & (cells['z'] == z)
                ]
                for cells in (velodyne, autoware, ouster)
            )
            seconds = TURNED[side] / 10
            assert one['time'] == pytest.approx([seconds], abs=1e-4)
            assert other['time_stamp'] == pytest.approx([seconds * 1e9], abs=1e5)
            assert third['t'] == pytest.approx([seconds * 1e9], abs=1e5)
            assert (one['ring'], other['channel'], third['ring']) == (laser, laser, 63 - laser)
            assert one['intensity'] == third['intensity'] == np.float32(0.2)
            assert other['intensity'] == third['reflectivity'] == 51
            metres = math.hypot(3.0016662, z)
            assert other['distance'] == pytest.approx([metres])
            assert third['range'] == pytest.approx([metres * 1000], abs=0.51)
            up = math.degrees(math.atan(z / 3.0016662))
            assert np.degrees(other['elevation']) == pytest.approx([up])
            clockwise = {'front': 358.09, 'left': 268.09, 'rear': 178.09, 'right': 88.09}[side]
            assert np.degrees(other['azimuth']) == pytest.approx([clockwise], abs=0.01)


def ring_filter_keeps(cloud):
    """The points that Autoware's filter of outliers keeps, (N,).

    The rule of autoware.universe 17799e5, outlier_kernels.cu:21-74, for whole walks (the kernel
    looks 4 points to either side): neighbours of a channel, in the order of the cloud, are joined
    if their distances differ by less than 3 % and the azimuth rises by less than a degree; points
    are kept with more than 4 in such a walk, or if its ends are 0.1 m apart.
    """
    kept = np.zeros(len(cloud), bool)
    for channel in np.unique(cloud['channel']):
        [ring] = np.nonzero(cloud['channel'] == channel)
        distance, azimuth = (cloud[name][ring].astype(float) for name in ('distance', 'azimuth'))
        near, far = np.sort([distance[:-1], distance[1:]], axis=0)
        joined = (far < near * 1.03) & (np.diff(azimuth) % (2 * np.pi) < np.pi / 180)
        for walk in np.split(ring, np.flatnonzero(~joined) + 1):
            ends = [[cloud[name][walk[at]] for name in 'xyz'] for at in (0, -1)]
            kept[walk] = len(walk) > 4 or math.dist(*ends) >= 0.1
    return kept


def test_autowares_ring_filter_keeps_a_street(real_kitti):
    path = real_kitti / 'raw/2011_09_26/2011_09_26_drive_0005_sync/velodyne_points/data'
    file = np.fromfile(path / '0000000000.bin', '<f4').reshape(-1, 4)
    [cloud] = cells_of(encode(Scan(file, turn=TURN), Points.XYZIRCAEDT), Points.XYZIRCAEDT)
    assert ring_filter_keeps(cloud).mean() > 0.95


def test_autowares_ring_filter_keeps_a_wall_and_drops_a_single_point():
    file = rings_of_points(8, 720)
    file[1000, :3] *= 0.5
    [cloud] = cells_of(encode(Scan(file, turn=TURN), Points.XYZIRCAEDT), Points.XYZIRCAEDT)
    kept = ring_filter_keeps(cloud)
    assert cloud['distance'][~kept].tolist() == [cloud['distance'].min()]


@settings(max_examples=30)
@given(file=points_of(FINITE), turn=TURNS)
def test_an_organised_cloud_has_a_row_a_laser_and_columns_of_time(file, turn):
    message = encode(Scan(file, turn=turn), Points.OUSTER)
    cells = cells_of(message, Points.OUSTER)
    assert cells.shape == (64, COLUMNS)
    is_return = ~np.isnan(cells['x'])
    assert is_return.sum() == len(file)
    assert (cells['ring'] == np.arange(64)[:, None]).all()
    assert (cells['ambient'] == 0).all()
    missing = cells[~is_return]
    for name in ('intensity', 'reflectivity', 'range'):
        assert not missing[name].any()
    assert np.isnan(missing['y']).all()
    assert np.isnan(missing['z']).all()
    [laser] = np.nonzero(is_return.any(axis=1))
    assert sorted(63 - np.nonzero(is_return)[0]) == sorted(rings(file).tolist())
    for row in laser:
        assert (np.diff(cells['t'][row, is_return[row]].astype(np.int64)) >= 0).all()
    returns = cells[is_return]
    distance = np.linalg.norm([returns[name].astype(np.float64) for name in 'xyz'], axis=0)
    np.testing.assert_allclose(returns['range'], distance * 1000, rtol=1e-6, atol=0.5)
    if turn is None:
        assert not cells['t'].any()
    else:
        assert cells['t'].max(initial=0) <= turn.length_ns
        assert cells['t'][0, 0] <= cells['t'][0, -1]


@settings(max_examples=30)
@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 5000).map(lambda n: n / 5000)), max_size=60
    ),
    st.integers(0, 2**32 - 1),
)
def test_each_point_has_a_cell_of_its_own_and_rows_rise_with_time(pairs, seed):
    pairs = pairs * 60  # many at the same place
    shuffled = [pairs[at] for at in np.random.default_rng(seed).permutation(len(pairs))]
    rows = np.array([row for row, _ in shuffled], np.uint16)
    parts = np.array([part for _, part in shuffled], np.float64)
    cells, columns = assign_cells(rows, parts, 4)
    assert columns == max([COLUMNS, *np.bincount(rows, minlength=1).tolist()])
    assert len(set(cells.tolist())) == len(cells)
    assert (cells // columns).tolist() == rows.tolist()
    for row in range(4):
        inside = rows == row
        order = np.argsort(cells[inside])
        assert (np.diff(parts[inside][order]) >= 0).all()


@pytest.mark.parametrize('points', Points)
def test_an_empty_scan(points):
    message = encode(Scan(np.empty((0, 4), np.float32), turn=TURN), points)
    expected = (64, COLUMNS) if points is Points.OUSTER else (1, 0)
    assert (message.height, message.width) == expected
    assert decode_scan(message).points.shape == (0, 4)
    assert decode_cloud(message)[0].shape == (0, 4)


def rings_of_points(lasers, columns):
    """Lasers of a scan in the order of KITTI's files, from the highest to the lowest."""
    azimuth = np.linspace(0.001, 2 * np.pi - 0.001, columns)
    elevation = np.radians(np.linspace(2, -24.8, lasers))[:, None]
    x, y = np.cos(azimuth) * 10, np.sin(azimuth) * 10
    z = np.tan(elevation) * 10
    every = np.broadcast_arrays(x, y, z, np.float64(0.25))
    return np.stack(every, axis=-1).reshape(-1, 4).astype(np.float32)


@pytest.mark.parametrize(('lasers', 'rows'), [(64, 64), (32, 64), (65, 128), (128, 128)])
def test_lasers_in_the_order_of_kittis_files_are_counted(lasers, rows):
    file = rings_of_points(lasers, 50)
    notes = []
    message = encode(Scan(file, turn=TURN), Points.OUSTER, note=notes.append)
    cells = cells_of(message, Points.OUSTER)
    assert cells.shape == (rows, COLUMNS)
    counts = (~np.isnan(cells['x'])).sum(axis=1)
    assert counts.tolist() == [0] * (rows - lasers) + [50] * lasers
    assert not notes


@pytest.mark.parametrize('points', Points)
def test_lasers_of_points_in_another_order_are_estimated_and_noted(points):
    file = rings_of_points(64, 50)
    shuffled = np.random.default_rng(0).permutation(file)
    notes = []
    message = encode(Scan(shuffled, turn=TURN), points, note=notes.append)
    if points is Points.XYZI:
        assert not notes
        return
    assert notes == [ESTIMATED_LASERS]
    cells = cells_of(message, points)
    name = 'channel' if 'channel' in cells.dtype.names else 'ring'
    found = cells[~np.isnan(cells['x'])]
    elevation = np.degrees(np.arctan2(found['z'], 10))
    laser = found[name].astype(int) if points is not Points.OUSTER else 63 - found[name].astype(int)
    assert laser.min() == 0
    assert laser.max() == 63
    order = np.argsort(elevation)
    assert (np.diff(laser[order]) >= 0).all()


def test_scans_of_one_moment_have_the_time_0_where_a_format_needs_one():
    file = rings_of_points(64, 50)
    assert 'time' not in [field.name for field in encode(Scan(file), Points.XYZIRT).fields]
    [cloud] = cells_of(encode(Scan(file), Points.XYZIRCAEDT), Points.XYZIRCAEDT)
    assert not cloud['time_stamp'].any()
    assert [cloud[name].tolist() for name in 'xyz'] == [*file.T[:3].tolist()]
    cells = cells_of(encode(Scan(file), Points.OUSTER), Points.OUSTER)
    assert not cells['t'].any()
    azimuth = np.arctan2(cells['y'], cells['x'])
    for row in azimuth:
        assert (np.diff(row[~np.isnan(row)]) < 0).all()


def test_times_before_the_stamp_are_0_if_unsigned():
    file = rings_of_points(2, 50)
    forward = STAMP + LENGTH // 2
    [cloud] = cells_of(encode(Scan(file, turn=TURN), Points.XYZIRCAEDT, forward), Points.XYZIRCAEDT)
    half = len(file) // 2
    assert not cloud['time_stamp'][: half - 2].any()
    assert (cloud['time_stamp'][half + 2 :] > 0).all()


def test_a_real_scan_lies_within_a_few_columns_of_its_times(real_kitti):
    path = real_kitti / 'raw/2011_09_26/2011_09_26_drive_0005_sync/velodyne_points/data'
    file = np.fromfile(path / '0000000000.bin', '<f4').reshape(-1, 4)
    cells = cells_of(encode(Scan(file, turn=TURN), Points.OUSTER), Points.OUSTER)
    is_return = ~np.isnan(cells['x'])
    column = np.nonzero(is_return)[1]
    at = cells['t'][is_return] / LENGTH * COLUMNS
    assert np.abs(column + 0.5 - at).max() < 5
    assert (is_return.sum(axis=1) > 1000).all()
    assert decode_scan(encode(Scan(file, turn=TURN), Points.XYZIRC)).points.tobytes() == (
        file.tobytes()
    )


def test_a_cloud_with_another_field_is_of_no_format():
    message = encode(Scan(np.ones((3, 4), np.float32), turn=TURN), Points.XYZIRCAEDT)
    message.fields[-1].name = 'stamp'
    with pytest.raises(ValueError, match='or with other types or offsets'):
        decode_scan(message)
    assert len(decode_cloud(message, 255.0)[0]) == 3


@pytest.mark.parametrize('points', Points)
def test_importers_of_any_cloud_read_every_format(points):
    file = hundredths(rings_of_points(64, 20))
    decoded, dropped = decode_cloud(
        encode(Scan(file, turn=TURN), points),
        255.0 if points in {Points.XYZIRC, Points.XYZIRCAEDT} else 1.0,
    )
    assert dropped == (64 * COLUMNS - len(file) if points is Points.OUSTER else 0)
    assert sorted_rows(decoded[:, :3]) == sorted_rows(file[:, :3])
    np.testing.assert_allclose(decoded[:, 3], 0.25, atol=0.5 / 255)
