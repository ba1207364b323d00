# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The values of the sections of frames, route, objects and calibration; None without data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import OCCLUSIONS
from ..model.streams import Clock
from .contents import NUMBER, TEXT, Table
from .plots import class_colour, course_plot, histogram_plot, shares_bar
from .rig_plot import MOST_FRAMES, mounts_of, rig_plot
from .route_plot import route_plot
from .statistics import histogram

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ..model.route import Route
    from .contents import Report
    from .glances import CameraGlance
    from .rig_plot import Mount
    from .statistics import ClassFacts, ClassStatistics

_EDGES_M = tuple(range(0, 100, 10))
_MOST_HISTOGRAMS = 9


def frames_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section with pictures of a few frames."""
    if not report.scenes:
        return None
    frames = report.frames or len(report.scenes)
    timed = report.clock is Clock.UTC
    return {'scenes': report.scenes, 'frames': f'{frames:,}', 'timed': timed}


def route_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section of the route."""
    route = report.route
    if route is None:
        return None
    speed = ''
    if report.clock is not Clock.NOMINAL and route.duration_s > 0:
        speed = f', {route.length_m / route.duration_s:.1f} m/s in the mean'
    climb = float(np.ptp(route.positions[:, 2]))
    words = (
        f'{route.length_m:.1f} m along {len(route.positions):,} poses{speed};'
        f' {route.net_m:.1f} m from start to end, {climb:.1f} m between the lowest and the highest.'
    )
    plot = route_plot('route-plot', route.positions[:, :2], words)
    return {
        'words': words,
        'jumps': route.jumps,
        'timed': report.clock is not Clock.NOMINAL,
        'plot': plot,
        'courses': list(_courses(route)),
    }


def _courses(route: Route) -> Iterator[tuple[str, str, str]]:
    """Yield name, extent and plot of speed, altitude and yaw over time."""
    times = (route.stamps_ns - route.stamps_ns[0]) / 1e9
    heights, place, axis = route.positions[:, 2] - route.positions[0, 2], 'the start', 'the x axis'
    if route.altitude_m is not None:
        heights, place, axis = route.positions[:, 2] + route.altitude_m, 'sea level', 'east'
    courses = (
        ('Speed', 'm/s', route.speeds_m_s, ''),
        ('Altitude', 'm', heights, f'above {place}'),
        ('Yaw', 'deg', np.degrees(route.yaws_rad), f'counter-clockwise from {axis}'),
    )
    for name, unit, values, remark in courses:
        known = np.isfinite(values)
        if known.sum() > 1:
            plot = course_plot(f'course-{name.lower()}', name, times[known], values[known], unit)
            extent = f'{np.nanmin(values):.1f} to {np.nanmax(values):.1f} {unit}'
            yield name, f'{extent} {remark}', plot


def objects_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section of labelled objects."""
    classes = report.classes
    if classes is None:
        return None
    words = (
        f'{classes.count:,} objects in {classes.labelled:,} of {classes.frames:,} frames'
        f' ({classes.count / max(classes.frames, 1):.1f} a frame).'
    )
    if classes.dont_care:
        words += f' {classes.dont_care:,} regions are without labels (DontCare).'
    distances = [
        (
            each.class_name,
            f'{np.median(each.distances_m):.1f} m',
            histogram_plot(
                f'distance-{place}',
                f'Distances of {each.class_name}',
                _EDGES_M,
                histogram(each.distances_m, _EDGES_M),
                'metres from the scanner',
                class_colour(each.class_name),
            ),
        )
        for place, each in enumerate(classes.classes[:_MOST_HISTOGRAMS])
        if len(each.distances_m)
    ]
    return {'words': words, 'table': _class_table(classes), 'distances': distances}


def _class_table(classes: ClassStatistics) -> Table:
    found = classes.classes
    occluded = any(each.occlusions is not None for each in found)
    tracked = any(each.tracks is not None for each in found)
    cut = any(each.truncated is not None for each in found)
    columns = [('Class', TEXT), ('Objects', NUMBER), ('Frames', NUMBER), ('A frame', NUMBER)]
    columns += [('Most', NUMBER)] + [('Tracks', NUMBER)] * tracked
    columns += [(name.capitalize(), NUMBER) for name in OCCLUSIONS if occluded]
    columns += [('Occlusion', TEXT)] * occluded + [('Truncated', NUMBER)] * cut
    rows = [
        [
            each.class_name,
            f'{each.count:,}',
            f'{each.frames:,}',
            f'{each.count / max(classes.frames, 1):.2f}',
            f'{each.most:,}',
            *([_count(each.tracks)] if tracked else []),
            *(_occlusions(each) if occluded else []),
            *([_count(each.truncated)] if cut else []),
        ]
        for each in found
    ]
    return Table('Labelled objects by class', columns, rows)


def _count(count: int | None) -> str:
    return '' if count is None else f'{count:,}'


def _occlusions(facts: ClassFacts) -> list[str]:
    if facts.occlusions is None:
        return [''] * (len(OCCLUSIONS) + 1)
    return [*(f'{count:,}' for count in facts.occlusions), shares_bar(facts.occlusions)]


def calibration_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section of sensor poses and camera intrinsics."""
    mounts = mounts_of(report.overview.links)
    cameras = report.overview.cameras
    if not (report.projections or len(mounts) > 1 or cameras):
        return None
    values: dict[str, object] = {
        'projections': report.projections,
        'mounts': None,
        'cameras': _camera_table(cameras) if cameras else None,
    }
    if len(mounts) > 1:
        drawn = mounts[:MOST_FRAMES]
        values |= {
            'mounts': _mount_table(mounts),
            'left': len(mounts) - len(drawn),
            'above': rig_plot('rig-top', drawn, side=False),
            'beside': rig_plot('rig-side', drawn, side=True),
        }
    return values


def _mount_table(mounts: Sequence[Mount]) -> Table:
    order = {mount.name: str(place + 1) for place, mount in enumerate(mounts)}
    columns = [('Frame', TEXT), ('On', NUMBER), ('Distance m', NUMBER)]
    columns += [(f'{axis} m', NUMBER) for axis in 'xyz']
    columns += [(f'{angle} \N{DEGREE SIGN}', NUMBER) for angle in ('Roll', 'Pitch', 'Yaw')]
    rows = [
        [
            {'order': order[mount.name], 'name': mount.name},
            order[mount.parent] if mount.parent else '',
            f'{mount.distance_m:.3f}' if mount.parent else '',
            *([f'{value + 0.0:.3f}' for value in mount.xyz_m] or [''] * 3),
            *([f'{value + 0.0:.2f}' for value in mount.rpy_deg] or [''] * 3),
        ]
        for mount in mounts
    ]
    return Table('Where each frame is in the axes of the one that it is on', columns, rows)


def _camera_table(cameras: Sequence[CameraGlance]) -> Table:
    columns = [('Camera', TEXT), ('Size', NUMBER)]
    columns += [(name, NUMBER) for name in ('fx', 'fy', 'cx', 'cy', 'Field of view', 'Baseline m')]
    rows = []
    for each in cameras:
        name, *pixels, baseline = each.cells()
        size = f'{each.width} \N{MULTIPLICATION SIGN} {each.height}' if each.width else 'by image'
        rows.append([name, size, *pixels, _field_of_view(each), baseline])
    return Table('Intrinsics of the rectified cameras, in pixels', columns, rows)


def _field_of_view(camera: CameraGlance) -> str:
    if not camera.width or camera.fx is None or camera.fx <= 0:
        return ''
    angle = 2 * np.degrees(np.arctan(camera.width / 2 / camera.fx))
    return f'{angle:.1f}\N{DEGREE SIGN}'
