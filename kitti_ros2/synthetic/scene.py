# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The objects of the synthetic street: upright boxes in lanes beside the ego lane.

A lane is the ego lane shifted in y: negative to the right. Objects of one lane have the same
speed, so they never collide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, hypot, pi, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.geometry import Transform, rotation_from_rpy
from .path import COURSE, Course
from .rig import CAR_T_VELO

if TYPE_CHECKING:
    from collections.abc import Iterator

ROAD_CENTRE = 1.75
ROAD_RIGHT, ROAD_LEFT = -4.5, 7.6
REACH = 125.0
"""Greatest distance of a visible box's centre from the scanner, metres."""

_BEHIND, _AHEAD = 130.0, 160.0
_ONCOMING_SPEED = 9.0
_WALKING, _CYCLING = 1.3, 4.4


class Look(NamedTuple):
    """The appearance of a box: a style of textures.py, a variant of it, and a reflectance."""

    style: str
    variant: int
    reflectance: float


@dataclass(frozen=True)
class Solid:
    """An upright box and how it moves along its lane.

    Attributes:
        look: Its appearance.
        size: Length, width, height, metres.
        x: Along the street at time 0; for a leader, ahead of the ego car.
        lane: Shift of its lane in y, metres.
        height: Of its bottom above the ground, metres.
        turn: Heading against the street's, radians.
        speed: Along the street, m/s.
        leads: Whether it keeps ahead of the ego car instead.
        class_name: Class of its label, None for an unlabelled object.
        track_id: Its identity, -1 for an unlabelled object.
    """

    look: Look
    size: tuple[float, float, float]
    x: float
    lane: float
    height: float = 0.0
    turn: float = 0.0
    speed: float = 0.0
    leads: bool = False
    class_name: str | None = None
    track_id: int = -1

    def along(self, time: float, course: Course) -> float:
        """Return its position along the street at a time, street frame x, metres."""
        if self.leads:
            return course.ego_x(time) + self.x + 1.5 * sin(0.4 * time)
        return self.x + self.speed * time

    def pose(self, time: float, course: Course) -> Transform:
        """Return street_T_solid: its bottom face's centre, x along its length."""
        x = self.along(time, course)
        rotation = rotation_from_rpy(0.0, 0.0, course.yaw(x) + self.turn)
        return Transform(rotation, np.array([x, course.y(x) + self.lane, self.height]))


@dataclass(frozen=True)
class PlacedSolid:
    """A solid at one moment, in the scanner's frame.

    Attributes:
        solid: The box.
        centre: Bottom face's centre in velo_link, metres.
        yaw: Its heading about velo_link's z, radians.
    """

    solid: Solid
    centre: tuple[float, float, float]
    yaw: float

    @property
    def distance(self) -> float:
        """Return the distance from the scanner to its centre on the ground, metres."""
        return hypot(self.centre[0], self.centre[1])

    def footprint(self) -> tuple[tuple[float, float], ...]:
        """Return the four corners (x, y) in velo_link, counter-clockwise."""
        length, width, _ = self.solid.size
        c, s = cos(self.yaw), sin(self.yaw)
        corners = ((length, width), (-length, width), (-length, -width), (length, -width))
        return tuple(
            (
                self.centre[0] + (c * dx - s * dy) / 2,
                self.centre[1] + (s * dx + c * dy) / 2,
            )
            for dx, dy in corners
        )


def place_solids(
    solids: tuple[Solid, ...], time: float, street_T_car: Transform, course: Course = COURSE
) -> list[PlacedSolid]:
    """Return the solids within range of the scanner at a time, nearest first."""
    velo_t_street = (street_T_car @ CAR_T_VELO).inverse()
    ego = street_T_car.translation[0]
    placed = []
    for solid in solids:
        if abs(solid.along(time, course) - ego) > REACH:
            continue
        pose = velo_t_street @ solid.pose(time, course)
        x, y, z = (float(value) for value in pose.translation)
        yaw = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
        placed.append(PlacedSolid(solid, (x, y, z), yaw))
    return sorted(placed, key=lambda one: one.distance)


def build_street(seed: int, duration: float, speed: float = COURSE.speed) -> tuple[Solid, ...]:
    """Return all objects of a drive of a duration in seconds; track ids count from 0."""
    rng = np.random.default_rng([seed, 1])
    end = speed * duration + _AHEAD
    solids = [*_traffic(rng, end, duration), *_parked(rng, end), *_people(rng, end, duration)]
    labelled = [replace(solid, track_id=track_id) for track_id, solid in enumerate(solids)]
    return (*labelled, *_buildings(rng, end), *_furniture(rng, end))


def _every(
    rng: np.random.Generator, start: float, end: float, gap: float, chance: float
) -> Iterator[float]:
    """Yield positions from about start to end, gap apart, each with a probability."""
    for x in np.arange(start + rng.uniform(0.0, gap), end, gap):
        if rng.random() < chance:
            yield float(x)


def _vehicle(rng: np.random.Generator, class_name: str) -> tuple[Look, tuple[float, float, float]]:
    length, width, height = {'Car': (4.1, 1.72, 1.5), 'Van': (4.9, 1.9, 2.0)}.get(
        class_name, (7.2, 2.4, 3.0)
    )
    stretch = rng.uniform(0.94, 1.06)
    look = Look(class_name, int(rng.integers(8)), float(rng.uniform(0.08, 0.6)))
    return look, (length * stretch, width * rng.uniform(0.97, 1.03), height)


def _traffic(rng: np.random.Generator, end: float, duration: float) -> Iterator[Solid]:
    """Make a car ahead of the ego car, and oncoming ones in the other lane."""
    look, size = _vehicle(rng, 'Car')
    yield Solid(look, size, x=19.0, lane=0.0, leads=True, class_name='Car')
    for x in _every(rng, -100.0, end + _ONCOMING_SPEED * duration, 29.0, 0.8):
        class_name = 'Van' if rng.random() < 0.2 else 'Car'
        look, size = _vehicle(rng, class_name)
        yield Solid(
            look,
            size,
            x + rng.uniform(-6, 6),
            3.5,
            turn=pi,
            speed=-_ONCOMING_SPEED,
            class_name=class_name,
        )


def _parked(rng: np.random.Generator, end: float) -> Iterator[Solid]:
    """Make rows of parked cars on both sides, trucks only on the right."""
    for lane, turn, chance in ((-3.3, 0.0, 0.55), (6.4, pi, 0.5)):
        for x in _every(rng, -_BEHIND, end, 8.4, chance):
            class_name = str(rng.choice(['Car', 'Van', 'Truck'], p=[0.84, 0.12, 0.04]))
            if class_name == 'Truck' and turn:
                class_name = 'Car'
            look, size = _vehicle(rng, class_name)
            yield Solid(
                look, size, x + rng.uniform(-0.2, 0.2), lane, turn=turn, class_name=class_name
            )


def _people(rng: np.random.Generator, end: float, duration: float) -> Iterator[Solid]:
    """Make pedestrians on four lanes of the pavements, cyclists on one."""
    spare = _CYCLING * duration
    for lane, speed in ((-7.0, _WALKING), (-7.8, -_WALKING), (9.3, _WALKING), (10.1, -_WALKING)):
        for x in _every(rng, -_BEHIND - spare, end + spare, 13.0, 0.45):
            size = (rng.uniform(0.5, 0.9), rng.uniform(0.5, 0.7), rng.uniform(1.6, 1.85))
            look = Look('Pedestrian', int(rng.integers(6)), float(rng.uniform(0.15, 0.5)))
            turn = 0.0 if speed > 0 else pi
            shift = rng.uniform(-4, 4)
            yield Solid(
                look, size, x + shift, lane, turn=turn, speed=speed, class_name='Pedestrian'
            )
    for x in _every(rng, -_BEHIND - spare, end, 31.0, 0.7):
        look = Look('Cyclist', int(rng.integers(6)), 0.3)
        yield Solid(look, (1.8, 0.62, 1.75), x, -5.3, speed=_CYCLING, class_name='Cyclist')


def _buildings(rng: np.random.Generator, end: float) -> Iterator[Solid]:
    """Make two rows of houses, some with a gap beside them; bays of 2.5 m, storeys of 3 m."""
    for face, side in ((-8.8, -1.0), (11.2, 1.0)):
        x = -_BEHIND
        while x < end:
            length = 2.5 * int(rng.integers(4, 8))
            height = 3.0 * int(rng.integers(2, 5))
            look = Look('Building', int(rng.integers(5)), float(rng.uniform(0.2, 0.4)))
            set_back = face + side * (5.0 + rng.choice([0.0, 0.0, 0.8]))
            yield Solid(look, (length, 10.0, height), x + length / 2, set_back)
            x += length + rng.choice([0.05, 0.05, 4.0])
    for x in np.arange(-_BEHIND, end, 15.0):
        for lane in (-24.0, 27.0):
            yield Solid(Look('Hedge', 0, 0.45), (14.9, 3.0, 4.5), float(x), lane)


def _furniture(rng: np.random.Generator, end: float) -> Iterator[Solid]:
    """Make trees and lamp posts between the parked cars and the pavements."""
    for lane in (-6.2, 8.3):
        for x in _every(rng, -_BEHIND, end, 11.0, 0.6):
            crown = rng.uniform(1.3, 1.6)
            yield Solid(Look('Trunk', 0, 0.25), (0.26, 0.26, 2.4), x, lane)
            yield Solid(Look('Crown', 0, 0.45), (crown, crown, rng.uniform(2, 3)), x, lane, 2.4)
        for x in np.arange(-_BEHIND, end, 33.0):
            yield Solid(Look('Post', 0, 0.6), (0.14, 0.14, 6.0), float(x), lane * 1.05)
