"""The page of a diagnosis: what it says, names are never markup, and a browser takes it."""

from __future__ import annotations

import html
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chromium import Page
from sample_diagnosis import (
    DECLARED,
    effect_found,
    interrupted,
    nothing_found,
    sample_replay,
    unknown_found,
)
from sample_run import NASTY
from test_accessibility import serious
from test_browser import quiet

from eha_bench.diagnosis.data.dataset import Use
from eha_bench.diagnosis.fit.convergence import Convergence
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.diagnosis import ChannelError, Unknown, Verdict
from eha_bench.diagnosis.outcome.remainder import Remainder
from eha_bench.diagnosis.replay.error_by_value import ErrorBin, ErrorByValue
from eha_bench.plants.model import DeclaredEffect
from eha_bench.report.curve_figure import learned_curve
from eha_bench.report.diagnosis_report import write_diagnosis_report
from eha_bench.report.diagnosis_scene import diagnosis_scene
from eha_bench.report.diagnosis_text import (
    declared_wrongly,
    effect_rows,
    error_rows,
    headline,
    share,
    times,
    unknown_place,
    unknown_text,
)
from eha_bench.report.error_by_value_table import error_tables

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("diagnosis")
    return write_diagnosis_report(folder, effect_found(), f"{NASTY}/dataset.yaml", DECLARED)


@pytest.fixture(scope="module")
def unknown_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unknown")
    return write_diagnosis_report(folder, unknown_found(), "dataset.yaml", DECLARED)


@pytest.mark.parametrize(
    ("found", "status", "says"),
    [
        (effect_found(), "warned", "lacks entrained air or external leakage (in the flow"),
        (nothing_found(), "passed", "Nothing is missing"),
        (unknown_found(), "undecided", "unknown acts in the actuation and depends on time"),
        (interrupted(), "incomplete", "remains open"),
    ],
)
def test_the_verdict_is_one_sentence(found, status, says) -> None:
    told, verdict, sentence = headline(found)
    assert told == status
    assert says in verdict
    assert sentence.endswith(".")


def test_a_number_that_is_declared_wrongly_stands_in_the_headline() -> None:
    """A tick over a machine's file with a wrong gear would pass it."""
    asked = Estimate(5.001, 4.99, 5.01, "")
    found = replace(
        nothing_found(),
        corrected={"gear.ratio": 5.75},
        calibrated={"gear.ratio": asked},
    )
    told, verdict, sentence = headline(found)
    assert told == "warned"
    assert verdict.endswith("gear.ratio is declared as 5.750, and the data ask for 5.001")
    assert sentence.startswith("The error in pressure A on runs that were never fitted falls ")
    assert found.to_dict()["corrected"] == {
        "gear.ratio": {"declared": 5.75, "value": 5.001, "low": 4.99, "high": 5.01, "unit": ""}
    }


def test_parts_that_are_declared_alike_are_one_clause_of_the_headline() -> None:
    asked = Estimate(8.5e-4, 8.4e-4, 8.6e-4, "m^2")
    names = ("cylinder.area_a", "cylinder.area_b")
    found = replace(
        nothing_found(),
        corrected=dict.fromkeys(names, 8e-4),
        calibrated=dict.fromkeys(names, asked),
    )
    (clause,) = declared_wrongly(found)
    assert clause.startswith("cylinder.area_a and cylinder.area_b are declared as 8.000\u00a0cm²")
    assert clause.count("data ask for") == 1


def test_the_sentence_gives_the_error_on_held_out_runs_beside_the_noise() -> None:
    _, _, sentence = headline(effect_found())
    plain = sentence.replace("\N{NO-BREAK SPACE}", " ")
    assert "pressure A on runs that were never fitted falls from 0.5000 MPa to 31.00" in plain
    assert "noise there is 30.00 kPa" in plain


def test_an_error_that_stays_is_not_said_to_grow() -> None:
    found = effect_found()
    same = {name: replace(item, after=1.0002 * item.before) for name, item in found.holdout.items()}
    _, _, sentence = headline(replace(found, holdout=same))
    assert "stays at" in sentence


def test_an_error_is_not_said_to_fall_where_nothing_was_added(tmp_path: Path) -> None:
    where = "the model errs most where position is 0.04 to 0.05 m: speed by 8, 0.4 elsewhere"
    unknown = Unknown("flow", (), "something acts in the flow balance", where=where)
    found = replace(nothing_found(), verdict=Verdict.UNKNOWN, unknown=unknown)
    _, _, sentence = headline(found)
    assert sentence.startswith("Recalibrated, its error in ")
    assert "falls" not in sentence
    page = write_diagnosis_report(tmp_path, found, "dataset.yaml", DECLARED).read_text()
    assert f"The{where[3:]}." in page


def test_an_unknown_that_follows_nothing_is_not_said_to(tmp_path: Path) -> None:
    text = "something acts in the actuation balance in held-out runs"
    found = replace(
        nothing_found(), verdict=Verdict.UNKNOWN, unknown=Unknown("actuation", (), text)
    )
    page = write_diagnosis_report(tmp_path, found, "dataset.yaml", DECLARED).read_text()
    assert text[1:] in page
    assert "It depends on" not in page


def test_a_variable_that_is_no_channel_is_named_with_the_channel_behind_it(tmp_path: Path) -> None:
    values = {
        "equation": "force", "form": "additive", "variable": "piston_velocity", "place": "motor",
        "period": 0.0, "low": -0.1, "high": 0.1, "values": [float(k) for k in range(24)],
    }  # fmt: skip
    revised = DECLARED.with_effect(DeclaredEffect("learned", values))
    derived = {"piston_velocity": "piston_position"}
    unknown = Unknown("force", ("piston_velocity",), "", 0.9, derived=derived)
    found = replace(unknown_found(), unknown=unknown, revised=revised, replays=())
    page = write_diagnosis_report(tmp_path, found, "dataset.yaml", DECLARED).read_text()
    words = html.unescape(re.sub(r"<[^>]+>", "", page))
    assert "depends on piston velocity (derivative of piston position)" in words
    drawn = learned_curve(revised)
    assert drawn is not None
    assert drawn.variable == ("Piston velocity", "m/s")
    content = found.to_dict()["unknown"]
    assert (content["variables"], content["derived"]) == (["piston_velocity"], derived)


def test_a_sensor_that_reads_wrongly_is_the_cause_and_no_curve(tmp_path: Path) -> None:
    said = "'pressure_b' reads 0.9 times what there is"
    unknown = Unknown(
        "measurement", ("pressure_b",), "", 0.998, at="pressure_b.sensor", sensor=said
    )
    found = replace(nothing_found(), verdict=Verdict.UNKNOWN, unknown=unknown)
    page = write_diagnosis_report(tmp_path, found, "dataset.yaml", DECLARED).read_text()
    words = html.unescape(re.sub(r"<[^>]+>", "", page))
    assert f"A sensor reads wrongly: {said}" in words
    assert "Sensor in a sensor, at pressure b" in words
    assert f"{said}: read right, as here, 99.8 % of what was missing goes." in words
    assert "It depends on" not in words
    assert "learned curve" not in words


def test_a_curve_that_is_left_out_of_the_model_is_said_to_be() -> None:
    found = unknown_found()
    assert found.unknown is not None
    assert "without it" not in unknown_text(found.unknown, found.revised.effects)
    assert "the revised model is without it" in unknown_text(found.unknown, ())


def test_the_place_of_an_unknown_is_named() -> None:
    assert unknown_place(Unknown("flow", ("time",), "", at="supply")).endswith(", at supply")
    assert unknown_place(Unknown(None, (), "")) == ""


def test_names_are_text(page: Path) -> None:
    text = page.read_text()
    assert NASTY not in text
    assert text.count("&lt;script&gt;alert(1)&lt;/script&gt;") > 4


def test_the_page_tells_all_parts(page: Path) -> None:
    text = page.read_text()
    for part in (
        "Cause", "Errors of the model", "do not distinguish", "Ranking of the candidates",
        "not determined by these data", "squeeze it at several pressures", "diverges",
        "20 rejected: not refitted",
        "leakage is not determined", "0.02490 … 0.02510",
    ):  # fmt: skip
        assert part in text, part


def test_it_shows_where_the_model_holds() -> None:
    """The revised model errs by the noise everywhere; below -10 rad/s lies a bin of its own."""
    tables = error_tables(effect_found().error_by_value, {"pressure_a": 3e4})
    assert [table.name for table in tables] == ["Pressure A", "Motor speed"]
    rows = {row.name: row for row in tables[0].rows}
    assert set(rows) == {"Pressure A", "Motor speed"}
    assert rows["Pressure A"].fitted == "9.00 … 12.00\N{NO-BREAK SPACE}MPa"
    errors = [cell.error for cell in rows["Pressure A"].cells]
    assert len(errors) == 7
    assert all(28 <= float(error) <= 32 for error in errors), "kPa, below and above too"
    assert {cell.shade for cell in rows["Pressure A"].cells} == {0}
    below = rows["Motor speed"].cells[0]
    assert below.within.startswith("\N{MINUS SIGN}191")


def test_shades_double_from_twice_the_noise_floor() -> None:
    errors = (1.9, 2.1, 4.1, 8.1, 16.1)
    part = tuple(ErrorBin(k, k + 1.0, errors[k], 1.0, float(k > 0)) for k in range(5))
    item = ErrorByValue("angle", "m", "angle", "m", None, part, None)
    (table,) = error_tables([item], {"angle": 1.0})
    cells = table.rows[0].cells
    assert [cell.shade for cell in cells] == [0, 0, 1, 2, 3, 4, 0]
    assert [cell.fitted for cell in cells[1:6]] == [False, True, True, True, True]


def test_a_model_that_nothing_was_added_to_is_shown_once(tmp_path: Path) -> None:
    found = nothing_found()
    same = replace(found, revised=found.recalibrated)
    text = write_diagnosis_report(tmp_path, same, "x", DECLARED).read_text()
    assert "recalibrated" in text
    assert ">revised<" not in text
    assert 'data-label="Revised"' not in text


def test_an_interrupted_diagnosis_has_a_page(tmp_path: Path) -> None:
    text = write_diagnosis_report(tmp_path, interrupted(), "x", DECLARED).read_text()
    assert "Interrupted" in text
    assert "Interrupted, so the verdict is open." in text
    assert "It depends on" not in text
    assert "None" not in text
    assert "Errors of the model" not in text


def test_an_effect_of_a_fit_that_has_not_converged_has_no_interval_and_says_why() -> None:
    found = effect_found()
    effect = found.effects[0]
    number = replace(next(iter(effect.parameters.values())), low=math.nan, high=math.nan)
    effect = replace(effect, parameters={"strength": number})
    stuck = Convergence(distance=9.0, ratio=1.1, starts=3, agreed=1, at_bounds={})
    told = replace(found, convergence=stuck)
    assert effect_rows(effect, told)[0].interval == "no interval: not converged"
    told = replace(found, convergence=None)
    assert effect_rows(effect, told)[0].interval == "not determined by these data"
    left = Remainder(0.1, "flow", "a", "pressure_a", 0.9, found_there=(effect.id,))
    told = replace(told, remainder=left)
    assert effect_rows(effect, told)[0].interval == "no interval: its law may be another one"


def test_short_gaps_between_times_are_closed() -> None:
    assert times(((0.5, 0.9), (0.905, 1.0), (1.5, 2.0))) == "0.500 … 1.000 s, 1.500 … 2.000 s"


def test_a_share_is_never_more_than_all() -> None:
    assert share(1.5) == "100.0 %"
    assert share(-0.1) == "nothing"


def test_a_run_that_runs_away_does_not_flatten_what_was_measured() -> None:
    replay = sample_replay("a", Use.TRAIN, 0)
    replay.simulated[2]["pressure_a"][1000:] = 1e12
    replay.simulated[2]["pressure_a"][1500:] = np.inf
    scene = diagnosis_scene(replay, {"pressure_a": 3e4})
    drawn = scene.recording["pressure_a: revised"]
    assert np.nanmax(drawn) < 1e8
    assert np.isnan(drawn[1000:]).all()


def test_the_learned_curve_closes_its_period() -> None:
    curve = learned_curve(unknown_found().revised)
    assert curve is not None
    assert curve.at[-1] == 1.0
    assert curve.values[-1] == curve.values[0]
    assert curve.amount == ("Added to the command", "A")


@pytest.mark.parametrize(
    ("equation", "form", "place", "variable"),
    [
        ("torque", "friction", "motor", "motor_speed"),
        ("flow", "gain", "a_to_b", "pressure_difference"),
        ("measurement", "additive", "pressure_a", "pressure_sum"),
        ("measurement", "additive", "pressures", "time"),
        ("force", "additive", "motor", "piston_position"),
    ],
)
def test_any_learned_curve_is_drawn(tmp_path, equation, form, place, variable) -> None:
    values = {
        "equation": equation, "form": form, "variable": variable, "place": place, "period": 0.0,
        "low": 0.0, "high": 1.0, "values": [float(k) for k in range(24)],
    }  # fmt: skip
    revised = DECLARED.with_effect(DeclaredEffect("learned", values))
    found = replace(unknown_found(), revised=revised, replays=())
    assert "<svg" in write_diagnosis_report(tmp_path, found, "x", DECLARED).read_text()


@pytest.mark.parametrize("width", [1280, 390])
def test_a_browser_draws_it_quietly(tab: Page, page: Path, width: int) -> None:
    tab.emulate(width)
    tab.open(page)
    tab.run("document.querySelector('.with-charts').scrollIntoView()")
    tab.wait("document.querySelectorAll('.canvas[data-drawn]').length >= 2")
    assert tab.run("document.documentElement.scrollWidth") <= width
    quiet(tab, page)


def test_a_run_opens_where_it_is_asked_for(tab: Page, page: Path) -> None:
    tab.open(page, "#trial=locked_steps")
    tab.wait("document.querySelector('details.run').open")


@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (1280, "dark"),
        pytest.param(1280, "light", marks=pytest.mark.slow),
        pytest.param(390, "light", marks=pytest.mark.slow),
    ],
)
def test_no_serious_finding(tab: Page, unknown_page: Path, width: int, scheme: str) -> None:
    tab.emulate(width, scheme=scheme)
    tab.open(unknown_page)
    tab.run("document.querySelector('.with-charts').scrollIntoView()")
    tab.wait("document.querySelector('.canvas[data-drawn]')")
    assert serious(tab) == []


def test_an_interval_that_reaches_nothing_says_so_in_one_digit() -> None:
    from eha_bench.report.diagnosis_text import parameter_row

    row = parameter_row("slip.conductance", Estimate(1.1e-9, 0.0, 2.2e-9, "m^3/(s*Pa)"))
    assert row.interval.startswith("0 … 2.2")


def test_a_frequency_is_no_speed() -> None:
    from eha_bench.diagnosis.fit.uncertainty import Estimate
    from eha_bench.report.diagnosis_text import parameter_row

    own = parameter_row("valve.natural_frequency", Estimate(508.2, 500.0, 516.0, "rad/s"), 440.0)
    assert own.value == "508.2\N{NO-BREAK SPACE}rad/s"
    assert own.declared == "440.0\N{NO-BREAK SPACE}rad/s"
    speed = parameter_row("seals.stribeck_velocity", Estimate(1.0, 0.9, 1.1, "rad/s"))
    assert speed.value.endswith("rpm")


def test_a_channel_without_noise_has_its_row() -> None:
    errors = {
        "current": ChannelError(0.0, 0.0, 0.0, 0.0, "A"),
        "motor_speed": ChannelError(2.0, 2.0, 1.0, 0.5, "rad/s"),
    }
    rows = error_rows(errors)
    assert rows[1].channel.lower().startswith("current")
    assert rows[1].ratio != rows[0].ratio
