"""Ctrl-C is a request first, an interrupt when repeated."""

import os
import signal
import threading

import pytest

from eha_bench.core.interruption import Interruption, checkpoint, checkpoints


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
