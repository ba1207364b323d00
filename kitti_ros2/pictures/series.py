# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of many frames, drawn on all cores and yielded in order."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..files.workers import ordered_map, worker_count
from ..importer.selected_frames import within
from ..model.errors import MissingDataError, UsageError
from ..model.losses import Loss, describe_frames
from ..model.stamps import NS_PER_S
from ..model.streams import Stream
from ..options.read import NOMINAL_PERIOD_NS
from .frame_parts import name_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from ..drawing.pixels import Pixels
    from ..options.pictures import PictureOptions
    from ..options.selection import SelectionOptions
    from .frame import FrameData, FrameSource
    from .modes import Mode

_NOMINAL_HZ = NS_PER_S / NOMINAL_PERIOD_NS
_LEAST_HZ, _MOST_HZ = 0.1, 60.0


class Drawn(NamedTuple):
    """The picture of a frame, None if required data is missing.

    Attributes:
        number: The frame number.
        picture: (H, W, 3) uint8 BGR.
        missing: Missing data of the frame: name to the reason, one line; {} stands for numbers.
        kinds: The classes of its objects and predictions, drawn or not.
    """

    number: int
    picture: Pixels | None
    missing: Mapping[str, str]
    kinds: frozenset[str] = frozenset()


def draw_frames(
    source: FrameSource,
    numbers: Sequence[int],
    mode: Mode,
    options: PictureOptions,
    refine: Callable[[FrameData], FrameData] = lambda frame: frame,
) -> Iterator[Drawn]:
    """Draw the pictures of some frames, in their order.

    Args:
        source: The frames.
        numbers: Frame numbers.
        mode: The kind of picture.
        options: Picture options.
        refine: Adds data to a frame that the source does not have, such as predictions.

    Raises:
        UsageError: A frame does not exist.
    """
    wanted = mode.streams(source.cameras, options)

    def draw(number: int) -> Drawn:
        frame = refine(source.frame(number, wanted))
        kinds = frozenset(each.class_name for each in (*frame.objects, *frame.predictions))
        try:
            return Drawn(number, mode.draw(frame, options), frame.missing, kinds)
        except MissingDataError as error:
            # One line per reason, independent of the number of frames.
            reason = str(error).removeprefix(name_of(frame)).lstrip(': ')
            return Drawn(number, None, {'picture': f'{reason}; frames not drawn: {{}}'}, kinds)

    return ordered_map(draw, numbers, worker_count(most=None))


def concerned_losses(
    source: FrameSource, numbers: Sequence[int], mode: Mode, options: PictureOptions
) -> tuple[Loss, ...]:
    """Return the losses of the source itself that concern pictures of some frames."""
    wanted = mode.streams(source.cameras, options) | {Stream.CALIBRATION.value}
    others = {stream.value for stream in Stream} - wanted
    drawn = set(numbers)
    found = []
    for loss in source.losses:
        if loss.stream in others:
            continue
        lost = tuple(number for number in loss.numbers if number in drawn)
        if lost:
            found.append(Loss(loss.stream, len(lost), loss.message, lost))
        elif not loss.numbers:
            found.append(loss)
    return tuple(found)


class PictureTally:
    """Result of drawing a series of frames."""

    def __init__(self) -> None:
        self.drawn = 0
        self.kinds: set[str] = set()
        self._missing: dict[tuple[str, str], list[int]] = {}

    def pictures(
        self, series: Iterable[Drawn], progress: Callable[[int], None] = lambda _: None
    ) -> Iterator[tuple[int, Pixels]]:
        """Yield the pictures with their frame numbers; count missing data."""
        for done, each in enumerate(series, 1):
            for name, reason in each.missing.items():
                self._missing.setdefault((name.split()[0], reason), []).append(each.number)
            self.kinds |= each.kinds
            if each.picture is not None:
                self.drawn += 1
                yield each.number, each.picture
            progress(done)

    def check(self) -> None:
        """Raise if nothing was drawn.

        Raises:
            MissingDataError: Nothing was drawn; contains the reason.
        """
        if not self.drawn:
            losses = self.losses() or (Loss('picture', 0, 'no frames'),)
            raise MissingDataError(f'nothing to draw: {losses[-1].text()}')

    def losses(self) -> tuple[Loss, ...]:
        """Return the missing data, one loss per reason."""
        return tuple(
            Loss(name, len(numbers), reason, tuple(numbers))
            for (name, reason), numbers in self._missing.items()
        )


def parse_frames(text: str, source: FrameSource) -> list[int]:
    """Parse FIRST:LAST or FIRST:LAST:STEP, both ends included; each part may be omitted.

    Raises:
        UsageError: The text is invalid, or matches no frame.
    """
    words = text.split(':')
    if len(words) not in {2, 3} or not all(not word or word.isdecimal() for word in words):
        raise UsageError(f'{text!r} are no frames; write FIRST:LAST, such as 0:99, or : for all')
    first, last, step = (int(word) if word else None for word in (*words, '')[:3])
    if step == 0:
        raise UsageError(f'{text!r}: a step of 0')
    if first is not None and last is not None and last < first:
        raise UsageError(f'{text!r}: the last frame is before the first')
    numbers = source.numbers
    chosen = numbers[
        (numbers >= (first or 0)) & (numbers <= (int(numbers[-1]) if last is None else last))
    ]
    if not len(chosen):
        raise UsageError(f'{source.name} has no frame in {text}; it has {describe_frames(numbers)}')
    found: list[int] = chosen[:: step or 1].tolist()
    return found


def select_frames(source: FrameSource, selection: SelectionOptions) -> list[int]:
    """Return the frames from the start to the end of a selection, both included.

    Raises:
        UsageError: There are none.
    """
    chosen = within(selection, source.numbers, source.stamps_ns)
    if not chosen.any():
        span = f'{source.numbers[0]} to {source.numbers[-1]}'
        raise UsageError(f'{source.name}: the selection takes no frame; it has {span}')
    found: list[int] = source.numbers[chosen].tolist()
    return found


def rate_of(source: FrameSource, numbers: Sequence[int]) -> float:
    """Return the rate of some frames, from the median interval, in Hz."""
    periods = np.diff(np.sort(source.stamps_ns[np.isin(source.numbers, numbers)]))
    period = float(np.median(periods)) if len(periods) else 0.0
    return min(max(NS_PER_S / period, _LEAST_HZ), _MOST_HZ) if period > 0 else _NOMINAL_HZ
