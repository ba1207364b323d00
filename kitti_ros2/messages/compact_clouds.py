# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scan -> point_cloud_interfaces/CompressedPointCloud2; the rest of its file <-> std_msgs/String.

A scan on KITTI's grid is written as Cloudini does it, x y z to 1 mm and intensity to 0.01; what
its file is besides is a JSON object with

- file, crc32: its name and CRC-32
- twist: six numbers for a scan that KITTI compensated for motion, else absent
- values: absent if the cloud has all bytes of the points, else the values that do not follow from
  the rounded ones, float32
- steps: with a twist, the coordinates that are some millimetres beside, int8

Both are base64 of zlib of the differences of their indices, uint32, and of themselves, in planes:
the lowest bytes of all numbers first. How the file follows is in kitti/compact_scan.py. Other scans
are in the cloud byte for byte.
"""

from __future__ import annotations

import json
import zlib
from base64 import b64decode, b64encode
from typing import TYPE_CHECKING

import numpy as np

from ..model.bag_formats import COMPRESSED_POINTS
from ..model.samples import MISSING, Exceptions, GridSteps, ScanRest
from .cdr import make_header
from .cloudini_writer import write_bytes, write_multiples
from .ros_types import TYPESTORE, PointField, String

if TYPE_CHECKING:
    from pathlib import PurePath
    from typing import Any

    import numpy.typing as npt

    from ..model.samples import Float32Array

OFF_GRID = (
    "points are not on KITTI's grid of 1 mm, so their clouds are compressed as they are, to two"
    ' thirds at best'
)

_NAMES = ('x', 'y', 'z', 'intensity')
_STEPS = ('0.001', '0.001', '0.001', '0.01')
_FORMAT = 'cloudini'
_POINT_BYTES = 4 * len(_NAMES)
_TWIST_NUMBERS = 6
_MOST_EXCEPTIONS_BYTES = 2**26


def encode_compact(
    points: Float32Array,
    multiples: npt.NDArray[np.int32] | None,
    stamp_ns: int,
    frame_id: str,
) -> Any:  # noqa: ANN401 - a rosbags class
    """Make the compressed cloud of (N, 4) points: of their multiples, or without of all bytes."""
    if multiples is None:
        data = write_bytes(points, _NAMES)
    else:
        data = write_multiples(multiples, _NAMES, _STEPS, MISSING)
    compressed: Any = TYPESTORE.types[COMPRESSED_POINTS]
    return compressed(
        header=make_header(stamp_ns, frame_id),
        height=1,
        width=len(points),
        fields=[
            PointField(name, 4 * place, PointField.FLOAT32, 1) for place, name in enumerate(_NAMES)
        ],
        is_bigendian=False,
        point_step=_POINT_BYTES,
        row_step=_POINT_BYTES * len(points),
        compressed_data=np.frombuffer(data, np.uint8),
        is_dense=bool(np.isfinite(points).all()),
        format=_FORMAT,
    )


def encode_rest(rest: ScanRest, path: PurePath) -> String:
    """Make a String of the rest of a scan's file."""
    values: dict[str, Any] = {'file': path.name, 'crc32': rest.crc}
    if rest.twist is not None:
        values['twist'] = rest.twist.tolist()
    if rest.exceptions is not None:
        values['values'] = _pack(*rest.exceptions)
    if rest.steps is not None:
        values['steps'] = _pack(*rest.steps)
    return String(json.dumps(values))


def decode_rest(message: String) -> tuple[str, ScanRest]:
    """Decode the name of a scan's file, and the rest of it: the inverse of encode_rest.

    Raises:
        ValueError: The message is damaged.
    """
    try:
        values = json.loads(message.data)
        name, crc = str(values['file']), int(values['crc32'])
        if 'values' not in values:
            return name, ScanRest(crc)
        twist = np.array(values['twist'], np.float64) if 'twist' in values else None
        exceptions = Exceptions(*_unpack(values['values'], '<u4'))
        steps = GridSteps(*_unpack(values['steps'], 'i1')) if 'steps' in values else None
    except (KeyError, TypeError, ValueError, RecursionError, OverflowError, zlib.error) as error:
        raise ValueError(f'is not what kitti-ros2 writes ({error})') from error
    if twist is not None and not (twist.shape == (_TWIST_NUMBERS,) and np.isfinite(twist).all()):
        raise ValueError('is not what kitti-ros2 writes (its twist is not six numbers)')
    return name, ScanRest(crc, exceptions, twist, steps)


def _pack(indices: npt.NDArray[np.uint32], values: npt.NDArray[Any]) -> str:
    differences = np.diff(indices, prepend=np.uint32(0))
    planes = (_octets(numbers).T.tobytes() for numbers in (differences, values))
    return b64encode(zlib.compress(b''.join(planes))).decode()


def _octets(numbers: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    return numbers.view(np.uint8).reshape(len(numbers), numbers.itemsize)


def _unpack(text: str, kind: str) -> tuple[npt.NDArray[np.uint32], npt.NDArray[Any]]:
    """Undo _pack, of numbers of a kind."""
    packed = zlib.decompressobj()
    octets = packed.decompress(b64decode(text), _MOST_EXCEPTIONS_BYTES)
    if not packed.eof:
        raise ValueError('its values are cut off, or too many')
    planes = np.frombuffer(octets, np.uint8).reshape(4 + np.dtype(kind).itemsize, -1)
    differences, values = (
        np.ascontiguousarray(part.T).view(as_kind)[:, 0]
        for part, as_kind in ((planes[:4], '<u4'), (planes[4:], kind))
    )
    indices = np.cumsum(differences, dtype=np.uint64)
    if len(indices) and indices[-1] >= 2**32:
        raise ValueError('an index is beyond 32 bits')
    return indices.astype(np.uint32), values
