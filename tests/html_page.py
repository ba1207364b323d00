# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An HTML page taken apart, with all that is wrong with it."""

from __future__ import annotations

import re
from collections import Counter
from html.parser import HTMLParser
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

VOID = {'br', 'img', 'link', 'meta', 'wbr'}
RUNS = {'script', 'iframe', 'object', 'embed', 'base', 'form'}
OUTSIDE = re.compile(r'(?:[a-z+]+:)?//|url\(|@import', re.IGNORECASE)


class Page(HTMLParser):
    """A page.

    Attributes:
        faults: What is wrong, a line each.
        text: The words of each element, those of its children aside: (tag, words).
        tags: How often each element comes.
    """

    def __init__(self, source: str) -> None:
        super().__init__()
        self.faults: list[str] = []
        self.text: list[tuple[str, str]] = []
        self.tags: Counter[str] = Counter()
        self._open: list[str] = []
        self._told: list[list[str]] = []
        self._ids: Counter[str] = Counter()
        self._references: list[str] = []
        self.feed(source)
        self.close()
        self.faults += [f'<{tag}> is never closed' for tag in self._open]
        self.faults += [f'id {name} comes {n} times' for name, n in self._ids.items() if n > 1]
        self.faults += [f'#{name} is nowhere' for name in self._references if name not in self._ids]

    @classmethod
    def of(cls, path: Path) -> Page:
        """The page in a file."""
        return cls(path.read_text(encoding='utf-8'))

    def words(self, tag: str) -> list[str]:
        """The words that stand in elements of a kind, as they read."""
        return [words for name, words in self.text if name == tag]

    def handle_starttag(self, tag, attrs):
        self.tags[tag] += 1
        if tag in RUNS:
            self.faults.append(f'<{tag}> does something')
        if tag not in VOID:
            self._open.append(tag)
            self._told.append([])
        values = dict(attrs)
        if tag == 'img' and not values.get('alt'):
            self.faults.append('an image without words')
        if tag == 'th' and values.get('scope') not in {'row', 'col'}:
            self.faults.append('a heading of nothing')
        if 'id' in values:
            self._ids[values['id']] += 1
        self._references += (values.get('aria-labelledby') or '').split()
        if (values.get('href') or '').startswith('#'):
            self._references.append(values['href'][1:])
        for name, value in attrs:
            self._check(tag, name, value or '')

    def _check(self, tag, name, value):
        if name.startswith('on'):
            self.faults.append(f'<{tag}> acts {name}')
        if name in {'src', 'href', 'srcset', 'action', 'data', 'poster', 'style', 'xlink:href'}:
            inside = value.startswith(('data:', '#'))
            if not inside or OUTSIDE.search(value.partition(',')[0]):
                self.faults.append(f'<{tag}> has {name} {value[:60]}')

    def handle_endtag(self, tag):
        if not self._open or self._open.pop() != tag:
            self.faults.append(f'</{tag}> closes nothing')
            return
        words = ''.join(self._told.pop())
        if words.strip():
            self.text.append((tag, words))

    def handle_data(self, data):
        if self._open[-1:] == ['style'] and OUTSIDE.search(data):
            self.faults.append('the style loads something')
        if self._open:
            self._told[-1].append(data)
