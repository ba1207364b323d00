# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One data set a camera (--all-cameras), with frames and scans in common.

Scans that are turned to the camera (scan.forward: camera) are those of each set.

A set of layout object is a split named after its camera (training_CAM_BACK), and ImageSets lists
the frames that are whole in all of them. Another layout has a folder a camera (CAM_BACK).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..files.hard_links import FilePlacer
from ..kitti import names
from ..kitti.store import STORE
from ..model.errors import UnsynchronisedError, UsageError
from ..model.streams import Stream
from .clocks import clocked
from .convert import build
from .frames import choose_frames, pick_frames, select_frames
from .plan import TF
from .poses import read_motion
from .report import LossTally
from .scan_frame import CAMERA
from .set_builder import Target

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..bags.reader import BagSource
    from ..options.importing import ImportOptions
    from ..options.selection import SelectionOptions
    from ..rig.pose_track import Track
    from .frames import Frames
    from .plan import Plan
    from .report import ImportReport
    from .survey import Survey

_CAMERA = 2
_SCANS = frozenset({names.SCANS, names.RAW_SCANS, names.POINT_LABELS})


def plans_of(plan: Plan) -> dict[str, Plan]:
    """Return the plan of each camera's set, by the set's name; the plan itself without sets.

    Raises:
        UsageError: The calibration is not that of each camera.
    """
    if not plan.camera_sets:
        return {plan.name: plan}
    if plan.calibration != TF:
        raise UsageError(
            f'calibration: {plan.calibration}; expected tf, for each of camera_sets has its own'
        )
    labels = None if plan.labels is None else replace(plan.labels, camera=_CAMERA)
    return {
        name: replace(plan, cameras={_CAMERA: camera}, labels=labels, camera_sets={})
        for name, camera in plan.camera_sets.items()
    }


def folder_of(plan: Plan, name: str) -> str:
    """Return the folder of a camera's set in the output."""
    return f'{plan.name}_{name}' if plan.layout.traits.frame_set else name


def build_sets(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    stage: Path,
    options: ImportOptions,
    progress: Callable[[int, int], None],
) -> list[ImportReport]:
    """Convert bags into one data set a camera, below the folder stage.

    Raises:
        BadBagError, UsageError, MissingDataError: As apply_plan.convert_by_plan.
        OSError: A file cannot be written.
    """
    plans = plans_of(plan)
    common = common_frames(bags, plans, survey, options.selection)
    reports: list[ImportReport] = []
    first: Path | None = None
    shared = bool(common) and not (plan.scan is not None and plan.scan.forward == CAMERA)
    done = [0, 0]

    def show(samples: int, size_bytes: int) -> None:
        progress(done[0] + samples, done[1] + size_bytes)

    for name, one in plans.items():
        without = frozenset({Stream.SCAN}) if first is not None and shared else frozenset()
        target = Target(stage / name, 0, common.get(name), without)
        report = build(bags, one, survey, target, options, show)
        if first is not None and shared:
            _link_scans(first, target.stage)
        first = first or stage / name
        done = [done[0] + sum(report.counts.values()), done[1] + report.size_bytes]
        known = {loss for each in reports for loss in each.losses}  # of topics in common
        losses = tuple(loss for loss in report.losses if loss not in known)
        told = {
            note for each in reports for note in each.notes if note.startswith(names.IMAGE_SETS)
        }
        notes = tuple(note for note in report.notes if note not in told)
        reports.append(replace(report, name=folder_of(plan, name), losses=losses, notes=notes))
    if plan.layout.traits.frame_set:
        _beside_each_other(stage, plan, plans)
    return reports


def common_frames(
    bags: Sequence[BagSource],
    plans: Mapping[str, Plan],
    survey: Survey,
    selection: SelectionOptions,
) -> dict[str, Frames]:
    """Return the frames that all sets have, by set; none if the frames are those of each camera.

    Raises:
        UsageError: As frames_of_sets.
    """
    plan = next(iter(plans.values()))
    if _is_own(plan):
        return {}
    track = read_motion(bags, plan, clocked(survey, plan), LossTally()).of_frames
    return frames_of_sets(plans, survey, track, selection)


def frames_of_sets(
    plans: Mapping[str, Plan],
    survey: Survey,
    track: Track | None,
    selection: SelectionOptions,
) -> dict[str, Frames]:
    """Choose the frames of each set, by its name: those that all have, unless they are its images.

    Args:
        plans: The result of plans_of.
        survey: Of the bags.
        track: As choose_frames.
        selection: Of the frames.

    Raises:
        UsageError: No frame is whole in all sets, or the selection takes none.
    """
    if len(plans) == 1 or _is_own(next(iter(plans.values()))):
        return {
            name: _frames_of(name, each, survey, track, selection) for name, each in plans.items()
        }
    found = {name: _frames_of(name, each, survey, track) for name, each in plans.items()}
    keys = {name: _keys(frames) for name, frames in found.items()}
    kept = set.intersection(*(set(each.tolist()) for each in keys.values()))
    if not kept:
        raise UsageError(
            'no frame is whole in all cameras; widen tolerance_s of the plan, or remove cameras'
            ' from its camera_sets'
        )
    wanted = np.array(sorted(kept))
    return {
        name: select_frames(pick_frames(frames, np.isin(keys[name], wanted)), selection)
        for name, frames in found.items()
    }


def _is_own(plan: Plan) -> bool:
    """Whether the frames of a set are its images."""
    return plan.reference == f'image_{_CAMERA}'


def _frames_of(
    name: str,
    plan: Plan,
    survey: Survey,
    track: Track | None,
    selection: SelectionOptions | None = None,
) -> Frames:
    """Choose the frames of a set; its camera has another key in the plan of all sets."""
    try:
        return choose_frames(plan, survey, track, selection)
    except UnsynchronisedError as error:
        keys = f'cameras.{_CAMERA}.', f'camera_sets.{name}.'
        raise UnsynchronisedError(str(error).replace(*keys)) from None


def _keys(frames: Frames) -> np.typing.NDArray[np.int64]:
    """Return (N,) what tells frames apart in all sets: the scan, else the stamp."""
    return frames.samples.get(Stream.SCAN, frames.stamps_ns)


def _link_scans(source: Path, target: Path) -> None:
    """Place the scans of one set in another, as hard links where the file system has them."""
    placer = FilePlacer(copy=False)
    for path in sorted(source.rglob('*')):
        place = target / path.relative_to(source)
        in_scans = _SCANS.intersection(path.relative_to(source).parts)
        if in_scans and path.is_file() and not place.exists():
            placer.place(path, place)


def _beside_each_other(stage: Path, plan: Plan, plans: Mapping[str, Plan]) -> None:
    """Move splits from folders of their own to their places; keep the frames that all list."""
    lists: dict[str, list[str]] = {}
    for name in plans:
        folder = stage / name / names.IMAGE_SETS
        for listed in STORE.names(folder):
            lines = STORE.read_text(folder / listed).splitlines()
            lists[listed] = [line for line in lists.get(listed, lines) if line in set(lines)]
            (folder / listed).unlink()
        folder.rmdir()
        (stage / name / plan.name).rename(stage / folder_of(plan, name))
        (stage / name).rmdir()
    for listed, lines in lists.items():
        text = ''.join(f'{line}\n' for line in lines)
        STORE.write_text(stage / names.IMAGE_SETS / listed, text)
