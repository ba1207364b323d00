# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Memory shared with a forked process, for results with large buffers.

A result is pickled by protocol 5: its large buffers go through the memory, the rest through a pipe.
The memory has no name, so nothing is left of it however the processes end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pickle
    from collections.abc import Callable

_SLOTS = 2  # one is filled while the other is read
_SHARED_FROM = 16 * 2**10
"""Below this size in bytes, the pipe costs no more."""


class PickledResult(NamedTuple):
    """A pickled result.

    Attributes:
        pickled: All but the shared buffers.
        slot: The slot of these; None without any.
        ends: The end of each in the slot, ascending.
    """

    pickled: bytes
    slot: int | None
    ends: list[int]


class SharedSlots:
    """Slots of shared memory, each with the buffers of one result until it is taken.

    Args:
        size: Bytes of a slot; buffers that do not fit are pickled. Pages are allocated when used.
    """

    def __init__(self, size: int) -> None:
        import mmap  # noqa: PLC0415 - as in _Fork

        self._size = size
        self._memory = mmap.mmap(-1, _SLOTS * size)
        self._free = list(range(_SLOTS))

    def pack(self, result: object, wait_for_slot: Callable[[], int]) -> PickledResult:
        """Pickle a result, its buffers (pickle.PickleBuffer) in a slot.

        Args:
            result: The result.
            wait_for_slot: Returns the number of a slot that was taken; called if none is free.
        """
        import pickle  # noqa: PLC0415 - as in _Fork

        slot: int | None = None
        ends: list[int] = []

        def is_pickled(buffer: pickle.PickleBuffer) -> bool:
            nonlocal slot
            with buffer.raw() as data:
                start = ends[-1] if ends else 0
                if len(data) < _SHARED_FROM or start + len(data) > self._size:
                    return True
                if slot is None:
                    slot = self._free.pop() if self._free else wait_for_slot()
                place = slot * self._size + start
                self._memory[place : place + len(data)] = data
                ends.append(start + len(data))
                return False

        return PickledResult(
            pickle.dumps(result, protocol=5, buffer_callback=is_pickled), slot, ends
        )

    def take(self, packed: PickledResult) -> Any:  # noqa: ANN401 - whatever was packed
        """Return a result; its slot is free then, since its buffers are views of a copy."""
        import pickle  # noqa: PLC0415 - as in _Fork

        if packed.slot is None:
            return pickle.loads(packed.pickled)  # noqa: S301 - of a process of this program
        start = packed.slot * self._size
        data = memoryview(self._memory[start : start + packed.ends[-1]])
        starts = [0, *packed.ends[:-1]]
        buffers = [data[a:b] for a, b in zip(starts, packed.ends, strict=True)]
        return pickle.loads(packed.pickled, buffers=buffers)  # noqa: S301 - as above

    def close(self) -> None:
        """Release the memory."""
        self._memory.close()
