# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's folder and file names.

Sources: the readme.txt of the raw, object, odometry and tracking devkits.

Sets of others in KITTI's folders name their files with more or fewer digits, by names that are no
numbers, or as JPEG. FileNames alone has the names of the files of a folder.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ..model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path


T = TypeVar('T')

_NUMBER = re.compile(r'[0-9]+')

_MOST_SHOWN = 80
MOST_DIGITS = 12
"""Limit for numbers in the description of a bag."""
RAW_DIGITS = 10
FRAME_DIGITS = 6
SEQUENCE_DIGITS = 4

RAW_IMAGES = ('image_00', 'image_01', 'image_02', 'image_03')
RAW_SCANS = 'velodyne_points'
RAW_OXTS = 'oxts'
RAW_DATA = 'data'
RAW_DEPTH = 'proj_depth/velodyne_raw'
"""Depth maps of scans, a folder a colour camera (readme.txt of the depth devkit)."""
RAW_TRACKLETS = 'tracklet_labels.xml'
RAW_DRIVE = re.compile(r'\d{4}_\d{2}_\d{2}_drive_(\d{4})_(sync|extract)')
RAW_DATE = re.compile(r'\d{4}_\d{2}_\d{2}')
TIMESTAMPS = 'timestamps.txt'
TIMESTAMPS_START = 'timestamps_start.txt'
TIMESTAMPS_END = 'timestamps_end.txt'
RAW_LABEL_STAMPS = f'{RAW_IMAGES[2]}/{TIMESTAMPS}'
"""The stamps of tracklets in a drive without scans."""
DATAFORMAT = 'dataformat.txt'
CALIB_CAM_TO_CAM = 'calib_cam_to_cam.txt'
CALIB_VELO_TO_CAM = 'calib_velo_to_cam.txt'
CALIB_IMU_TO_VELO = 'calib_imu_to_velo.txt'
RAW_CALIB = (CALIB_CAM_TO_CAM, CALIB_VELO_TO_CAM, CALIB_IMU_TO_VELO)

KITTI_360_PARTS = ('data_2d_raw', 'data_3d_raw', 'data_poses')
"""The folders of KITTI-360 with a folder a drive."""
KITTI_360_TEST_SLAM = ('data_2d_test_slam', 'data_3d_test_slam')
"""Those of its SLAM benchmark, with test_0/DRIVE to test_3/DRIVE."""
KITTI_360_IMAGES = (
    ('image_00', 'data_rect'),
    ('image_01', 'data_rect'),
    ('image_02', 'data_rgb'),
    ('image_03', 'data_rgb'),
)
"""By camera the folder in a drive, and that of the files in it."""
KITTI_360_SICK = 'sick_points'
KITTI_360_LABEL_IMAGES = 'data_2d_semantics/train'
KITTI_360_BOXES = 'data_3d_bboxes'
KITTI_360_BOX_FOLDERS = ('train', 'train_full')
"""In this order: the first has instances alone, the other everything that is annotated."""
KITTI_360_POSES = ('poses.txt', 'cam0_to_world.txt')
KITTI_360_CALIBRATION = 'calibration'
KITTI_360_FISHEYES = {2: 'image_02.yaml', 3: 'image_03.yaml'}
KITTI_360_CALIB = (
    'perspective.txt',
    'calib_cam_to_pose.txt',
    'calib_cam_to_velo.txt',
    *KITTI_360_FISHEYES.values(),
    'calib_sick_to_velo.txt',
)
OTHER_RIGS = frozenset(KITTI_360_CALIB)
"""Files of calibrations whose cameras are numbered unlike KITTI's: 2 and 3 are no colour pair."""
KITTI_360_DATE = '2013_05_28'
"""The date in the names of its drives."""

SPLITS = ('training', 'testing')
OBJECT_IMAGES = ('image_0', 'image_1', 'image_2', 'image_3', 'image_4')
TRACKING_IMAGES = ('image_00', 'image_01', 'image_02', 'image_03')
SCANS = 'velodyne'
CALIB = 'calib'
OXTS = 'oxts'
OBJECT_LABELS = 'label_2'
WAYMO_LABELS = 'label_all'
"""Labels of all cameras, as mmdetection3d's converter of Waymo wrote them up to 1.3: label_2 beside
it has only those that camera 2 sees."""
LABEL_FOLDERS = (WAYMO_LABELS, OBJECT_LABELS)
OBJECT_DEPTH = 'depth_2'
"""Depth maps of camera 2, as OpenPCDet and CaDDN name the folder; KITTI's set has none."""
TRACKING_LABELS = 'label_02'
IMAGE_SETS = 'ImageSets'

DATASET = 'dataset'
SEQUENCES = 'sequences'
POSES = 'poses'
TIMES = 'times.txt'
ODOMETRY_CALIB = 'calib.txt'
ODOMETRY_DRIVES = {
    '00': '2011_10_03_drive_0027',
    '01': '2011_10_03_drive_0042',
    '02': '2011_10_03_drive_0034',
    '03': '2011_09_26_drive_0067',
    '04': '2011_09_30_drive_0016',
    '05': '2011_09_30_drive_0018',
    '06': '2011_09_30_drive_0020',
    '07': '2011_09_30_drive_0027',
    '08': '2011_09_30_drive_0028',
    '09': '2011_09_30_drive_0033',
    '10': '2011_09_30_drive_0034',
}
"""The raw drive that each training sequence is a part of (odometry devkit)."""
POINT_LABELS = 'labels'

PNG = '.png'
JPEGS = ('.jpg', '.jpeg')
IMAGE_SUFFIXES = (PNG, *JPEGS)
"""Suffixes of images, in any case; KITTI's own first."""
OTHER_FORMATS = frozenset({
    '.bmp', '.gif', '.jp2', '.pgm', '.ppm', '.tif', '.tiff', '.webp',
    '.csv', '.las', '.laz', '.npy', '.npz', '.pcd', '.ply', '.json', '.xml',
})  # fmt: skip
"""Suffixes of images, scans and labels that are not read."""
BIN = '.bin'
TXT = '.txt'
LABEL = '.label'


def file_name(number: int, digits: int, suffix: str) -> str:
    """Return the name of a numbered file, such as 0000000012.png."""
    return f'{number:0{digits}d}{suffix}'


def number_of(stem: str) -> int | None:
    """Return the number that a stem is; None for others, and for more digits than KITTI has.

    Longer ones are time stamps, which are names here: they are no indices of a sequence.
    """
    is_number = stem.isdecimal() and stem.isascii() and len(stem) <= RAW_DIGITS
    return int(stem) if is_number else None


@dataclass(frozen=True, eq=False)
class FileNames:
    """The names of the files of a folder, or of the frames of a recording.

    Attributes:
        digits: The digits of numbers, filled with zeros.
        suffix: The suffix of most files; empty for the frames of a recording.
        stems: If names are no numbers, the stem of each frame, whose number is its index here.
        others: The whole names of files with other digits or another suffix, by number.
    """

    digits: int
    suffix: str = ''
    stems: Sequence[str] = ()
    others: Mapping[int, str] = field(default_factory=dict)

    def stem(self, number: int) -> str:
        """Return the name of a frame, without a suffix."""
        if 0 <= number < len(self.stems):
            return self.stems[number]
        return file_name(number, self.digits, '')

    def name(self, number: int) -> str:
        """Return the name of a file."""
        return self.others.get(number) or f'{self.stem(number)}{self.suffix}'

    def number(self, stem: str) -> int | None:
        """Return the number of a frame by its name; None if no frame has such a name."""
        return self._numbers.get(stem) if self.stems else number_of(stem)

    @property
    def example(self) -> str:
        """A name like those of the files, for errors."""
        return self.name(0)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {stem: number for number, stem in enumerate(self.stems)}


FRAME_NAMES = 'names'
"""The stems of frames that are no numbers, in a description."""


SIX_DIGITS = FileNames(FRAME_DIGITS)
"""Names of KITTI's frames but for raw drives."""


def describe_names(names: FileNames) -> dict[str, object]:
    """Describe the names in a folder; the stems of frames are those of the recording."""
    description: dict[str, object] = {'digits': names.digits, 'suffix': names.suffix}
    return {**description, 'others': [*names.others.items()]} if names.others else description


def parse_names(values: Mapping[str, Any], stems: Sequence[str]) -> FileNames:
    """Parse the names in a folder; the inverse of describe_names.

    Raises:
        ValueError: A name is no name of a file, or two files have one.
        KeyError, TypeError: They are not described.
    """
    digits, suffix = int(values['digits']), str(values['suffix'])
    others = {int(number): str(name) for number, name in values.get('others', ())}
    suffixes = (*IMAGE_SUFFIXES, BIN, TXT)
    if not 0 < digits <= MOST_DIGITS or suffix.lower() not in suffixes:
        raise ValueError(f'files of {digits} digits and suffix {suffix!r}')
    if any(split_name(name)[1].lower() not in suffixes for name in others.values()):
        raise ValueError('files of another suffix')
    for name in (*stems, *others.values()):
        if not name or '/' in name or '\0' in name or name.startswith('.'):
            raise ValueError(f'a file named {name[:_MOST_SHOWN]!r}')
    names = FileNames(digits, suffix, stems, others)
    if len({*others.values()}) < len(others) or len({*stems}) < len(stems):
        raise ValueError('two files of one name')
    if any(names.number(split_name(name)[0]) != number for number, name in others.items()):
        raise ValueError('files named by other numbers')
    return names


class NumberedNames(NamedTuple):
    """The names in a folder, by number.

    Attributes:
        numbers: The numbers of the files, ascending.
        names: How they are named.
        strays: Names that are of no frame.
        doubles: By number the names of further files of a frame, which are not read.
    """

    numbers: list[int]
    names: FileNames
    strays: tuple[str, ...] = ()
    doubles: Mapping[int, tuple[str, ...]] = {}


def find_numbered(
    entries: Sequence[str], suffixes: tuple[str, ...], digits: int, frames: FileNames | None = None
) -> NumberedNames:
    """Find the files of frames among the names in a folder.

    Two files of one frame are never chosen from in silence: KITTI's name is read before others,
    and the others are doubles.

    Args:
        entries: The names.
        suffixes: Suffixes of the files, in lower case, KITTI's own first.
        digits: Digits of KITTI's names.
        frames: The names of the frames, where they are no numbers.
    """
    frames = frames or FileNames(digits)
    usual, rest = [], []
    for name in entries:
        number = name[:digits]
        if name[digits:] == suffixes[0] and number.isdecimal() and number.isascii():
            usual.append(int(number))
        elif not name.startswith('.'):
            rest.append(name)
    if rest or frames.stems:
        beside = bool(usual) and suffixes == (TXT,) and digits != SEQUENCE_DIGITS
        return _find_unusual(entries, suffixes, frames, beside_sequences=beside)
    return NumberedNames(usual, FileNames(digits, suffixes[0]))


def _find_unusual(
    entries: Sequence[str],
    suffixes: tuple[str, ...],
    frames: FileNames,
    *,
    beside_sequences: bool,
) -> NumberedNames:
    """Find the files of frames among names that are not all like KITTI's.

    The archives of object and tracking both unpack to training/calib: texts of four digits beside
    those of frames are of sequences.
    """
    files: dict[int, list[tuple[int, bool, str]]] = {}
    strays = []
    for name in entries:
        stem, suffix = split_name(name)
        number = frames.number(stem) if suffix.lower() in suffixes else None
        if number is not None and not (beside_sequences and len(stem) == SEQUENCE_DIGITS):
            rank = suffixes.index(suffix.lower())
            is_other = name != f'{frames.stem(number)}{suffixes[rank]}'
            files.setdefault(number, []).append((rank, is_other, name))
        elif not name.startswith('.'):
            strays.append(name)
    numbers = sorted(files)
    several = {number: [name for *_, name in sorted(files[number])] for number in numbers}
    by_number = {number: names[0] for number, names in several.items()}
    return NumberedNames(
        numbers,
        _pattern(by_number, suffixes[0], frames),
        tuple(strays),
        {number: tuple(names[1:]) for number, names in several.items() if len(names) > 1},
    )


def _pattern(by_number: Mapping[int, str], suffix: str, frames: FileNames) -> FileNames:
    """Return how files are named: by the digits and the suffix of most, with the others apart."""
    parts = {number: split_name(name) for number, name in by_number.items()}
    suffix = _most([ending for _, ending in parts.values()]) or suffix
    digits = frames.digits
    if parts and not frames.stems:
        lengths = [len(stem) for stem, _ in parts.values()]
        # Without zeros in front, every name has the least number of digits that it needs.
        digits = min(lengths)
        if any(stem != file_name(number, digits, '') for number, (stem, _) in parts.items()):
            digits = _most(lengths) or digits
    usual = FileNames(digits, suffix, frames.stems)
    others = {number: name for number, name in by_number.items() if name != usual.name(number)}
    return FileNames(digits, suffix, frames.stems, others)


def _most(values: list[T]) -> T | None:
    """Return the most frequent value, of several the first; None without any."""
    return Counter(values).most_common(1)[0][0] if values else None


def split_name(name: str) -> tuple[str, str]:
    """Split the name of a file into stem and suffix, with its point."""
    stem, point, suffix = name.rpartition('.')
    return (stem, f'.{suffix}') if point and stem else (name, '')


def find_frames(folders: Iterable[tuple[Sequence[str], tuple[str, ...]]], digits: int) -> FileNames:
    """Return how the frames of a recording are named: by numbers, or else in the order of names.

    Args:
        folders: The names in each folder, and the suffixes of its files.
        digits: Digits of KITTI's names.
    """
    frame_stems: set[str] = set()
    for entries, suffixes in folders:
        for name in entries:
            stem, suffix = split_name(name)
            if suffix.lower() in suffixes and not name.startswith('.'):
                if number_of(stem) is not None:
                    return FileNames(digits)
                frame_stems.add(stem)
    return FileNames(digits, stems=tuple(sorted(frame_stems, key=_order_of(frame_stems))))


def _order_of(stems: Iterable[str]) -> Callable[[str], tuple[list[int], str]]:
    """Return the key of the order of names: by value where they differ in numbers only."""
    alike = len({_NUMBER.sub('', stem) for stem in stems}) == 1
    return lambda stem: ([*map(int, _NUMBER.findall(stem))] if alike else [], stem)


def check_split(name: str) -> None:
    """Check the name of a split.

    Raises:
        UsageError: There is no such split.
    """
    if name not in SPLITS:
        raise UsageError(f'no split {name!r}; there are {" and ".join(SPLITS)}')


def parse_drive(name: str) -> tuple[str, int, str]:
    """Parse the name of a raw drive into date, number and kind (sync or extract).

    Raises:
        UsageError: The name is not that of a drive.
    """
    match = RAW_DRIVE.fullmatch(name)
    if match is None:
        raise UsageError(f'{name} is no drive; expected a name like 2011_09_26_drive_0001_sync')
    return name[: len('2011_09_26')], int(match[1]), match[2]


def drive_of(name: str) -> str | None:
    """Return the drive of a raw recording, the same of sync and extract; None for other names."""
    return name.rpartition('_')[0] if RAW_DRIVE.fullmatch(name) else None


def parse_sequence(name: str) -> int:
    """Parse the name of a sequence into its number.

    Raises:
        UsageError: The name is no number of a sequence.
    """
    if not (name.isascii() and name.isdecimal()) or len(name) > SEQUENCE_DIGITS:
        raise UsageError(f'{name} is no sequence; expected a number like 00 or 0000')
    return int(name)


# Lists of frames or sequences: ImageSets/train.txt, one name a line, LF at each end.
#
# Object sets list frames by six digits, other layouts sequences or drives by their names. They are
# no part of KITTI: training frameworks (SECOND, OpenPCDet, mmdet3d) expect them.

_MARK = '\ufeff'
_COUNTED = ('are ', 'repeat ', 'have not ')


@dataclass(frozen=True)
class ImageSet:
    """A list as its file has it.

    Attributes:
        entries: The names, each once, in the order of the file.
        invalid: Reasons of the lines that are no name, with file and line.
        repaired: Lines that a reader may not accept: repeated, blank, CRLF or short lines.
    """

    entries: tuple[str, ...]
    invalid: tuple[str, ...] = ()
    repaired: tuple[str, ...] = ()


def parse_image_set(
    text: str, path: Path | str, *, frames: bool, file_names: FileNames = SIX_DIGITS
) -> ImageSet:
    """Parse a list.

    Args:
        text: Its content.
        path: For the reasons.
        frames: Whether names are those of frames, as in object sets.
        file_names: How the frames are named.
    """
    entries: dict[str, int] = {}
    invalid: list[str] = []
    repaired: dict[str, list[int]] = {}
    if text.startswith(_MARK):
        repaired['begin with a byte order mark'] = [1]
        text = text.removeprefix(_MARK)
    if '\r' in text:
        repaired['end in CRLF'] = [text[: text.index('\r')].count('\n') + 1]
    for line_number, line in enumerate(text.rstrip().splitlines(), 1):
        word = line.strip()
        name = _frame_name(word, file_names) if frames else word
        if not word:
            repaired.setdefault('are blank', []).append(line_number)
        elif name is None or len(word.split()) > 1:
            expected = _expected(file_names) if frames else 'one name'
            invalid.append(f'{path}:{line_number}: {word!r}; expected {expected}')
        elif name in entries:
            repaired.setdefault('repeat another', []).append(line_number)
        else:
            if name != word:
                repaired.setdefault(_unlike(file_names), []).append(line_number)
            entries[name] = line_number
    return ImageSet(tuple(entries), tuple(invalid), tuple(_notes(path, repaired)))


def _frame_name(word: str, file_names: FileNames) -> str | None:
    """Return the name of a frame as its files have it; None if the word is none."""
    number = file_names.number(word)
    return None if number is None else file_names.stem(number)


def _expected(file_names: FileNames) -> str:
    if file_names.stems:
        return f'the name of a frame, such as {file_names.stem(0)}'
    return f'a frame number of {_digits(file_names)} digits'


def _unlike(file_names: FileNames) -> str:
    return f'have not {_digits(file_names)} digits'


def _digits(file_names: FileNames) -> str:
    return 'six' if file_names.digits == FRAME_DIGITS else str(file_names.digits)


def _notes(path: Path | str, repaired: dict[str, list[int]]) -> Iterable[str]:
    for fault, lines in repaired.items():
        count = f'{len(lines)} of the lines' if fault.startswith(_COUNTED) else 'lines'
        yield f'{path}:{lines[0]}: {count} {fault}'


def format_image_set(entries: Iterable[str]) -> str:
    """Format a list; the inverse of parse_image_set."""
    return ''.join(f'{name}\n' for name in entries)
