# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of label files and result files from the texts of their frames."""

from __future__ import annotations


def write_frames(folder, texts):
    """Write the files of frames; texts are in a list, or by number."""
    folder.mkdir(parents=True, exist_ok=True)
    numbered = texts if isinstance(texts, dict) else dict(enumerate(texts))
    for number, text in numbered.items():
        (folder / f'{number:06d}.txt').write_text(text)
    return folder


def line(kind='Car', area=(100, 100, 200, 200), score=None, **rest):
    """A line of a label file, or with a score of a result file; as much as a test cares for."""
    size = rest.get('size', (1.5, 1.6, 4.0))
    words = [
        kind,
        rest.get('truncated', 0),
        rest.get('occluded', 0),
        rest.get('alpha', 0.5),
        *area,
        *size,
        *rest.get('place', (0.0, 1.7, 20.0)),
        rest.get('ry', 0.3),
        *([] if score is None else [score]),
    ]
    return ' '.join(map(str, words)) + '\n'


def dont_care(area):
    return line('DontCare', area, truncated=-1, occluded=-1, alpha=-10, size=(-1, -1, -1),
                place=(-1000, -1000, -1000), ry=-10)  # fmt: skip
