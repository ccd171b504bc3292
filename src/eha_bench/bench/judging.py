"""Scores recordings: those of a run just made, and those made earlier or elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from eha_bench.bench.circumstances import Circumstances
from eha_bench.bench.loop_health import loop_note
from eha_bench.bench.provenance import NO_DIGESTS, environment, file_sha256, now
from eha_bench.bench.safety import breach, unchecked
from eha_bench.core.errors import InputError, Place
from eha_bench.core.limit import AcceptanceLimit
from eha_bench.core.progress import Progress, silent
from eha_bench.core.recording import Recording
from eha_bench.core.repeats_summary import RepeatsSummary
from eha_bench.core.result import Result, Status, TrialResult
from eha_bench.core.score import Measure, Score, ScoreStatus
from eha_bench.core.signal import FromRecording
from eha_bench.core.trial import Trial
from eha_bench.metrics import accepted, judge_repeats, score
from eha_bench.metrics.other_reference import ReferenceLevels, is_of_trial, other_reference
from eha_bench.metrics.repeats_summary import summaries
from eha_bench.metrics.scoring import check_reference, load_metrics
from eha_bench.recordings import read
from eha_bench.suites import Suite, trial_from_source
from eha_bench.suites.trial_source import definition_of

RECORDINGS = "recordings"
"""Target of a result whose recordings were made earlier or elsewhere."""

_WHOLE = 0.98
"""Share of a trial's duration from which a recording of it is whole."""

Scorer = Callable[[Recording, Trial], tuple[Score, ...]]
"""Gives a recording's scores: those that a trial's limits ask for come first."""


def judge(
    recording: Recording,
    trial: Trial,
    repeat: int,
    scorer: Scorer = score,
    unsafe: str | None = None,
) -> TrialResult:
    """Return a trial's scores and status; the recording's place is filled in by the caller.

    A recording that was beyond a safety limit fails, and the reason says so; its scores stand, as
    the run came to its end.

    Args:
        recording: to score. trial, repeat: that it is of. scorer: gives the scores.
        unsafe: what `breach` says of it, where it was asked already; None: it is asked here.
    """
    scores = scorer(recording, trial)
    unhealthy = recording.metadata.get("loop_unhealthy", "")
    reason = f"not scored: loop: {unhealthy}" if unhealthy else ""
    loop = loop_note(recording.metadata)
    if unhealthy:
        scores = tuple(_withheld(item, reason) for item in scores)
    status = Status.INCOMPLETE if unhealthy else _status(scores)
    unsafe = breach(recording, trial) if unsafe is None else unsafe
    if unsafe:
        status = Status.FAULT if unhealthy else Status.FAILED
    notes = (*recording.notes, *_ends_early(recording, trial), *unchecked(recording, trial))
    return TrialResult(
        id=trial.id,
        repeat=repeat,
        status=status,
        recording="",
        sha256="",
        scores=scores,
        reason=unsafe or reason,
        notes=(*notes, *([loop] if loop else [])),
        definition=definition_of(trial.source),
    )


def _ends_early(recording: Recording, trial: Trial) -> Iterator[str]:
    """Say where a log that is judged by its own reference is shorter than its trial.

    Of any other trial what is missing is asked for, and its metrics say so.
    """
    signal = trial.signal
    if not isinstance(signal, FromRecording) or len(recording) < 2:
        return
    length = float(recording.time[-1] - recording.time[0])
    if length < _WHOLE * trial.duration and trial.duration < signal.duration:
        yield f"the recording lasts {length:.4g} s, and the trial {trial.duration:.4g} s"


def _withheld(item: Score, reason: str) -> Score:
    """Return a score without its value: the loop that ran the trial is not to be believed."""
    if item.metric == "loop_overruns":
        return item
    return replace(item, measure=Measure.none(reason), status=ScoreStatus.NOT_SCORED)


def _status(scores: tuple[Score, ...]) -> Status:
    """A trial fails if a score that has a limit is rejected; scores without one never fail it."""
    return Status.PASSED if accepted(scores) else Status.FAILED


def judge_together(
    results: Sequence[TrialResult], limits: Sequence[AcceptanceLimit]
) -> list[TrialResult]:
    """Return the repeats of one trial with the limits applied that hold for all of them."""
    together = list(results)
    ended = (Status.PASSED, Status.FAILED)
    scored = [place for place, item in enumerate(results) if item.status in ended]
    judged = judge_repeats([results[place].scores for place in scored], limits)
    for place, scores in zip(scored, judged, strict=True):
        status = Status.FAILED if results[place].is_unsafe else _status(scores)
        together[place] = replace(results[place], scores=scores, status=status)
    return together


def repeats_summaries(
    results: Sequence[TrialResult], trials: Iterable[Trial]
) -> tuple[RepeatsSummary, ...]:
    """Return every metric over the repeats of its trial, of repeats that came to their end.

    Args:
        results: of one run, or of recordings. trials: what they were scored by.
    """
    by_id = {trial.id: trial for trial in trials}
    ended: dict[str, list[tuple[Score, ...]]] = {}
    for result in results:
        if result.status in (Status.PASSED, Status.FAILED):
            ended.setdefault(result.id, []).append(result.scores)
    return tuple(
        summary for name, repeats in ended.items() for summary in summaries(by_id[name], repeats)
    )


def score_recordings(
    paths: Sequence[Path],
    *,
    suite: Suite | None = None,
    channels: Path | None = None,
    trial: str | None = None,
    progress: Progress = silent,
) -> tuple[Result, dict[tuple[str, int], Trial]]:
    """Score recordings made earlier or elsewhere; nothing that they hold is executed.

    Args:
        paths: recordings of any format that can be read.
        suite: what they are scored by; None for recordings of our own, which carry their trial.
        channels: channels.yaml for a foreign log.
        trial: id of the suite's trial that they all belong to; otherwise the recording's own
            metadata or its file name says so.
        progress: called at the start of every recording.

    Returns:
        The result, and for each (trial id, repeat) the trial it was scored by.

    Raises:
        EhaBenchError: a recording cannot be read, or belongs to no trial; a metric of the suite
            cannot be loaded.
    """
    if suite is not None:
        load_metrics(one for one in suite.trials if trial in (None, one.id))
    done: list[TrialResult] = []
    used: dict[tuple[str, int], Trial] = {}
    digests: dict[str, set[str]] = {key: set() for key in NO_DIGESTS}
    circumstances = Circumstances()
    references = _References()
    for number, path in enumerate(paths):
        progress(number, len(paths), path.name)
        recording = read(path, channels=channels)
        chosen = _trial_of(recording, path, suite, trial)
        for key, found in digests.items():
            found.add(recording.metadata.get(key, ""))
        circumstances.add(recording)
        if channels is not None:
            check_reference(recording, chosen, Place(file=str(path)))
        repeat = sum(result.id == chosen.id for result in done)
        judged = judge(recording, chosen, repeat)
        status, reason = _ended(recording, judged)
        used[chosen.id, repeat] = chosen
        done.append(
            TrialResult(
                id=judged.id,
                repeat=repeat,
                status=status,
                recording=str(path),
                sha256=file_sha256(path) if path.is_file() else "",
                scores=judged.scores,
                reason=reason,
                notes=(
                    *judged.notes,
                    *_of_another(recording, chosen),
                    *_of_another_size(recording, chosen, suite),
                    *references.unlike_the_first(recording, chosen, path.name),
                ),
                definition=judged.definition,
            )
        )
    for name, limits in {key[0]: one.limits for key, one in used.items()}.items():
        places = [place for place, item in enumerate(done) if item.id == name]
        together = judge_together([done[place] for place in places], limits)
        for place, item in zip(places, together, strict=True):
            done[place] = item
    trials = tuple(done)
    folder = suite.path.parent if suite else Path.cwd()
    # of model and controller what all recordings agree on, as a run wrote it into them
    agreed = {key: found.pop() for key, found in digests.items() if len(found) == 1}
    provenance = {
        **environment(folder),
        "started": now(),
        **circumstances.recording_time(),
        **circumstances.oil(),
        **NO_DIGESTS,
        **agreed,
    }
    if suite:
        provenance["suite_sha256"] = suite.sha256
    result = Result(
        suite=suite.name if suite else "recordings",
        target=RECORDINGS,
        status=Result.overall(trials, complete=True),
        trials=trials,
        provenance=provenance,
        description=suite.description if suite else "",
        repeats=repeats_summaries(trials, used.values()),
    )
    return result, used


def _ended(recording: Recording, judged: TrialResult) -> tuple[Status, str]:
    """Return the status of a scored recording and why: as the run of it ended, or as judged.

    What was beyond a safety limit is a fault where the run was interrupted later.
    """
    unfinished = _unfinished_status(recording)
    if unfinished is None:
        return judged.status, judged.reason
    unsafe = judged.is_unsafe or judged.status is Status.FAULT
    if unsafe and unfinished is not Status.FAULT:
        return Status.FAULT, judged.reason
    return unfinished, recording.metadata.get("ending_reason", "") or judged.reason


def _unfinished_status(recording: Recording) -> Status | None:
    """Return the status of a run that did not come to its end, as the recording says."""
    ending = recording.metadata.get("ending", "complete")
    if ending == "complete":
        return None
    return Status.INCOMPLETE if ending == "interrupted" else Status.FAULT


def _of_another(recording: Recording, trial: Trial) -> tuple[str, ...]:
    """Return a note where --trial or the file's name takes a recording for another trial's."""
    recorded_trial = recording.metadata.get("trial", "")
    taken = bool(recorded_trial) and recorded_trial != trial.id
    return (
        (f"its metadata names trial '{recorded_trial}'; scored as '{trial.id}'",) if taken else ()
    )


class _References:
    """What was commanded in the recordings of each trial that takes whatever was."""

    def __init__(self) -> None:
        self._first: dict[str, tuple[str, ReferenceLevels]] = {}
        self._said: set[str] = set()

    def unlike_the_first(self, recording: Recording, trial: Trial, name: str) -> tuple[str, ...]:
        """Return a note, once a trial, where a recording cannot be a repeat of the first one."""
        own = ReferenceLevels.of(recording)
        if own is None or not isinstance(trial.signal, FromRecording) or trial.id in self._said:
            return ()
        first_name, first = self._first.setdefault(trial.id, (name, own))
        if not own.differ_from(first):
            return ()
        self._said.add(trial.id)
        return (
            f"CAUTION: the reference of {name} goes {own}, and that of {first_name} {first}: these "
            f"are no repeats of one trial, as which '{trial.id}' takes them; give each a trial of "
            "its own, or score them one by one",
        )


def _of_another_size(recording: Recording, trial: Trial, suite: Suite | None) -> tuple[str, ...]:
    """Return a note where a recording's reference is plainly another one than its trial's."""
    other = other_reference(recording, trial)
    if other is None:
        return ()
    fits = [
        one.id
        for one in (suite.trials if suite else ())
        if one is not trial and is_of_trial(recording, one)
    ]
    way = f"score it as {' or '.join(fits)} (--trial), or " if fits else ""
    return (
        f"CAUTION: {other}: it was scored by what it was asked for, and limits are those of the "
        f"trial; {way}check which trial it is of, and the unit of its reference",
    )


def _trial_of(recording: Recording, path: Path, suite: Suite | None, named: str | None) -> Trial:
    where = Place(file=str(path))
    if suite is None:
        source = recording.attachments.get("trial.json")
        if source is None and "trial.json" in recording.damaged:
            raise InputError(
                "its trial is damaged (wrong checksum), so its limits cannot be trusted",
                where=where,
                hint="name the suite with --suite",
            )
        if source is None:
            raise InputError(
                "does not carry its trial",
                where=where,
                hint="name the suite with --suite",
            )
        return trial_from_source(source.decode("utf-8", "replace"))
    by_id = {trial.id: trial for trial in suite.trials}
    if named is not None:
        if named not in by_id:
            raise InputError(
                f"the suite has no trial '{named}'", hint=f"it has: {', '.join(by_id)}"
            )
        return by_id[named]
    known = recording.metadata.get("trial", "")
    stem = path.stem
    for candidate in (known, stem, stem.rpartition("-")[0]):
        if candidate in by_id:
            return by_id[candidate]
    if known:
        raise InputError(
            f"is a recording of trial '{known}', which the suite does not have",
            where=where,
            hint=f"to score it anyway, give --trial; the suite has: {', '.join(by_id)}",
        )
    if len(by_id) == 1:
        return suite.trials[0]
    raise InputError(
        "belongs to no trial of the suite",
        where=where,
        hint=f"name the file after its trial or give --trial; the suite has: {', '.join(by_id)}",
    )
