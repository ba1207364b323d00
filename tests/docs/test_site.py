# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The built site, opened from disk: on a desk and on a phone, every internal link followed."""

from __future__ import annotations

import re
import subprocess
import sys
from html import unescape
from html.parser import HTMLParser
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

import pytest
from chromium import DESK, PHONE
from code_blocks import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.programs

FIRST_RESULT = """new Promise(done => {
    const look = () => {
        const result = document.querySelector('.md-search-result__link')
        result ? done(result.href) : requestAnimationFrame(look)
    }
    look()
})"""
LOADING_TAGS = {'img': 'src', 'script': 'src', 'link': 'href', 'iframe': 'src', 'source': 'src'}


class Page(HTMLParser):
    """The anchors of a page, its links, what it loads, and the texts of the cells of its tables."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.cells: list[str] = []
        self._in_cell = False
        self.feed(page.read_text('utf-8'))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.anchors |= {value for name in ('id', 'name') if (value := values.get(name))}
        if tag == 'a' and values.get('href'):
            self.links.append(values['href'] or '')
        url = values.get(LOADING_TAGS.get(tag, ''))
        if url and values.get('rel') != 'canonical':
            self.loads.append(url)
        if tag in {'td', 'th'}:
            self._in_cell = True
            self.cells.append('')

    def handle_endtag(self, tag: str) -> None:
        self._in_cell = self._in_cell and tag not in {'td', 'th'}

    def handle_data(self, data: str) -> None:
        if self._in_cell:
            self.cells[-1] += data


def cells_of(markdown: str) -> list[str]:
    """The texts of the cells of all tables, as a reader of the page should see them."""
    without_code = re.sub(r'^ *```.*?^ *```$', '', markdown, flags=re.MULTILINE | re.DOTALL)
    rows = re.findall(r'^\|(.*)\|$', without_code, re.MULTILINE)
    cells = [cell.strip() for row in rows for cell in re.split(r'(?<!\\)\|', row)]
    texts = (re.sub(r'\[([^]]*)\]\([^)]*\)', r'\1', cell) for cell in cells)
    plain = (re.sub(r'\*\*|`|\\(?=[*_|])', '', text) for text in texts)
    return [unescape(text) for text in plain if not re.fullmatch('-*', text)]


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    pytest.importorskip('material', reason='no mkdocs-material: install the extra docs')
    out = tmp_path_factory.mktemp('site')
    done = subprocess.run(
        [sys.executable, '-m', 'mkdocs', 'build', '--strict', '-d', str(out)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope='module')
def pages(site):
    found = sorted(site.rglob('*.html'))
    assert len(found) > 20
    return found


def test_every_internal_link_leads_somewhere(pages):
    parsed = {page: Page(page) for page in pages}
    broken = []
    for page, found in parsed.items():
        for link in (*found.links, *found.loads):
            url = urlsplit(link)
            if url.scheme or url.netloc:
                continue
            target = (page.parent / unquote(url.path)).resolve() if url.path else page
            anchors = parsed[target].anchors if target in parsed else {unquote(url.fragment)}
            if not target.is_file() or (url.fragment and unquote(url.fragment) not in anchors):
                broken.append(f'{page.name}: {link}')
    assert broken == []


def test_tables_have_the_words_of_the_repository(site):
    """No asterisk, bar or angle of a cell is lost to Markdown."""
    for source in sorted((ROOT / 'docs').rglob('*.md')):
        page = site / source.relative_to(ROOT / 'docs').with_suffix('')
        shown = Page(page / 'index.html' if page.is_dir() else page.with_suffix('.html')).cells
        assert [cell for cell in cells_of(source.read_text('utf-8')) if cell not in shown] == []


def test_no_pattern_becomes_emphasis(pages):
    for page in pages:
        text = page.read_text('utf-8')
        assert re.findall(r"""\S*['"`/]</?em>\S*|\S*</?em>['"`/]\S*""", text) == []


def test_nothing_is_loaded_from_elsewhere(pages):
    for page in pages:
        assert [url for url in Page(page).loads if urlsplit(url).scheme not in ('', 'data')] == []


@pytest.mark.parametrize('width', [DESK, PHONE])
def test_pages_fit_and_load_without_complaint(browser, pages, width):
    for page in pages:
        browser.open(page, width)
        assert browser.page_width() <= width, page
        assert browser.complaints == [], page


def test_search_works_in_a_page_from_disk(browser, site):
    browser.open(site / 'index.html', DESK)
    browser.evaluate("document.querySelector('[data-md-toggle=search]').click()")
    browser.evaluate("document.querySelector('[data-md-component=search-query]').focus()")
    browser.call('Input.insertText', text='ring-time')
    found = browser.evaluate(FIRST_RESULT)
    assert found.startswith('file:')
    assert urlsplit(found).path.endswith('.html')


@pytest.mark.parametrize('dark', [False, True], ids=['light', 'dark'])
@pytest.mark.parametrize('width', [DESK, PHONE])
def test_axe_finds_no_fault(browser, axe, pages, width, dark):
    browser.open(pages[0], width, dark=dark)
    browser.evaluate('localStorage.clear()')  # the choice of colours
    faults = set()
    for page in pages:
        browser.open(page, width, dark=dark)
        faults |= {f'{page.name}: {fault}' for fault in browser.axe_faults(axe)}
    assert faults == set()
