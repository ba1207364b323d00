#!/usr/bin/env bash
# OpenCV: cv2.omnidir has no inverse of its own projection beyond 90 degrees, and no mask.
#
# Versions: opencv-contrib-python-headless 5.0.0.93, Python 3.11.
#
# Behaviour: omnidir is OpenCV's MEI model (xi > 1: lenses that see more than 180 degrees).
# projectPoints is right to the limit of the model, arccos(-1/xi), 117 degrees here. Beyond it points
# get pixels, too: the point straight behind the camera has exactly the pixel of the point straight
# ahead. undistortPoints returns x/z and y/z also where z < 0: a pixel whose ray is 99 degrees to the
# right comes back as (-6.3, 0), the same as that of the ray 81 degrees to the left.
#
# Why it surprises: the module exists for such lenses, and the pixels at the edge of a fisheye's image
# are beyond 90 degrees. Neither function reports it: rectifying points by undistortPoints mirrors the
# outer ring of the image to the other side.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q 'opencv-contrib-python-headless==5.0.0.93' numpy
"$folder/venv/bin/python" - <<'PYTHON'
import cv2
import numpy as np

K = np.array([[1336.3, 0, 716.9], [0, 1335.8, 705.8], [0, 0, 1.0]])
D, XI = np.array([[0.0168, 1.6548, 0.0, 0.0]]), 2.2134
NONE = np.zeros((3, 1))


def pixel(degrees):
    angle = np.radians(degrees)
    point = np.array([[[np.sin(angle), 0.0, np.cos(angle)]]])
    return cv2.omnidir.projectPoints(point, NONE, NONE, K, XI, D)[0].reshape(2)


def plane(degrees):
    found = cv2.omnidir.undistortPoints(
        pixel(degrees).reshape(1, 1, 2), K, D, np.array([XI]), np.eye(3)
    )
    return found.reshape(2)


limit = np.degrees(np.arccos(-1 / XI))
print(f'limit of the model {limit:.1f} degrees; ahead {pixel(0)}, behind {pixel(180)}')
assert np.allclose(pixel(0), pixel(180))
assert pixel(limit - 1)[0] < pixel(limit)[0] > pixel(limit + 1)[0]
right, left = plane(99), plane(-81)
print(f'99 degrees to the right: {right.round(3)}; 81 degrees to the left: {left.round(3)}')
assert np.allclose(right, left, atol=1e-6)
assert not np.allclose(pixel(99), pixel(-81), atol=100)
print('confirmed')
PYTHON
