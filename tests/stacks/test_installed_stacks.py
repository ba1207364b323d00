# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Installed odometry stacks on their bags: little drift with deskewing, twice as much without.

pip install kiss-icp genz-icp rko_lio
"""

from __future__ import annotations

import subprocess
import sysconfig
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

pytestmark = pytest.mark.programs

BENCHMARKS = Path(__file__).parents[2] / 'benchmarks'
MODULES = {'kiss-icp': 'kiss_icp', 'genz-icp': 'genz_icp', 'rko_lio': 'rko_lio'}
INSTALLED = [
    pytest.param(
        stack,
        marks=pytest.mark.skipif(find_spec(module) is None, reason=f'{stack} is not installed'),
    )
    for stack, module in MODULES.items()
]


@pytest.fixture(scope='module')
def benchmark():
    """The module benchmarks/stacks.py."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)
        yield import_module('stacks')


@pytest.fixture(scope='module')
def street(benchmark):
    """A shorter drive than that of the benchmark, with fewer points."""
    return benchmark.make_street(frames=140, columns=400)


@pytest.fixture(scope='module')
def swept_drive(benchmark, street, tmp_path_factory):
    """Its folder."""
    return benchmark.write_drive(tmp_path_factory.mktemp('street'), street)


@pytest.mark.parametrize('stack', INSTALLED)
def test_deskewing_halves_the_drift(stack, benchmark, street, swept_drive, tmp_path):
    bag = benchmark.write_bag(swept_drive, stack, tmp_path / 'bag')
    found = benchmark.measure(benchmark.PROGRAMS[stack], street, bag, tmp_path / 'runs')
    assert found.on < 1.0, found
    assert found.off >= 2 * found.on, found


# The inputs that docs/howto/stacks.md calls readable.
WAYS = {
    'rosbag2, MCAP': ('bag', ''),
    'rosbag2, sqlite3': ('bag', '--storage sqlite3'),
    'ROS 1': ('bag.bag', ''),
    'one MCAP file': ('bag.mcap', ''),
    'velodyne': ('velodyne_points/data', ''),
}


@pytest.mark.parametrize('way', WAYS)
@pytest.mark.parametrize('stack', INSTALLED[:2])
def test_commands_from_pypi_read_what_the_page_says(stack, way, recordings, tmp_path, monkeypatch):
    name, options = WAYS[way]
    drive = recordings[Layout.RAW]
    source = drive / name
    if name.startswith('bag'):
        source = tmp_path / name
        words = ['to-bag', str(drive), str(source), '--for', stack, '-q', *options.split()]
        assert main(words) == 0
    monkeypatch.setenv(f'{MODULES[stack]}_out_dir', str(tmp_path / 'results'))
    program = Path(sysconfig.get_path('scripts'), f'{MODULES[stack]}_pipeline')
    words = ['--topic', '/kitti/velo/points'] if name.startswith('bag') else []
    words += ['--dataloader', 'rosbag'] if source.suffix == '.mcap' else []
    subprocess.run([program, source, *words], capture_output=True, check=True)
    (poses,) = tmp_path.glob('results/latest/*_poses.npy')
    assert np.load(poses).shape == (5, 4, 4)
