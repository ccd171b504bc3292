"""The shell that all pages share."""

import re
from pathlib import Path

import pytest
from chromium import Page
from jinja2 import DictLoader, UndefinedError
from matplotlib.figure import Figure
from sample_run import NASTY

from eha_bench.report.embed_svg import SHADES
from eha_bench.report.figure_view import FigureView
from eha_bench.report.figures import plot_style, render_svg
from eha_bench.report.page import (
    Fact,
    content_security_policy,
    environment,
    render_page,
    write_page,
)

TEMPLATE = """
{% extends "base.html.j2" %}
{% from "parts/status.html.j2" import verdict %}
{% from "parts/tables.html.j2" import fact_list %}
{% from "parts/figure.html.j2" import plot %}
{% block masthead %}<h1>{{ name }}</h1>{% endblock %}
{% block main %}{{ verdict("warned", "Drifted", name) }}{{ plot(figure, name) }}{% endblock %}
{% block foot %}{{ fact_list(facts) }}{% endblock %}
"""


@pytest.fixture
def other_kind(monkeypatch: pytest.MonkeyPatch) -> str:
    """A page of another kind, as diagnosis or comparison are."""
    shared = environment().loader
    assert shared is not None
    own = DictLoader({"other.html.j2": TEMPLATE})

    class Both(DictLoader):
        def get_source(self, env, template):
            loader = own if template == "other.html.j2" else shared
            return loader.get_source(env, template)

    monkeypatch.setattr(environment(), "loader", Both({}))
    return "other.html.j2"


def bars() -> FigureView:
    with plot_style():
        figure = Figure(figsize=(6, 2))
        figure.add_subplot().bar(["a", "b"], [1.0, 2.0], color=SHADES["blue"])
        return FigureView("bars", render_svg(figure, "bars", title="bars"))


def test_another_page_shares_shell_and_parts(tab: Page, other_kind: str, tmp_path: Path) -> None:
    content = {"name": NASTY, "figure": bars(), "facts": (Fact("Revision", NASTY, code=True),)}
    path = write_page(tmp_path / "other.html", other_kind, content, title=NASTY)
    tab.open(path)
    assert tab.run("document.querySelector('h1').textContent") == NASTY
    assert tab.run("document.title") == NASTY
    # a static plot shows also where scripts run
    assert tab.run("document.querySelector('.plot svg').getBoundingClientRect().height") > 100
    assert tab.complaints == []
    assert tab.requests == [path.as_uri()]


def test_an_unknown_name_in_a_template_is_an_error(other_kind: str) -> None:
    with pytest.raises(UndefinedError):
        render_page(other_kind, {"name": "x"}, title="x")


def test_the_policy_names_digests_only() -> None:
    policy = content_security_policy(["a{}"], ["1", "2"])
    assert policy.count("'sha256-") == 3
    assert "unsafe" not in policy
    assert not re.search(r"https?:|\*", policy)
    empty = content_security_policy([], [])
    assert "script-src 'none'" in empty
    assert "style-src 'none'" in empty
