"""The page of a machine before and after: recordings, diagnosis, model, gains, its own results."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Score, ScoreStatus
from eha_bench.core.units import factor_and_offset
from eha_bench.report.diagnosis_text import where, words_of
from eha_bench.report.engineering import (
    DisplayUnit,
    channel_name,
    decimals_for,
    display_unit,
    limit_text,
    metric_name,
    number,
    printed_unit,
    quantity,
)
from eha_bench.report.page import Fact, write_page

_NOTHING: Final = "\N{EN DASH}"
_RUNS: Final = {"unseen": "unseen runs", "holdout": "held-out runs", "train": "fitted runs"}
_RANK: Final = (
    ScoreStatus.PASSED, ScoreStatus.WARNED, ScoreStatus.UNDECIDED, ScoreStatus.NOT_SCORED,
    ScoreStatus.FAILED,
)  # fmt: skip


@dataclass(frozen=True)
class BeforeAfter:
    """What the page shows.

    Attributes:
        diagnosis: content of diagnosis.json. tuning: of tuning.json.
        before: the machine's result with the gains as they were, if there is one.
        after: with the tuned gains; None where the machine has not been run with them.
        notes: what does not belong together. diagnosis_folder, tuning_folder, result_folders: where
            the pages lie that are linked.
    """

    diagnosis: Mapping[str, Any]
    tuning: Mapping[str, Any]
    before: Result | None
    after: Result | None
    notes: tuple[str, ...]
    diagnosis_folder: Path
    tuning_folder: Path
    result_folders: tuple[Path, ...]


@dataclass(frozen=True)
class ErrorChange:
    """A channel's error of the model as calibrated and as revised, as text."""

    channel: str
    before: str
    after: str
    floor: str
    worse: bool


@dataclass(frozen=True)
class LimitChange:
    """A limit: what the machine did before and after, and what was stated."""

    trial: str
    about: str
    before: str
    after: str
    stated: str
    status: str


def write_before_after(content: BeforeAfter, path: Path) -> Path:
    """Write the page and return its path."""
    diagnosis, tuning, after = content.diagnosis, content.tuning, content.after
    kind = next((name for name in _RUNS if diagnosis["error"].get(name)), "train")
    rows = _limit_rows(content)
    look, word, sentence = _summary(content, rows)
    page = {
        "look": look,
        "word": word,
        "sentence": sentence,
        "suite": tuning["suite"],
        "target": after.target if after else _NOTHING,
        "notes": content.notes,
        "covered": _covered_facts(diagnosis),
        "cause": _cause(diagnosis),
        "errors_of": _RUNS[kind],
        "is_revised": diagnosis["verdict"] != "none",
        "errors": _errors(diagnosis["error"].get(kind, {})),
        "effects": _effects(diagnosis),
        "parameters": _parameters(diagnosis),
        "gains": [_gain(name, item) for name, item in tuning["gains"].items()],
        "stated": _chance(tuning["p_pass"]),
        "stated_before": _chance(tuning["p_pass_before"]),
        "infeasible": tuning["infeasible"] is not None,
        "rows": rows,
        "has_before": content.before is not None,
        "has_after": after is not None,
        "links": _links(content, path),
        "facts": _facts(content),
    }  # fmt: skip
    title = f"Before and after: {tuning['suite']}"
    return write_page(path, "before_after.html.j2", page, title=title)


def _summary(content: BeforeAfter, rows: Sequence[LimitChange]) -> tuple[str, str, str]:
    """Return status, verdict and one sentence."""
    stated = content.tuning["p_pass"]
    amount = (
        f"P(pass) was predicted as {_chance(stated)}." if stated else "No P(pass) was predicted."
    )
    if content.after is None:
        return (
            "undecided",
            "Not run yet",
            f"The machine has not been run with these gains. {amount}",
        )
    kept = sum(row.status == "passed" for row in rows)
    sentence = f"With the tuned gains the machine keeps {kept} of {len(rows)} limits"
    if content.before is not None:
        earlier = list(_limited_scores(content.before).values())
        count = sum(not scores[0].status.rejects for scores in earlier)
        sentence += f"; with the previous gains it kept {count} of {len(earlier)}"
    status = content.after.status
    word = "Passed" if status is Status.PASSED else "Not passed"
    return status.value, f"{word} on the machine", f"{sentence}. {amount}"


def _covered_facts(diagnosis: Mapping[str, Any]) -> list[Fact]:
    covered = diagnosis["covered"] or {}
    found = []
    if covered.get("seconds"):
        found.append(Fact("Length of the recordings", quantity(float(covered["seconds"]), "s")))
    if covered.get("rate"):
        found.append(Fact("Sample rate", f"{float(covered['rate']):.6g} Hz"))
    for setup in covered.get("setups", []):
        words = ", ".join(f"{key} {setup[key]}" for key in ("piston", "bypass") if setup.get(key))
        found.append(Fact("Setup", words))
    return found


def _cause(diagnosis: Mapping[str, Any]) -> str:
    if diagnosis["verdict"] == "none":
        numbers = [f"another {name}" for name in diagnosis.get("corrected") or {}]
        maps = [f"another channel map ({words})" for words in diagnosis.get("misread") or []]
        doubts = [f"perhaps {words}" for words in diagnosis.get("doubtful") or []]
        but = ", ".join([*numbers, *maps, *doubts])
        return f"Nothing is missing from the model{f' but {but}' if but else ''}."
    if diagnosis["verdict"] == "effect":
        causes = [f"{words_of(i['id'])} (in {where(i['equation'])})" for i in diagnosis["effects"]]
        return f"The model lacked {', '.join(causes)}."
    unknown = diagnosis["unknown"] or {}
    if unknown.get("sensor"):
        return f"A sensor reads wrongly: {unknown['sensor']}."
    if unknown.get("equation"):
        return f"Something unknown acts in {where(unknown['equation'])}."
    return "Something is missing from the model; what it is remains open."


def _errors(errors: Mapping[str, Any]) -> list[ErrorChange]:
    rows = []
    for channel, item in errors.items():
        before, after, unit = item["before"], item["after"], item["unit"]
        if before is None or after is None:
            continue
        floor = item["noise_floor"]
        # one unit a row, so that its numbers compare at a glance
        shown = display_unit(unit, (before, floor or 0.0))
        noise = _NOTHING if floor is None else _error(floor, shown)
        rows.append(
            ErrorChange(
                channel_name(channel), _error(before, shown), _error(after, shown), noise,
                after > before,
            )
        )  # fmt: skip
    return rows


def _error(value: float, unit: DisplayUnit) -> str:
    amount = unit.difference(value)
    return number(amount, decimals_for(amount)) + unit.suffix


def _effects(diagnosis: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    return [
        (f"{item['id']}.{name}", *_estimate(value))
        for item in diagnosis["effects"]
        for name, value in item["parameters"].items()
    ]


def _parameters(diagnosis: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    return [(name, *_estimate(value)) for name, value in diagnosis["calibrated"].items()]


def _estimate(item: Mapping[str, Any]) -> tuple[str, str]:
    """Return a value and its interval as text; a curve has neither."""
    value, low, high, unit = (item.get(key) for key in ("value", "low", "high", "unit"))
    if not isinstance(value, (int, float)):
        return _NOTHING, _NOTHING
    interval = _NOTHING
    if isinstance(low, (int, float)) and isinstance(high, (int, float)):
        shown = display_unit(str(unit or ""), (value,))
        digits = decimals_for(shown.from_si(value), shown.difference(0.5 * (high - low)))
        interval = " … ".join(number(shown.from_si(end), digits) for end in (low, high))
        return number(shown.from_si(value), digits) + shown.suffix, interval
    return quantity(float(value), str(unit or "")), interval


def _gain(name: str, item: Mapping[str, Any]) -> tuple[str, str, str]:
    shown, unit = item.get("written_in") or item.get("unit") or "", item.get("unit") or ""
    factor, offset = factor_and_offset(shown, unit) if shown and unit else (1.0, 0.0)

    def amount(value: float | None) -> str:
        return (
            _NOTHING
            if value is None
            else f"{(value - offset) / factor:.5g} {printed_unit(shown)}".rstrip()
        )

    return name, amount(item["before"]), amount(item["after"])


def _chance(item: Mapping[str, Any] | None) -> str:
    if item is None:
        return _NOTHING
    return f"{item['value']:.3f} ({item['low']:.3f} … {item['high']:.3f})"


def _limited_scores(result: Result) -> dict[tuple[str, str, str], list[Score]]:
    """Return the scores that have a limit, by trial, metric and limit, the worst repeat first."""
    found: dict[tuple[str, str, str], list[Score]] = {}
    for run in result.trials:
        for score in _scores_with_limit(run):
            found.setdefault((run.id, score.metric, score.limit), []).append(score)
    return {
        key: sorted(scores, key=lambda item: -_RANK.index(item.status))
        for key, scores in found.items()
    }


def _scores_with_limit(run: TrialResult) -> list[Score]:
    return [score for score in run.scores if score.limit]


def _limit_rows(content: BeforeAfter) -> list[LimitChange]:
    """Return a row for each limit of the later result, or of the tuning where there is none."""
    stated = {
        (item["key"].rpartition("#")[0] or item["key"], item["limit"]): item["p_pass"]
        for item in content.tuning["limits"]
    }
    if content.after is None:
        return [
            LimitChange(key, limit_text(text), _NOTHING, _NOTHING, _chance(chance), "undecided")
            for (key, text), chance in stated.items()
        ]
    before = _limited_scores(content.before) if content.before else {}
    rows = []
    for (trial, metric, limit), scores in _limited_scores(content.after).items():
        chance = next(
            (
                item
                for (key, text), item in stated.items()
                if text == limit
                and key in (f"{trial}.{metric}", f"{trial}.{metric}.{scores[0].channel}")
            ),
            None,
        )
        earlier = before.get((trial, metric, limit))
        rows.append(
            LimitChange(
                trial, f"{metric_name(metric)} {limit_text(limit)}",
                _values(earlier) if earlier else _NOTHING, _values(scores), _chance(chance),
                "failed" if scores[0].status.rejects else "passed",
            )
        )  # fmt: skip
    return rows


def _values(scores: Sequence[Score]) -> str:
    """Return the value of a limit's score; of several repeats from the least to the largest."""
    known = [score.value for score in scores if np.isfinite(score.value)]
    if not known:
        return "not scored"
    first = scores[0]
    ends = dict.fromkeys(
        quantity(value, first.unit, metric=first.metric) for value in (min(known), max(known))
    )
    return " … ".join(ends)


def _links(content: BeforeAfter, path: Path) -> list[tuple[str, str]]:
    """Return names and addresses of the pages that this one rests on."""
    pages = [
        ("Diagnosis", content.diagnosis_folder / "diagnosis.html"),
        ("Revised model", content.diagnosis_folder / str(content.diagnosis["model"])),
        ("Tuning", content.tuning_folder / "tuning.html"),
        ("Tuned gains", content.tuning_folder / str(content.tuning["controller"])),
        *(
            (f"Report in {folder.name}", folder / "report.html")
            for folder in content.result_folders
        ),
    ]
    folder = path.resolve().parent
    return [
        (name, Path(os.path.relpath(page.resolve(), folder)).as_posix())
        for name, page in pages
        if page.is_file()
    ]


def _facts(content: BeforeAfter) -> list[Fact]:
    facts = [Fact("Dataset", str((content.diagnosis["covered"] or {}).get("dataset", _NOTHING)))]
    for name, result in (("Result before", content.before), ("Result after", content.after)):
        if result is not None:
            facts.append(Fact(name, result.provenance.get("started", _NOTHING)))
    return facts
