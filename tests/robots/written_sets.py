# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a written KITTI set holds, in any layout, read without this package.

By the readmes of KITTI's development kits: P_i @ R_rect @ Tr_velo_to_cam projects a point of a
scan; a label's place is the middle of its bottom in the rectified camera 0; a tracklet's is that in
the scan.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from camera_rigs import moved

if TYPE_CHECKING:
    from pathlib import Path


class Held(NamedTuple):
    """A label: its class, and (N,) which points of the scan its box holds."""

    name: str
    points: np.ndarray


class WrittenSet:
    """A set; root is the folder that was written."""

    def __init__(self, root: Path, layout: str) -> None:
        self.root = root
        self.layout = layout
        if layout == 'raw':
            (self.drive,) = root.glob('*/*_drive_*')

    @property
    def _folder(self) -> Path:
        place = {'object': 'training', 'tracking': 'training', 'odometry': 'sequences/00'}
        return self.root / place[self.layout]

    @property
    def frames(self) -> int:
        return len(list(self._scans().iterdir()))

    def _scans(self) -> Path:
        if self.layout == 'raw':
            return self.drive / 'velodyne_points/data'
        own = {'tracking': 'velodyne/0000'}
        return self._folder / own.get(self.layout, 'velodyne')

    def images(self, index: int) -> list[Path]:
        if self.layout == 'raw':
            folder = self.drive / f'image_{index:02d}/data'
        elif self.layout == 'tracking':
            folder = self._folder / f'image_{index:02d}/0000'
        else:
            folder = self._folder / f'image_{index}'
        return sorted(folder.iterdir())

    def scan(self, number: int) -> np.ndarray:
        """(N, 4) of a frame."""
        path = sorted(self._scans().iterdir())[number]
        if path.suffix == '.txt':
            return np.loadtxt(path, ndmin=2)
        return np.fromfile(path, np.float32).reshape(-1, 4).astype(float)

    def calibration(self, number: int) -> tuple[dict[int, np.ndarray], np.ndarray]:
        """P (3, 4) of each camera, and rect_T_velo (4, 4) of the rectified camera 0."""
        if self.layout == 'raw':
            rows = values_of(self.drive.parent / 'calib_cam_to_cam.txt')
            velo = values_of(self.drive.parent / 'calib_velo_to_cam.txt')
            tr = rigid(velo['R'].reshape(3, 3), velo['T'])
            rect = rigid(rows['R_rect_00'].reshape(3, 3))
            p = {n: rows[f'P_rect_{n:02d}'].reshape(3, 4) for n in range(4)}
            return p, rect @ tr
        names = {'object': f'calib/{number:06d}.txt', 'tracking': 'calib/0000.txt'}
        rows = values_of(self._folder / names.get(self.layout, 'calib.txt'))
        tr = next(rows[key] for key in ('Tr_velo_to_cam', 'Tr_velo_cam', 'Tr') if key in rows)
        rect = next((rows[key] for key in ('R0_rect', 'R_rect') if key in rows), np.eye(3))
        p = {n: rows[f'P{n}'].reshape(3, 4) for n in range(4)}
        tr = tr.reshape(3, 4)
        return p, rigid(rect.reshape(3, 3)) @ rigid(tr[:, :3], tr[:, 3])

    def pixels(self, index: int, number: int) -> np.ndarray:
        """(N, 2) of the points of a scan in a camera's images, NaN behind it."""
        p, rect_T_velo = self.calibration(number)
        rect = moved(rect_T_velo, self.scan(number)[:, :3])
        seen = rect @ p[index][:, :3].T + p[index][:, 3]
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.where(seen[:, 2:] > 0, seen[:, :2] / seen[:, 2:], np.nan)

    def labels(self, number: int) -> list[Held]:
        """The labels of a frame."""
        if self.layout == 'raw':
            return self._tracklets(number)
        if self.layout == 'tracking':
            lines = (self._folder / 'label_02/0000.txt').read_text().splitlines()
            rows = [line.split() for line in lines]
            rows = [row[2:] for row in rows if int(row[0]) == number]
        else:
            text = (self._folder / f'label_2/{number:06d}.txt').read_text()
            rows = [line.split() for line in text.splitlines()]
        places = moved(self.calibration(number)[1], self.scan(number)[:, :3])
        return [Held(row[0], _in_label(places, *map(float, row[8:15]))) for row in rows]

    def _tracklets(self, number: int) -> list[Held]:
        points = self.scan(number)[:, :3]
        root = ET.parse(self.drive / 'tracklet_labels.xml').getroot()
        found = []
        for item in root.find('tracklets').findall('item'):
            place = number - int(item.find('first_frame').text)
            poses = item.find('poses').findall('item')
            if not 0 <= place < len(poses):
                continue
            tx, ty, tz, rz = (
                float(poses[place].find(key).text) for key in ('tx', 'ty', 'tz', 'rz')
            )
            height, width, length = (float(item.find(key).text) for key in 'hwl')
            cosine, sine = np.cos(rz), np.sin(rz)
            local = (points - [tx, ty, tz]) @ np.array([[cosine, -sine], [sine, cosine], [0, 0]])
            inside = (np.abs(local) <= np.array([length, width]) / 2).all(axis=1)
            inside &= (points[:, 2] >= tz) & (points[:, 2] <= tz + height)
            found.append(Held(item.find('objectType').text, inside))
        return found


def _in_label(places, height, width, length, x, y, z, ry):
    turned = (places - [x, y, z]) @ np.array(
        [[np.cos(ry), 0, np.sin(ry)], [0, 1, 0], [-np.sin(ry), 0, np.cos(ry)]]
    )
    within = (np.abs(turned[:, 0]) <= length / 2) & (np.abs(turned[:, 2]) <= width / 2)
    return within & (turned[:, 1] <= 0) & (turned[:, 1] >= -height)


def rigid(rotation: np.ndarray, translation=(0, 0, 0)) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation, translation
    return made


def values_of(path: Path) -> dict[str, np.ndarray]:
    """The numbers of a calibration file, by key, with or without a colon."""
    found = {}
    for line in path.read_text().splitlines():
        key, _, values = line.replace(':', ' ', 1).partition(' ')
        try:
            found[key] = np.array(values.split(), float)
        except ValueError:
            continue
    return found
