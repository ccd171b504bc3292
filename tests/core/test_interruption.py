"""Ctrl-C is a request first, an interrupt when repeated."""

import os
import signal
import threading
from pathlib import Path

import pytest

from eha_bench.core.interruption import (
    Interruption,
    checkpoint,
    checkpoints,
    signals_noted_only,
    signals_raised_after,
)
from forked import Forked


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_is_noted_and_the_second_interrupts(number: int) -> None:
    before = signal.getsignal(number)
    with Interruption() as interrupted:
        assert not interrupted()
        os.kill(os.getpid(), number)
        assert interrupted()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert signal.getsignal(number) is before


def test_another_thread_is_left_alone() -> None:
    found: list[bool] = []

    def work() -> None:
        with Interruption() as interrupted:
            found.append(interrupted())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [False]


def test_checkpoints_interrupt_only_where_they_were_asked_to() -> None:
    asked = [False]
    with checkpoints(lambda: asked[0]):
        checkpoint()
        asked[0] = True
        with pytest.raises(KeyboardInterrupt):
            checkpoint()
    checkpoint()


def test_a_noted_signal_is_raised_again_once_its_work_is_kept() -> None:
    done: list[str] = []

    @signals_raised_after()
    def work() -> None:
        with Interruption() as asked:
            os.kill(os.getpid(), signal.SIGINT)
        assert asked()
        done.append("kept")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["kept"]


def test_nothing_is_raised_where_no_signal_came() -> None:
    with signals_raised_after(), Interruption() as asked:
        pass
    assert not asked()


def test_a_signal_is_raised_again_by_the_outermost_alone() -> None:
    done: list[str] = []

    @signals_raised_after()
    def inner() -> None:
        with Interruption():
            os.kill(os.getpid(), signal.SIGINT)
        done.append("inner")

    @signals_raised_after()
    def outer() -> None:
        inner()
        done.append("outer")

    with pytest.raises(KeyboardInterrupt):
        outer()
    assert done == ["inner", "outer"]


def test_ctrl_c_leaves_what_is_only_returned() -> None:
    with signals_raised_after(kept=False), Interruption() as asked:
        os.kill(os.getpid(), signal.SIGINT)
    assert asked()


def test_a_request_to_end_is_never_lost(forked: Forked, tmp_path: Path) -> None:
    code = (
        "import os, signal\n"
        "from eha_bench.core.interruption import Interruption, signals_raised_after\n"
        "for number in range(2):\n"
        "    with signals_raised_after(kept=False), Interruption():\n"
        "        os.kill(os.getpid(), signal.SIGTERM)\n"
        "    print('went on', flush=True)\n"
    )
    done = forked.run(folder=tmp_path, code=code)
    assert done.returncode == -signal.SIGTERM
    assert "went on" not in done.stdout


def test_who_ends_by_itself_is_not_raised_at() -> None:
    with signals_noted_only(), signals_raised_after(), Interruption() as asked:
        os.kill(os.getpid(), signal.SIGINT)
    assert asked()
