# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about the stamps and the QoS of a topic in a bag."""

from __future__ import annotations

import time
from array import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..bags.offered_qos import qos_faults
from ..model.stamps import NS_PER_S, format_stamp
from ..model.text import format_count
from .rule import Breach, Rule, RuleScope, RuleSeverity

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..model.samples import Int64Array

_EARLIEST_NS = 946_684_800 * NS_PER_S
"""2000-01-01 UTC: the clock of a simulation begins at 0."""
_DAY_NS = 86_400 * NS_PER_S
_ONE_CLOCK_NS = 60 * NS_PER_S
_WIDE_GAP = 10.0
_LEAST_GAP_NS = NS_PER_S
_LEAST_MESSAGES = 10


@dataclass(eq=False)
class TopicTrack:
    """The stamps of a topic.

    Attributes:
        bag: The bag.
        topic: Its name.
        latched: Whether its publisher keeps the last messages for late subscribers.
        has_qos: Whether the bag stores the QoS of publishers.
        profiles: rosbag2's text of it.
        log_ns: Log times, in the order of the bag.
        header_ns: Stamps of the messages' headers, for types that have one.
    """

    bag: Path
    topic: str
    latched: bool = False
    has_qos: bool = True
    profiles: str = ''
    log_ns: array[int] = field(default_factory=lambda: array('q'))
    header_ns: array[int] = field(default_factory=lambda: array('q'))

    def breach(self, text: str) -> Breach:
        """Return a breach of the topic."""
        return Breach(f'{self.topic}: {text}', self.bag)

    def headers(self) -> Int64Array:
        """Return the header stamps that are not 0."""
        stamps: Int64Array = np.array(self.header_ns, np.int64)
        known: Int64Array = stamps[stamps != 0]
        return known


def _find_backward(track: TopicTrack) -> Iterator[Breach]:
    stamps = track.headers()
    backward = np.flatnonzero(np.diff(stamps) < 0)
    if len(backward) and not track.latched:
        first = int(backward[0])
        count = format_count(len(backward), 'stamp')
        by = (int(stamps[first]) - int(stamps[first + 1])) / NS_PER_S
        yield track.breach(f'{count} before the one above, first by {by:.3g} s')


def _find_zero(track: TopicTrack) -> Iterator[Breach]:
    zeros = sum(stamp == 0 for stamp in track.header_ns)
    if zeros and not track.latched:
        yield track.breach(f'{zeros} of {len(track.header_ns)} header stamps are 0')


def _find_future(track: TopicTrack) -> Iterator[Breach]:
    latest = time.time_ns() + _DAY_NS
    for name, stamps in (('header stamp', track.header_ns), ('log time', track.log_ns)):
        last = max(stamps, default=0)
        if last > latest:
            yield track.breach(f'the last {name} is {_moment(last)}')


def _find_late(track: TopicTrack) -> Iterator[Breach]:
    if track.latched or len(track.header_ns) != len(track.log_ns):
        return
    header, log = np.array(track.header_ns, np.int64), np.array(track.log_ns, np.int64)
    dated = (header > _EARLIEST_NS) & (log > _EARLIEST_NS)
    delays = (log - header)[dated]
    far = np.abs(delays) > _ONE_CLOCK_NS
    if far.any():
        text = f'{int(far.sum())} of {len(header)} header stamps are'
        yield track.breach(f'{text} {delays[far][0] / NS_PER_S:.0f} s from their log times')


def _find_gap(track: TopicTrack) -> Iterator[Breach]:
    if len(track.log_ns) < _LEAST_MESSAGES or track.latched:
        return
    gaps = np.diff(np.sort(np.array(track.log_ns, np.int64)))
    usual, widest = float(np.median(gaps)), int(gaps.max())
    steady = float(np.percentile(gaps, 90)) < 2 * usual
    if steady and widest > max(_WIDE_GAP * usual, _LEAST_GAP_NS):
        text = f'a gap of {widest / NS_PER_S:.1f} s; usual are {usual / NS_PER_S:.3g} s'
        yield track.breach(text)


def _find_unlatched(track: TopicTrack) -> Iterator[Breach]:
    if track.topic.endswith('tf_static') and track.has_qos and not track.latched:
        yield track.breach('its publisher does not offer durability transient local')


def _find_qos_faults(track: TopicTrack) -> Iterator[Breach]:
    for fault in qos_faults(track.profiles):
        yield track.breach(fault)


def _moment(stamp_ns: int) -> str:
    try:
        return f'{format_stamp(stamp_ns)} UTC'
    except (OverflowError, ValueError):
        return f'{stamp_ns} ns'


_STREAM = RuleScope.STREAM
_WARNING = RuleSeverity.WARNING

TOPIC_RULES: tuple[Rule[TopicTrack], ...] = (
    Rule(
        'header-order',
        _WARNING,
        _STREAM,
        'Header stamps of a topic do not go back',
        'several publishers on the topic, or a clock that was set; to-kitti uses log times then',
        _find_backward,
    ),
    Rule(
        'header-zero',
        _WARNING,
        _STREAM,
        'Header stamps are not 0',
        'set header.stamp in the publisher; to-kitti uses log times then',
        _find_zero,
    ),
    Rule(
        'header-late',
        _WARNING,
        _STREAM,
        'Header stamps are within 60 s of the log times',
        'recorded from another bag, or the clocks of the machines differ',
        _find_late,
    ),
    Rule(
        'bag-future',
        _WARNING,
        _STREAM,
        'Stamps are not in the future',
        'check the clock of the machine, and the unit: nanoseconds',
        _find_future,
    ),
    Rule(
        'bag-gap',
        _WARNING,
        _STREAM,
        'Topics of a steady rate have no gap of 1 s and ten periods',
        'messages were dropped while recording: check the disk, or the QoS',
        _find_gap,
    ),
    Rule(
        'bag-latched',
        _WARNING,
        _STREAM,
        '/tf_static is latched (QoS durability transient local)',
        'record with --qos-profile-overrides-path, else late subscribers get no frames',
        _find_unlatched,
    ),
    Rule(
        'bag-qos',
        _WARNING,
        _STREAM,
        'Offered QoS profiles have known policies, and publishers of a topic agree',
        'ros2 bag play falls back to another QoS: give it --qos-profile-overrides-path',
        _find_qos_faults,
    ),
)
