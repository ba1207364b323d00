# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command recover."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ...model.containers import CONTAINER_NAMES
from .declared import QuietOption


def recover(
    bag: Annotated[Path, typer.Argument(help='A truncated or damaged bag.')],
    out: Annotated[Path, typer.Argument(help='The repaired bag, named like OUT of to-bag.')],
    storage: Annotated[
        Optional[str],
        typer.Option(help=f'{CONTAINER_NAMES} [default: by OUT, else that of BAG]'),
    ] = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing bag.')
    ] = False,
    quiet: QuietOption = False,
) -> int:
    """Repair a truncated or damaged bag; each loss is listed."""
    from ..recover import run_recover

    return run_recover(bag, out, storage, overwrite=overwrite, quiet=quiet)
