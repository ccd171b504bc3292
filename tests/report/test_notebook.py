"""What a notebook shows of an object: units of the pages, what matters first, names escaped."""

import re

import numpy as np
from sample_diagnosis import effect_found, nothing_found
from sample_run import NASTY

from eha_bench.core.recording import Recording


def text_of(html: str) -> str:
    return re.sub(r"<[^>]+>", " ", html)


def test_a_diagnosis_shows_what_was_found_and_the_errors_in_units() -> None:
    html = effect_found()._repr_html_()
    assert (
        "The model lacks entrained air or external leakage (in the flow balances of the chambers)"
        in html
    )
    assert "<td>air_fraction</td><td>0.02500</td><td>0.02490 … 0.02510</td>" in html
    assert "<td>Pressure A / MPa</td><td>0.500</td><td>0.0310</td><td>0.0300</td>" in html
    assert NASTY not in html
    assert "Nothing is missing from the model" in text_of(nothing_found()._repr_html_())


def test_a_recording_shows_ranges_and_what_is_missing() -> None:
    values = np.array([0.0, 5.3e6, np.nan, 2e6])
    rec = Recording(np.arange(4) / 1e3, {"pressure_a": values, NASTY: values}, {NASTY: "Pa"})
    html = rec._repr_html_()
    assert "<td>pressure_a</td><td>0.000</td><td>5.300</td><td>MPa</td><td>1</td>" in html
    assert NASTY not in html
    whole = Recording(np.arange(3) / 1e3, {"current": np.array([-7e-4, 41.0, 3.0])})
    assert "<td>current</td><td>0.00</td><td>41.00</td><td>A</td></tr>" in whole._repr_html_()


def test_one_line_names_some_channels_of_many() -> None:
    rec = Recording(np.arange(3) / 1e3, {f"c{k}": np.zeros(3) for k in range(30)})
    assert repr(rec).endswith(", c10, c11 and 18 more>")
