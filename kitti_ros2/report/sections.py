# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The sections of frames, route, objects and calibration; None without data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..drawing.palette import rgb_of
from ..model.stamps import format_stamp
from ..model.streams import Clock
from .markup import Markup, breakable, element, join
from .plots import histogram_plot, shares_bar
from .rig_plot import MOST_FRAMES, mounts_of, rig_plot
from .route_plot import route_plot
from .statistics import OCCLUSIONS, histogram
from .tables import NUMBER, TEXT, captioned, pictured, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .contents import Report, Scene
    from .markup import Child
    from .overview import CameraGlance
    from .rig_plot import Mount
    from .statistics import ClassFacts, ClassStatistics

_EDGES_M = tuple(range(0, 100, 10))
_MOST_HISTOGRAMS = 9


def scenes_section(report: Report) -> Markup | None:
    """Make the section with pictures of a few frames."""
    if not report.scenes:
        return None
    frames = report.frames or len(report.scenes)
    words = f'{len(report.scenes)} of {frames:,}, spread over the recording.'
    return join(
        [
            element('p', words, class_='lead'),
            *[_scene(each, timed=report.clock is Clock.UTC) for each in report.scenes],
        ]
    )


def _scene(scene: Scene, *, timed: bool) -> Markup:
    when = f', {format_stamp(scene.stamp_ns)[11:-6]} UTC' if timed else ''
    shots = (('camera', scene.camera), ('points', scene.points), ('above', scene.above))
    pictures = [pictured(picture, place) for place, picture in shots if picture is not None]
    return element(
        'article',
        element('h3', f'Frame {scene.number}{when}'),
        element('p', ' \N{MIDDLE DOT} '.join(scene.words), class_='lead') if scene.words else None,
        element('div', pictures, class_='shots'),
    )


def route_section(report: Report) -> Markup | None:
    """Make the section of the route."""
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
    jumps = f' {route.jumps} jumps are not counted.' if route.jumps else ''
    drawn = route_plot('route-plot', route.positions[:, :2], words)
    caption = 'Seen from above, the same scale both ways.'
    return join(
        [
            element('p', words + jumps, class_='lead'),
            element('div', captioned(drawn, caption), class_='single'),
        ]
    )


def objects_section(report: Report) -> Markup | None:
    """Make the section of labelled objects."""
    classes = report.classes
    if classes is None:
        return None
    words = (
        f'{classes.count:,} objects in {classes.labelled:,} of {classes.frames:,} frames'
        f' ({classes.count / max(classes.frames, 1):.1f} a frame).'
    )
    if classes.dont_care:
        words += f' {classes.dont_care:,} regions are without labels (DontCare).'
    plots = [
        captioned(
            histogram_plot(
                f'distance-{place}',
                f'Distances of {each.kind}',
                _EDGES_M,
                histogram(each.distances_m, _EDGES_M),
                'metres from the scanner',
            ),
            element('b', each.kind),
            f' median {np.median(each.distances_m):.1f} m',
        )
        for place, each in enumerate(classes.classes[:_MOST_HISTOGRAMS])
        if len(each.distances_m)
    ]
    return join(
        [
            element('p', words, class_='lead'),
            _class_table(classes) if classes.classes else None,
            element('h3', 'Distances') if plots else None,
            element('div', plots, class_='grid') if plots else None,
        ]
    )


def _class_table(classes: ClassStatistics) -> Markup:
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
            join([_swatch(each.kind), breakable(each.kind)]),
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
    return table('Labelled objects by class', columns, rows)


def _swatch(kind: str) -> Markup:
    """Draw the colour of a class in the pictures."""
    red, green, blue = rgb_of(kind)
    patch = element('rect', width=12, height=12, rx=3, fill=f'#{red:02x}{green:02x}{blue:02x}')
    return element('svg', patch, viewBox='0 0 12 12', class_='swatch', aria_hidden='true')


def _count(count: int | None) -> str:
    return '' if count is None else f'{count:,}'


def _occlusions(facts: ClassFacts) -> list[Child]:
    if facts.occlusions is None:
        return [''] * (len(OCCLUSIONS) + 1)
    return [*(f'{count:,}' for count in facts.occlusions), shares_bar(facts.occlusions)]


def calibration_section(report: Report) -> Markup | None:
    """Make the section of sensor poses and camera intrinsics."""
    mounts = mounts_of(report.overview.links)
    parts: list[Child] = []
    if report.projections:
        words = 'Points of the scanner over the images: edges of things must agree.'
        parts += [
            element('h3', 'Projection check'),
            element('p', words, class_='lead'),
            element('div', [pictured(each) for each in report.projections], class_='grid pair'),
        ]
    if len(mounts) > 1:
        parts += _rig(mounts)
    if report.overview.cameras:
        parts += [element('h3', 'Cameras'), _camera_table(report.overview.cameras)]
    return join(parts) if parts else None


def _rig(mounts: Sequence[Mount]) -> list[Child]:
    drawn = mounts[:MOST_FRAMES]
    left = len(mounts) - len(drawn)
    words = 'Numbers are those of the table; x, y and z are the axes of each frame.'
    if left:
        words += f' {left} more frames are in the table only.'
    return [
        element('h3', 'Sensors'),
        element('p', words, class_='lead'),
        element(
            'div',
            captioned(rig_plot('rig-top', drawn, side=False), 'From above'),
            captioned(rig_plot('rig-side', drawn, side=True), 'From the left side'),
            class_='grid pair',
        ),
        _mount_table(mounts, folded=left > 0),
    ]


def _mount_table(mounts: Sequence[Mount], *, folded: bool) -> Markup:
    order = {mount.name: str(place + 1) for place, mount in enumerate(mounts)}
    columns = [('Frame', TEXT), ('On', NUMBER), ('Distance m', NUMBER)]
    columns += [(f'{axis} m', NUMBER) for axis in 'xyz']
    columns += [(f'{angle} \N{DEGREE SIGN}', NUMBER) for angle in ('Roll', 'Pitch', 'Yaw')]
    rows = [
        [
            join([_numbered(order[mount.name]), breakable(mount.name)]),
            _numbered(order[mount.parent]) if mount.parent else '',
            f'{mount.distance_m:.3f}' if mount.parent else '',
            *([f'{value + 0.0:.3f}' for value in mount.xyz_m] or [''] * 3),
            *([f'{value + 0.0:.2f}' for value in mount.rpy_deg] or [''] * 3),
        ]
        for mount in mounts
    ]
    whole = table('Where each frame is in the axes of the one that it is on', columns, rows)
    if not folded:
        return whole
    return element('details', element('summary', f'All {len(mounts)} frames'), whole)


def _numbered(number: str) -> Markup:
    return element('span', number, class_='number')


def _camera_table(cameras: Sequence[CameraGlance]) -> Markup:
    columns = [('Camera', TEXT), ('Size', NUMBER)]
    columns += [(name, NUMBER) for name in ('fx', 'fy', 'cx', 'cy', 'Field of view', 'Baseline m')]
    rows = [
        [
            breakable(each.name.removesuffix('/camera_info')),
            f'{each.width} \N{MULTIPLICATION SIGN} {each.height}' if each.width else 'by image',
            *(_pixels(value) for value in (each.fx, each.fy, each.cx, each.cy)),
            _field_of_view(each),
            f'{each.baseline_m:.4f}' if abs(each.baseline_m or 0) > 1e-6 else '',
        ]
        for each in cameras
    ]
    return table('Intrinsics of the rectified cameras, in pixels', columns, rows)


def _pixels(value: float | None) -> str:
    return '' if value is None else f'{value:.2f}'


def _field_of_view(camera: CameraGlance) -> str:
    if not camera.width or camera.fx is None or camera.fx <= 0:
        return ''
    angle = 2 * np.degrees(np.arctan(camera.width / 2 / camera.fx))
    return f'{angle:.1f}\N{DEGREE SIGN}'
