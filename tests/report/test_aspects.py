"""What each metric shows of a response, by which the comparison's page puts them together."""

from __future__ import annotations

from eha_bench.core import plugins
from eha_bench.report.aspects import aspect_of


def test_every_metric_of_ours_has_an_aspect() -> None:
    ids = plugins.names("metrics")
    assert "rise_time" in ids
    assert [metric for metric in ids if aspect_of(metric, "") == "Other"] == []


def test_one_that_is_not_ours_is_placed_by_its_unit() -> None:
    assert aspect_of("overshoot", "") == "Damping"
    assert aspect_of("of_a_plug_in", "s") == "Speed"
    assert aspect_of("of_a_plug_in", "N*m") == "Effort"
    assert aspect_of("of_a_plug_in", "K") == "Other"
