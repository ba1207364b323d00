# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's archives by benchmark and part: names, sizes and checksums as far as they are public.

Where the figures are from:

- Names: the links of KITTI's pages, which public download scripts repeat. Paths below the base URL:
  KITTI's raw_data_downloader.sh.
- Sizes of object, tracking and odometry: the texts of the links on KITTI's pages, such as
  "left color images of object data set (12 GB)"; that of SemanticKITTI's labels and voxels: its
  page. They are rounded.
- Sizes of raw drives: see raw_drives.py. A calibration has 4068 to 4075 bytes (same list).
- SHA-256: a public loader of SemanticKITTI (odometry calib, velodyne, labels, voxels), a public
  fetch script (tracking oxts). No source has others.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..kitti import archives

KITTI_URL = 'https://s3.eu-central-1.amazonaws.com/avg-kitti'
"""The bucket that KITTI's download links and its raw_data_downloader.sh lead to."""
_SEMANTIC_URL = 'http://www.semantic-kitti.org/assets'
_MB, _GB = 10**6, 10**9
CALIB_BYTES = 4100


@dataclass(frozen=True)
class CatalogueEntry:
    """An archive that can be downloaded.

    Attributes:
        benchmark: raw, object, tracking or odometry.
        part: Its name on the command line.
        name: Name of the file.
        path: Path below the base URL.
        about_bytes: Its size, rounded; None if no source has it.
        sha256: Its checksum; empty if no source has it.
        own_url: Where it is if it is not with KITTI's other archives.
    """

    benchmark: str
    part: str
    name: str
    path: str
    about_bytes: int | None
    sha256: str = ''
    own_url: str = ''

    def urls(self, base_url: str) -> tuple[str, ...]:
        """Return where to look for it: at KITTI's path, else beside all others."""
        if base_url == KITTI_URL:
            return (self.own_url or f'{base_url}/{self.path}',)
        return tuple(dict.fromkeys((f'{base_url}/{self.path}', f'{base_url}/{self.name}')))


def raw_entry(drive: str, kind: str, about_bytes: int | None) -> CatalogueEntry:
    """Return an archive of a raw drive.

    Args:
        drive: Its name, without the kind.
        kind: sync, extract or tracklets.
        about_bytes: Its size, None if it is not known.
    """
    name = f'{drive}_{kind}.zip'
    return CatalogueEntry('raw', f'{drive}_{kind}', name, f'raw_data/{drive}/{name}', about_bytes)


def calib_entry(date: str) -> CatalogueEntry:
    """Return the archive with the calibration of a day."""
    name = archives.raw_calib(date)
    return CatalogueEntry('raw', f'{date}_calib', name, f'raw_data/{name}', CALIB_BYTES)


def _entry(
    benchmark: str, part: str, name: str, about_bytes: int | None, *, sha256: str = ''
) -> CatalogueEntry:
    return CatalogueEntry(benchmark, part, name, name, about_bytes, sha256)


def _semantic(part: str, name: str, about_bytes: int, sha256: str) -> CatalogueEntry:
    url = f'{_SEMANTIC_URL}/{name}'
    return CatalogueEntry('odometry', part, name, name, about_bytes, sha256, url)


ENTRIES = (
    _entry('object', 'image_2', 'data_object_image_2.zip', 12 * _GB),
    _entry('object', 'image_3', 'data_object_image_3.zip', 12 * _GB),
    _entry('object', 'velodyne', 'data_object_velodyne.zip', 29 * _GB),
    _entry('object', 'calib', archives.OBJECT_CALIB, 16 * _MB),
    _entry('object', 'label_2', 'data_object_label_2.zip', 5 * _MB),
    _entry('object', 'prev_2', 'data_object_prev_2.zip', 36 * _GB),
    _entry('object', 'prev_3', 'data_object_prev_3.zip', 36 * _GB),
    _entry('object', 'devkit', 'devkit_object.zip', _MB),
    _entry('tracking', 'image_02', 'data_tracking_image_2.zip', 15 * _GB),
    _entry('tracking', 'image_03', 'data_tracking_image_3.zip', 14 * _GB),
    _entry('tracking', 'velodyne', 'data_tracking_velodyne.zip', 35 * _GB),
    _entry(
        'tracking',
        'oxts',
        'data_tracking_oxts.zip',
        8 * _MB,
        sha256='0b93e47a01d9479b7aeffcad50c0a08566f723119b6dfb7a11da3466acaf02de',
    ),
    _entry('tracking', 'calib', archives.TRACKING_CALIB, _MB),
    _entry('tracking', 'label_02', 'data_tracking_label_2.zip', 9 * _MB),
    _entry('tracking', 'devkit', 'devkit_tracking.zip', None),
    _entry('odometry', 'gray', 'data_odometry_gray.zip', 22 * _GB),
    _entry('odometry', 'color', 'data_odometry_color.zip', 65 * _GB),
    _entry(
        'odometry',
        'velodyne',
        'data_odometry_velodyne.zip',
        80 * _GB,
        sha256='062a45667bec6874ac27f733bd6809919f077265e7ac0bb25ac885798fa85ab5',
    ),
    _entry(
        'odometry',
        'calib',
        archives.ODOMETRY_CALIB,
        _MB,
        sha256='fa45d2bbff828776e6df689b161415fb7cd719345454b6d3567c2ff81fa4d075',
    ),
    _entry('odometry', 'poses', 'data_odometry_poses.zip', 4 * _MB),
    _semantic(
        'labels',
        'data_odometry_labels.zip',
        179 * _MB,
        '408ec524636a393bae0288a0b2f48bf5418a1af988e82dee8496f89ddb7e6dda',
    ),
    _semantic(
        'voxels',
        'data_odometry_voxels.zip',
        700 * _MB,
        'd92c253e88e5e30c0a0b88f028510760e1db83b7e262d75c5931bf9b8d6dd51b',
    ),
    _entry('odometry', 'devkit', 'devkit_odometry.zip', _MB),
    _entry('raw', 'devkit', 'devkit_raw_data.zip', None),
)
"""All archives but those of raw drives and calibrations."""
BENCHMARKS = ('raw', 'object', 'tracking', 'odometry')
