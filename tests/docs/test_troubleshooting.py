# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The error messages on the page of troubleshooting are those of the code."""

from __future__ import annotations

import ast
import re

import pytest
from code_blocks import ROOT

PAGE = (ROOT / 'docs' / 'troubleshooting.md').read_text('utf-8')
HEADINGS = re.findall(r'^### (`.*)$', PAGE, re.MULTILINE)
MESSAGES = [message for heading in HEADINGS for message in re.findall(r'`([^`]+)`', heading)]


@pytest.fixture(scope='session')
def texts():
    """Every text in the code; those of an f-string are its parts between the values."""
    trees = (ast.parse(path.read_text('utf-8')) for path in (ROOT / 'kitti_ros2').rglob('*.py'))
    return [
        node.value
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


@pytest.mark.one_in(3)
@pytest.mark.parametrize('message', MESSAGES)
def test_a_message_of_the_page_is_one_of_the_code(message, texts):
    parts = [part.strip() for part in message.split('...')]
    assert any(parts)
    for part in parts:
        assert any(part in text for text in texts), part


def test_a_message_that_is_not_in_the_code_is_found(texts):
    assert len(MESSAGES) > 20
    assert not any('no such message in any module' in text for text in texts)


def test_every_message_has_its_advice():
    for heading, text in re.findall(r'^### (.+)\n+(.*)', PAGE, re.MULTILINE):
        assert re.match(r'[^#\s]', text), heading
