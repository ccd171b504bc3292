"""Zeros that wander: told where they do, never where noise is noise, and then no cause."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from fixtures.rig.case import Conditions, record_case
from fixtures.rig.plans import make_plans
from scipy.signal import lfilter

from eha_bench.core.arrays import FloatArray
from eha_bench.diagnosis.data.colour import Colour
from eha_bench.diagnosis.data.wander import LARGEST, NoiseStretch, Wander, cosines, wander_of
from eha_bench.diagnosis.diagnose import diagnose
from eha_bench.diagnosis.fit.baseline import Baseline
from eha_bench.diagnosis.fit.prepared import orthonormal, orthonormal_of_many
from eha_bench.diagnosis.fit.thresholds import DEFAULT
from eha_bench.diagnosis.outcome import own_noise
from eha_bench.diagnosis.outcome.decide import Decision
from eha_bench.diagnosis.outcome.diagnosis import Unknown, Verdict
from eha_bench.diagnosis.search.state import Search

TICK = 1e-3
TIME = np.arange(4000) * TICK


def remembering(generator: np.random.Generator, kept: float, shape: tuple[int, int]) -> FloatArray:
    """Return stationary paths of standard deviation 1 that keep a share from tick to tick."""
    new = generator.standard_normal(shape)
    new[:, 1:] *= np.sqrt(1.0 - kept * kept)
    return np.asarray(lfilter([1.0], [1.0, -kept], new, axis=1))


def stretches(seed: int, size: float, *, colour: float = 0.0, count: int = 6) -> list[NoiseStretch]:
    generator = np.random.default_rng(seed)
    noise = remembering(generator, colour, (count, TIME.size))
    zero = remembering(generator, float(np.exp(-TICK / 1.5)), (count, TIME.size))
    known = Colour((colour,)) if colour else None
    return [NoiseStretch(TIME, own, known) for own in noise + size * zero]


@pytest.mark.parametrize("colour", [0.0, 0.35])
def test_a_zero_that_wanders_is_told_with_its_size(colour: float) -> None:
    found = [wander_of(stretches(seed, 0.25, colour=colour)) for seed in range(4)]
    assert all(item is not None for item in found)
    assert 0.17 < np.median([item.size for item in found if item]) < 0.34


@pytest.mark.parametrize("colour", [0.0, 0.35, 0.7])
def test_of_noise_alone_no_zero_wanders(colour: float) -> None:
    assert not any(wander_of(stretches(seed, 0.0, colour=colour)) for seed in range(6))


def test_what_moves_as_far_as_the_noise_is_no_zero_that_wanders() -> None:
    assert wander_of(stretches(0, 2.0 * LARGEST)) is None


def test_an_offset_is_no_zero_that_wanders() -> None:
    shifted = [NoiseStretch(s.time, s.left + 0.4, s.colour) for s in stretches(1, 0.0)]
    assert wander_of(shifted) is None


def test_too_little_tells_nothing() -> None:
    short = [NoiseStretch(s.time[:200], s.left[:200], None) for s in stretches(2, 0.3)]
    assert wander_of(short) is None


def test_cosines_make_the_covariance_of_a_zero_that_wanders() -> None:
    """Half a memory apart, in the middle of a stretch of many: exp(-1/2) of the variance."""
    waves = cosines(np.arange(0.0, 20.0, 0.01), Wander(0.3, 1.0))
    covariance = waves[800:1200] @ waves[1000]
    assert covariance[200] == pytest.approx(0.09, rel=0.05)
    assert covariance[150] == pytest.approx(0.09 * np.exp(-0.5), rel=0.05)


def test_in_a_stretch_much_shorter_than_its_memory_a_zero_stands() -> None:
    waves = cosines(TIME[:20], Wander(0.3, 5.0))
    assert np.sum(waves**2, axis=1) == pytest.approx(np.full(20, 0.09), rel=0.05)


def test_over_a_few_readings_a_zero_that_wanders_has_no_cosine() -> None:
    columns = cosines(np.array([0.0, 1e-3]), Wander(0.05, 10.0))
    assert columns.shape == (2, 0)
    basis, sizes = orthonormal_of_many(columns)
    assert basis.shape == (2, 0)
    assert sizes.size == 0


def test_a_basis_by_products_is_that_by_singular_values() -> None:
    columns = np.random.default_rng(0).standard_normal((300, 15)) * np.geomspace(30.0, 0.1, 15)
    one, other = orthonormal(columns), orthonormal_of_many(columns)
    assert np.sort(other[1]) == pytest.approx(np.sort(one[1]))
    for basis, sizes in (one, other):
        assert (basis * sizes**2) @ basis.T == pytest.approx(columns @ columns.T, abs=1e-6)


@pytest.mark.parametrize(
    ("verdict", "relative", "followed", "effects"),
    [
        (Verdict.NONE, 0.05, 0.0, []),
        (Verdict.EFFECT, 0.05, 0.0, []),
        (Verdict.UNKNOWN, 0.5, 0.0, []),
        (Verdict.UNKNOWN, 0.05, 0.6, []),
        (Verdict.UNKNOWN, 0.05, 0.0, ["gravity_load"]),
    ],
)
def test_only_a_little_that_nothing_explains_may_be_the_sensors_own(
    monkeypatch: pytest.MonkeyPatch,
    verdict: Verdict,
    relative: float,
    followed: float,
    effects: list[str],
) -> None:
    monkeypatch.setattr(own_noise, "wandering", lambda *_: pytest.fail("asked"))
    search = SimpleNamespace(
        excess_base=SimpleNamespace(relative=relative, significance=40.0),
        effects=effects,
        thresholds=DEFAULT,
    )
    unknown = Unknown("torque", (), "", followed)
    decision = SimpleNamespace(verdict=verdict, unknown=unknown)
    assert (
        own_noise.with_slow_noise(
            cast("Baseline", None), cast("Search", search), cast("Decision", decision)
        )
        is None
    )


def test_a_number_of_a_sheet_hides_no_slow_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was taken for a part of what slow noise had left."""
    asked: list[str] = []
    monkeypatch.setattr(own_noise, "with_noise_of_residual", lambda problem, _: problem)
    monkeypatch.setattr(own_noise, "refit_with_noise", lambda *_: None)
    monkeypatch.setattr(own_noise, "wandering", lambda *_: asked.append("asked") or {})
    search = SimpleNamespace(
        excess_base=SimpleNamespace(relative=0.05, significance=40.0),
        accepted=["parameter:check_a.cracking_pressure"],
        effects=[],
        problem=SimpleNamespace(prepare=lambda _: None),
        base=SimpleNamespace(vector=None),
        thresholds=DEFAULT,
    )
    decision = SimpleNamespace(verdict=Verdict.UNKNOWN, unknown=Unknown("force", (), "", 0.0))
    nothing = own_noise.with_slow_noise(
        cast("Baseline", None), cast("Search", search), cast("Decision", decision)
    )
    assert nothing is None
    assert asked == ["asked"]


@pytest.mark.parametrize(
    ("relative", "significance", "effects"),
    [(4.5, 40.0, ["air"]), (0.05, 5.0, []), (0.15, 5.0, ["air"]), (1.3, -2.0, [])],
)
def test_noise_is_told_from_a_fit_only_where_a_little_with_structure_is_left(
    monkeypatch: pytest.MonkeyPatch, relative: float, significance: float, effects: list[str]
) -> None:
    monkeypatch.setattr(own_noise, "with_noise_of_residual", lambda *_: pytest.fail("asked"))
    search = SimpleNamespace(
        excess_left=SimpleNamespace(relative=relative, significance=significance),
        effects=effects,
        thresholds=DEFAULT,
    )
    found = own_noise.with_own_noise(cast("Baseline", None), cast("Search", search))
    assert found is None


@pytest.mark.parametrize(
    ("relative", "significance", "effects"),
    [(3.5, 40.0, []), (-0.1, 0.0, []), (1.3, -2.0, ["air"])],
)
def test_noise_is_asked_of_a_fit_that_leaves_structure_or_another_level(
    monkeypatch: pytest.MonkeyPatch, relative: float, significance: float, effects: list[str]
) -> None:
    class AskedError(Exception):
        pass

    def asked(*_: object) -> None:
        raise AskedError

    monkeypatch.setattr(own_noise, "with_noise_of_residual", asked)
    search = SimpleNamespace(
        excess_left=SimpleNamespace(relative=relative, significance=significance),
        thresholds=DEFAULT,
        effects=effects,
        problem=SimpleNamespace(prepare=lambda _: None),
        fit=SimpleNamespace(vector=None),
    )
    with pytest.raises(AskedError):
        own_noise.with_own_noise(cast("Baseline", None), cast("Search", search))


@pytest.mark.slow(54)
def test_noise_that_rest_does_not_tell_hides_no_cause(tmp_path: Path) -> None:
    """Noise that remembers for half a millisecond, and zeros that drift by a fifth of it.

    With the noise as rest tells it, 5 % above it were left, and the verdict was unknown.
    """
    plan = make_plans(90231, 16, none=5, foreign=5)[17]
    found = diagnose(record_case(plan, tmp_path, Conditions(other_forms=True)))
    assert found.verdict is Verdict.EFFECT
    assert [item.id for item in found.effects] == [item.id for item in plan.hidden]
