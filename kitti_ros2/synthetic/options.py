# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the synthetic recording."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

from ..model.errors import UsageError
from .path import COURSE, Course

MAX_FRAMES = 10_000
FULL_SIZE = (1242, 375)


@dataclass(frozen=True)
class SyntheticOptions:
    """Options of the synthetic recording: the same options give the same bytes.

    Attributes:
        frames: Number of frames, at 10 Hz.
        seed: Of the street: objects, places and colours.
        image_size: (width, height) in pixels; the projections scale with it.
        lidar_columns: Firings per turn; each is 64 rays.
        range_noise_m: Standard deviation of the ranges; 0 puts points exactly on the surfaces.
        speed: Mean speed of the car, m/s.
        turn_rate: Of the car in the middle of bends, degrees a second; None is a gentle one that
            grows with the speed, 4 at 8 m/s.
        rest: Seconds for which the car stands before it drives off; it reaches its speed 6 s later.
            None: it drives from the beginning.
        swept: Whether points are measured while the scanner turns, as by KITTI's; else a scan is a
            snapshot.
        extract: Whether the raw layout also has the 100 Hz packets of the unsynchronised drive; the
            packets of the synchronised drive are then some of them.
    """

    frames: int = 20
    seed: int = 0
    image_size: tuple[int, int] = FULL_SIZE
    lidar_columns: int = 2000
    range_noise_m: float = 0.0
    speed: float = COURSE.speed
    turn_rate: float | None = None
    rest: float | None = None
    swept: bool = False
    extract: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.frames <= MAX_FRAMES:
            raise UsageError(f'frames is {self.frames}; expected 1 to {MAX_FRAMES}')
        if self.seed < 0:
            raise UsageError(f'seed is {self.seed}; expected 0 or more')
        width, height = self.image_size
        if not (16 <= width <= 8192 and 16 <= height <= 8192):
            raise UsageError(f'image_size is {width}x{height}; expected 16 to 8192 pixels a side')
        if not 16 <= self.lidar_columns <= 20_000:
            raise UsageError(f'lidar_columns is {self.lidar_columns}; expected 16 to 20000')
        if not 0.0 <= self.range_noise_m <= 1.0:
            raise UsageError(f'range_noise_m is {self.range_noise_m}; expected 0 to 1')
        if not 1.0 <= self.speed <= 50.0:
            raise UsageError(f'speed is {self.speed}; expected 1 to 50 m/s')
        if self.turn_rate is not None and not 0.0 < self.turn_rate <= 60.0:
            raise UsageError(f'turn_rate is {self.turn_rate}; expected above 0, to 60 degrees/s')
        if self.rest is not None and not 0.0 <= self.rest <= 1000.0:
            raise UsageError(f'rest is {self.rest}; expected 0 to 1000 s')

    @property
    def course(self) -> Course:
        """The lane and the car on it."""
        if self.turn_rate is None:
            return Course(self.speed, rest=self.rest)
        return Course.turning(self.speed, radians(self.turn_rate), self.rest)
