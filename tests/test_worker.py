"""A browser's worker: everything in order, of what is dragged only the latest."""

import threading
import time

import pytest

from hoi_retarget.errors import ClipError
from hoi_retarget.studio.browser.worker import Worker


def test_tasks_are_done_in_the_order_they_were_asked_for():
    worker, done = Worker("test", print), []
    for number in range(50):
        worker.do(lambda number=number: done.append(number))
    finished = threading.Event()
    worker.do(finished.set)
    assert finished.wait(5.0)
    worker.stop()
    assert done == list(range(50))


def test_of_what_only_the_latest_is_worth_doing_the_rest_is_dropped():
    worker, done, busy, finished = Worker("test", print), [], threading.Event(), threading.Event()
    worker.do(lambda: busy.wait(5.0))
    for number in range(20):
        worker.do_latest(lambda number=number: (done.append(number), finished.set()))
    busy.set()
    assert finished.wait(5.0)
    worker.stop()
    assert done == [19]


def test_what_is_asked_for_takes_the_place_of_what_waited():
    worker, done, busy, finished = Worker("test", print), [], threading.Event(), threading.Event()
    worker.do(lambda: busy.wait(5.0))
    worker.do_latest(lambda: done.append("dragged"))
    worker.do(finished.set)
    busy.set()
    assert finished.wait(5.0)
    worker.stop()
    assert done == []


@pytest.mark.parametrize("ask", ["do", "do_latest"])
def test_what_can_wait_is_done_before_what_is_asked_for_after_it(ask):
    worker, done, finished = Worker("test", print), [], threading.Event()
    worker.do_later(lambda: done.append("typed"), 60.0)
    getattr(worker, ask)(lambda: (done.append("asked"), finished.set()))
    assert finished.wait(5.0)
    worker.stop()
    assert done == ["typed", "asked"]


def test_what_waits_is_forgotten_for_its_own_kind_alone():
    worker, done, finished = Worker("test", print), [], threading.Event()
    worker.do_later(lambda: done.append("a"), 60.0, "frames")
    worker.do_later(lambda: done.append("b"), 60.0, "frames")
    worker.do_later(lambda: done.append("c"), 60.0, "point")
    worker.do(finished.set)
    assert finished.wait(5.0)
    worker.stop()
    assert done == ["b", "c"]


def test_a_delay_is_kept_and_starts_anew():
    worker, done, finished = Worker("test", print), [], threading.Event()
    start = time.monotonic()
    worker.do_later(lambda: done.append("first"), 0.1)
    worker.do_later(lambda: (done.append("second"), finished.set()), 0.2)
    assert finished.wait(5.0)
    worker.stop()
    assert done == ["second"]
    assert time.monotonic() - start >= 0.2


def test_stopped_it_does_nothing_more_and_its_thread_ends():
    worker, done = Worker("test to be stopped", print), []
    worker.do_later(lambda: done.append("late"), 60.0)
    worker.stop()
    worker.do(lambda: done.append("too late"))
    assert done == []
    assert all(thread.name != "test to be stopped" for thread in threading.enumerate())


def test_an_error_is_handed_on_and_the_next_task_done():
    errors, finished = [], threading.Event()
    worker = Worker("test", errors.append)

    def fail():
        raise ClipError("no such contact")

    worker.do(fail)
    worker.do(finished.set)
    assert finished.wait(5.0)
    worker.stop()
    assert [str(error) for error in errors] == ["no such contact"]
