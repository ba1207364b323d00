# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the functions that run units share: errors become reasons, losses lines of text."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

from ..files.json_text import json_text
from ..files.replacing import KEEP_ALL_BUT_JSON, keep_all
from ..files.staging import staged_file
from ..model.errors import KittiRos2Error, describe_error, interruption_of
from .results import UnitResult

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from ..model.losses import Loss
    from .results import Advance, UnitJob

_KEPT_LINES = 20


def run_guarded(
    work: Callable[[UnitJob, Advance], UnitResult], job: UnitJob, advance: Advance
) -> UnitResult:
    """Run a unit and measure the time; errors of its data become the reason of a failed result.

    Raises:
        KeyboardInterrupt, SystemExit: A signal ended it, also where that broke a lock.
    """
    started = time.monotonic()
    try:
        result = work(job, advance)
    except (KittiRos2Error, OSError) as error:
        result = UnitResult(reason=describe_error(error))
    except MemoryError:
        result = UnitResult(reason='not enough memory; lower --jobs, and run it again with --retry')
    except Exception as error:  # noqa: BLE001 - one bad unit does not stop the rest
        if interruption := interruption_of(error):
            raise interruption from None
        reason = f'internal error, {type(error).__name__}: {error}; please report it'
        result = UnitResult(reason=reason)
    return replace(result, seconds=time.monotonic() - started)


def first_lines(lines: Iterable[str]) -> tuple[str, ...]:
    """Return the first few different lines."""
    return tuple(islice(dict.fromkeys(lines), _KEPT_LINES))


def loss_lines(losses: Iterable[Loss]) -> tuple[str, ...]:
    """Return the first few losses as lines."""
    return first_lines(f'{loss.stream} ({loss.count}): {loss.text()}' for loss in losses)


def write_unit_json(job: UnitJob, values: object) -> None:
    """Write the output of a unit as JSON.

    Raises:
        OutputError: It exists and may not be replaced, or the disk refuses.
    """
    refusal = KEEP_ALL_BUT_JSON if job.options.get('overwrite') else keep_all
    with staged_file(job.out, refusal) as path:
        path.write_text(json_text(values), 'utf-8')


@contextmanager
def samples_shown(advance: Advance, samples: int, _frames: int) -> Iterator[Advance]:
    """Show the progress of a conversion: yield a function of the samples done and the bytes."""
    yield lambda done, _bytes: advance(done, samples)
