# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 recover."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from ..bags.locate import locate_bag
from ..bags.writer import guess_storage
from ..options import BagOptions
from ..recover import recover
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .memory import keep_imports
from .text import format_bytes, format_count, format_path
from .to_bag import show_losses

if TYPE_CHECKING:
    from pathlib import Path


def run_recover(bag: Path, out: Path, storage: str | None, *, overwrite: bool, quiet: bool) -> int:
    """Recover, and say what came of it.

    Args:
        bag: The bag to read.
        out: The bag to write.
        storage: Its storage; by its ending, else as the source has it, where None.
        overwrite: Whether an existing bag may be replaced.
        quiet: Say only what was lost.

    Returns:
        The exit code.
    """
    keep_imports()
    wanted = guess_storage(out, storage) if storage or out.suffix else locate_bag(bag).storage
    found = recover(bag, out, BagOptions(storage=wanted, overwrite=overwrite))
    if not quiet:
        for note in found.notes:
            sys.stdout.write(f'note: {note}\n')
        sys.stdout.write(
            f'{format_path(found.path)}: {format_count(sum(found.counts.values()), "message")} on'
            f' {format_count(len(found.counts), "topic")}, {format_bytes(found.size_bytes)}\n'
        )
    show_losses(found.losses)
    return EXIT_LOSSES if found.losses else EXIT_OK
