"""What wears, on the page and in sentences, from causes made by hand."""

import math
from pathlib import Path

import numpy as np
import pytest

from eha_bench.report.cause_plot import cause_svg, scaled_unit
from eha_bench.report.causes_section import causes_view
from eha_bench.report.causes_text import causes_line, nights_left_text, wear_sentence
from eha_bench.report.trend_site import write_site
from eha_bench.trends.history import History
from eha_bench.trends.index import Night
from eha_bench.trends.wear import Causes, CauseTrend, LimitCrossing, Number, Wear, causes_from

NIGHTS = tuple(
    Night(k, f"{k:02d}/result.json", f"2025-01-{k + 1:02d}T02:00:00+00:00", "nightly", "rig",
          "passed", "", "", "", "", "", "", None)
    for k in range(12)
)  # fmt: skip


def trend(name: str = "leakage") -> CauseTrend:
    line = np.where(np.arange(12) < 6, 2e-15, 2e-15 + 4e-15 * (np.arange(12) - 5))
    return CauseTrend(
        name, "m^3/(s*Pa)", 2e-15, NIGHTS, line + 1e-16, np.full(12, 2e-16), line, "moves"
    )


def wear(name: str = "leakage", left: Number | None = None, *, alarm: bool = True) -> Wear:
    return Wear(
        trend(name), ("external_leakage at all",), 0.97, NIGHTS[6], NIGHTS[5], NIGHTS[7],
        Number(2.4e-14, 2.3e-14, 2.5e-14), Number(4e-15, 3.9e-15, 4.1e-15),
        LimitCrossing(1e-13, np.full(3, 1e-13), "step", "response_time", "<= 60 ms"),
        left or Number(18.2, 16.9, 19.7), alarm, ((10, 1.0), (20, 0.02)),
    )  # fmt: skip


def history(causes: Causes | None) -> History:
    return History("nights", NIGHTS, (), (), causes)


def test_a_sentence_says_which_since_when_how_fast_and_how_long_yet() -> None:
    said = wear_sentence(wear()).replace("\N{NO-BREAK SPACE}", " ")
    for part in ("leakage: 2.00e−15 → 2.60e−14", "since 2025-01-07 (2025-01-06 … 2025-01-08)",
                 "4.00e−15 (3.90e−15 … 4.10e−15) m³/(s·Pa) a night", "18 (17 … 20) nights left",
                 "Response time", "≤ 60", "97", "external_leakage at all"):  # fmt: skip
        assert part in said, (part, said)


def test_a_limit_that_is_reached_and_one_that_is_not_on_the_way() -> None:
    assert "its first limit is reached" in nights_left_text(wear(left=Number(-1.0, -2.0, 0.0)))
    endless = nights_left_text(wear(left=Number(40.0, 12.0, math.inf)))
    assert "∞" in endless


@pytest.mark.parametrize(("alarm", "status"), [(True, 1), (False, 0)])
def test_only_what_matters_is_an_alarm(alarm: bool, status: int) -> None:
    found = history(Causes("nightly", "rig", (trend(),), (wear(alarm=alarm),)))
    assert found.exit_status() == status
    assert (found.status == "drifted") is alarm
    assert ("cause: leakage" in causes_line(found)) is alarm


def test_the_page_shows_causes_and_hostile_names_stay_text(tmp_path: Path) -> None:
    name = "<script>alert(1)</script>"
    causes = Causes(
        "nightly", "rig", (trend(name), trend("bulk_modulus")), (wear(name),),
        ((NIGHTS[3], "no <b>recording</b>"),), ("oil & more",),
    )  # fmt: skip
    page = write_site(tmp_path, history(causes), tmp_path).read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "no &lt;b&gt;recording" in page
    assert "Oil &amp; more" in page
    assert ">change</text>" in page
    assert "first limit: step" in page
    assert "2 % after 20 nights" in page.replace("\N{NO-BREAK SPACE}", " ")
    assert page.count("<figure>") == 2


def test_nobody_asked() -> None:
    assert causes_view(None) is None
    assert causes_line(history(None)) == ""


def test_a_plot_has_a_point_and_an_interval_a_night() -> None:
    svg = str(cause_svg(trend(), wear(), number=0))
    assert svg.count("<circle") == 12
    assert scaled_unit(trend()).symbol == "1e−15 m³/(s·Pa)"
    assert scaled_unit(trend()).factor == pytest.approx(1e15)


def test_causes_come_back_from_json_without_the_nights_that_are_gone() -> None:
    causes = Causes("nightly", "rig", (trend(),), (wear(),), ((NIGHTS[0], "why"),), ("note",))
    assert causes_from(causes.to_dict(), NIGHTS).to_dict() == causes.to_dict()
    fewer = causes_from(causes.to_dict(), NIGHTS[2:])
    assert len(fewer.trends[0].nights) == 10
    assert fewer.untold == ()
    assert causes_from(causes.to_dict(), NIGHTS[8:]).wear == ()
