"""JUnit XML of a run, for CI servers: one test case an acceptance limit and run.

A limit that is not kept is a `<failure>`, also where it is undecided or not scored: the command
leaves with status 1 then. Faults, safety stops and unfinished runs are `<error>`: the rig is to
be looked at, not the actuator. A limit that was not scored because its run stopped is that run's
error.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from eha_bench.core.atomic_file import write_text
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Score, ScoreStatus
from eha_bench.report.engineering import quantity

# XML 1.0 has no way to write these.
_FORBIDDEN: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(path: Path, result: Result) -> None:
    """Write `junit.xml` whole or not at all."""
    write_text(path, junit(result))


def junit(result: Result) -> str:
    """Return a run as JUnit XML: a test suite a run of a trial, a test case a limit."""
    root = ET.Element("testsuites", {"name": _clean(result.suite)})
    total = {"tests": 0, "failures": 0, "errors": 0}
    started = result.provenance.get("started", "")
    for run in result.trials:
        suite = ET.SubElement(root, "testsuite", {"name": _clean(_name(result, run))})
        if started:
            suite.set("timestamp", _clean(started))
        for score in run.scores:
            if score.limit:
                _limit_case(suite, result, run, score)
        stopped = run.status in (Status.FAULT, Status.INCOMPLETE)
        # what ended a run, or was beyond a safety limit, where no limit says so
        told = "testcase/error" if stopped else "testcase/failure"
        untold = run.status is not Status.PASSED and suite.find(told) is None
        if len(suite) == 0 or untold:
            _run_case(suite, result, run)
        counted = {
            "tests": len(suite.findall("testcase")),
            "failures": len(suite.findall("testcase/failure")),
            "errors": len(suite.findall("testcase/error")),
        }
        for key, count in counted.items():
            suite.set(key, str(count))
            total[key] += count
        text = [run.reason, *run.notes, f"recording: {run.recording}" if run.recording else ""]
        output = "\n".join(line for line in text if line)
        if output:
            ET.SubElement(suite, "system-out").text = _clean(output)
    if result.status is Status.INCOMPLETE and total["errors"] == 0:
        # Nothing that was run says so, but trials are missing.
        suite = ET.SubElement(root, "testsuite", {"name": _clean(result.suite)})
        case = ET.SubElement(suite, "testcase", {"classname": _clean(result.suite), "name": "run"})
        ET.SubElement(case, "error", {"type": "incomplete", "message": "not all trials were run"})
        suite.attrib.update({"tests": "1", "failures": "0", "errors": "1"})
        total["tests"] += 1
        total["errors"] += 1
    root.attrib.update({key: str(count) for key, count in total.items()})
    ET.indent(root, " ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _name(result: Result, run: TrialResult) -> str:
    return f"{result.suite}.{run.id}" + (f".{run.repeat}" if run.repeat else "")


def _limit_case(suite: ET.Element, result: Result, run: TrialResult, score: Score) -> None:
    case = ET.SubElement(
        suite,
        "testcase",
        {
            "classname": _clean(_name(result, run)),
            "name": _clean(f"{score.metric} {score.channel} {score.limit}"),
        },
    )
    value = quantity(score.value, score.unit, metric=score.metric, written=score.limit)
    reason = score.reason
    if not score.status.rejects:
        return
    if score.status is ScoreStatus.NOT_SCORED and run.status in (Status.FAULT, Status.INCOMPLETE):
        message = run.reason or reason or run.status.value
        ET.SubElement(case, "error", {"type": run.status.value, "message": _clean(message)})
        return
    found = "not scored" if score.status is ScoreStatus.NOT_SCORED else f"is {value}"
    message = f"{score.metric} {found}, limit {score.limit}" + (f": {reason}" if reason else "")
    ET.SubElement(case, "failure", {"type": score.status.value, "message": _clean(message)})


def _run_case(suite: ET.Element, result: Result, run: TrialResult) -> None:
    case = ET.SubElement(
        suite, "testcase", {"classname": _clean(_name(result, run)), "name": "run"}
    )
    if run.status in (Status.FAULT, Status.INCOMPLETE):
        message = _clean(run.reason or run.status.value)
        ET.SubElement(case, "error", {"type": run.status.value, "message": message})
    elif run.status is Status.FAILED:
        message = _clean(run.reason or "failed")
        ET.SubElement(case, "failure", {"type": "failed", "message": message})


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
