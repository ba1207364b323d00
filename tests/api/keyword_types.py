# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The text of kitti_ros2/options/keywords.py, from the declarations of the options.

    python tests/api/keyword_types.py

writes the file.
"""

from __future__ import annotations

from pathlib import Path

from kitti_ros2.api.arguments import keyword_of
from kitti_ros2.api.draw import DRAW
from kitti_ros2.options import datasets, evaluation, keywords, table
from kitti_ros2.options.declare import options_of
from kitti_ros2.options.read import ReadOptions

FILE = Path(keywords.__file__)
READ = options_of(ReadOptions)
FOLDER = [each for each in READ if each.name in {'layout', 'sequence', 'columns'}]
TABLES = {
    'Folder': ('of the folder, which many commands have', FOLDER),
    'Read': ('of reading a KITTI folder', READ),
    'ToBag': ('of to-bag', table.TO_BAG),
    'ToKitti': ('of to-kitti', table.TO_KITTI),
    'Draw': ('of view that concern a picture', DRAW),
    'Extract': ('of extract', datasets.EXTRACT),
    'Download': ('of download', datasets.DOWNLOAD),
    'Validate': ('of validate', datasets.VALIDATE),
    'Statistics': ('of stats', datasets.STATS),
    'Crop': ('of crop', datasets.CROP),
    'Split': ('of split', datasets.SPLIT),
    'Detection': ('of eval detection', evaluation.DETECTION),
    'Odometry': ('of eval odometry', evaluation.ODOMETRY),
    'Tracking': ('of eval tracking', evaluation.TRACKING),
    'Live': ('of eval live', evaluation.LIVE),
}
HEAD = '''# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Types of the library's keyword options: the command line's, with underscores.

Written by tests/api/keyword_types.py from the declarations of the options. For meanings and
defaults see `kitti-ros2 COMMAND --help-all`, or the reference of the commands.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence

    AnyPath = str | os.PathLike[str]
    OneOrMore = str | Sequence[str]
'''


def text() -> str:
    """Return the text; a class has as its base the largest one that is a part of it."""
    written, parts = {}, [HEAD]
    for name, (meaning, options) in TABLES.items():
        items = {(keyword_of(each), each.keyword_type) for each in options}
        bases = [base for base, known in written.items() if known <= items]
        base = max(bases, key=lambda each: len(written[each]), default='TypedDict')
        lines = [
            f'    {keyword_of(each)}: {each.keyword_type}\n'
            for each in options
            if (keyword_of(each), each.keyword_type) not in written.get(base, ())
        ]
        head = f'class {name}Keywords({base}, total=False):\n    """Options {meaning}."""\n\n'
        parts.append(head + ''.join(lines))
        written[f'{name}Keywords'] = items
    return '\n\n'.join(parts)


if __name__ == '__main__':
    FILE.write_text(text(), 'utf-8')
