# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The layouts of config/ against the panels of the SDK, which know every setting by name."""

import dataclasses
import json
from pathlib import Path

import pytest

pytest.importorskip('foxglove', reason='needs foxglove-sdk (pip install kitti_ros2[test])')

from foxglove import layouts

CONFIG = Path(__file__).resolve().parents[2] / 'config'
PANELS = {
    '3D': layouts.ThreeDeeConfig,
    'Image': layouts.ImageConfig,
    'map': layouts.MapConfig,
    'Plot': layouts.PlotConfig,
    'DiagnosticSummary': layouts.DiagnosticsSummaryConfig,
    'Table': layouts.TableConfig,
}
LAYOUT, OF_360 = (
    json.loads((CONFIG / f'{name}.json').read_text(encoding='utf-8'))['configById']
    for name in ('foxglove', 'foxglove_kitti360')
)
SCENE = LAYOUT['3D!scene']
TITLE = {'foxglovePanelTitle'}
"""In an exported layout part of each panel's configuration."""


def settings(kind):
    """The names of a class of settings, as they are written in JSON."""
    required = {
        field.name: None
        for field in dataclasses.fields(kind)
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    }
    return set(kind(**required)._to_dict())


@pytest.mark.parametrize('name', {**LAYOUT, **OF_360})
def test_each_setting_of_a_panel_exists(name):
    assert set({**LAYOUT, **OF_360}[name]) <= settings(PANELS[name.split('!')[0]]) | TITLE


@pytest.mark.parametrize(
    ('found', 'kind'),
    [
        (SCENE['cameraState'], layouts.ThreeDeeCameraState),
        (SCENE['scene'], layouts.BaseRendererSceneSettings),
        (SCENE['scene']['transforms'], layouts.BaseRendererTransforms),
        (SCENE['layers']['grid'], layouts.BaseRendererGridLayerSettings),
        (SCENE['topics']['/kitti/velo/points'], layouts.BaseRendererPointCloudTopicSettings),
        (SCENE['topics']['/kitti/labels/markers'], layouts.BaseRendererRosMarkerTopicSettings),
        (SCENE['topics']['/kitti/ground_truth/path'], layouts.BaseRendererPosesTopicSettings),
        (LAYOUT['Image!color_left']['imageMode'], layouts.ImageModeConfig),
        (OF_360['Image!camera_2']['imageMode'], layouts.ImageModeConfig),
        (LAYOUT['map!fix']['topicConfig']['/kitti/oxts/fix'], layouts.MapTopicSettings),
        (LAYOUT['Plot!acceleration']['paths'][0], layouts.PlotSeries),
    ],
    ids=lambda value: value.__name__ if isinstance(value, type) else '',
)
def test_each_setting_within_exists(found, kind):
    assert set(found) <= settings(kind)
