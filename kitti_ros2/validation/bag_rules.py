# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about a whole bag: container, metadata, schemas, frames, cameras and their images."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

from ..bags.locate import METADATA
from ..messages.naming import FrameNames
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_in

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ..rig.tf_tree import FrameTree

Size = tuple[int, int]
_MOST_UNPAIRED = 64
"""Sizes that are kept of a topic, to be compared with the other one of the same stamp."""
_UNDEFINED = 'it is copied as it is'
_GROUND_TRUTH = '/kitti/ground_truth/'
"""Topics of to-bag, whose frames may be a tree of their own."""
_FIXED = frozenset({'', 'map', 'odom', 'world', 'earth'})


class CameraSizes:
    """Sizes of images and of the CameraInfo beside them, paired by their stamps.

    Both may change within a bag: the frames of an object set have several sizes.
    """

    def __init__(self) -> None:
        self._latest: dict[str, dict[int, Size]] = defaultdict(dict)
        self._all: dict[str, set[Size]] = defaultdict(set)
        self._infos: dict[str, set[str]] = defaultdict(set)
        self._images: dict[str, set[str]] = defaultdict(set)
        self._paired: dict[tuple[str, str], tuple[Size, Size] | None] = {}

    def add_info(self, topic: str, stamp_ns: int, size: Size) -> None:
        """Enter the size of a CameraInfo."""
        namespace = topic.rpartition('/')[0]
        if namespace:
            self._infos[namespace].add(topic)
            self._enter(topic, stamp_ns, size)
            for image in self._images[namespace]:
                self._compare(topic, image, stamp_ns)

    def add_image(self, topic: str, stamp_ns: int, size: Size) -> None:
        """Enter the size of an image."""
        namespace, image, _ = topic.rpartition('/image')
        if image and namespace:
            self._images[namespace].add(topic)
            self._enter(topic, stamp_ns, size)
            for info in self._infos[namespace]:
                self._compare(info, topic, stamp_ns)

    def _enter(self, topic: str, stamp_ns: int, size: Size) -> None:
        latest = self._latest[topic]
        latest[stamp_ns] = size
        if len(latest) > _MOST_UNPAIRED:
            del latest[next(iter(latest))]
        if len(self._all[topic]) < _MOST_UNPAIRED:
            self._all[topic].add(size)

    def _compare(self, info: str, image: str, stamp_ns: int) -> None:
        sizes = self._latest[info].get(stamp_ns), self._latest[image].get(stamp_ns)
        if sizes[0] is not None and sizes[1] is not None and not self._paired.get((info, image)):
            self._paired[info, image] = None if sizes[0] == sizes[1] else (sizes[0], sizes[1])

    def differences(self) -> Iterator[tuple[str, Size, str, Size]]:
        """Yield topics of CameraInfo and images whose sizes differ, with the first of these.

        Without equal stamps they differ if no size is that of both.
        """
        for namespace, infos in sorted(self._infos.items()):
            for info, image in product(sorted(infos), sorted(self._images[namespace])):
                sizes = self._paired.get((info, image))
                apart = self._all[info].isdisjoint(self._all[image])
                if (info, image) not in self._paired and apart:
                    sizes = min(self._all[info]), min(self._all[image])
                if sizes is not None:
                    yield info, sizes[0], image, sizes[1]


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
        sizes: Of CameraInfo and images.
        per_frame: Whether the bag is an object set of to-bag, with a calibration a frame.
    """

    path: Path
    losses: Sequence[str] = ()
    notes: Sequence[str] = ()
    left_out: Sequence[str] = ()
    messages: int = 0
    tree: FrameTree | None = None
    changing: Sequence[tuple[str, str]] = ()
    frames: dict[str, str] = field(default_factory=dict)
    sizes: CameraSizes = field(default_factory=CameraSizes)
    per_frame: bool = False

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
    for parent, child in () if bag.per_frame else bag.changing:
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
    for info, size, image, shape in bag.sizes.differences():
        text = f'{info} is for {size[0]}x{size[1]}, {image} has {shape[0]}x{shape[1]}'
        yield Breach(text, bag.path)


_BAG = RuleScope.BAG
_ERROR = RuleSeverity.ERROR
_WARNING = RuleSeverity.WARNING
_NOTE = RuleSeverity.NOTE

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
        'subscribers use the last value: stop one of two publishers; to-kitti --layout object'
        ' writes the calibration of each frame',
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
