# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options that several commands have."""

from typing import Annotated

import typer

QuietOption = Annotated[bool, typer.Option('--quiet', '-q', help='Print only errors and losses.')]
