"""Work for the tests of workers: it must be importable where it runs."""

import os
import signal
import time
from pathlib import Path


def square(x: float) -> float:
    return x * x


def fails_on_three(x: int) -> int:
    if x == 3:
        raise ValueError("three is not a good")
    return x


def kills_on_three(x: int) -> int:
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return 10 * x


def kills_once(task: tuple[int, str]) -> int:
    x, flag = task
    if x == 3 and not Path(flag).exists():
        Path(flag).write_text("done")
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * x


def slow_square(x: float) -> tuple[float, int]:
    time.sleep(0.25)
    return x * x, os.getpid()


class Shared:
    """What all items need; every arrival somewhere leaves a line in a file."""

    def __init__(self, told: str) -> None:
        self.told = told

    def __reduce__(self) -> tuple[object, ...]:
        return _arrived, (self.told,)

    def __call__(self, x: float) -> float:
        time.sleep(0.05)
        return x * x


def _arrived(told: str) -> Shared:
    with Path(told).open("a") as file:
        file.write(f"{os.getpid()}\n")
    return Shared(told)
