# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's own packets are in KITTI's axes; those of drivers with others are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kitti_ros2.importer.oxts_packets import OxtsChecks
from kitti_ros2.kitti.kitti_recording import geographic_positions
from kitti_ros2.kitti.text_file import COLUMNS, parse_packet
from kitti_ros2.messages.oxts import encode_fix, encode_imu, encode_velocity, make_packet
from kitti_ros2.model.samples import OxtsPacket
from kitti_ros2.model.streams import GeoOrigin

STEP_NS = 100_000_000
ZEROS = dict.fromkeys(COLUMNS, 0) | {'posmode': 3, 'velmode': -1, 'orimode': -1}


def packets():
    """A car that drives 8 m/s along a bend of 0.3 rad/s, as its messages make it."""
    stamps = np.arange(40) * 0.1
    yaws = 0.5 + 0.3 * stamps
    ways = 8.0 / 0.3 * np.column_stack([np.sin(yaws) - np.sin(0.5), np.cos(0.5) - np.cos(yaws)])
    places = geographic_positions(np.column_stack([ways, 0 * yaws]), GeoOrigin(49.0, 8.4, 110.0))
    for yaw, (lat, lon, alt) in zip(yaws.tolist(), places.tolist(), strict=True):
        columns = {'lat': lat, 'lon': lon, 'alt': alt, 'yaw': yaw, 'wz': 0.3, 'ax': 0.1}
        columns |= {'ay': 2.4, 'az': 9.8, 've': 8 * np.cos(yaw), 'vn': 8 * np.sin(yaw)}
        packet = OxtsPacket(**(ZEROS | columns))
        yield made_of(packet)


def made_of(packet, change=lambda imu, fix, velocity: (imu, fix, velocity)):
    messages = (encode(packet, 0, 'imu') for encode in (encode_imu, encode_fix, encode_velocity))
    return make_packet(*change(*messages))


def notes_of(found, seconds=0.1, attitude='/imu'):
    checks = OxtsChecks()
    for place, packet in enumerate(found):
        checks.take(round(place * seconds * 1e9), packet)
    return list(checks.notes('/imu', '/vel', attitude))


def turned(degrees):
    """The heading and the axes of accelerations and rates, and not the velocity east and north."""

    def change(packet):
        return replace(packet, yaw=packet.yaw + np.radians(degrees))

    return change


CHANGES = {
    'as they are': (lambda each: each, []),
    'backwards': (turned(180), []),
    'from the start of the drive': (turned(-50), ['its heading is 50 degrees in the median from']),
    'to the right from north': (
        lambda each: replace(each, yaw=np.pi / 2 - each.yaw),
        ['its heading is'],
    ),
    'of a world of z down': (
        lambda each: replace(each, af=each.af, al=-each.al, au=-each.au),
        ['gravity is -9.8 m/s^2 up'],
    ),
    'without gravity': (lambda each: replace(each, al=0.2, au=0.1), ['are without gravity (0.2']),
    'in g': (
        lambda each: replace(each, af=each.af / 9.81, al=each.al / 9.81, au=each.au / 9.81),
        ['/imu: its accelerations look like g (1.00 up in the mean'],
    ),
    'along the axes of the car': (
        lambda each: replace(each, ve=8.0, vn=0.0),
        ['its velocities are off by'],
    ),
}


@pytest.mark.parametrize('name', CHANGES)
def test_axes_that_are_others_are_told(name):
    change, said = CHANGES[name]
    notes = notes_of(map(change, packets()))
    assert len(notes) == len(said), notes
    assert all(words in note for words, note in zip(said, notes, strict=True))


def test_accelerations_in_g_are_told_without_an_orientation_too():
    change, said = CHANGES['in g']
    (note,) = notes_of(map(change, packets()), attitude='')
    assert said[0] in note
    change, _ = CHANGES['without gravity']
    assert notes_of(map(change, packets()), attitude='') == []


def test_a_unit_that_stands_says_nothing_of_its_heading():
    first = next(packets())
    still = replace(first, ve=0.0, vn=0.0, yaw=first.yaw + 2)
    assert notes_of([still] * 40) == []


@pytest.mark.parametrize('drive', ['0001', '0005'])
def test_kitti_s_own_packets_are_in_its_axes(drive, real_kitti):
    folder = real_kitti / f'raw/2011_09_26/2011_09_26_drive_{drive}_sync/oxts/data'
    parsed = [parse_packet(file.read_text(), file) for file in sorted(folder.iterdir())]
    assert notes_of(parsed, 0.1033) == []
