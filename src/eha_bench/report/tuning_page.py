"""The page of tuned gains: before and after, or which limits contradict each other."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from eha_bench.core.per_cent import per_cent
from eha_bench.report.engineering import limit_text, metric_name, number, printed_unit
from eha_bench.report.page import Fact, write_page
from eha_bench.tuning.tune import Tuned, finite_least

PAGE: Final = "tuning.html"


@dataclass(frozen=True)
class TunedLimit:
    """A limit with its margin and its chances before and after."""

    trial: str
    about: str
    margin: str
    before: str
    after: str
    look: str


def write_tuning_page(found: Tuned, out: Path, facts: tuple[Fact, ...]) -> Path:
    """Write tuning.html into a folder; return its path."""
    clash = found.contradiction
    after, declared = found.after, found.declared
    named = [f"{limit.key} ({limit_text(limit.text)})" for limit in found.limits]
    content = {
        "suite": found.space.case.suite.name,
        "target": found.space.case.simulator.identity.name,
        "look": "failed" if clash else "passed" if found.complete else "incomplete",
        "word": "Infeasible"
        if clash
        else f"P(pass) {after.suite.value:.3f}"
        if after
        else "Passes with the model as declared",
        "headline": _headline(found),
        "gains": [
            (factor.key, printed_unit(factor.formatted(was)), printed_unit(factor.formatted(now)))
            for factor, was, now in zip(found.space.factors, found.before, found.point, strict=True)
        ],
        "limits": [
            TunedLimit(
                limit.trial,
                f"{metric_name(limit.metric)} {limit_text(limit.text)}",
                number(found.margins[k], 3, sign=True),
                f"{declared.of(k).value:.3f}" if declared else "",
                f"{after.of(k).value:.3f}" if after else "",
                "passed" if found.margins[k] >= 0.0 else "failed",
            )
            for k, limit in enumerate(found.limits)
        ],
        "unknowns": [
            (
                item.key,
                per_cent(item.share),
                f"{item.lower.value:.2f}",
                f"{item.upper.value:.2f}",
            )
            for item in (after.unknowns if after else ())
        ],
        "never": [named[k] for k in clash.never] if clash else [],
        "together": [" and ".join(named[k] for k in group) for group in clash.together]
        if clash
        else [],
        "tried": found.tried,
        "notes": found.notes,
        "facts": facts,
    }
    title = f"Gains for {found.space.case.suite.name}"
    return write_page(out / PAGE, "tuning.html.j2", content, title=title)


def _headline(found: Tuned) -> str:
    least = number(finite_least(found.margins), 3, sign=True)
    text = f"Least margin at the model as fitted {least}; {found.tried} candidates tried."
    if found.after is not None:
        whole = found.after.suite
        text = (
            f"{whole.kept} of {whole.draws} draws keep all limits (95 % interval {whole.low:.3f} "
            f"… {whole.high:.3f}). {text}"
        )
    if found.declared is not None:
        text += f" With the declared gains: P(pass) {found.declared.suite.value:.3f}."
    return text
