# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's archives and raw drives as far as they are public, and the choice among them.

Where the figures of archives are from:

- Names: the links of KITTI's pages, which public download scripts repeat. Paths below the base URL:
  KITTI's raw_data_downloader.sh.
- Sizes of object, tracking and odometry: the texts of the links on KITTI's pages, such as
  "left color images of object data set (12 GB)"; that of SemanticKITTI's labels and voxels: its
  page. They are rounded.
- Sizes of raw drives: see below. A calibration has 4068 to 4075 bytes (same list).
- SHA-256: a public loader of SemanticKITTI (odometry calib, velodyne, labels, voxels), a public
  fetch script (tracking oxts). No source has others.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from ..kitti import archives, names
from ..model.errors import UsageError, did_you_mean, either, not_one_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


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


# KITTI's raw drives: category, frames, size of the archive, and whether there are tracklets.
#
# Where the figures are from; one that no source has is left out (-):
#
# - Drives and categories: the pages of KITTI's raw data, one for each category
#   (cvlibs.net/datasets/kitti/raw_data.php), as two public lists repeat them.
# - Bytes of the sync archive: src/download_kitti_raw.py of
#   github.com/Jiang-Muyun/Open3D-Semantic-KITTI-Vis. A second public list has all of them with
#   three or more digits, and agrees.
# - Frames, which are images of camera 2 in sync: a public table of 61 drives. No source has those
#   of campus, person and calibration.
# - Tracklets: the table of archives in panoptic_slam/kitti, from the pages of the categories.


CATEGORIES = ('city', 'residential', 'road', 'campus', 'person', 'calibration')


@dataclass(frozen=True)
class RawDrive:
    """A drive of KITTI's raw data.

    Attributes:
        name: Date and number, without sync or extract.
        category: One of CATEGORIES.
        frames: Number of frames of sync; None if no source has it.
        sync_bytes: Size of the archive of sync.
        has_tracklets: Whether there is an archive of tracklets.
    """

    name: str
    category: str
    frames: int | None
    sync_bytes: int
    has_tracklets: bool

    @property
    def date(self) -> str:
        """The date in the name, which the archive of the calibration has, too."""
        return self.name.partition('_drive_')[0]

    @property
    def number(self) -> int:
        """The number in the name."""
        return int(self.name[-4:])


@cache
def raw_drives() -> dict[str, RawDrive]:
    """Return all drives by name, in the order of their dates and numbers."""
    drives = {}
    for line in _TABLE.splitlines():
        name, category, frames, size, tracklets = line.split()
        count = None if frames == '-' else int(frames)
        drives[name] = RawDrive(name, category, count, int(size), tracklets != '-')
    return drives


_TABLE = """\
2011_09_26_drive_0001 city 108 458643963 tracklets
2011_09_26_drive_0002 city 77 319776816 tracklets
2011_09_26_drive_0005 city 154 645940900 tracklets
2011_09_26_drive_0009 city 447 1791264044 tracklets
2011_09_26_drive_0011 city 233 939815328 tracklets
2011_09_26_drive_0013 city 144 630044598 tracklets
2011_09_26_drive_0014 city 314 1261710548 tracklets
2011_09_26_drive_0015 road 297 1206523127 tracklets
2011_09_26_drive_0017 city 114 469598656 tracklets
2011_09_26_drive_0018 city 270 1115646800 tracklets
2011_09_26_drive_0019 residential 481 2097547106 tracklets
2011_09_26_drive_0020 residential 86 367093728 tracklets
2011_09_26_drive_0022 residential 800 3409516068 tracklets
2011_09_26_drive_0023 residential 474 1999129806 tracklets
2011_09_26_drive_0027 road 188 849872514 tracklets
2011_09_26_drive_0028 road 430 1907576425 tracklets
2011_09_26_drive_0029 road 430 1684284933 tracklets
2011_09_26_drive_0032 road 390 1451679572 tracklets
2011_09_26_drive_0035 residential 131 512019684 tracklets
2011_09_26_drive_0036 residential 803 3257339348 tracklets
2011_09_26_drive_0039 residential 395 1538110914 tracklets
2011_09_26_drive_0046 residential 125 486623395 tracklets
2011_09_26_drive_0048 city 22 83650171 tracklets
2011_09_26_drive_0051 city 438 1702327445 tracklets
2011_09_26_drive_0052 road 78 285158280 tracklets
2011_09_26_drive_0056 city 294 1214030003 tracklets
2011_09_26_drive_0057 city 361 1321890349 tracklets
2011_09_26_drive_0059 city 373 1517489971 tracklets
2011_09_26_drive_0060 city 78 298725765 tracklets
2011_09_26_drive_0061 residential 703 3049963820 tracklets
2011_09_26_drive_0064 residential 570 2376539657 tracklets
2011_09_26_drive_0070 road 420 1759098358 tracklets
2011_09_26_drive_0079 residential 100 439133579 tracklets
2011_09_26_drive_0084 city 383 1574584300 tracklets
2011_09_26_drive_0086 residential 706 3055393176 tracklets
2011_09_26_drive_0087 residential 729 3138789859 tracklets
2011_09_26_drive_0091 city 340 1419552280 tracklets
2011_09_26_drive_0093 city 433 1720308957 tracklets
2011_09_26_drive_0095 city 268 1097371915 -
2011_09_26_drive_0096 city 475 2016323567 -
2011_09_26_drive_0101 road 936 3617310729 -
2011_09_26_drive_0104 city 312 1310103586 -
2011_09_26_drive_0106 city 227 936875950 -
2011_09_26_drive_0113 city 87 372444404 -
2011_09_26_drive_0117 city 660 2786458483 -
2011_09_26_drive_0119 calibration - 5710265 -
2011_09_28_drive_0001 city 106 424412944 -
2011_09_28_drive_0002 city 376 1458258535 -
2011_09_28_drive_0016 campus - 756451122 -
2011_09_28_drive_0021 campus - 855844547 -
2011_09_28_drive_0034 campus - 193510705 -
2011_09_28_drive_0035 campus - 131723850 -
2011_09_28_drive_0037 campus - 369717988 -
2011_09_28_drive_0038 campus - 451849097 -
2011_09_28_drive_0039 campus - 1476221896 -
2011_09_28_drive_0043 campus - 604398155 -
2011_09_28_drive_0045 campus - 173725652 -
2011_09_28_drive_0047 campus - 123103730 -
2011_09_28_drive_0053 person - 295337473 -
2011_09_28_drive_0054 person - 195437062 -
2011_09_28_drive_0057 person - 320437507 -
2011_09_28_drive_0065 person - 167935773 -
2011_09_28_drive_0066 person - 125814469 -
2011_09_28_drive_0068 person - 290664620 -
2011_09_28_drive_0070 person - 169295097 -
2011_09_28_drive_0071 person - 186674086 -
2011_09_28_drive_0075 person - 303143703 -
2011_09_28_drive_0077 person - 182314464 -
2011_09_28_drive_0078 person - 160697640 -
2011_09_28_drive_0080 person - 172762287 -
2011_09_28_drive_0082 person - 324118229 -
2011_09_28_drive_0086 person - 130739109 -
2011_09_28_drive_0087 person - 357182085 -
2011_09_28_drive_0089 person - 165564431 -
2011_09_28_drive_0090 person - 200362597 -
2011_09_28_drive_0094 person - 372271335 -
2011_09_28_drive_0095 person - 177817864 -
2011_09_28_drive_0096 person - 195251631 -
2011_09_28_drive_0098 person - 190678556 -
2011_09_28_drive_0100 person - 323180083 -
2011_09_28_drive_0102 person - 193048180 -
2011_09_28_drive_0103 person - 159515450 -
2011_09_28_drive_0104 person - 184636446 -
2011_09_28_drive_0106 person - 314547727 -
2011_09_28_drive_0108 person - 200917052 -
2011_09_28_drive_0110 person - 264196469 -
2011_09_28_drive_0113 person - 310511554 -
2011_09_28_drive_0117 person - 150486958 -
2011_09_28_drive_0119 person - 322630862 -
2011_09_28_drive_0121 person - 192762200 -
2011_09_28_drive_0122 person - 180266851 -
2011_09_28_drive_0125 person - 247319927 -
2011_09_28_drive_0126 person - 134052781 -
2011_09_28_drive_0128 person - 121502858 -
2011_09_28_drive_0132 person - 306195410 -
2011_09_28_drive_0134 person - 230595320 -
2011_09_28_drive_0135 person - 176161577 -
2011_09_28_drive_0136 person - 130045777 -
2011_09_28_drive_0138 person - 286710514 -
2011_09_28_drive_0141 person - 297900856 -
2011_09_28_drive_0143 person - 134208483 -
2011_09_28_drive_0145 person - 151015865 -
2011_09_28_drive_0146 person - 297735474 -
2011_09_28_drive_0149 person - 192923310 -
2011_09_28_drive_0153 person - 376787274 -
2011_09_28_drive_0154 person - 180253120 -
2011_09_28_drive_0155 person - 201334439 -
2011_09_28_drive_0156 person - 125713935 -
2011_09_28_drive_0160 person - 171702560 -
2011_09_28_drive_0161 person - 154892601 -
2011_09_28_drive_0162 person - 159121039 -
2011_09_28_drive_0165 person - 347674884 -
2011_09_28_drive_0166 person - 163378555 -
2011_09_28_drive_0167 person - 226207751 -
2011_09_28_drive_0168 person - 238715266 -
2011_09_28_drive_0171 person - 117380254 -
2011_09_28_drive_0174 person - 225884553 -
2011_09_28_drive_0177 person - 326712111 -
2011_09_28_drive_0179 person - 180155301 -
2011_09_28_drive_0183 person - 163488111 -
2011_09_28_drive_0184 person - 360343144 -
2011_09_28_drive_0185 person - 334968556 -
2011_09_28_drive_0186 person - 171726108 -
2011_09_28_drive_0187 person - 230477498 -
2011_09_28_drive_0191 person - 157634097 -
2011_09_28_drive_0192 person - 351788149 -
2011_09_28_drive_0195 person - 162817175 -
2011_09_28_drive_0198 person - 263315557 -
2011_09_28_drive_0199 person - 145873361 -
2011_09_28_drive_0201 person - 345762778 -
2011_09_28_drive_0204 person - 212190008 -
2011_09_28_drive_0205 person - 145981018 -
2011_09_28_drive_0208 person - 224367125 -
2011_09_28_drive_0209 person - 358923876 -
2011_09_28_drive_0214 person - 175470479 -
2011_09_28_drive_0216 person - 246629515 -
2011_09_28_drive_0220 person - 311130693 -
2011_09_28_drive_0222 person - 224626212 -
2011_09_28_drive_0225 calibration - 14354315 -
2011_09_29_drive_0004 road 339 1406686016 -
2011_09_29_drive_0026 city 158 590851286 -
2011_09_29_drive_0071 city 1059 4337332333 -
2011_09_29_drive_0108 calibration - 14140145 -
2011_09_30_drive_0016 road 279 1134226963 -
2011_09_30_drive_0018 residential 2762 11320688364 -
2011_09_30_drive_0020 residential 1104 4474549463 -
2011_09_30_drive_0027 residential 1106 4424930450 -
2011_09_30_drive_0028 residential 5177 21198755156 -
2011_09_30_drive_0033 residential 1594 6555121798 -
2011_09_30_drive_0034 residential 1224 5079656140 -
2011_09_30_drive_0072 calibration - 5096853 -
2011_10_03_drive_0027 residential 4544 18349607637 -
2011_10_03_drive_0034 residential 4663 19782483045 -
2011_10_03_drive_0042 road 1170 4239391956 -
2011_10_03_drive_0047 road 837 3103291675 -
2011_10_03_drive_0058 calibration - 60225505 -
"""


# Words of a user to archives: a benchmark with its parts, raw drives, ranges of them, dates.
#
# object image_2 calib label_2          parts of a benchmark; all selects each of them
# raw 2011_09_26_drive_0005             a drive, with the calibration of its day
# raw 2011_09_26_drive_0001..0017       the drives of a day between two numbers, both included
# raw 2011_09_26                        all drives of a day
# raw 2011_09_26_calib                  a calibration alone
# data_object_calib.zip                 an archive by its name, alone


_DRIVE = re.compile(r'(\d{4}_\d{2}_\d{2}_drive_\d{4})(?:_(sync|extract|tracklets))?(?:\.zip)?')
_RANGE = re.compile(r'(\d{4}_\d{2}_\d{2})_drive_(\d{4})\.\.(?:\1_drive_)?(\d{4})')
_CALIB = re.compile(r'(\d{4}_\d{2}_\d{2})_calib(?:\.zip)?')
_ALL = 'all'
_ALIASES = {'image_2': 'image_02', 'image_3': 'image_03', 'label_2': 'label_02'}
"""Parts of tracking by the names of their archives."""


@dataclass(frozen=True)
class RawKinds:
    """Which archives of raw drives are selected.

    Attributes:
        kinds: Of sync, extract and tracklets; empty selects sync, and tracklets where they exist.
        categories: Only drives of these; empty selects all.

    Raises:
        UsageError: A category is unknown.
    """

    kinds: tuple[str, ...] = ()
    categories: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for each in self.categories:
            if each not in CATEGORIES:
                raise not_one_of('category', each, CATEGORIES)

    def entries(self, drives: Iterable[RawDrive], kind: str = '') -> list[CatalogueEntry]:
        """Return the archives of drives, each day's calibration first.

        Args:
            drives: The drives; those of other categories are left out.
            kind: The kind that was given with a drive's name.

        Raises:
            UsageError: None of them is of the categories.
        """
        given = list(drives)
        chosen = [each for each in given if not self.categories or each.category in self.categories]
        if given and not chosen:
            raise UsageError(f'none of these drives is of category {either(self.categories)}')
        found = [calib_entry(date) for date in dict.fromkeys(each.date for each in chosen)]
        for drive in chosen:
            kinds = (kind,) if kind else self.kinds or ('sync', *self._labels(drive))
            sizes = {'sync': drive.sync_bytes}
            found += [raw_entry(drive.name, each, sizes.get(each)) for each in kinds]
        return found

    @staticmethod
    def _labels(drive: RawDrive) -> tuple[str, ...]:
        return ('tracklets',) if drive.has_tracklets else ()


def select(words: Sequence[str], raw: RawKinds) -> list[CatalogueEntry]:
    """Return the archives that words name, each once.

    Raises:
        UsageError: A word is unknown, or nothing is selected.
    """
    found: list[CatalogueEntry] = []
    benchmark, chosen = '', False
    for word in words:
        if word in BENCHMARKS:
            found += _close(benchmark, raw, chosen=chosen)
            benchmark, chosen = word, False
            continue
        found += _select_word(word, benchmark, raw)
        chosen = True
    found += _close(benchmark, raw, chosen=chosen)
    if not found:
        raise UsageError(
            f'nothing is selected; give {either(BENCHMARKS)} with parts, such as object calib'
            f' label_2, or raw 2011_09_26_drive_0005 (--list shows all)'
        )
    return list(dict.fromkeys(found))


def _close(benchmark: str, raw: RawKinds, *, chosen: bool) -> list[CatalogueEntry]:
    """Return the archives of a benchmark without parts: only --category selects some."""
    if chosen or not benchmark:
        return []
    if benchmark == 'raw' and raw.categories:
        return raw.entries(raw_drives().values())
    if benchmark == 'raw':
        parts = ['2011_09_26_drive_0005', '2011_09_26', '2011_09_26_calib', _ALL]
    else:
        parts = [*_parts(benchmark), _ALL]
    raise UsageError(f'{benchmark}: give parts of it: {either(parts)}')


def _parts(benchmark: str) -> dict[str, CatalogueEntry]:
    return {each.part: each for each in ENTRIES if each.benchmark == benchmark}


def _select_word(word: str, benchmark: str, raw: RawKinds) -> list[CatalogueEntry]:
    """Return the archives that a word names."""
    by_name = {each.name: each for each in ENTRIES}
    if word in by_name:
        return [by_name[word]]
    parts = _parts(benchmark)
    part = _ALIASES.get(word, word) if benchmark == 'tracking' else word
    if part in parts:
        return [parts[part]]
    if word == _ALL and benchmark == 'raw':
        return raw.entries(raw_drives().values())
    if word == _ALL and benchmark:
        return list(parts.values())
    if benchmark in {'', 'raw'}:
        found = _select_raw(word, raw)
        if found:
            return found
    known = [*parts, _ALL] if benchmark else [*BENCHMARKS, *by_name]
    if benchmark == 'raw':
        known += [*raw_drives()]
    hint = did_you_mean(word, known) or f'; there are {either(known[:9])} (--list shows all)'
    raise UsageError(f'there is no {f"{benchmark} " if benchmark else ""}{word}{hint}')


def _select_raw(word: str, raw: RawKinds) -> list[CatalogueEntry]:
    drives = raw_drives()
    dates = {each.date for each in drives.values()}
    drive, span, calib = _DRIVE.fullmatch(word), _RANGE.fullmatch(word), _CALIB.fullmatch(word)
    if drive is not None and drive[1] in drives:
        if word.endswith('.zip') and drive[2]:
            size = drives[drive[1]].sync_bytes if drive[2] == 'sync' else None
            return [raw_entry(drive[1], drive[2], size)]
        return RawKinds(raw.kinds).entries([drives[drive[1]]], drive[2] or '')
    if span is not None:
        first, last = int(span[2]), int(span[3])
        within = [
            each
            for each in drives.values()
            if each.date == span[1] and first <= each.number <= last
        ]
        if not within:
            raise UsageError(f'{word}: there is no drive between these; --list shows all')
        return raw.entries(within)
    if calib is not None and calib[1] in dates:
        return [calib_entry(calib[1])]
    if names.RAW_DATE.fullmatch(word) and word in dates:
        return raw.entries([each for each in drives.values() if each.date == word])
    return []
