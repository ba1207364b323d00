# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The oxts packets of a plan: one a frame, from the Imu, fix and velocity around its stamp."""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.oxts import Mounting, has_orientation, make_packet, place_of
from ..model.geographic import GeoOrigin
from ..model.geometry import Transform
from ..model.losses import Loss, format_numbers
from ..model.stamps import NS_PER_S
from ..model.streams import Stream
from .between_messages import fix_between, imu_between, velocity_between
from .derived_velocity import SLOWEST_FIX_M_S, DerivedVelocities, metres_of
from .oxts_poses import as_velocity
from .plan import VelocityAxes
from .planned_topics import topic_of
from .unit_checks import UnitChecks, acceleration_unit, scaled_accelerations

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import TypeAlias

    import numpy.typing as npt

    from ..kitti.writer import LayoutWriter
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array, OxtsPacket
    from .frames import Frames
    from .oxts_poses import UnitPoses
    from .plan import Plan
    from .survey import Survey

    _Between: TypeAlias = Callable[[Any, Any, float], Any]

_MAX_FIX_GAP_NS = 2 * NS_PER_S + NS_PER_S // 2
"""Receivers send their position once a second or more often; one lost fix is bridged."""

_BRIDGED_PERIODS = 2.5
"""The same of the other messages: one that is lost is bridged."""

_USUAL_PERIODS = 1.5
"""Fixes farther apart have one between them that is lost."""

_OR = ', or messages that cannot be decoded,'
_IDENTITY = Transform.identity()
_BETWEEN: tuple[_Between, ...] = (imu_between, fix_between, velocity_between)


class PacketMaker:
    """Makes packets while a bag is read; keeps only a few frames of messages in memory.

    Imu, position and velocity are interpolated between the messages before and after the frame's
    stamp; of positions between those with a fix. Where one of these is missing, the nearest counts,
    within the plan's tolerance or its own period. Without a velocity it is derived from the places.

    Attributes:
        losses: Frames without a packet, where the layout has a line for each.
    """

    def __init__(
        self,
        plan: Plan,
        survey: Survey,
        frames: Frames,
        turns: Mapping[str, Transform],
        unit: UnitPoses,
    ) -> None:
        """Select the required messages.

        Args:
            plan: Names the topics.
            survey: Their stamps.
            frames: The frames.
            turns: By topic its frame in KITTI's imu frame.
            unit: Poses that take the place of the fix.

        Raises:
            UsageError: A topic is missing.
        """
        self._notes: list[str] = [*unit.notes]
        self._lacking = 0
        self.losses: tuple[Loss, ...] = ()
        self._frames_ns = frames.stamps_ns
        self._unit = unit
        self._topics = {
            'imu': plan.imu,
            'fix': plan.fix,
            'velocity': plan.velocity or unit.velocity,
        }
        self._mounting = self._mounted(plan, turns)
        named = {role: topic for role, topic in self._topics.items() if topic}
        self._imu_unit = self._acceleration_unit(plan.imu, survey)
        self._stamps = {topic: topic_of(survey, topic).stamps()[0] for topic in named.values()}
        self._tolerance_ns = round(plan.tolerance_s * NS_PER_S)
        self._far: dict[str, list[int]] = {}
        gaps = np.diff(np.sort(self._stamps[plan.fix])) if plan.fix else np.zeros(0)
        self._usual_gap_ns = _USUAL_PERIODS * float(np.median(gaps)) if len(gaps) else 0.0
        self._carried_m: list[float] = []
        self._bridged: list[tuple[int, float]] = []
        fixed = np.isfinite(topic_of(survey, plan.fix).fixes[:, 0]) if plan.fix else None
        self._velocities = self._find_velocities(survey, fixed)
        velocity = self._topics['velocity']
        self._velocity_of = velocity if velocity and topic_of(survey, velocity).moves else ''
        self._derived = 0
        wanted = {
            role: self._around(topic, _MAX_FIX_GAP_NS, fixed)
            if role == 'fix'
            else self._around(topic, 0)
            for role, topic in named.items()
        }
        self._wanted = self._parts_of_frames(wanted)
        self._without_fix = [part is None for part in wanted.get('fix', ())]
        self._gapless = Stream.OXTS in plan.layout.traits.line_streams
        self._forbid_gaps()
        self._pending: dict[int, dict[tuple[str, int], Any]] = {}
        self._frames_of: dict[tuple[str, int], list[int]] = {}
        for frame, parts in enumerate(self._wanted):
            for part in parts or ():
                self._frames_of.setdefault(part, []).append(frame)
        self._ready: dict[int, OxtsPacket | None] = {}
        self._next = 0
        self._unoriented: list[int] = []
        self._checks = UnitChecks()

    def _mounted(self, plan: Plan, turns: Mapping[str, Transform]) -> Mounting:
        """Return how the sensors of the topics are mounted in KITTI's imu frame."""
        unit, velocity = self._unit, self._topics['velocity']
        placed = {**turns, unit.velocity: unit.imu_T_velocity} if unit.velocity else turns
        return Mounting(
            placed.get(plan.imu, _IDENTITY),
            placed.get(velocity, _IDENTITY),
            placed.get(plan.fix, _IDENTITY),
            plan.velocity_axes is VelocityAxes.ENU,
        )

    def _acceleration_unit(self, imu: str, survey: Survey) -> float:
        """Return the m/s^2 of the unit of a topic's accelerations, and note one that is not 1."""
        unit = acceleration_unit(topic_of(survey, imu)) if imu else 1.0
        if unit != 1:
            self._notes.append(
                f"{imu}: its accelerations are in g, as Livox' drivers give them; they are"
                f' multiplied by {unit}'
            )
        return unit

    def _find_velocities(
        self, survey: Survey, fixed: npt.NDArray[np.bool_] | None
    ) -> DerivedVelocities | None:
        """Return the velocities by the poses or by the fixes, None without either."""
        fix = self._topics['fix']
        if self._unit.moving is not None or fixed is None:
            return self._unit.moving
        stamps, first = np.unique(self._stamps[fix][fixed], return_index=True)
        places = metres_of(topic_of(survey, fix).fixes[fixed][first])
        return DerivedVelocities(stamps, places, _MAX_FIX_GAP_NS, SLOWEST_FIX_M_S)

    def _moving(self, frame: int) -> Float64Array | None:
        """Return the velocity of a frame by the places, None where it is not known."""
        places = self._velocities
        return None if places is None else places.at(int(self._frames_ns[frame]))

    def _parts_of_frames(
        self, by_role: Mapping[str, Sequence[set[tuple[str, int]] | None]]
    ) -> list[set[tuple[str, int]] | None]:
        """Return the messages of each frame's packet, None without one.

        With poses a packet needs no message: columns of those that are not near are 0.
        """
        if 'velocity' in by_role:
            optional = [
                set() if part is None and self._moving(frame) is not None else part
                for frame, part in enumerate(by_role['velocity'])
            ]
            by_role = {**by_role, 'velocity': optional}
        poses, wanted = self._unit.poses, list(by_role.values())
        if poses is None:
            return [
                None if None in parts else {part for each in parts for part in each or ()}
                for parts in zip(*wanted, strict=True)
            ]
        self._notes += [
            f'oxts: no message of {self._topics[role]} near {parts.count(None)} frames; its columns'
            f' are 0 there'
            for role, parts in by_role.items()
            if None in parts
        ]
        return [
            None if pose is None else {part for parts in wanted for part in parts[frame] or ()}
            for frame, pose in enumerate(poses)
        ]

    @property
    def topics(self) -> set[str]:
        """The topics to read."""
        return {topic for topic, _ in self._frames_of}

    def notes(self) -> list[str]:
        """Return non-fatal remarks on the packets so far."""
        told = [
            f'oxts: {topic} has no message within the tolerance of {len(away)} frames, which take'
            f' the nearest: up to {max(away) / NS_PER_S:.2f} s away{self._metres(topic)}'
            for topic, away in self._far.items()
        ]
        if self._bridged:
            longest, farthest = (max(values) for values in zip(*self._bridged, strict=True))
            told.append(
                f'oxts: {self._topics["fix"]} has no fix beside {len(self._bridged)} frames, whose'
                f' places lie between fixes that are up to {longest / NS_PER_S:.2f} s and'
                f' {farthest:.2f} m apart'
            )
        if self._derived:
            velocity, place = self._topics['velocity'], self._topics['fix']
            why = f', for {velocity} has none (all are 0)' if velocity != self._velocity_of else ''
            source = place if self._unit.poses is None else 'the poses'
            told.append(
                f'oxts: the velocities of {self._derived} packets are derived from the places of'
                f' {source}{why}'
            )
        if self._lacking and not self._gapless:
            told.append(f'{self._lacking} frames have no fix{_OR} and get no packet')
        if self._unoriented:
            told.append(self._without_orientation())
        attitude = self._topics['imu'] if self._unit.poses is None and not self._unoriented else ''
        told += self._checks.notes(self._topics['imu'], self._velocity_of, attitude)
        return [*self._notes, *told]

    def _without_orientation(self) -> str:
        """Return the note on packets whose Imu has no orientation, by frames unless all are."""
        packets = sum(parts is not None for parts in self._wanted)
        some = len(self._unoriented) < packets
        where = f' near frames {format_numbers(sorted(self._unoriented))}, where' if some else ';'
        fix = self._topics['fix']
        places = f', and the places those of {fix}' if fix else ''
        return f'{self._topics["imu"]}: no orientation{where} roll, pitch and yaw are 0{places}'

    def _metres(self, topic: str) -> str:
        """Return how far the places of fixes were carried on."""
        if topic != self._topics['fix'] or not self._carried_m:
            return ''
        return f', and are carried on by up to {max(self._carried_m):.2f} m, by the velocity there'

    def wants(self, topic: str, place: int) -> bool:
        """Whether a message, by its place in its topic, is part of a packet."""
        return (topic, place) in self._frames_of

    def take(self, topic: str, place: int, message: Any) -> None:  # noqa: ANN401 - of the bag
        """Take a required message; None where it cannot be decoded."""
        part = (topic, place)
        for frame in self._frames_of.pop(part):
            found = self._pending.setdefault(frame, {})
            found[part] = message if message is None else self._prepared(topic, message)
            if found.keys() == self._wanted[frame]:
                self._ready[frame] = self._make(frame, self._pending.pop(frame))

    def _prepared(self, topic: str, message: Any) -> Any:  # noqa: ANN401 - of the bag
        if topic == self._topics['imu'] and self._imu_unit != 1:
            return scaled_accelerations(message, self._imu_unit)
        return as_velocity(message)

    def write(self, writer: LayoutWriter, first: int) -> int:
        """Write the packets that are ready, in order; returns how many."""
        count = 0
        while self._next < len(self._wanted):
            parts = self._wanted[self._next]
            if parts is not None and not parts:
                self._ready[self._next] = self._make(self._next, {})
            if parts is not None and self._next not in self._ready:
                break
            packet = self._ready.pop(self._next, None)
            if packet is not None:
                stamp_ns = int(self._frames_ns[self._next])
                writer.write_oxts(first + self._next, stamp_ns, packet)
                self._checks.take(stamp_ns, packet)
                count += 1
            elif self._wanted[self._next] is not None:
                self._lack()
            self._next += 1
        return count

    def _lack(self) -> None:
        """Count a frame whose messages have no fix, or cannot be decoded."""
        self._lacking += 1
        if self._gapless:
            self._lose(
                f'oxts ends before frame {self._next}, which has no fix{_OR}',
                len(self._wanted) - self._next,
            )
            self._wanted.clear()
            self._frames_of.clear()

    def _lose(self, reason: str, frames: int) -> None:
        """Enter the frames that go without a packet although others near them have one."""
        topic = next(filter(None, self._topics.values()), Stream.OXTS.value)
        rest = f'{reason}: line n is frame n, so {frames} frames go without'
        self.losses = (Loss(topic, frames, rest),)

    def _around(
        self, topic: str, most_ns: int, usable: npt.NDArray[np.bool_] | None = None
    ) -> list[set[tuple[str, int]] | None]:
        """Return the messages of a topic that each frame needs: two, one, or None for none near.

        Args:
            topic: Its name.
            most_ns: The longest gap that is bridged, if it is longer than some periods.
            usable: (N,) which messages count; None for all.
        """
        kept = np.arange(len(self._stamps[topic])) if usable is None else np.flatnonzero(usable)
        stamps = self._stamps[topic][kept]
        if not len(stamps):
            return [None] * len(self._frames_ns)
        every = np.sort(self._stamps[topic])
        period = int(np.median(np.diff(every))) if len(every) > 1 else 0
        most_ns = max(most_ns, round(_BRIDGED_PERIODS * period))
        places = _nearest(stamps, self._frames_ns)
        away = np.abs(stamps[places] - self._frames_ns)
        far = away > max(self._tolerance_ns, period)
        order = np.argsort(stamps, kind='stable')
        ranked = stamps[order]
        after = np.searchsorted(ranked, self._frames_ns)
        wanted: list[set[tuple[str, int]] | None] = []
        for frame, place in enumerate(after.tolist()):
            between = away[frame] > 0 and 0 < place < len(stamps)
            if between and ranked[place] - ranked[place - 1] <= most_ns:
                wanted.append({(topic, int(kept[at])) for at in order[place - 1 : place + 1]})
            else:
                wanted.append(None if far[frame] else {(topic, int(kept[places[frame]]))})
        return wanted

    def _forbid_gaps(self) -> None:
        """Require packets of all frames in the tracking layout, where line n is frame n."""
        lacking = [frame for frame, parts in enumerate(self._wanted) if parts is None]
        if not lacking:
            return
        source = 'imu, fix or velocity near' if self._unit.poses is None else 'poses around'
        if self._without_fix and all(self._without_fix[frame] for frame in lacking):
            source = 'fix near'
        which = f'no {source} frames {format_numbers(lacking)}'
        first = lacking[0]
        if self._gapless and first and source == 'fix near':
            text = f'oxts ends before frame {first}, which has no fix near'
            self._lose(text, len(self._wanted) - first)
            del self._wanted[first:]
        elif self._gapless:
            self._lose(f'{which}, so {Stream.OXTS.value} is left out', len(self._wanted))
            self._wanted = []
        else:
            self._notes.append(which)

    def _make(self, frame: int, found: Mapping[tuple[str, int], Any]) -> OxtsPacket | None:
        by_topic: dict[str, list[tuple[int, Any]]] = {topic: [] for topic, _ in found}
        for (topic, place), message in found.items():
            if message is not None:
                by_topic[topic].append((place, message))
        if not all(by_topic.values()):
            return None
        imu, fix, velocity = (
            self._at(frame, topic, by_topic[topic], between) if topic in by_topic else None
            for topic, between in zip(self._topics.values(), _BETWEEN, strict=True)
        )
        pose = None if self._unit.poses is None else self._unit.poses[frame]
        if imu is not None and pose is None and not has_orientation(imu):
            self._unoriented.append(frame)
        packet = make_packet(
            imu,
            fix,
            velocity,
            mounting=self._mounting,
            pose=pose,
            moving=self._derive(frame, velocity),
        )
        still = self._unit.place
        if packet is None or still is None:
            return packet
        return replace(packet, lat=still.lat, lon=still.lon, alt=still.alt)

    def _derive(self, frame: int, velocity: Any) -> Float64Array | None:  # noqa: ANN401 - as _at
        """Return the velocity of a frame by its places, None where a message has it, or without."""
        has_one = self._velocity_of and velocity is not None
        moving = None if has_one else self._moving(frame)
        self._derived += moving is not None and bool(moving.any())
        return moving

    def _at(
        self, frame: int, topic: str, messages: list[tuple[int, Any]], between: _Between
    ) -> Any:  # noqa: ANN401 - of the bag
        """Return what lies between the two messages around a frame, or the only one."""
        stamps = self._stamps[topic]
        known = sorted(((int(stamps[each[0]]), each[1]) for each in messages), key=itemgetter(0))
        frame_ns = int(self._frames_ns[frame])
        (found_ns, found), (end_ns, last) = known[0], known[-1]
        if found_ns != end_ns:
            mixed = between(found, last, (frame_ns - found_ns) / (end_ns - found_ns))
            if mixed is not found and mixed is not last:
                if topic == self._topics['fix'] and end_ns - found_ns > self._usual_gap_ns:
                    way = metres_of(np.array([place_of(found), place_of(last)]))[1]
                    self._bridged.append((end_ns - found_ns, float(np.linalg.norm(way))))
                return mixed
            found_ns, found = (found_ns, found) if mixed is found else (end_ns, last)
        if abs(frame_ns - found_ns) > self._tolerance_ns:
            self._far.setdefault(topic, []).append(abs(frame_ns - found_ns))
        if topic == self._topics['fix']:
            return self._carried(found, frame, frame_ns - found_ns)
        return found

    def _carried(self, fix: Any, frame: int, later_ns: int) -> Any:  # noqa: ANN401 - of the bag
        """Return a fix before a frame, or after it, carried on by the velocity of the places."""
        moving = self._moving(frame) if later_ns else None
        if moving is None or not moving.any():
            return fix
        way = moving * (later_ns / NS_PER_S)
        self._carried_m.append(float(np.linalg.norm(way)))
        place = GeoOrigin(fix.latitude, fix.longitude, fix.altitude).moved(*way.tolist())
        return replace(fix, latitude=place.lat, longitude=place.lon, altitude=place.alt)


def _nearest(stamps: Int64Array, wanted: Int64Array) -> Int64Array:
    """Return (M,) index of the stamp nearest to each of (M,) requested ones."""
    order = np.argsort(stamps, kind='stable')
    ranked = stamps[order]
    after = np.clip(np.searchsorted(ranked, wanted), 1, max(len(ranked) - 1, 1))
    before = after - 1
    later = np.minimum(after, len(ranked) - 1)
    nearer = np.abs(ranked[later] - wanted) < np.abs(ranked[before] - wanted)
    return order[np.where(nearer, later, before)].astype(np.int64)
