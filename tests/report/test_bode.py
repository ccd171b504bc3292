"""Bode plots: what was judged is what is drawn, for readers with and without scripts."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from chromium import Page

from eha_bench.core.recording import Recording
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.signal import Lines, Signal
from eha_bench.core.trial import ControlMode, Setup, Trial
from eha_bench.metrics import score
from eha_bench.report import write_report
from eha_bench.report.bode import bode_of

HARMONICS = tuple(range(1, 42, 2))
PERIODS, REALISATIONS, RATE = 3, 4, 500
NATURAL, DAMPING = 8.0, 0.4
NOISY_FROM = 15  # line from which the disturbance hides the response


class Multisine(Signal):
    """Odd lines of 1 s, new phases every three periods."""

    @property
    def duration(self) -> float:
        return float(PERIODS * REALISATIONS)

    def __call__(self, time):
        return np.interp(time, *reference())

    @property
    def lines(self) -> tuple[Lines, ...]:
        return tuple(
            Lines(float(PERIODS * k), float(PERIODS * (k + 1)), 1.0, HARMONICS)
            for k in range(REALISATIONS)
        )


def spectra(gain: np.ndarray) -> np.ndarray:
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, (REALISATIONS, len(HARMONICS)))
    whole = np.zeros((REALISATIONS, RATE // 2 + 1), dtype=complex)
    whole[:, HARMONICS] = np.exp(1j * phases) * gain * RATE / 2
    return np.tile(np.fft.irfft(whole, axis=1), (1, PERIODS)).ravel()


def reference() -> tuple[np.ndarray, np.ndarray]:
    values = spectra(np.ones(len(HARMONICS)))
    return np.arange(values.size) / RATE, values


@pytest.fixture(scope="module")
def measured() -> tuple[Recording, Trial, TrialResult]:
    time, values = reference()
    s = 1j * np.array(HARMONICS) / NATURAL
    plant = 1.0 / (s * s + 2 * DAMPING * s + 1)
    rng = np.random.default_rng(2)
    noise = np.fft.rfft(rng.normal(size=time.size))
    noise[np.fft.rfftfreq(time.size, 1 / RATE) < NOISY_FROM * 2 + 1] *= 0.01
    response = spectra(plant) + 3.0 * np.fft.irfft(noise, time.size)
    recording = Recording(
        time,
        {"reference": values, "pressure_difference": response},
        metadata={"signal_start": "0.0"},
    )
    trial = Trial("bode", Multisine(), ControlMode.PRESSURE, Setup(), time[-1], 0.0, RATE)
    run = TrialResult("bode", 0, Status.PASSED, "", "", scores=score(recording, trial))
    return recording, trial, run


def test_what_was_judged_is_drawn(measured) -> None:
    recording, trial, run = measured
    bode = bode_of(recording, run, trial)
    gain, phase, coherence = bode.panels
    first = gain.curves[0]
    used = np.isfinite(first.values)
    s = 1j * bode.frequency[used] / NATURAL
    exact = 20 * np.log10(np.abs(1 / (s * s + 2 * DAMPING * s + 1)))
    low = bode.frequency[used] < 20
    assert first.values[used][low] == pytest.approx(exact[low], abs=0.5)
    assert np.mean((first.low[used] <= exact) & (exact <= first.high[used])) > 0.8
    scored = {item.metric: item.value for item in run.scores}
    marked = {mark.frequency for mark in (*gain.marks, *phase.marks) if mark.frequency}
    assert {scored["bandwidth_3db"], scored["bandwidth_90deg"]} <= marked
    assert [curve.label for curve in gain.curves][:2] == ["measured", "noise"]
    assert bode.left_out
    left = coherence.curves[1]
    assert np.count_nonzero(np.isfinite(left.values)) == len(bode.left_out)
    assert not np.any(np.isfinite(left.values) & np.isfinite(coherence.curves[0].values))


def test_no_band_no_plot(measured) -> None:
    recording, trial, run = measured
    assert bode_of(recording, run, None) is None
    silent = recording.with_values({"pressure_difference": np.zeros(len(recording))})
    assert bode_of(silent, run, trial) is None


@pytest.fixture(scope="module")
def page(measured, tmp_path_factory) -> Path:
    recording, trial, run = measured
    result = Result("bodes", "made up", Status.PASSED, (run,), {})
    folder = tmp_path_factory.mktemp("bode")
    return write_report(folder, result, {("bode", 0): lambda: recording}, {"bode": trial})


def test_the_page_names_what_is_left_out(page, measured) -> None:
    text = page.read_text()
    assert text.count('class="figure with-bode"') == 1
    data = json.loads(re.search(r'class="bode">(.*?)</script>', text, re.DOTALL)[1])
    assert [panel["heading"] for panel in data["panels"]] == ["Gain", "Phase", "Coherence"]
    count = len(bode_of(*(measured[k] for k in (0, 2, 1))).left_out)
    assert f"{count} points left out" in text
    assert re.search(r"<dt>[\d.]+\s?Hz</dt><dd>(coherence|gain known)", text)


def test_in_a_browser(tab: Page, page: Path) -> None:
    tab.open(page)
    tab.run("document.querySelector('.with-bode').scrollIntoView()")
    tab.wait("document.querySelectorAll('.with-bode .canvas[data-drawn]').length === 3")
    assert (
        tab.run("getComputedStyle(document.querySelector('.with-bode > .plot')).display") == "none"
    )
    tab.run("document.querySelector('.with-bode .charts').focus()")
    tab.key("ArrowRight")
    tab.key("ArrowRight")
    assert tab.run("document.querySelector('.with-bode .when').textContent") == "3 Hz"
    readings = (
        "[...document.querySelectorAll('.with-bode .reading')].map(e => e.textContent).join('|')"
    )
    assert re.match(r"0\.\d\d\|−", tab.run(readings)), tab.run(readings)
    tab.emulate(1280, media="print")
    assert (
        tab.run("getComputedStyle(document.querySelector('.with-bode > .plot')).display") == "block"
    )
    assert tab.complaints == []
