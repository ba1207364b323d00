# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options that several commands have."""

from typing import Annotated, Optional

import typer

from ...model.streams import LAYOUT_NAMES

LayoutOption = Annotated[
    Optional[str],
    typer.Option('--layout', help=f'{LAYOUT_NAMES} [default: guess]'),
]
SequenceOption = Annotated[
    Optional[str], typer.Option('--sequence', help='Which drive, split or sequence of SRC, e.g. 00')
]
QuietOption = Annotated[bool, typer.Option('--quiet', '-q', help='Print only what went wrong.')]
