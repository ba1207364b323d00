# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The built site, opened from disk: on a desk and on a phone, every internal link followed."""

from __future__ import annotations

import subprocess
import sys
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


class Links(HTMLParser):
    """The anchors of a page, its links, and what it loads."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(page.read_text('utf-8'))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.anchors |= {value for name in ('id', 'name') if (value := values.get(name))}
        if tag == 'a' and values.get('href'):
            self.links.append(values['href'] or '')
        url = values.get(LOADING_TAGS.get(tag, ''))
        if url and values.get('rel') != 'canonical':
            self.loads.append(url)


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    pytest.importorskip('material', reason='no mkdocs-material: install the extra docs')
    pytest.importorskip('mkdocstrings', reason='no mkdocstrings: install the extra docs')
    pytest.importorskip('rclpy', reason='no rclpy, which the reference needs')
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
    parsed = {page: Links(page) for page in pages}
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


def test_nothing_is_loaded_from_elsewhere(pages):
    for page in pages:
        assert [url for url in Links(page).loads if urlsplit(url).scheme not in ('', 'data')] == []


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
