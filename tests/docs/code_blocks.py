# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The fenced blocks of the pages, each with its language and the reason why it is not run.

A block that cannot run in a test has an HTML comment on the line before:

    <!-- not run: needs a ROS 2 workspace -->

What docs/tables.py writes is left out: examples, files and docstrings have tests where they stand.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md')))
_GENERATED = re.compile(r'^<!-- generated: .*?^<!-- end -->$', re.MULTILINE | re.DOTALL)
_FENCE = re.compile(
    r'(?:^ *<!-- not run: (?P<reason>.+?) -->\n)?'
    r'^(?P<indent> *)```(?P<language>\S*)(?: title="(?P<title>[^"\n]+)")?[^\n]*\n'
    r'(?P<text>.*?)'
    r'^(?P=indent)```$',
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        language: The first word of its fence.
        text: Its lines, without common indentation.
        line: The line of its fence in the page.
        reason: Why it is not run, empty if it is.
        title: The name of the file that it shows, empty for none.
    """

    language: str
    text: str
    line: int
    reason: str = ''
    title: str = ''


def blocks_in(markdown: str) -> list[Block]:
    """The blocks of a page, in their order."""
    markdown = _GENERATED.sub(lambda found: '\n' * found[0].count('\n'), markdown)
    return [
        Block(
            found['language'],
            dedent(found['text']),
            markdown[: found.start('indent')].count('\n') + 1,
            found['reason'] or '',
            found['title'] or '',
        )
        for found in _FENCE.finditer(markdown)
    ]


def page_name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()
