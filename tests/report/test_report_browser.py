# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a report in a real browser: on a desk and on a phone, light and dark, by keyboard."""

from __future__ import annotations

import cv2
import foreign
import numpy as np
import pytest
from chromium import DESK, PHONE

from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.report.gather import gather
from kitti_ros2.report.page import make_page

from builders import SHARED  # isort: skip

REAL_BAGS = ('nav2_turtlebot.mcap', 'tilt_laser.bag', 'example-lz4.bag', 'rosbag2_split_mcap')

CUT_OFF = """[...document.querySelectorAll('svg')].flatMap(svg => {
    const view = svg.viewBox.baseVal, near = .01
    return [...svg.querySelectorAll('rect, line, path, circle, text')].filter(each => {
        const box = each.getBBox()
        return box.x < view.x - near || box.x + box.width > view.x + view.width + near
            || box.y < view.y - near || box.y + box.height > view.y + view.height + near
    }).map(each => `${svg.getAttribute('class')}: ${each.outerHTML}`)
})"""
"""What of a plot lies beyond the edge of its viewBox, and is not drawn."""

TOO_WIDE = """[...document.querySelectorAll('.scroll')]
    .filter(box => box.scrollWidth > box.clientWidth).map(box => box.getAttribute('aria-label'))"""

LINES = """[...document.querySelectorAll('#streams tbody th')].map(cell => {
    const range = document.createRange()
    range.selectNodeContents(cell)
    return [cell.textContent, new Set([...range.getClientRects()].map(line => line.top)).size]
})"""
OPEN = """(open => open.length === 1 && open[0].querySelector('img').width)(
    document.querySelectorAll(':popover-open'))"""
"""Width of the picture that is open, false without exactly one."""

TAB, ENTER, ESCAPE = 9, 13, 27


@pytest.fixture(scope='module')
def pages(recordings, tmp_path_factory):
    folder = tmp_path_factory.mktemp('pages')
    made = {}
    for layout, path in recordings.items():
        made[layout] = folder / f'{layout.value}.html'
        made[layout].write_text(make_page(gather(path, ReadOptions())), encoding='utf-8')
    return made


@pytest.fixture(params=list(Layout), ids=[layout.value for layout in Layout])
def page(request, pages):
    return pages[request.param]


@pytest.fixture(scope='module')
def others(tmp_path_factory):
    """Pages of bags that are not ours, the real ones among them where they are."""
    folder = tmp_path_factory.mktemp('others')
    bags = [foreign.write_foreign(folder / 'foreign.mcap', foreign.make_truth())]
    real = SHARED / 'kitti' / 'bags'
    bags += [real / name for name in REAL_BAGS if (real / name).exists()]
    made = []
    for bag in bags:
        made.append(folder / f'{bag.stem}.html')
        made[-1].write_text(make_page(gather(bag, ReadOptions())), encoding='utf-8')
    return made


@pytest.mark.parametrize('dark', [False, True], ids=['light', 'dark'])
@pytest.mark.parametrize('width', [DESK, PHONE])
def test_it_fits_and_all_of_it_is_shown(browser, page, width, dark):
    browser.open(page, width, dark=dark)
    assert browser.page_width() <= width
    shown = browser.evaluate(
        'Promise.all([...document.images].map(i => i.decode().then(() => i.naturalWidth)))'
    )
    assert shown
    assert min(shown) > 0
    assert browser.complaints == []


@pytest.mark.parametrize('dark', [False, True], ids=['light', 'dark'])
def test_it_is_light_or_dark_as_the_reader_likes(browser, pages, dark):
    browser.open(pages[Layout.RAW], DESK, dark=dark)
    pixels = cv2.imdecode(np.frombuffer(browser.picture(), np.uint8), cv2.IMREAD_COLOR)
    corner = pixels[:20, :20].mean()
    assert corner < 60 if dark else corner > 200


def test_text_is_large_enough_on_a_phone(browser, page):
    browser.open(page, PHONE)
    smallest = browser.evaluate(
        'Math.min(...[...document.querySelectorAll("svg.plot text")].map(t =>'
        ' parseFloat(getComputedStyle(t).fontSize) * t.getScreenCTM().a))'
    )
    assert smallest >= 8


def test_it_is_read_by_keyboard(browser, page):
    """The first stop skips to the content; every box that scrolls is one, and has a name."""
    browser.open(page, PHONE)
    browser.press('Tab', TAB)
    assert browser.evaluate('document.activeElement.className') == 'skip'
    reach = browser.evaluate(
        '[...document.querySelectorAll("*")].filter(e => e.scrollWidth > e.clientWidth + 1'
        ' && ["auto", "scroll"].includes(getComputedStyle(e).overflowX))'
        '.map(e => e.tabIndex === 0 && !!e.getAttribute("aria-label"))'
    )
    assert reach
    assert all(reach)


@pytest.mark.parametrize('width', [DESK, PHONE])
def test_pictures_open_in_full_size_and_close(browser, page, width):
    """By click and by key; what is behind stays where it is."""
    browser.open(page, width)
    small, whole, height = browser.evaluate(
        '(each => [each.width, each.naturalWidth, document.scrollingElement.scrollHeight])'
        '(document.images[0])'
    )
    assert not browser.evaluate(OPEN)
    browser.click('figure img')
    for again in (True, False):
        assert browser.evaluate(OPEN) > max(small, whole - 1)
        assert browser.evaluate('document.scrollingElement.scrollHeight') == height
        browser.press('Escape', ESCAPE)
        assert not browser.evaluate(OPEN)
        assert browser.evaluate('document.activeElement.querySelector("img").alt')
        if again:
            browser.press('Enter', ENTER, '\r')
    assert browser.complaints == []


def test_axe_finds_no_fault_in_an_open_picture(browser, axe, page):
    browser.open(page, DESK)
    browser.click('figure img')
    assert browser.evaluate(OPEN)
    assert browser.axe_faults(axe) == []


@pytest.mark.parametrize('dark', [False, True], ids=['light', 'dark'])
@pytest.mark.parametrize('width', [DESK, PHONE])
def test_axe_finds_no_fault(browser, axe, page, width, dark):
    browser.open(page, width, dark=dark)
    assert browser.axe_faults(axe) == []


@pytest.mark.parametrize('width', [DESK, PHONE])
def test_nothing_of_a_plot_is_cut_off(browser, page, width):
    browser.open(page, width)
    assert browser.evaluate(CUT_OFF) == []


@pytest.mark.parametrize('width', [DESK, PHONE])
def test_pages_of_other_bags_fit_and_their_plots_are_whole(browser, others, width):
    for page_url in others:
        browser.open(page_url, width)
        assert browser.page_width() <= width, page_url
        assert browser.evaluate(CUT_OFF) == [], page_url


def test_tables_have_room_on_a_desk(browser, pages, others):
    for page_url in (*pages.values(), *others):
        browser.open(page_url, DESK)
        assert browser.evaluate(TOO_WIDE) == [], page_url


def test_topics_have_room_beside_their_columns(browser, others):
    """A name shorter than the column that holds it is on one line, and none is on more than two."""
    for page_url in others:
        browser.open(page_url, DESK)
        lines = dict(browser.evaluate(LINES))
        assert lines
        assert max(lines.values()) <= 2, page_url
        assert all(count == 1 for name, count in lines.items() if len(name) < 18), page_url
