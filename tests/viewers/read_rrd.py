# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is in an .rrd file, by Rerun's own reader."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any, NamedTuple

from rerun.chunk import RrdReader

from kitti_ros2.viewers.rerun_viewer import write_file

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from kitti_ros2.player.program import Program
    from kitti_ros2.viewers.rerun_show import ShowReport


class Row(NamedTuple):
    """Components of an entity at a moment; None and None where they hold for all time."""

    stamp_ns: int | None
    frame: int | None
    components: dict[str, Any]


class Rrd:
    """The rows of each entity, in order of time; those of one time by their components.

    The SDK writes rows of one time in any order: a thread collects them in chunks, every few
    milliseconds.
    """

    def __init__(self, path: Path) -> None:
        self.rows: dict[str, list[Row]] = defaultdict(list)
        self.timelines: set[str] = set()
        self.blueprints = RrdReader(path).blueprints()
        for chunk in RrdReader(path).stream():
            self.timelines |= set(chunk.timeline_names)
            self._add(chunk)
        for rows in self.rows.values():
            rows.sort(key=_order)

    def _add(self, chunk: Any) -> None:
        batch = chunk.to_record_batch()
        names = batch.schema.names
        for place in range(batch.num_rows):
            components = {
                name: values.as_py() if _small(name) else _array(values)
                for name in names
                if ':' in name and (values := batch.column(name)[place]).is_valid
            }
            stamp = batch.column('time')[place].value if 'time' in names else None
            frame = batch.column('frame')[place].as_py() if 'frame' in names else None
            self.rows[chunk.entity_path].append(Row(stamp, frame, components))

    def having(self, entity: str, component: str) -> list[tuple[int, Any]]:
        """(stamp, value) of each row of an entity with a component."""
        return [
            (row.stamp_ns, row.components[component])
            for row in self.rows[entity]
            if component in row.components
        ]

    def one(self, entity: str, component: str) -> Any:
        """The only value there is."""
        ((_, value),) = self.having(entity, component)
        return value


def _order(row: Row) -> tuple[int, list[str]]:
    """By time; rows of one time are in chunks of any order."""
    return -1 if row.stamp_ns is None else row.stamp_ns, sorted(row.components)


def _small(name: str) -> bool:
    return name.split(':')[1] not in {'positions', 'blob', 'buffer', 'colors', 'sample'}


def _array(values: Any) -> np.ndarray:
    """The numbers of a batch, flat."""
    inner = values.values
    while hasattr(inner.type, 'value_type'):
        inner = inner.flatten()
    return inner.to_numpy(zero_copy_only=False)


def show_in(path: Path, program: Program) -> tuple[Rrd, ShowReport]:
    """Show a program in a file, and read it."""
    report = write_file(program, path, lambda _done, _bytes: None)
    program.close()
    return Rrd(path), report
