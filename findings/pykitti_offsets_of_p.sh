#!/usr/bin/env bash
# pykitti: K_cam3 and T_cam3_velo of a drive are not P_rect_03 of its calibration file.
#
# Version: pykitti 0.3.1, Python 3.11.
#
# Behaviour: of the fourth column of P_rect, pykitti makes a camera's place from the first row alone,
# P[0, 3] / P[0, 0] along x; the other two rows are dropped. With offsets of 3 mm along y and z, as
# KITTI's own calibration has them, points projected by K_cam3 and T_cam3_velo are up to 0.9 pixels off
# at 4 m, and the camera is 2.5 mm off along x as well: the first row holds fx * x + cx * z.
#
# Why it surprises: both come from the same P_rect, the frames are called rectified, and the drive has
# no other calibration: one expects K_cam3 @ T_cam3_velo to be P_rect_03 @ R_rect_00 @ T_velo_to_cam,
# as for cameras 0 and 1 it is. Bags that are made through pykitti have P and transforms that differ.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pykitti

folder = Path(sys.argv[1])
date, drive = folder / '2020_01_01', folder / '2020_01_01/2020_01_01_drive_0001_sync'
(drive / 'oxts').mkdir(parents=True)
(drive / 'oxts/timestamps.txt').write_text('2020-01-01 00:00:00.000000000\n')
k = np.array([[720.0, 0, 610], [0, 720, 173], [0, 0, 1]])
axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
places = [(0, 0, 0), (-0.54, 0, 0), (0.06, 0, 0.003), (-0.47, 0.003, 0.003)]
p_rect = [np.column_stack([k, k @ place]) for place in places]


def line(key, values):
    return f'{key}: {" ".join(f"{value:.6e}" for value in np.ravel(values))}\n'


lines = []
for camera, p in enumerate(p_rect):
    lines += [line(f'R_rect_0{camera}', np.eye(3)), line(f'P_rect_0{camera}', p)]
(date / 'calib_cam_to_cam.txt').write_text(''.join(lines))
motions = {'velo_to_cam': (axes, [0, -0.08, -0.27]), 'imu_to_velo': (np.eye(3), [-0.8, 0.3, -0.8])}
for name, (rotation, translation) in motions.items():
    (date / f'calib_{name}.txt').write_text(line('R', rotation) + line('T', translation))
calib = pykitti.raw(folder, '2020_01_01', '0001').calib

print('pykitti', version('pykitti'))
points = np.array([[4.0, 1.5, -0.5, 1], [4, -1.5, 0.5, 1], [10, 5, -1, 1]]).T
off = []
for camera, p in enumerate(p_rect):
    in_camera = (getattr(calib, f'T_cam{camera}_velo') @ points)[:3]
    theirs = getattr(calib, f'K_cam{camera}') @ in_camera
    ours = p @ (calib.T_cam0_velo @ points)
    off.append(np.linalg.norm(theirs[:2] / theirs[2] - ours[:2] / ours[2], axis=0).max())
    print(f'camera {camera}: {off[-1]:.2f} pixels off')
assert max(off[:2]) < 1e-3 and min(off[2:]) > 0.3, off
moved = (calib.T_cam3_velo @ np.linalg.inv(calib.T_cam0_velo))[:3, 3] - places[3]
print('camera 3 is off by', np.round(1000 * moved, 2), 'mm')
assert np.allclose(1000 * moved, [610 / 720 * 3, -3, -3], atol=0.01), moved
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pykitti==0.3.1 opencv-python-headless==5.0.0.93
"$folder/venv/bin/python" "$folder/check.py" "$folder"
