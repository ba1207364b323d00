# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Corrupt JPEG data is an error; nothing that others print is lost."""

from __future__ import annotations

import os
import subprocess
import sys

import cv2
import numpy as np
import pytest

from kitti_ros2.files.image_files import decode_jpeg

COLOUR = cv2.IMREAD_COLOR


def jpeg(*words):
    """The bytes of a JPEG file of smooth noise."""
    rng = np.random.default_rng(3)
    small = rng.integers(0, 255, (30, 40, 3), np.uint8)
    pixels = cv2.resize(small, (320, 240), interpolation=cv2.INTER_CUBIC)
    return cv2.imencode('.jpg', pixels, list(words))[1].ravel()


def with_bytes(data, *values):
    """A file with bytes before its end."""
    return np.concatenate([data[:-2], np.array(values, np.uint8), data[-2:]])


@pytest.mark.parametrize('progressive', [0, 1])
def test_a_sound_file_is_decoded_as_by_opencv(progressive, capfd):
    data = jpeg(cv2.IMWRITE_JPEG_PROGRESSIVE, progressive)
    assert np.array_equal(decode_jpeg(data, COLOUR), cv2.imdecode(data, COLOUR))
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('progressive', [0, 1])
@pytest.mark.parametrize('seed', range(5))
def test_noise_is_an_error(progressive, seed, capfd):
    data = jpeg(cv2.IMWRITE_JPEG_PROGRESSIVE, progressive)
    middle = len(data) // 2
    data[middle : middle + 400] = np.random.default_rng(seed).integers(0, 255, 400)
    with pytest.raises(ValueError, match='the JPEG is corrupt: '):
        decode_jpeg(data, COLOUR)
    assert capfd.readouterr().err == ''


def test_a_cut_scan_with_an_end_is_an_error(capfd):
    data = jpeg()
    with pytest.raises(ValueError, match='corrupt: premature end of data segment'):
        decode_jpeg(np.concatenate([data[: len(data) // 2], data[-2:]]), COLOUR)
    assert capfd.readouterr().err == ''


def test_a_few_bytes_of_padding_are_harmless(capfd):
    data = jpeg()
    found = decode_jpeg(with_bytes(data, *[0] * 12), COLOUR)
    assert np.array_equal(found, cv2.imdecode(data, COLOUR))
    with pytest.raises(ValueError, match='extraneous bytes'):
        decode_jpeg(with_bytes(data, *[1] * 100), COLOUR)
    assert capfd.readouterr().err == ''


def test_what_others_print_meanwhile_goes_on(capfd, monkeypatch):
    true = cv2.imdecode

    def imdecode(file, flags):
        os.write(2, b'12 %\nof another thread')
        return true(file, flags)

    monkeypatch.setattr(cv2, 'imdecode', imdecode)
    assert decode_jpeg(jpeg(), COLOUR) is not None
    assert capfd.readouterr().err == '12 %\nof another thread'


def test_a_process_without_standard_error_decodes(tmp_path):
    path = tmp_path / 'image.jpg'
    jpeg().tofile(path)
    program = (
        'import os, numpy, kitti_ros2.files.image_files as jpeg; os.close(2);'
        f'print(jpeg.decode_jpeg(numpy.fromfile({str(path)!r}, numpy.uint8), 1).shape)'
    )
    done = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, check=True
    )
    assert done.stdout == '(240, 320, 3)\n'
