"""What is marked on a sine lies where the sine is: by hand-worked amplitudes, lag and limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sample_run import SineSignal, limit, score

from eha_bench.core.recording import Recording
from eha_bench.core.result import Status, TrialResult
from eha_bench.core.signal import Tone
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.report.charts import chart_data
from eha_bench.report.marks import LevelLine, Point, Role, TimeBand, TimeLine, Tube
from eha_bench.report.scene import Scene, scene_of
from eha_bench.report.scene_figure import scene_svg

CHANNEL = "pressure_difference"
# 5 Hz, 10 MPa about 12 MPa; the answer is 0.8 of it about 12.5 MPa, 10 ms late.
TONE = Tone(0.0, 2.0, 5.0, 10e6, 12e6)
LIMITS = (
    limit("amplitude_ratio", CHANNEL, 0.7, math.inf, ">= 0.7", ""),
    limit("time_lag", CHANNEL, -math.inf, 0.02, "<= 20 ms", "s"),
    limit("tracking_max", CHANNEL, -math.inf, 4e6, "<= 4 MPa", "Pa"),
)
SCORES = (
    score("amplitude_ratio", CHANNEL, 0.8, "", text=">= 0.7"),
    score("time_lag", CHANNEL, 0.01, "s", text="<= 20 ms"),
    score("tracking_max", CHANNEL, 3.9e6, "Pa", text="<= 4 MPa"),
)


@pytest.fixture(scope="module")
def scene() -> Scene:
    trial = Trial("sine", SineSignal(TONE), ControlMode.PRESSURE, Setup(), 2.0, limits=LIMITS)
    time = np.arange(2000) / 1000.0
    answer = 12.5e6 + 8e6 * np.sin(2 * math.pi * 5.0 * (time - 0.01))
    recording = Recording(
        time, {CHANNEL: answer, "reference": trial.reference(time)}, metadata={"signal_start": "0"}
    )
    return scene_of(recording, TrialResult("sine", 0, Status.PASSED, "", "", SCORES), trial)


def levels(scene: Scene, role: Role) -> list[float]:
    return sorted(m.value for m in scene.marks if isinstance(m, LevelLine) and m.role is role)


def test_amplitudes_lie_about_the_answers_own_centre(scene: Scene) -> None:
    assert levels(scene, Role.MEASURED) == pytest.approx([4.5e6, 20.5e6], rel=1e-4)
    assert levels(scene, Role.LIMIT) == pytest.approx([5.5e6, 19.5e6], rel=1e-4)


def test_the_lag_is_marked_at_the_crest(scene: Scene) -> None:
    crest = next(m for m in scene.marks if isinstance(m, TimeLine) and m.role is Role.LEVEL)
    # a sine of 0.2 s peaks after a quarter of it
    assert (crest.time - 0.05) % 0.2 == pytest.approx(0.0, abs=1e-3)
    point = next(m for m in scene.marks if isinstance(m, Point))
    assert point.time - crest.time == pytest.approx(0.01)
    assert point.value == pytest.approx(20.5e6, rel=1e-4)
    late = next(m for m in scene.marks if isinstance(m, TimeLine) and m.role is Role.LIMIT)
    assert late.time - crest.time == pytest.approx(0.02)


def test_periods_that_no_fit_uses_are_shaded(scene: Scene) -> None:
    band = next(m for m in scene.marks if isinstance(m, TimeBand))
    assert (band.start, band.stop) == pytest.approx((0.0, 0.4))  # two periods of 0.2 s


def test_a_limit_on_the_error_is_drawn_along_the_reference(scene: Scene) -> None:
    tube = next(m for m in scene.marks if isinstance(m, Tube))
    assert (tube.low, tube.high) == (-4e6, 4e6)
    marks = chart_data(scene).scene["panels"][0]["marks"]
    packed = next(mark for mark in marks if mark["kind"] == "Tube")
    assert (packed["low"], packed["high"]) == pytest.approx((-4.0, 4.0))  # MPa
    svg = str(scene_svg(scene, key="k", title="t"))
    assert "tracking error" in svg
    assert "amplitude ratio ≥ 0.7" in svg.replace("\u00a0", " ")


def test_of_a_sine_that_could_not_be_fitted_nothing_is_marked(scene: Scene) -> None:
    short = replace(TONE, stop=0.5)  # two and a half periods: too few
    trial = Trial("sine", SineSignal(short), ControlMode.PRESSURE, Setup(), 0.5, limits=LIMITS[:1])
    run = TrialResult("sine", 0, Status.PASSED, "", "", ())
    drawn = scene_of(scene.recording.between(0.0, 0.5), run, trial)
    assert drawn.panels
    assert not [m for m in drawn.marks if isinstance(m, LevelLine | Point | TimeBand)]
