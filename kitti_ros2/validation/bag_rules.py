# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about a whole bag: container, metadata, schemas, frames, cameras and their images."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..bags.locate import METADATA
from ..messages.naming import FrameNames
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_in

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ..rig.tf_tree import FrameTree

Size = tuple[int, int]
_UNDEFINED = 'it is copied as it is'
_GROUND_TRUTH = '/kitti/ground_truth/'
"""Topics of to-bag, whose frames may be a tree of their own."""
_FIXED = frozenset({'', 'map', 'odom', 'world', 'earth'})


@dataclass(eq=False)
class BagFacts:
    """What is known of a bag after one pass.

    Attributes:
        path: The bag.
        losses: Damage, one line each.
        notes: Remarks that are no damage.
        left_out: Topics that cannot be read, and why.
        messages: Number of messages.
        tree: Its frames; None without transforms.
        changing: Static links that were published with two values.
        frames: Frames of the headers, each with a topic that has it.
        cameras: Size by topic of each CameraInfo.
        images: Size by topic of each image.
    """

    path: Path
    losses: Sequence[str] = ()
    notes: Sequence[str] = ()
    left_out: Sequence[str] = ()
    messages: int = 0
    tree: FrameTree | None = None
    changing: Sequence[tuple[str, str]] = ()
    frames: dict[str, str] = field(default_factory=dict)
    cameras: dict[str, Size] = field(default_factory=dict)
    images: dict[str, Size] = field(default_factory=dict)

    def breach(self, text: str) -> Breach:
        """Return a breach in the bag, or in its file that a text begins with."""
        return breach_in(text, self.path)


def _find_damage(bag: BagFacts) -> Iterator[Breach]:
    for text in bag.losses:
        if METADATA not in text:
            yield bag.breach(text)


def _find_metadata(bag: BagFacts) -> Iterator[Breach]:
    for text in (*bag.losses, *bag.notes):
        if METADATA in text:
            yield bag.breach(text)


def _find_notes(bag: BagFacts) -> Iterator[Breach]:
    for text in bag.notes:
        if METADATA not in text and _UNDEFINED not in text:
            yield bag.breach(text)


def _find_unreadable(bag: BagFacts) -> Iterator[Breach]:
    undefined = (text.partition(';')[0] for text in bag.notes if _UNDEFINED in text)
    for text in (*bag.left_out, *undefined):
        yield bag.breach(text)


def _find_empty(bag: BagFacts) -> Iterator[Breach]:
    if not bag.messages and not bag.losses:
        yield Breach('no messages', bag.path)


def _find_tree_faults(bag: BagFacts) -> Iterator[Breach]:
    for text in () if bag.tree is None else bag.tree.faults():
        yield Breach(text, bag.path)


def _find_changing(bag: BagFacts) -> Iterator[Breach]:
    for parent, child in bag.changing:
        yield Breach(f'{parent} -> {child} was published with two values', bag.path)


def _find_apart(bag: BagFacts) -> Iterator[Breach]:
    if bag.tree is None:
        return
    vehicle = bag.tree.root_of(FrameNames().base)
    truth = {frame for frame, topic in bag.frames.items() if topic.startswith(_GROUND_TRUTH)}
    roots = [root for root in bag.tree.roots if root == vehicle or root not in truth]
    if len(roots) > 1:
        yield Breach(f'{len(roots)} trees, of {", ".join(roots[:8])}', bag.path)


def _find_unknown_frames(bag: BagFacts) -> Iterator[Breach]:
    known = None if bag.tree is None else bag.tree.frames
    for frame, topic in sorted(bag.frames.items()):
        if known is not None and frame not in known and frame not in _FIXED:
            yield Breach(f'{topic}: frame {frame} is in no transform', bag.path)


def _find_other_size(bag: BagFacts) -> Iterator[Breach]:
    for topic, size in sorted(bag.cameras.items()):
        namespace = topic.rpartition('/')[0]
        for image, shape in sorted(bag.images.items()):
            ours = image.startswith(f'{namespace}/image') and namespace
            if ours and shape != size:
                text = f'{topic} is for {size[0]}x{size[1]}, {image} has {shape[0]}x{shape[1]}'
                yield Breach(text, bag.path)


_BAG = RuleScope.BAG
_ERROR, _WARNING, _NOTE = RuleSeverity.ERROR, RuleSeverity.WARNING, RuleSeverity.NOTE

BAG_RULES: tuple[Rule[BagFacts], ...] = (
    Rule(
        'bag-damage',
        _ERROR,
        _BAG,
        'Files are whole, and the checksums of chunks and summaries are right',
        'kitti-ros2 recover copies the readable messages',
        _find_damage,
    ),
    Rule(
        'bag-metadata',
        _ERROR,
        _BAG,
        'metadata.yaml exists, and agrees with the files',
        'ros2 bag reindex writes it again',
        _find_metadata,
    ),
    Rule(
        'bag-schema',
        _WARNING,
        _BAG,
        'Types are defined, and messages are CDR or of ROS 1',
        'the topics are left out; record them with their definitions',
        _find_unreadable,
    ),
    Rule(
        'bag-empty',
        _NOTE,
        _BAG,
        'Bags contain messages',
        'check that the topics were published while recording',
        _find_empty,
    ),
    Rule(
        'bag-note',
        _NOTE,
        _BAG,
        'Readers have no remarks',
        'nothing needs to be done: what is lost has a finding of its own',
        _find_notes,
    ),
    Rule(
        'tf-tree',
        _ERROR,
        _BAG,
        'Every frame has one parent, and there are no circles',
        'stop one of the publishers, or rename its frame',
        _find_tree_faults,
    ),
    Rule(
        'tf-changing',
        _WARNING,
        _BAG,
        'Static transforms do not change',
        'subscribers use the last value: stop one of the publishers',
        _find_changing,
    ),
    Rule(
        'tf-apart',
        _WARNING,
        _BAG,
        'All frames are in one tree',
        'publish or record the transforms between the trees',
        _find_apart,
    ),
    Rule(
        'tf-frame',
        _WARNING,
        _BAG,
        'Frames of headers are in the tree',
        'correct frame_id of the driver, or publish the transform',
        _find_unknown_frames,
    ),
    Rule(
        'camera-size',
        _ERROR,
        _BAG,
        'CameraInfo has the size of the images beside it',
        'load the calibration of this resolution in the driver',
        _find_other_size,
    ),
)
