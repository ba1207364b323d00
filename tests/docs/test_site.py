# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The built site, opened from disk: on a desk and on a phone, every internal link followed."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from chromium import Chromium, find_chromium
from code_blocks import ROOT

DESK, PHONE = 1280, 390
FIRST_RESULT = """new Promise(done => {
    const look = () => {
        const result = document.querySelector('.md-search-result__link')
        result ? done(result.href) : requestAnimationFrame(look)
    }
    look()
})"""
AXE = """axe.run({preload: false}).then(
    r => r.violations.map(v => `${v.impact} ${v.id}: ${v.nodes[0].html}`)
)"""
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


@pytest.fixture(scope='module')
def browser():
    program = find_chromium()
    if program is None:
        pytest.skip('no Chromium: install chromium, or name one in CHROMIUM')
    with (
        # A profile may still be written while its browser ends.
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        Chromium(program, Path(profile)) as chromium,
    ):
        yield chromium


@pytest.fixture(scope='module')
def axe() -> str:
    path = os.environ.get('AXE_CORE', '')
    if not path:
        pytest.skip('no axe-core: name its axe.min.js (npm install axe-core) in AXE_CORE')
    return Path(path).read_text(encoding='utf-8')


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
        browser.complaints.clear()
        browser.open(page, width)
        assert browser.evaluate('document.scrollingElement.scrollWidth') <= width, page
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
        browser.evaluate(f'{axe}; 0')
        faults |= {f'{page.name}: {fault}' for fault in browser.evaluate(AXE)}
    assert faults == set()
