# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Installs the package, for pip and for colcon alike; package.xml is the source of its facts."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

from setuptools import find_packages, setup

HERE = Path(__file__).resolve().parent
FACTS = ET.parse(HERE / 'package.xml').getroot()  # noqa: S314 - a file of our own
NAME = FACTS.findtext('name', '')
MAINTAINER = FACTS.find('maintainer')

# A package index shows README.md without the repository: neither its pictures nor its files.
README = re.sub(
    r'!\[[^]]*\]\([^)]*\)\n*|\[([^]]*)\]\((?!https?:)[^)]*\)',
    r'\1',
    (HERE / 'README.md').read_text(encoding='utf-8'),
)

CLASSIFIERS = [
    'Development Status :: 4 - Beta',
    'Environment :: Console',
    'Intended Audience :: Developers',
    'Intended Audience :: Science/Research',
    'Operating System :: POSIX :: Linux',
    'Programming Language :: Python :: 3',
    *(f'Programming Language :: Python :: 3.{minor}' for minor in range(10, 14)),
    'Topic :: Scientific/Engineering :: Artificial Intelligence',
    'Topic :: Scientific/Engineering :: Image Recognition',
    'Topic :: Scientific/Engineering :: Visualization',
    'Typing :: Typed',
]

KEYWORDS = ['KITTI', 'SemanticKITTI', 'ROS 2', 'rosbag2', 'MCAP', 'lidar', 'autonomous driving']

# What the converter needs, for pip; a workspace has its own (package.xml). The lower bounds work
# with Python 3.10; the upper ones stop at the next release that may break its promises.
REQUIREMENTS = [
    'httpx>=0.22,<0.29',  # imported by download only
    'isal>=1.7,<2',
    'jinja2>=3.1.2,<4',
    'lz4>=4.3,<5',
    'mcap>=1.3,<2',
    'numpy>=1.26,<3',
    'opencv-python-headless>=4.10.0.82,<6',
    'pillow>=10.2,<14',
    'pyyaml>=6.0.1,<7',
    'rich>=13.7,<16',
    'rosbags>=0.11.9,<0.12',
    'typer>=0.15.4,<0.29',  # 0.29 loads pydantic, a tenth of a second at every start
    'zstandard>=0.22,<0.26',
]

EXTRAS = {
    # Clouds that Draco compressed.
    'clouds': ['dracopy>=2,<3'],
    # The workers of `--scheduler`: a Dask cluster, or processes of one that is started here.
    'cluster': ['distributed>=2024.8,<2028'],
    # The documentation site: mkdocs build --strict, and its notebook.
    'docs': [
        'ipykernel>=6.29,<8',
        'mkdocs-material>=9.7,<10',
        'mkdocs>=1.6,<2',
        'nbclient>=0.10,<0.12',
    ],
    # The figures of `eval odometry` and `eval tracking`.
    'eval': ['evo>=1.31,<2', 'trackeval>=1.3,<2'],
    # The server that `play --foxglove` shows a recording with; Foxglove's schemas in protobuf.
    'foxglove': [
        'foxglove-sdk>=0.30,<0.31',
        'mcap-protobuf-support>=0.5.3,<0.7',
        'websockets>=15,<18',
    ],
    # Jupyter, in which the notebook of the tutorials runs.
    'notebook': ['ipykernel>=6.29,<8', 'jupyterlab>=4.2,<5'],
    # KITTI's form of PNG files in 0.6 of the time, the same bits.
    'png': ['zlib-ng>=0.5,<2'],
    # The pictures of `stats -o` and `eval odometry -o`.
    'plot': ['matplotlib>=3.8,<4'],
    # URLs: s3://, http://, https://. Other stores need a package of their own, such as gcsfs.
    'remote': ['aiohttp>=3.9.2,<4', 'fsspec>=2024.6,<2027', 's3fs>=2024.6,<2027'],
    # The viewer of `view --rerun`. 0.39 is the last for Python 3.10.
    'rerun': ['rerun-sdk>=0.39,<0.42'],
    # rclpy for a machine without ROS. Never a requirement: a workspace brings its own.
    'ros': [
        'ros-jazzy-common-interfaces>=5.3.6,<6',
        'ros-jazzy-rclpy[fastrtps]>=7.1.6,<8',
    ],
    # Video in bags; films in H.264, without it MPEG-4 Part 2, which browsers do not show.
    'video': ['av>=14,<19'],
}
EXTRAS['test'] = [
    *EXTRAS['remote'][:1],
    *EXTRAS['video'],
    *EXTRAS['cluster'],
    *EXTRAS['clouds'],
    'evo>=1.31,<2',  # trackeval brings a second OpenCV
    'foxglove-schemas-protobuf>=0.3,<0.5',
    *EXTRAS['foxglove'][:1],
    *EXTRAS['remote'][1:2],
    'hypothesis>=6.100,<7',
    *EXTRAS['plot'],
    *EXTRAS['foxglove'][1:2],
    'mcap-ros2-support>=0.5.5,<0.7',
    'moto[s3,server]>=5.0.20,<6',
    'mypy>=1.15,<3',
    'packaging>=23,<27',
    'pexpect>=4.9,<5',
    'pytest-timeout>=2.3.1,<3',
    'pytest-xdist>=3.5,<4',
    'pytest>=8,<10',
    'ruff>=0.17,<0.18',
    *EXTRAS['remote'][2:],
    'types-PyYAML>=6.0.12,<7',
    *EXTRAS['foxglove'][2:],
    *EXTRAS['png'],
]


def share(folder: str, pattern: str) -> list[tuple[str, list[str]]]:
    """Pair the files of a folder with the share folder that they are installed to."""
    found = sorted(str(path.relative_to(HERE)) for path in (HERE / folder).glob(pattern))
    return [(f'share/{NAME}/{folder}', found)] if found else []


setup(
    name=NAME,
    version=FACTS.findtext('version'),
    description=FACTS.findtext('description'),
    long_description=README,
    long_description_content_type='text/markdown',
    license=FACTS.findtext('license'),
    classifiers=CLASSIFIERS,
    keywords=KEYWORDS,
    maintainer=MAINTAINER.text,
    maintainer_email=MAINTAINER.get('email'),
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={
        NAME: [
            'py.typed',
            'datasets/*.txt',
            'messages/definitions/*',
            'options/stacks/*.yaml',
            'player/*.xml',
            'report/templates/*',
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *share('launch', '*.launch.py'),
        *share('config', '*.*'),
    ],
    python_requires='>=3.10',
    install_requires=REQUIREMENTS,
    extras_require=EXTRAS,
    entry_points={
        'console_scripts': [
            'kitti-ros2 = kitti_ros2.__main__:main',
            'player = kitti_ros2.__main__:player',  # as ros2 run kitti_ros2 player
        ]
    },
    zip_safe=False,
)
