"""Noise that was taken from a wrong model's residual goes when a better one leaves none of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.signal import lfilter

from eha_bench.diagnosis.data.colour import Colour, colour_of
from eha_bench.diagnosis.fit import wandering
from eha_bench.diagnosis.fit.baseline import Baseline, colour_notes
from eha_bench.diagnosis.fit.evidence import refined_noise
from eha_bench.diagnosis.fit.problem import Piece, Problem
from eha_bench.diagnosis.fit.residual_colour import SeenNoise
from eha_bench.diagnosis.outcome import own_noise


@dataclass(frozen=True)
class Base:
    measured: tuple[Any, ...]
    problem: Any
    notes: tuple[str, ...]


@pytest.fixture(scope="module")
def colour() -> Colour:
    """That of noise which remembers its last sample by 0.7."""
    white = np.random.default_rng(5).standard_normal((40, 64))
    found = colour_of([*lfilter([1.0], [1.0, -0.7], white, axis=1)])
    assert found is not None
    return found


def run(colours: Mapping[str, Colour]) -> Any:
    return SimpleNamespace(run=SimpleNamespace(name="one"), colours=colours)


def test_a_colour_that_is_gone_has_no_note(colour: Colour) -> None:
    coloured, white = run({"motor_speed": colour}), run({})
    (note,) = colour_notes([coloured])
    assert "the noise of 'motor_speed' is not white" in note
    base = cast("Baseline", Base((coloured,), None, ("first", note, "last")))
    problem = cast("Problem", SimpleNamespace(windows=[SimpleNamespace(measured=white)]))
    found = own_noise._with_noise(base, problem, {})
    assert found.measured == (white,)
    assert found.notes == ("first", "last")


def test_a_channel_that_is_seen_white_loses_its_colour(
    colour: Colour, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = SeenNoise({}, {"motor_speed": 0.1})
    given: list[Mapping[str, Colour]] = []
    monkeypatch.setattr(wandering, "steady_noise_of_residual", lambda *_: seen)
    monkeypatch.setattr(wandering, "with_colours", lambda _, colours: given.append(colours))

    def each(change: Callable[[object], object]) -> object:
        change(run({"motor_speed": colour, "current": colour}))
        return SimpleNamespace(with_noise=lambda noise: noise)

    noise = {"motor_speed": 1.0, "current": 2.0, "force": 3.0}
    # no stretch of the force is long enough, and what is left of it is a tenth of its noise
    left = {"motor_speed": 0.3, "current": 1.9, "force": 0.3}
    monkeypatch.setattr(wandering, "refined_noise", lambda *_: left)
    stub = SimpleNamespace(noise=noise, residual=lambda _: np.zeros(1), with_measured=each)
    found: object = wandering.with_noise_of_residual(cast("Problem", stub), np.zeros(1))
    assert given == [{"current": colour}]
    assert found == {"motor_speed": 0.1, "current": 2.0, "force": 0.3}


@pytest.mark.parametrize(("loud", "taken"), [(0.05, 0.05), (1.0, 1.0), (1.5, 1.0)])
def test_a_channel_in_short_windows_is_no_louder_than_what_is_left_of_it(
    loud: float, taken: float
) -> None:
    rng = np.random.default_rng(3)
    size, count = 40, 50
    measured = SimpleNamespace(
        run=SimpleNamespace(name="one"), steps={}, input_noise={}, colours={}
    )
    windows = [SimpleNamespace(measured=measured, first=0) for _ in range(count)]
    ticks, channels = np.arange(size), np.zeros(size, dtype=np.intp)
    pieces = [Piece(k, slice(k * size, (k + 1) * size), ticks, channels) for k in range(count)]
    stub = SimpleNamespace(
        plant=SimpleNamespace(outputs=("pressure",)), pieces=pieces, windows=windows
    )
    residual = rng.normal(0.0, loud, size * count)
    found = refined_noise(cast("Problem", stub), residual, {"pressure": 2e5})
    assert found["pressure"] == pytest.approx(2e5 * taken, rel=0.05)
