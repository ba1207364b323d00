# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plan by which bags would be converted, before anything is written."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..importer.apply_plan import adapt, guess
from ..importer.convert_scans import labelled_fields
from ..importer.plan_overview import streams_of_topics
from ..importer.plan_text import parse_plan
from ..importer.survey import look
from ..kitti.store import STORE
from ..model.errors import MissingDataError, UsageError
from ..model.layouts import Layout, LayoutTraits
from ..model.streams import Stream
from .to_kitti import is_restored, own_bags, selected, with_tracklets

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..bags.reader import OpenBag
    from ..importer.plan import Plan
    from ..importer.survey import Survey
    from ..options.importing import ImportOptions
    from .blueprint import Blueprint


@dataclass(frozen=True)
class Outlook:
    """The plan of a conversion.

    Attributes:
        survey: The content of the bags.
        plan: The plan that was given, or the one that was guessed.
        options: Of the conversion, with the layout and the selection of the plan.
        notes: Remarks, missing data and damage, a line each.
        restored: Whether to-bag wrote the bags and no option changes that: without a plan the
            original files come back.
        reason: Why the layout was chosen; empty if it was given.
        layouts: Without a given layout: by possible layout the streams that it would have.
    """

    survey: Survey
    plan: Plan
    options: ImportOptions
    notes: tuple[str, ...]
    restored: bool = False
    reason: str = ''
    layouts: Mapping[Layout, tuple[str, ...]] | None = None


def make_outlook(
    bags: Sequence[OpenBag],
    options: ImportOptions,
    plan_file: Path | None = None,
    *,
    any_layout: bool = False,
) -> Outlook:
    """Survey bags, and make or read the plan of their conversion.

    Args:
        bags: Those of one recording.
        options: Of the conversion.
        plan_file: A plan to use.
        any_layout: Whether a missing layout is chosen by the content of the bags.

    Raises:
        KittiRos2Error: A bag, the plan or an option is invalid.
    """
    own, damaged = own_bags(bags, options, planned=plan_file is not None)
    if plan_file is not None:
        plan = adapt(parse_plan(STORE.read_text(plan_file), plan_file), options)
        survey = with_tracklets(look(bags), own)
        options = replace(options, selection=selected(own, plan, options))
        return Outlook(survey, plan, options, (*survey.notes, *survey.losses))
    restored = is_restored(own, options)
    notes: tuple[str, ...] = ()
    if own:
        options, notes = _as_recorded(own[0][1], options)
    survey = with_tracklets(look(bags), own)
    reason, layouts = '', None
    if options.layout is None and any_layout:
        plans = _every_plan(bags, survey, options)
        layout, reason = _choose_layout(plans, survey)
        options = replace(options, layout=layout)
        layouts = {each: _streams(plan, survey) for each, plan in plans.items()}
    found = guess(bags, survey, options)
    notes += (*found.notes, *(loss.text() for loss in (*damaged, *found.losses)))
    notes += (*survey.notes, *survey.losses)
    options = replace(options, selection=selected(own, found.plan, options))
    notes = tuple(dict.fromkeys(notes))
    return Outlook(survey, found.plan, options, notes, restored, reason, layouts)


def _as_recorded(
    blueprint: Blueprint, options: ImportOptions
) -> tuple[ImportOptions, tuple[str, ...]]:
    """Return the options with layout and name of a bag written by to-bag, and a note about it."""
    if options.layout in (None, blueprint.layout):
        named = options.name or blueprint.name
        options = replace(options, layout=blueprint.layout, name=named)
    name = blueprint.name
    return options, (f'made by to-bag: without a plan every file of {name} comes back as it was',)


def _every_plan(
    bags: Sequence[OpenBag], survey: Survey, options: ImportOptions
) -> dict[Layout, Plan]:
    """Return the plans of all layouts that are possible.

    Raises:
        MissingDataError: None is.
    """
    found, errors = {}, []
    for layout in Layout:
        try:
            found[layout] = guess(bags, survey, replace(options, layout=layout)).plan
        except (MissingDataError, UsageError) as error:
            errors.append(error)
    if not found:
        raise errors[-1]
    return found


_PREFERENCES: Sequence[tuple[Callable[[LayoutTraits, Plan, Survey], bool], str]] = (
    (lambda traits, plan, _: traits.frame_set and plan.labels is not None, 'the bag has 3D boxes'),
    (
        lambda traits, plan, survey: traits.point_labels and _are_labelled(plan, survey),
        'the points have labels',
    ),
    (lambda traits, plan, _: traits.dated and bool(plan.fix), 'the bag has GPS'),
    (
        lambda traits, plan, _: Stream.POSE in traits.streams and plan.pose is not None,
        'the bag has poses',
    ),
    (lambda traits, _plan, _: traits.frame_set, 'the bag has neither 3D boxes nor GPS nor poses'),
    (lambda _traits, _plan, _: True, 'the first that is possible'),
)
"""What a bag has, and which layout most programs expect for it: the first that is possible."""


def _are_labelled(plan: Plan, survey: Survey) -> bool:
    return plan.scan is not None and bool(labelled_fields(survey.topics[plan.scan.topic]))


def _choose_layout(plans: Mapping[Layout, Plan], survey: Survey) -> tuple[Layout, str]:
    """Return the layout that most programs expect for the content of a bag, and the reason."""
    return next(
        (layout, reason)
        for fits, reason in _PREFERENCES
        for layout, plan in plans.items()
        if fits(layout.traits, plan, survey)
    )


def _streams(plan: Plan, survey: Survey) -> tuple[str, ...]:
    """Return the streams of a plan, by name."""
    found = {name for names in streams_of_topics(plan, survey).values() for name in names}
    return tuple(each.value for each in Stream if each.value in found)
