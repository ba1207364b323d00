# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scan <-> sensor_msgs/PointCloud2, in the formats of model/cloud_formats.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.cloud_formats import EXTRA, FORMATS, Order, Points
from ..model.samples import Scan
from .clouds import FILE_INDEX, file_order, read_field, read_points
from .header import make_header
from .point_grid import organise
from .point_values import PointValues
from .ros_types import PointCloud2, PointField

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from ..model.cloud_formats import CloudField, CloudFormat
    from ..model.samples import Float32Array

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
    remark: Callable[[str], None] = lambda _: None,
) -> PointCloud2:
    """Make the cloud of a scan; of x y z intensity its data are the file's bytes unchanged.

    Args:
        scan: N points.
        stamp_ns: Nanoseconds.
        frame_id: velo_link.
        points: The format of the cloud. Several SLAM packages use the last point's time as the end
            of the scan, so points with times are sorted.
        labels: (N,) SemanticKITTI labels; add label and instance (uint16) and rgb (float32).
        remark: Called with a remark on values that are estimated.
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
        remark(ESTIMATED_LASERS)
    if scan.extra and not cloud_format.extensible:
        remark(f'clouds of {points.value} have no field for the columns {", ".join(scan.extra)}')
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
    found = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    for points, cloud_format in FORMATS.items():
        if cloud_format.loss and not message.is_bigendian and found == _described(cloud_format):
            return _decode_nearest(message, points)
    names = tuple(field.name for field in message.fields)
    kinds = _kinds_of(message.fields)
    made = _message_fields(np.dtype([*kinds.items()])) if names[:4] == _XYZI else []
    if message.is_bigendian or found != _tuples(made):
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
    found: Float32Array = np.array(read_points(message, None))
    if any(field.value == 'brightness' for field in FORMATS[points].fields[:4]):
        hundredths = np.rint(read_field(message, 'intensity') * (100 / 255))
        found[:, 3] = (hundredths / 100).astype(np.float32)
    if FORMATS[points].order is Order.GRID:
        found = found[~np.isnan(found[:, :3]).any(axis=1)]
    return Scan(found, difference=f'in clouds of {points.value}, {FORMATS[points].loss}')


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
