# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's raw drives: category, frames, size of the archive, and whether there are tracklets.

Where the figures are from; one that no source has is left out (-):

- Drives and categories: the pages of KITTI's raw data, one for each category
  (cvlibs.net/datasets/kitti/raw_data.php), as two public lists repeat them.
- Bytes of the sync archive: src/download_kitti_raw.py of
  github.com/Jiang-Muyun/Open3D-Semantic-KITTI-Vis. A second public list has all of them with
  three or more digits, and agrees.
- Frames, which are images of camera 2 in sync: a public table of 61 drives. No source has those
  of campus, person and calibration.
- Tracklets: the table of archives in panoptic_slam/kitti, from the pages of the categories.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

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
