# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scan <-> sensor_msgs/PointCloud2, in the formats of model/bag_formats.py."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.labelled_objects import OTHER_COLOR, SEMANTIC_COLORS
from ..model.bag_formats import EXTRA, FORMATS, Order, Points
from ..model.recording import turned_to
from ..model.samples import LineScan, Scan
from ..model.streams import NS_PER_S
from .cdr import make_header
from .clouds import FILE_INDEX, file_order, read_field, read_points
from .ros_types import PointCloud2, PointField

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from ..model.bag_formats import CloudField, CloudFormat
    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array, Turn


# Organised clouds: a row for each laser, the highest first, and columns of time.

COLUMNS = 2176
"""Columns of a grid: the most returns of a laser in KITTI's samples are 2165, and 17 * 128 fits."""


def organise(cloud: npt.NDArray[np.void], values: PointValues) -> npt.NDArray[np.void]:
    """Return points as a grid (rows, columns), with each point in a cell of its own.

    Missing returns are NaN for x y z, with the ring of their row and the time of their column.
    """
    cells, columns = assign_cells(values.row, values.part, values.rows)
    grid = np.zeros((values.rows, columns), dtype=cloud.dtype)
    for name in 'xyz':
        grid[name] = np.nan
    grid['ring'] = np.arange(values.rows)[:, None]
    grid['t'] = values.nanoseconds_of((np.arange(columns) + 0.5) / columns)
    grid.reshape(-1).view(f'V{cloud.itemsize}')[cells] = cloud.view(f'V{cloud.itemsize}')
    return grid


def assign_cells(
    rows: npt.NDArray[np.uint16], parts: Float64Array, row_count: int
) -> tuple[npt.NDArray[np.intp], int]:
    """Return the cell of each point in a grid, row by row, (N,), and the number of columns.

    The column is that of the point's part of the turn, or the next free one: within a row, columns
    rise with time. There are more than COLUMNS if a row has more points.
    """
    order = np.argsort(rows + parts / 2, kind='stable')
    row = rows[order].astype(np.intp)
    counts = np.bincount(row, minlength=row_count)
    columns = max(COLUMNS, int(counts.max(initial=0)))
    index_in_row = np.arange(len(row)) - (np.cumsum(counts) - counts)[row]
    nominal_column = np.minimum((parts[order] * columns).astype(np.intp), columns - 1)
    # Columns minus indices must not fall within a row; rows are kept apart by an offset.
    apart = row * (2 * columns)
    free = np.maximum.accumulate(nominal_column - index_in_row + apart) - apart + index_in_row
    cells = np.empty(len(row), dtype=np.intp)
    cells[order] = row * columns + np.minimum(free, columns - counts[row] + index_in_row)
    return cells, columns


# The values of a scan's points for the fields of clouds: lasers, times, angles, labels.

LASERS = 64
MOST_LASERS = 128
_UPPER, _LOWER = (2.0, 3.0), (-8.83, 2.0)  # degrees of the highest laser, lasers a degree
_HALF = 32  # lasers of each block
_MOST_NS = 2**32 - 1

_COLOR_TABLE = np.full(1 << 16, OTHER_COLOR, dtype=np.uint32)
_COLOR_TABLE.put(list(SEMANTIC_COLORS), list(SEMANTIC_COLORS.values()))


class PointValues:
    """The values of N points by the names of model.bag_formats.VALUES, each (N,) or a number.

    Args:
        points: (N, 4) float32.
        turn: When each direction was scanned; None if all points are of one time.
        stamp_ns: The cloud's stamp.
        labels: (N,) SemanticKITTI labels, if they are in the cloud.
    """

    return_type = 1
    ambient = 0

    def __init__(
        self,
        points: Float32Array,
        turn: Turn | None,
        stamp_ns: int,
        labels: npt.NDArray[np.uint32] | None = None,
    ) -> None:
        self._turn = turn
        self._stamp_ns = stamp_ns
        self._labels = np.empty(0, np.uint32) if labels is None else labels
        self.x, self.y, self.z, self.reflectance = points.T

    @cached_property
    def _azimuth(self) -> Float32Array:
        azimuth: Float32Array = np.arctan2(self.y, self.x)
        return azimuth

    @cached_property
    def part(self) -> Float64Array:
        """The part of the turn at which the scanner faces each point, 0..1."""
        return turned_to(self._azimuth)

    @cached_property
    def laser(self) -> npt.NDArray[np.uint16]:
        """The laser, 0 the lowest; estimated from the elevation if they cannot be counted."""
        if not self.is_ordered:
            return _nominal_lasers(self.elevation)
        return self._counted.astype(np.uint16)

    @property
    def is_ordered(self) -> bool:
        """True if the points are in the order of the lasers, as in KITTI's files."""
        return bool(self._counted.max(initial=0) < MOST_LASERS)

    @cached_property
    def _counted(self) -> npt.NDArray[np.int64]:
        return _count_lasers(self._azimuth)

    @property
    def is_timed(self) -> bool:
        """True if the points have times."""
        return self._turn is not None

    @property
    def rows(self) -> int:
        """The rows of a grid with one for each laser: 64, or 128 if there are more lasers."""
        return LASERS if self.laser.max(initial=0) < LASERS else MOST_LASERS

    @cached_property
    def row(self) -> npt.NDArray[np.uint16]:
        """The laser, 0 the highest of the rows."""
        rows: npt.NDArray[np.uint16] = np.uint16(self.rows - 1) - self.laser
        return rows

    @cached_property
    def seconds(self) -> Float32Array:
        """Seconds from the stamp."""
        return (self._since_ns(self.part) / NS_PER_S).astype(np.float32)

    @cached_property
    def nanoseconds(self) -> npt.NDArray[np.uint32]:
        """Nanoseconds since the stamp; 0 before it, and of points that are all of one time."""
        return self.nanoseconds_of(self.part)

    def nanoseconds_of(self, parts: Float64Array) -> npt.NDArray[np.uint32]:
        """Return nanoseconds since the stamp of parts of the turn."""
        return np.rint(np.clip(self._since_ns(parts), 0, _MOST_NS)).astype(np.uint32)

    def _since_ns(self, parts: Float64Array) -> Float64Array:
        if self._turn is None:
            return np.zeros(len(parts))
        return parts * self._turn.length_ns + (self._turn.start_ns - self._stamp_ns)

    @property
    def file_index(self) -> npt.NDArray[np.int64]:
        """The index in the file."""
        return np.arange(len(self.x))

    @cached_property
    def brightness(self) -> npt.NDArray[np.uint8]:
        """Reflectance in steps of 1/255; KITTI's two digits can be restored from it."""
        scaled = np.clip(np.nan_to_num(self.reflectance), 0, 1) * np.float32(255)
        brightness: npt.NDArray[np.uint8] = np.rint(scaled).astype(np.uint8)
        return brightness

    @property
    def azimuth(self) -> Float32Array:
        """The angle from x, clockwise seen from above as the scanner turns, 0 to 2 pi."""
        whole = np.float32(2 * np.pi)
        return np.where(self._azimuth > 0, whole - self._azimuth, np.abs(self._azimuth))

    @cached_property
    def elevation(self) -> Float32Array:
        """The angle above the plane of x and y."""
        elevation: Float32Array = np.arctan2(self.z, self._across)
        return elevation

    @cached_property
    def distance(self) -> Float32Array:
        """The distance from the scanner."""
        distance: Float32Array = np.hypot(self._across, self.z)
        return distance

    @cached_property
    def _across(self) -> Float32Array:
        across: Float32Array = np.hypot(self.x, self.y)
        return across

    @property
    def millimetres(self) -> npt.NDArray[np.uint32]:
        """The distance in millimetres, 0 where it is not a number."""
        scaled = np.nan_to_num(self.distance.astype(np.float64) * 1000, posinf=_MOST_NS)
        return np.rint(np.minimum(scaled, _MOST_NS)).astype(np.uint32)

    @property
    def label_class(self) -> npt.NDArray[np.uint16]:
        """The class of the label."""
        return (self._labels & 0xFFFF).astype(np.uint16)

    @property
    def label_instance(self) -> npt.NDArray[np.uint16]:
        """The instance of the label."""
        return (self._labels >> 16).astype(np.uint16)

    @property
    def label_color(self) -> Float32Array:
        """The colour of the class."""
        return packed_colors(self.label_class)


def rings(points: Float32Array) -> npt.NDArray[np.uint16]:
    """Return the laser of each point, (N,) uint16, 0 the lowest.

    KITTI's files contain the lasers one after the other, top to bottom, the points of each sorted
    by rising azimuth from straight ahead (against the direction in which the scanner turns): a
    laser begins where the azimuth wraps from below 2 pi to 0. The count is correct if every laser
    has returns near the front.
    """
    return _count_lasers(np.arctan2(points[:, 1], points[:, 0])).astype(np.uint16)


def _count_lasers(azimuth: Float32Array) -> npt.NDArray[np.int64]:
    wraps = (azimuth[:-1] < 0) & (azimuth[1:] >= 0) & (azimuth[:-1] - azimuth[1:] > -np.pi)
    row = np.concatenate([[0], np.cumsum(wraps)]) if len(azimuth) else np.empty(0, np.int64)
    lowest = row[-1] if len(row) else 0
    laser: npt.NDArray[np.int64] = lowest - row
    return laser


def _nominal_lasers(elevation: Float32Array) -> npt.NDArray[np.uint16]:
    """Return the laser by the nominal angles of an HDL-64E, 0 the lowest.

    Two blocks of 32: three lasers a degree from +2, two a degree from -8.83 (the same rule as in
    A-LOAM, src/scanRegistration.cpp). In KITTI's scans it is right to about two lasers.
    """
    degrees = np.degrees(np.nan_to_num(elevation))
    upper, lower = (np.rint((first - degrees) * dense) for first, dense in (_UPPER, _LOWER))
    from_top = np.where(degrees > _LOWER[0] + 0.25, np.clip(upper, 0, _HALF - 1), lower + _HALF)
    return (LASERS - 1 - np.clip(from_top, 0, LASERS - 1)).astype(np.uint16)


def packed_colors(classes: npt.NDArray[np.uint16]) -> npt.NDArray[np.float32]:
    """Return (N,) float32 with the bits 0x00RRGGBB, the format of the field rgb in PCL and RViz."""
    return _COLOR_TABLE[classes].view(np.float32)


_DATATYPES = {
    '|u1': PointField.UINT8,
    '<u2': PointField.UINT16,
    '<u4': PointField.UINT32,
    '<f4': PointField.FLOAT32,
    '<f8': PointField.FLOAT64,
}
_COLUMN_KINDS = {PointField.FLOAT32: '<f4', PointField.FLOAT64: '<f8'}
_OF_LABELS = frozenset({'label', 'instance', 'rgb'})
_XYZI = tuple(field.name for field in FORMATS[Points.XYZI].fields)
_KINDS = {
    field.name: field.kind
    for field in FORMATS[Points.XYZIRT].fields_of(timed=True, labelled=True)
}  # fmt: skip
_OF_LASERS = frozenset({'laser', 'row'})

ESTIMATED_LASERS = (
    "points are not in the order of the scanner's lasers, which are estimated from the elevation"
)


def encode_scan(
    scan: Scan,
    stamp_ns: int,
    frame_id: str,
    points: Points = Points.XYZI,
    labels: npt.NDArray[np.uint32] | None = None,
    note: Callable[[str], None] = lambda _: None,
) -> PointCloud2:
    """Make the cloud of a scan; of x y z intensity its data are the file's bytes unchanged.

    Args:
        scan: N points.
        stamp_ns: Nanoseconds.
        frame_id: velo_link.
        points: The format of the cloud. Several SLAM packages use the last point's time as the end
            of the scan, so points with times are sorted.
        labels: (N,) SemanticKITTI labels; add label and instance (uint16) and rgb (float32).
        note: Called with a note on values that are estimated.
    """
    cloud_format = FORMATS[points]
    fields = cloud_format.fields_of(
        timed=scan.turn is not None,
        labelled=labels is not None,
        extra={name: values.dtype.str for name, values in scan.extra.items()},
    )
    file = np.ascontiguousarray(scan.points, dtype='<f4')
    values = PointValues(file, scan.turn, stamp_ns, labels)
    is_dense = bool(np.isfinite(file).all())
    if len(fields) == len(_XYZI):
        cloud = file.view(_point(fields, cloud_format)).reshape(1, -1)
    else:
        cloud = _arranged(_filled(fields, cloud_format, values, scan.extra), cloud_format, values)
        is_dense = is_dense and cloud.size == len(file)
    if any(field.value in _OF_LASERS for field in fields) and not values.is_ordered:
        note(ESTIMATED_LASERS)
    if scan.extra and not cloud_format.extensible:
        note(f'clouds of {points.value} have no field for the columns {", ".join(scan.extra)}')
    return _make_cloud(cloud, stamp_ns, frame_id, is_dense=is_dense)


def _make_cloud(
    cloud: npt.NDArray[np.void], stamp_ns: int, frame_id: str, *, is_dense: bool
) -> PointCloud2:
    height, width = cloud.shape
    return PointCloud2(
        header=make_header(stamp_ns, frame_id),
        height=height,
        width=width,
        fields=_message_fields(cloud.dtype),
        is_bigendian=False,
        point_step=cloud.itemsize,
        row_step=cloud.itemsize * width,
        data=cloud.reshape(-1).view(np.uint8),
        is_dense=is_dense,
    )


def _point(fields: Sequence[CloudField], cloud_format: CloudFormat) -> np.dtype[np.void]:
    """Return the structured type of a point with fields of a format."""
    return np.dtype({
        'names': [field.name for field in fields],
        'formats': [field.kind for field in fields],
        'offsets': [field.offset for field in fields],
        'itemsize': cloud_format.step_of(fields),
    })  # fmt: skip


def _filled(
    fields: Sequence[CloudField],
    cloud_format: CloudFormat,
    values: PointValues,
    extra: Mapping[str, npt.NDArray[np.floating]],
) -> npt.NDArray[np.void]:
    """Return (N,) points in the order of the file."""
    cloud = np.zeros(len(values.x), dtype=_point(fields, cloud_format))
    for field in fields:
        is_extra = field.value == EXTRA
        cloud[field.name] = extra[field.name] if is_extra else getattr(values, field.value)
    return cloud


def _arranged(
    cloud: npt.NDArray[np.void], cloud_format: CloudFormat, values: PointValues
) -> npt.NDArray[np.void]:
    """Return (rows, columns) points in the order of the format."""
    if cloud_format.order is Order.GRID:
        return organise(cloud, values)
    if cloud_format.order is Order.TIME and values.is_timed:
        times = values.nanoseconds if cloud_format.is_unsigned else values.seconds
        # Whole points are moved, which is faster than field by field.
        whole = cloud.view(f'V{cloud.itemsize}')
        cloud = whole[times.argsort(kind='stable')].view(cloud.dtype)
    return cloud.reshape(1, -1)


def decode_scan(message: PointCloud2) -> Scan:
    """Decode a cloud made by encode_scan: points and SemanticKITTI labels, in the file's order.

    The points are a view of the message if its step is 16. Lasers and times follow from the points,
    start and end of the sweep are not in the message. A cloud of a format that cannot restore the
    file becomes the nearest scan, with the difference.

    Raises:
        ValueError: The cloud has other fields or data of another length, or file_index does not
            contain each index once.
    """
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    for points, cloud_format in FORMATS.items():
        if cloud_format.loss and not message.is_bigendian and fields == _described(cloud_format):
            return _decode_nearest(message, points)
    names = tuple(field.name for field in message.fields)
    kinds = _kinds_of(message.fields)
    expected_fields = _message_fields(np.dtype([*kinds.items()])) if names[:4] == _XYZI else []
    if message.is_bigendian or fields != _tuples(expected_fields):
        raise ValueError(f'a cloud of fields {names}, or with other types or offsets')
    count = message.width * message.height
    if len(message.data) != count * message.point_step:
        raise ValueError(f'a cloud of {count} points with {len(message.data)} bytes of data')
    order = file_order(message)
    if order is None and FILE_INDEX in names:
        raise ValueError(f'a cloud whose {FILE_INDEX} does not give each place once')
    labels = None
    if 'label' in names and 'instance' in names:
        labels = read_field(message, 'label').astype(np.uint32)
        labels |= read_field(message, 'instance').astype(np.uint32) << np.uint32(16)
        labels = labels if order is None else labels[order]
    extra = {}
    for name in _extra_of(kinds):
        column = read_field(message, name)
        extra[name] = column if order is None else column[order]
    return Scan(read_points(message, order), labels=labels, extra=extra)


_LINE_POINT = np.dtype([(name, '<f4') for name in 'xyz'])


def encode_line_scan(scan: LineScan, stamp_ns: int, frame_id: str) -> PointCloud2:
    """Make the cloud of a line scan: x y z."""
    points = np.ascontiguousarray(scan.points, '<f4')
    is_dense = bool(np.isfinite(points).all())
    return _make_cloud(points.view(_LINE_POINT).T, stamp_ns, frame_id, is_dense=is_dense)


def decode_line_scan(message: PointCloud2) -> LineScan:
    """Decode a cloud made by encode_line_scan.

    Raises:
        ValueError: The cloud has other fields, or data of another length.
    """
    fields = _tuples(message.fields)
    if message.is_bigendian or fields != _tuples(_message_fields(_LINE_POINT)):
        raise ValueError(f'a cloud of fields {tuple(field[0] for field in fields)}, not of x y z')
    count = message.width * message.height
    if message.point_step != _LINE_POINT.itemsize or len(message.data) != count * 12:
        raise ValueError(f'a cloud of {count} points with {len(message.data)} bytes of data')
    return LineScan(np.frombuffer(message.data, '<f4').reshape(-1, 3))


def _kinds_of(fields: Sequence[PointField]) -> dict[str, str]:
    """Return the type of each field: that of to-bag's field, or of an extra column."""
    kinds = {}
    for field in fields:
        own = _KINDS.get(field.name)
        is_own = own is not None and _DATATYPES[own] == field.datatype
        kinds[field.name] = own if own and is_own else _COLUMN_KINDS.get(field.datatype, '<f4')
    if kinds.get('ring') == _KINDS['ring']:  # lasers and times are no columns of the file
        kinds.update((name, _KINDS[name]) for name in kinds.keys() & _KINDS.keys() - _OF_LABELS)
    return kinds


def _extra_of(kinds: Mapping[str, str]) -> list[str]:
    """Return the names of extra columns; those of lasers and times are in clouds of xyzirt."""
    timed = kinds.get('ring') == _KINDS['ring']
    own = _KINDS.keys() if timed else {*_XYZI, *_OF_LABELS}
    return [name for name, kind in kinds.items() if name not in own or kind != _KINDS[name]]


def _decode_nearest(message: PointCloud2, points: Points) -> Scan:
    """Decode a cloud of a format with a loss: finite points of a grid, else all points."""
    points_xyzi: Float32Array = np.array(read_points(message, None))
    if any(field.value == 'brightness' for field in FORMATS[points].fields[:4]):
        hundredths = np.rint(read_field(message, 'intensity') * (100 / 255))
        points_xyzi[:, 3] = (hundredths / 100).astype(np.float32)
    if FORMATS[points].order is Order.GRID:
        points_xyzi = points_xyzi[~np.isnan(points_xyzi[:, :3]).any(axis=1)]
    return Scan(points_xyzi, difference=f'in clouds of {points.value}, {FORMATS[points].loss}')


def _described(cloud_format: CloudFormat) -> list[tuple[str, int, int, int]]:
    return _tuples(_message_fields(_point(cloud_format.fields, cloud_format)))


def _tuples(fields: Sequence[PointField]) -> list[tuple[str, int, int, int]]:
    return [(field.name, field.offset, field.datatype, field.count) for field in fields]


def _message_fields(point: np.dtype[np.void]) -> list[PointField]:
    fields = []
    for name in point.names or ():
        kind, offset = point.fields[name][:2] if point.fields else (point, 0)
        fields.append(PointField(name, offset, _DATATYPES[kind.str], 1))
    return fields
