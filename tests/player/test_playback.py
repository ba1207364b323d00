# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player's clock and controls, in a time that the test makes."""

import threading
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.outputs import AtEnd, PlaybackOptions
from kitti_ros2.player.playback import Idle, Jump, Playback, Send, Tick

from waiting import PATIENCE_S, wait_until  # isort: skip

SECOND = 1_000_000_000
START = 1_300_000_000 * SECOND
# Three samples a frame, 10 frames a second.
STAMPS = np.array([START + f * SECOND // 10 + s * 1_000_000 for f in range(5) for s in range(3)])
FRAMES = np.repeat(np.arange(10, 15), 3)


class FakeClock:
    """Time that passes by waiting; at given moments something is done."""

    def __init__(self):
        self.now = 5 * SECOND
        self.deeds = []

    def at(self, seconds, deed):
        self.deeds.append((self.now + int(seconds * SECOND), deed))
        self.deeds.sort(key=lambda one: one[0])

    def now_ns(self):
        return self.now

    def wait(self, condition, seconds):
        if seconds is None and not self.deeds:
            raise AssertionError('it would wait for ever')
        until = None if seconds is None else self.now + max(1, round(seconds * SECOND))
        if self.deeds and (until is None or self.deeds[0][0] <= until):
            self.now, deed = self.deeds.pop(0)
            condition.release()
            try:
                deed()
            finally:
                condition.acquire()
        else:
            self.now = until


def play(clock=None, seconds=60, **options):
    """All events of a playback and when they came, seconds from the start."""
    clock = clock or FakeClock()
    options = {'clock_hz': 0, **options}
    playback = Playback(STAMPS, FRAMES, PlaybackOptions(**options), clock)
    return playback, walk(playback, clock, seconds)


def walk(playback, clock, seconds=60):
    begin = clock.now
    for event in playback.events():
        at = (clock.now - begin) / SECOND
        if at > seconds:
            return
        if not isinstance(event, Idle):
            yield at, event


def sends(events):
    return [(round(at, 6), event.position) for at, event in events if isinstance(event, Send)]


ON_TIME = [(round((stamp - START) / SECOND, 6), i) for i, stamp in enumerate(STAMPS.tolist())]


def test_everything_is_sent_once_in_time():
    assert sends(play()[1]) == ON_TIME


@pytest.mark.parametrize('rate', [0.01, 0.5, 2.0, 10.0, 100.0])
def test_rate_divides_time(rate):
    times = [at for at, _ in sends(play(rate=rate)[1])]
    assert times == pytest.approx([at / rate for at, _ in ON_TIME], abs=1e-5)


def test_delay_comes_before_the_first():
    assert sends(play(delay_ns=2 * SECOND)[1]) == [(at + 2, i) for at, i in ON_TIME]


def test_delay_comes_before_the_first_of_lossless_too():
    _, events = play(lossless=True, wait_for=0, delay_ns=2 * SECOND)
    assert sends(events) == [(2, i) for i in range(15)]


@pytest.mark.parametrize('lossless', [False, True])
@pytest.mark.parametrize(
    'deed',
    [
        lambda playback: (playback.pause(), playback.resume()),
        lambda playback: playback.change(rate=2.0),
        lambda playback: playback.seek_frame(10),
    ],
    ids=['pause', 'rate', 'seek'],
)
def test_what_is_done_during_the_delay_does_not_shorten_it(deed, lossless):
    clock = FakeClock()
    playback, events = play(clock, delay_ns=2 * SECOND, lossless=lossless, wait_for=0)
    clock.at(0.5, lambda: deed(playback))
    times = [at for at, _ in sends(events)]
    assert times[0] == 2
    assert len(times) == 15


@pytest.mark.parametrize(('resumed', 'first'), [(0.5, 2), (3, 3)])
def test_a_resume_does_not_shorten_the_delay(resumed, first):
    clock = FakeClock()
    playback, events = play(clock, start_paused=True, delay_ns=2 * SECOND)
    clock.at(resumed, playback.resume)
    assert sends(events)[0] == (first, 0)


@pytest.mark.parametrize('lossless', [False, True])
def test_nothing_is_sent_before_the_subscribers_are_there(lossless):
    clock = FakeClock()
    playback, events = play(clock, lossless=lossless, wait_for=3, delay_ns=SECOND)
    assert playback.state().waiting
    clock.at(7, playback.begin)
    times = [at for at, _ in sends(events)]
    assert times == ([8] * 15 if lossless else [at + 8 for at, _ in ON_TIME])
    assert not playback.state().waiting


def test_lossless_waits_for_one_subscriber_unless_told_otherwise():
    assert [
        PlaybackOptions(lossless=lossless, wait_for=wait_for).subscribers
        for lossless in (False, True)
        for wait_for in (None, 0, 2)
    ] == [0, 0, 2, 1, 0, 2]


@pytest.mark.parametrize('count', [-1, 1001])
def test_so_many_subscribers_are_refused(count):
    with pytest.raises(UsageError, match=f'wait_for {count} is not within 0 to 1000'):
        PlaybackOptions(wait_for=count)


def test_the_recording_stands_still_during_the_wait():
    clock = FakeClock()
    playback, events = play(clock, wait_for=1, clock_hz=10)
    clock.at(1.05, playback.stop)
    assert [event.stamp_ns for _, event in events] == [START] * 11
    assert playback.state().offset_ns == 0


def test_what_is_paused_stays_paused_when_subscribers_come():
    clock = FakeClock()
    playback, events = play(clock, wait_for=1, start_paused=True)
    clock.at(1, playback.begin)
    clock.at(2, playback.resume)
    assert sends(events) == [(round(at + 2, 6), i) for at, i in ON_TIME]


def test_a_resume_does_not_end_the_wait():
    clock = FakeClock()
    playback, events = play(clock, wait_for=1, start_paused=True)
    clock.at(1, playback.resume)
    clock.at(2, playback.begin)
    assert sends(events) == [(round(at + 2, 6), i) for at, i in ON_TIME]


def test_three_rounds_are_three_times_everything():
    _, events = play(loop=3)
    events = list(events)
    assert [i for _, i in sends(events)] == list(range(15)) * 3
    jumps = [event for _, event in events if isinstance(event, Jump)]
    assert [jump.position for jump in jumps] == [0, 0]
    assert jumps[0].stamp_ns == START


def test_no_end_goes_on():
    _, events = play(loop=0, seconds=20)
    assert len(sends(events)) > 15 * 40


def test_pause_and_resume_shift_what_follows():
    clock = FakeClock()
    playback, events = play(clock)
    clock.at(0.15, playback.pause)
    clock.at(1.15, playback.resume)
    assert sends(events) == [(at if at < 0.15 else round(at + 1, 6), i) for at, i in ON_TIME]


def test_rate_changes_while_it_runs():
    clock = FakeClock()
    playback, events = play(clock)
    clock.at(0.2, lambda: playback.change(rate=0.5))
    expected = [at if at < 0.2001 else 0.2 + (at - 0.2) * 2 for at, _ in ON_TIME]
    assert [at for at, _ in sends(events)] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize('rate', [0.0, -1.0, 0.009, 100.1, float('nan')])
def test_a_rate_out_of_range_leaves_the_old_one(rate):
    playback, events = play()
    with pytest.raises(UsageError, match='rate'):
        playback.change(rate=rate)
    assert playback.state().rate == 1.0
    assert sends(events) == ON_TIME


def test_seek_lands_on_the_frame():
    clock = FakeClock()
    playback, events = play(clock)
    clock.at(0.05, lambda: playback.seek_frame(13))
    events = list(events)
    assert [i for _, i in sends(events)] == [0, 1, 2, 9, 10, 11, 12, 13, 14]
    jump = next(event for _, event in events if isinstance(event, Jump))
    assert (jump.position, jump.stamp_ns) == (9, STAMPS[9])


@pytest.mark.parametrize('rate', [1.0, 3.0])
def test_time_stands_still_until_a_jump_is_handled(rate):
    clock = FakeClock()
    playback, events = play(clock, rate=rate)
    clock.at(0.05, lambda: playback.seek_offset(int(0.35 * SECOND)))
    following = []
    for at, event in events:
        if isinstance(event, Jump):
            clock.now += SECOND // 2
            assert playback.state().offset_ns == int(0.35 * SECOND)
        elif event.position >= 12:
            following.append((round(at, 6), event.position))
    after_s = [0.05, 0.051, 0.052]
    assert following == [
        (round(0.55 + each / rate, 6), 12 + number) for number, each in enumerate(after_s)
    ]


def test_time_stands_still_before_the_start():
    clock = FakeClock()
    playback, events = play(clock)
    clock.now += SECOND
    assert playback.state().offset_ns == 0
    assert sends(events) == ON_TIME


def test_seek_in_time_waits_for_the_next_sample():
    clock = FakeClock()
    playback, events = play(clock)
    clock.at(0.05, lambda: playback.seek_offset(int(0.35 * SECOND)))
    assert sends(events)[3] == (0.1, 12)


def test_seek_before_the_first_is_the_first_and_after_the_last_is_refused():
    playback, _ = play()
    playback.seek(0)
    assert playback.state().stamp_ns == START
    with pytest.raises(UsageError, match='after the end'):
        playback.seek(int(STAMPS[-1]) + 1)
    with pytest.raises(UsageError, match='no frame 15; it has 5 frames, 10 to 14'):
        playback.seek_frame(15)


@pytest.mark.parametrize(
    ('seconds', 'first'), [(-9, 0), (0, 0), (0.0995, 0), (0.1, 3), (0.2015, 6), (99, 12)]
)
def test_show_plays_the_frame_at_a_time_at_once(seconds, first):
    clock = FakeClock()
    playback, events = play(clock, start_paused=True)
    clock.at(0.5, lambda: playback.show(START + int(seconds * SECOND)))
    clock.at(1, playback.stop)
    assert sends(events) == [(0.5, first + i) for i in range(3)]
    assert playback.state().paused


def test_show_while_it_plays_goes_on_from_the_frame():
    clock = FakeClock()
    playback, events = play(clock)
    clock.at(0.05, lambda: playback.show(int(STAMPS[-1])))
    assert sends(events)[3:] == [(0.05, 12), (0.051, 13), (0.052, 14)]


def test_a_step_is_a_frame():
    clock = FakeClock()
    playback, events = play(clock, start_paused=True)
    begin = clock.now
    walked = threading.Thread(target=lambda: done.extend(events), daemon=True)
    done = []
    del begin
    clock.at(1, lambda: playback.play_next(timeout=0))
    clock.at(2, lambda: playback.play_next(timeout=0))
    clock.at(3, playback.stop)
    walked.start()
    walked.join(PATIENCE_S)
    assert not walked.is_alive()
    assert sends(done) == [(1, 0), (1, 1), (1, 2), (2, 3), (2, 4), (2, 5)]
    assert playback.state().frame == 11


@pytest.mark.parametrize(('step', 'count'), [(0, 1), (1, 3), (2, 6), (99, 15)])
def test_steps_of_other_lengths(step, count):
    clock = FakeClock()
    playback, events = play(clock, start_paused=True, step=step)
    clock.at(1, lambda: playback.play_next(timeout=0))
    clock.at(2, playback.stop)
    assert len(sends(events)) == count


def test_a_step_back_plays_the_frame_before():
    clock = FakeClock()
    playback, events = play(clock)
    clock.at(0.25, playback.pause)
    clock.at(1, lambda: playback.play_previous(timeout=0))
    clock.at(2, playback.stop)
    assert [i for _, i in sends(events)][9:] == [3, 4, 5]


def test_a_burst_plays_whole_samples_until_there_are_so_many_messages():
    clock = FakeClock()
    playback, events = play(clock, start_paused=True)
    counted = []
    asking = threading.Thread(target=lambda: counted.append(playback.burst(5)), daemon=True)

    def ask():
        asking.start()
        wait_until(lambda: playback._burst_left)

    clock.at(1, ask)
    clock.at(2, lambda: (asking.join(PATIENCE_S), playback.stop()))
    played = []
    for at, event in events:
        if isinstance(event, Send):
            played.append((round(at, 3), event.position))
            playback.sent(2)
    assert played == [(1, 0), (1, 1), (1, 2)]
    assert counted == [6]


def test_time_runs_no_step():
    playback, _ = play()
    assert not playback.play_next(timeout=0)
    assert playback.burst(3, timeout=0) == 0


def test_stop_ends_it():
    clock = FakeClock()
    playback, events = play(clock)
    clock.at(0.15, playback.stop)
    assert len(sends(events)) == 6


def test_ticks_tell_the_time_and_stop_at_what_is_unsent():
    clock = FakeClock()
    _, events = play(clock, clock_hz=100)
    events = list(events)
    ticks = [event.stamp_ns for _, event in events if isinstance(event, Tick)]
    assert len(ticks) == 41
    assert np.diff(ticks).tolist() == pytest.approx([10_000_000] * 40, abs=2)


def test_ticks_go_on_while_paused_and_time_stands():
    clock = FakeClock()
    playback, events = play(clock, clock_hz=10, start_paused=True)
    clock.at(1.05, playback.stop)
    assert [event.stamp_ns for _, event in events] == [START] * 11


def test_lossless_does_not_wait():
    assert sends(play(lossless=True, wait_for=0)[1]) == [(0, i) for i in range(15)]


def test_at_the_end_it_may_pause_and_be_sent_back():
    clock = FakeClock()
    playback, events = play(clock, at_end=AtEnd.PAUSE)
    clock.at(2, lambda: playback.seek_frame(14))
    clock.at(3, playback.resume)
    clock.at(4, playback.stop)
    assert [i for _, i in sends(events)][15:] == [12, 13, 14]
    assert playback.state().finished


def test_state():
    clock = FakeClock()
    playback, events = play(clock, loop=2)
    clock.at(0.25, playback.pause)
    clock.at(0.3, playback.stop)
    list(events)
    state = playback.state()
    assert (state.frame, state.offset_ns, state.paused, state.round) == (12, SECOND // 4, True, 1)


@given(
    st.lists(
        st.tuples(st.integers(1, 400), st.sampled_from(['pause', 'resume', 'toggle_paused'])),
        max_size=8,
    )
)
def test_whatever_is_pressed_nothing_is_lost_or_sent_twice(deeds):
    clock = FakeClock()
    playback, events = play(clock)
    for at, deed in deeds:
        clock.at(at / 1000, getattr(playback, deed))
    clock.at(1, playback.resume)
    assert [i for _, i in sends(events)] == list(range(15))


@given(st.lists(st.tuples(st.integers(1, 900), st.integers(10, 14)), min_size=1, max_size=6))
def test_after_each_seek_comes_its_frame(seeks):
    clock = FakeClock()
    playback, events = play(clock)
    for at, frame in seeks:
        clock.at(at / 1000, lambda frame=frame: playback.seek_frame(frame))
    positions = [(type(event), getattr(event, 'position', None)) for _, event in events]
    for (kind, position), (after, following) in pairwise(positions):
        if kind is Jump and after is Send:
            assert following == position


GAPS = np.array([0, 100, 101, 864_100, 864_101]) * SECOND + START
"""Two of ten days and 99 s, one after the first second."""


def gapped(clock, **options):
    return Playback(
        GAPS, np.array([7, 3, 3, 9, 5]), PlaybackOptions(**options), clock, longest_gap_ns=SECOND
    )


def test_long_gaps_are_skipped():
    clock = FakeClock()
    playback = gapped(clock, clock_hz=10.0)
    events = [*walk(playback, clock)]
    assert sends(events) == [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4)]
    ticks = [event.stamp_ns for _, event in events if isinstance(event, Tick)]
    assert ticks == sorted(ticks)
    assert all(min(abs(GAPS - tick)) <= SECOND for tick in ticks)
    assert sends(walk(gapped(clock, rate=2.0), clock))[-1] == (2, 4)


def test_long_gaps_are_skipped_after_a_seek_and_after_a_pause():
    clock = FakeClock()
    playback = gapped(clock, start_paused=True)
    clock.at(1, lambda: playback.seek(START + 200 * SECOND))
    clock.at(2, playback.resume)
    assert sends(walk(playback, clock)) == [(3, 3), (4, 4)]


def test_time_does_not_skip_a_gap_while_paused():
    clock = FakeClock()
    playback = gapped(clock, start_paused=True)
    clock.at(0.5, lambda: playback.play_next(timeout=0))
    stamps = []
    clock.at(2, lambda: stamps.append(playback.state().stamp_ns))
    clock.at(3, playback.stop)
    assert sends(walk(playback, clock)) == [(0.5, 0)]
    assert stamps == [START]


def test_frames_need_not_be_in_order_of_number():
    clock = FakeClock()
    playback = gapped(clock, start_paused=True)
    shown = []
    for number in (9, 7, 5, 3):
        playback.seek_frame(number)
        shown.append(playback.state().stamp_ns)
    assert shown == [int(GAPS[place]) for place in (3, 0, 4, 1)]
    with pytest.raises(UsageError, match='no frame 4; it has 4 frames, 3 to 9 with gaps'):
        playback.seek_frame(4)
