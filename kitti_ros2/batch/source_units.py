# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The units of a collection of bags, or of recordings and bags."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..bags.mistaken import explain_file, explain_no_bag
from ..bags.search import bags_among, stem_of
from ..kitti.find import absolute
from ..kitti.nearby import explain
from ..model.errors import NotABagError, UsageError
from .folders import common_folder, relative_name
from .units import WorkUnit, in_order, recordings_at

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from ..model.layouts import Layout
    from .folders import FolderSearch


def find_bag_units(roots: Sequence[Path], search: FolderSearch) -> list[WorkUnit]:
    """Find the bags of a collection; the endings of files are no part of the names of units.

    Args:
        roots: Bags, and folders of any number of them.
        search: Knows which folders are left out; gets those that could not be read.

    Raises:
        KittiRos2Error: There is no bag, or the outputs of two would be at one place.
        OSError: A root cannot be read.
    """
    base = common_folder(roots)
    found: dict[Path, WorkUnit] = {}
    for root in roots:
        bags = list(bags_at(root, search)) if root.exists() else []
        if not bags:
            found_none = (
                'has no bag, nor has a folder below it'
                if root.exists()
                else 'there is no such file or directory'
            )
            raise search.nothing() or explain_no_bag(root, NotABagError(root, found_none))
        for bag in bags:
            name = stem_of(bag) if bag.is_file() else bag.name
            place = Path(relative_name(bag, base)).with_name(name)
            found.setdefault(bag, WorkUnit(place.as_posix(), bag))
    units = in_order(found.values(), roots)
    _refuse_nested(units)
    return units


def _refuse_nested(units: Iterable[WorkUnit]) -> None:
    """Refuse two outputs of which one lies inside the other."""
    bags = {unit.name: unit.source for unit in units}
    for name, bag in bags.items():
        for parent in Path(name).parents:
            other = bags.get(parent.as_posix())
            if other is not None:
                raise UsageError(
                    f'{bag}: its data set would lie inside that of {other}; choose among them with'
                    f' a glob or a list'
                )


def find_source_units(
    roots: Sequence[Path], layout: Layout | None, search: FolderSearch
) -> list[WorkUnit]:
    """Find the recordings and the bags of a collection; names of bags have their endings.

    Args:
        roots: Recordings, data sets, bags, and folders of any number of them.
        layout: Only recordings of this layout, and no bags; None takes all.
        search: Knows which folders are left out; gets those that could not be read.

    Raises:
        KittiRos2Error: A root has none, a layout is ambiguous, or two units have one name.
        OSError: A root cannot be read.
    """
    base = common_folder(roots)
    found: dict[tuple[Path, str | None], WorkUnit] = {}
    for root in roots:
        units = recordings_at(root, base, layout, search) if root.is_dir() else []
        if layout is None and root.exists():
            units += [WorkUnit(relative_name(bag, base), bag) for bag in bags_at(root, search)]
        if not units:
            raise search.nothing() or (explain_file(root) if root.is_file() else explain(root))
        for unit in units:
            found.setdefault((unit.source, unit.sequence), unit)
    return in_order(found.values(), roots)


def bags_at(root: Path, search: FolderSearch) -> Iterator[Path]:
    """Yield the bags at a path and below it, except within the folder of another.

    Args:
        root: A folder, or a file, which is taken as a bag whatever its name.
        search: As in find_bag_units.

    Raises:
        OSError: The root cannot be read.
    """
    place = absolute(root)
    if place.is_file():
        yield place
        return
    found: list[Path] = []

    def visit(folder: Path, folders: Sequence[str], others: Sequence[str]) -> Sequence[str]:
        bags = bags_among(folder, others)
        found.extend(bags)
        return () if bags == [folder] else folders

    search.walk(place, visit)
    yield from found
