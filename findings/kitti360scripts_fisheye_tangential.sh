#!/usr/bin/env bash
# kitti360Scripts: the projection into KITTI-360's fisheyes leaves out p1 and p2 of their calibration.
#
# Versions: kitti360Scripts 1.0.0, opencv-contrib-python-headless 5.0.0.93, Python 3.11.
#
# Behaviour: image_02.yaml and image_03.yaml have the MEI model with xi, k1, k2, p1, p2. The authors'
# CameraFisheye.cam2image takes xi, k1 and k2: with p1 = p2 = 0 it is OpenCV's omnidir to 1e-9 px, with
# p1 = p2 = 4e-4, as a fisheye of that rig has, points differ by up to 0.5 px, the more the farther from the
# middle. The depth that it returns is the distance, negative from 90 degrees off the axis on, where the
# lens still sees (to 99 degrees): a mask of depth > 0 drops points that are in the image.
#
# Why it surprises: these are the data set's own scripts, they load the file with p1 and p2, and who
# tests a projection against them takes the difference for an error of his own.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q 'opencv-contrib-python-headless==5.0.0.93' numpy pyyaml
"$folder/venv/bin/pip" install -q --no-deps 'kitti360Scripts==1.0.0'
"$folder/venv/bin/python" - <<'PYTHON'
import cv2
import numpy as np
from kitti360scripts.helpers.project import CameraFisheye

GAMMA1, GAMMA2, U0, V0, XI, K1, K2 = 1336.3, 1335.8, 716.9, 705.8, 2.2134, 0.0168, 1.6548
NONE = np.zeros((3, 1))

off_axis, around = np.meshgrid(np.radians(np.arange(1, 99.5, 0.5)), np.radians(np.arange(0, 360, 5)))
sine = np.sin(off_axis)
rays = np.stack([sine * np.cos(around), sine * np.sin(around), np.cos(off_axis)], -1).reshape(-1, 3)


def authors(p1, p2):
    camera = CameraFisheye.__new__(CameraFisheye)  # its loader needs PyYAML before 6
    camera.fi = {
        'mirror_parameters': {'xi': XI},
        'distortion_parameters': {'k1': K1, 'k2': K2, 'p1': p1, 'p2': p2},
        'projection_parameters': {'gamma1': GAMMA1, 'gamma2': GAMMA2, 'u0': U0, 'v0': V0},
    }
    u, v, depth = camera.cam2image(10 * rays.T)
    return np.column_stack([u, v]), depth


def opencv(p1, p2):
    k = np.array([[GAMMA1, 0, U0], [0, GAMMA2, V0], [0, 0, 1.0]])
    d = np.array([[K1, K2, p1, p2]])
    return cv2.omnidir.projectPoints(rays[None], NONE, NONE, k, XI, d)[0].reshape(-1, 2)


for p in (0.0, 4e-4):
    (pixels, depth), expected = authors(p, p), opencv(p, p)
    apart = np.linalg.norm(pixels - expected, axis=1)
    print(f'p1 = p2 = {p:g}: up to {apart.max():.3g} px apart')
    assert apart.max() < 1e-6 if p == 0 else 0.5 < apart.max() < 1.5
seen = ((expected >= 0) & (expected < 1400)).all(axis=1)
print(f'{(seen & (depth < 0)).sum()} of {seen.sum()} rays in the image have a negative depth')
assert (seen & (depth < 0)).any()
assert np.allclose(np.abs(depth), 10)
print('confirmed')
PYTHON
