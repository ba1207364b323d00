# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames that a selection takes: by their numbers, seconds from the first, or stamps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import UsageError
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.samples import Int64Array
    from ..options.selection import SelectionOptions


def span_of(
    stamps_ns: Int64Array, kept: npt.NDArray[np.bool_], selection: SelectionOptions
) -> npt.NDArray[np.bool_]:
    """Return which frames a selection takes.

    Raises:
        UsageError: None of those that are kept.
    """
    numbers = np.cumsum(kept) - 1
    chosen = within(selection, numbers, stamps_ns)
    if not (chosen & kept).any():
        seconds = (int(stamps_ns[kept].max()) - int(stamps_ns.min())) / NS_PER_S
        raise UsageError(
            f'the selection takes no frame; there are frames 0 to {numbers[-1]},'
            f' seconds 0s to {seconds:.3f}s'
        )
    return chosen


def within(
    selection: SelectionOptions, numbers: Int64Array, stamps_ns: Int64Array
) -> npt.NDArray[np.bool_]:
    """Return (N,) which frames are between the start and the end of a selection, both included.

    Args:
        selection: Its seconds count from the first frame.
        numbers: (N,) of the frames.
        stamps_ns: (N,) of the frames.
    """
    chosen = np.ones(len(numbers), dtype=np.bool_)
    for bound, compare in ((selection.start, np.greater_equal), (selection.end, np.less_equal)):
        if bound is None:
            continue
        if bound.frame is not None:
            chosen &= compare(numbers, bound.frame)
        elif bound.offset_ns is not None:
            chosen &= compare(stamps_ns, int(stamps_ns.min()) + bound.offset_ns)
        else:
            chosen &= compare(stamps_ns, bound.stamp_ns or 0)
    return chosen
