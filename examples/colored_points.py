# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Write the points that a camera sees, with the colours of its image.

python examples/colored_points.py RECORDING OUT.ply

OUT is a PLY file, which MeshLab, CloudCompare and Open3D open.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import kitti_ros2

if TYPE_CHECKING:
    import numpy.typing as npt

VERTEX = np.dtype([('xyz', '<f4', 3), ('rgb', 'u1', 3)])


def colored(
    frame: kitti_ros2.Frame, camera: int = 2
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """Return the (N, 3) points of a frame that a camera sees, and their (N, 3) RGB colours."""
    if frame.calibration is None:
        raise SystemExit(f'frame {frame.number} has no calibration')
    image = frame.image(camera)
    uv, depth = frame.calibration.project(frame.points, camera)
    # Pixel (0, 0) is the centre of the first one.
    pixels = np.rint(np.nan_to_num(uv, nan=-1.0)).clip(-1, 1e6).astype(int)
    height, width, _ = image.shape
    seen = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels < (width, height)).all(axis=1)
    u, v = pixels[seen].T
    return frame.points[seen, :3], image[v, u]


def main(path: str, out: str) -> None:
    """Write the first frame with a scan and an image."""
    recording = kitti_ros2.open(path)
    frame = next(one for one in recording if {'scan', 'image_2'} <= set(one.streams))
    points, colors = colored(frame)
    vertices = np.empty(len(points), VERTEX)
    vertices['xyz'], vertices['rgb'] = points, colors
    header = ['ply', 'format binary_little_endian 1.0', f'element vertex {len(points)}']
    header += [f'property float {axis}' for axis in 'xyz']
    header += [f'property uchar {color}' for color in ('red', 'green', 'blue')]
    text = '\n'.join([*header, 'end_header', ''])
    Path(out).write_bytes(text.encode() + vertices.tobytes())
    print(f'{out}: {len(points)} of {len(frame.points)} points of frame {frame.number}')


if __name__ == '__main__':
    main(*sys.argv[1:])
