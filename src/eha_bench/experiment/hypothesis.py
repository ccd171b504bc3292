"""What a diagnosis leaves open: its rivals, each a model with the covariance of what was fitted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from eha_bench.core.arrays import FloatArray, IndexArray
from eha_bench.core.errors import InputError, Place
from eha_bench.core.json_file import read_object
from eha_bench.diagnosis.data.dataset import load_dataset
from eha_bench.diagnosis.fit.beliefs import Belief, beliefs_of
from eha_bench.diagnosis.fit.convergence import MOST
from eha_bench.diagnosis.fit.friction_at_rest import is_friction_at_rest
from eha_bench.diagnosis.outcome.beyond_training import SHOWN_BY_HELD_OUT
from eha_bench.diagnosis.outcome.diagnosis import (
    DIAGNOSIS_FILE,
    MAY_AS_WELL,
    SCHEMA_VERSION,
    Verdict,
)
from eha_bench.diagnosis.outcome.rival import Standing
from eha_bench.plants.model import Model, load_model
from eha_bench.plants.parameter import Parameter
from eha_bench.posterior.covered import Covered
from eha_bench.posterior.posterior import root_of

_CAUTION = "CAUTION: "
_AT_NOISE = 1.05
"""Remainder, over the noise, from which on more than noise is left."""
OF_VALUE = "its value"
_TURNS = 12.0
"""Bounds of an angle, rad: what may be more is a position of a shaft."""
_LEAST = 0.05
"""Share of a positive parameter's fitted value below which none is drawn."""


@dataclass(frozen=True)
class Scale:
    """What half of an interval is a share of: its size, SI, 0 for nothing, and what that is."""

    size: float
    words: str = OF_VALUE


def may_be_nothing(parameter: Parameter) -> bool:
    """Whether a parameter may be zero or of either sign: an angle, an offset, a force."""
    return parameter.low < 0.0 and not parameter.nonzero


def _scale_of(parameter: Parameter, size: float, half: float, usual: float) -> Scale:
    """Return what an interval of a parameter that may be nothing is judged against.

    A phase that is off by 0.1 rad makes its effect off by a tenth of its size, wherever the angle's
    zero is. An offset is judged against what such an offset usually is, where that is more than its
    value. What has no usual size is judged by its value, or not at all where it may be nothing.

    Args:
        size: of its value. half: of its interval. usual: its usual size, 0 where none is known.
    """
    if parameter.unit == "rad" and parameter.low >= -_TURNS and parameter.high <= _TURNS:
        return Scale(1.0, "1 rad")
    if usual > size:
        return Scale(usual, "its usual size")
    return Scale(size if size > half or usual > 0.0 else 0.0)


def _usual_size(parameter: Parameter, *, of_effect: bool) -> float:
    """Return the usual size of a parameter, 0 where none is known.

    An effect's default is one. A plant's is what its file declares, and one without bounds is any.
    """
    if not math.isfinite(parameter.high):
        return 0.0
    return parameter.usual or (abs(parameter.default) if of_effect else 0.0)


def _half_widths(covariance: FloatArray) -> FloatArray:
    """Return half of each 95 % interval, SI."""
    found: FloatArray = 1.96 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return found


@dataclass(frozen=True)
class Hypothesis:
    """One rival explanation, ready to be simulated for draws of its posterior.

    Attributes:
        id: as in diagnosis.json. cause: what a diagnosis would name; several forms may have one.
        standing, behind: what the data say of it already.
        model: as fitted. keys: of what was fitted, (p,). covariance: (p, p) SI.
        moved: parameters that take the place of the fitted ones, SI; None for these.
        doubted: parameters as fitted, but as declared where the fit is outside of `within`, SI;
            None where it is not: a limit has to be kept with these as well.
    """

    id: str
    cause: str
    standing: Standing
    behind: float
    model: Model
    keys: tuple[str, ...]
    covariance: FloatArray
    moved: FloatArray | None = None
    doubted: FloatArray | None = None

    @cached_property
    def vector(self) -> FloatArray:
        """The plant's parameters as fitted, or where it was moved to, SI."""
        return self.model.vector() if self.moved is None else self.moved

    @cached_property
    def _places(self) -> IndexArray:
        index = self.model.plant.layout.index
        found = []
        for key in self.keys:
            name, _, number = key.partition("[")
            found.append(index[name] + (int(number[:-1]) if number else 0))
        return np.array(found, dtype=np.intp)

    @cached_property
    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        known = self.model.plant.layout.by_key
        own = [known[key.partition("[")[0]] for key in self.keys]
        low, high = np.array([item.low for item in own]), np.array([item.high for item in own])
        fitted = self.vector[self._places]
        # what is none at zero (a time constant, a mass) is not drawn there
        positive = (low >= 0.0) & (fitted > 0.0)
        return np.where(positive, np.maximum(low, _LEAST * fitted), low), high

    @cached_property
    def root(self) -> FloatArray:
        """R with R R' = covariance, (p, p): parameters are as fitted plus R z, z ~ N(0, 1)."""
        return root_of(self.covariance)

    def at(self, z: FloatArray) -> FloatArray:
        """Return vectors of parameters, (m, size), inside their bounds.

        Args:
            z: (m, p) standard normal coordinates of the posterior.
        """
        out = np.tile(self.vector, (len(z), 1))
        low, high = self._bounds
        out[:, self._places] = np.clip(out[:, self._places] + z @ self.root.T, low, high)
        return out

    def drawn(self, z: FloatArray) -> Hypothesis:
        """Return it about a draw of its posterior, (p,) standard normal coordinates."""
        return replace(self, moved=self.at(z[None, :])[0])

    @cached_property
    def _scales(self) -> tuple[Scale, ...]:
        """What the interval of each parameter is judged against, (p,)."""
        layout = self.model.plant.layout
        plants_own = {item.name for item in layout.parameters}
        fitted = self.model.vector()[self._places]
        sizes, half = np.abs(self.vector[self._places]), _half_widths(self.covariance)
        found = []
        for place, key in enumerate(self.keys):
            name = key.partition("[")[0]
            parameter = layout.by_key[name]
            own = Scale(float(sizes[place]))
            if may_be_nothing(parameter):
                usual = _usual_size(parameter, of_effect=name not in plants_own)
                own = _scale_of(parameter, abs(float(fitted[place])), float(half[place]), usual)
            found.append(own)
        return tuple(found)

    @property
    def judged_against(self) -> dict[str, str]:
        """What each parameter's interval is a share of, in words, by key."""
        return {key: scale.words for key, scale in zip(self.keys, self._scales, strict=True)}

    @property
    def unjudged(self) -> tuple[str, ...]:
        """Parameters whose interval is a share of nothing: as well 0, and of no usual size."""
        return tuple(
            key for key, scale in zip(self.keys, self._scales, strict=True) if not scale.size > 0.0
        )

    def relative_half_widths(self, covariance: FloatArray) -> dict[str, float]:
        """Return half of each parameter's 95 % interval, as a share of its `judged_against`."""
        half = _half_widths(covariance)
        return {
            key: float(width / scale.size)
            for key, width, scale in zip(self.keys, half, self._scales, strict=True)
            if scale.size > 0.0 and math.isfinite(width)
        }

    def sticking(self) -> Hypothesis | None:
        """Return it with friction that sticks at rest; None where no friction was found to creep.

        How slowly something creeps was fitted to what next to nothing moved in.
        """
        creeping = [place for place, key in enumerate(self.keys) if is_friction_at_rest(key)]
        if not any(self.vector[self._places[place]] > 0.0 for place in creeping):
            return None
        kept = [place for place in range(len(self.keys)) if place not in creeping]
        return replace(
            self,
            id=f"{self.id}, sticking",
            model=self.model.with_parameters({self.keys[place]: 0.0 for place in creeping}),
            keys=tuple(self.keys[place] for place in kept),
            covariance=self.covariance[np.ix_(kept, kept)],
        )


_MOST_CAUSES = 5
_MOST_RIVALS = 9


def rivals_to_separate(rivals: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Return the rivals that an experiment is planned for: the first causes, then their forms.

    Where there is one cause, its forms are nothing to separate: the first of them is returned. A
    friction that creeps counts as one that sticks, too: what only the creeping tells is not told.
    """
    causes = list(dict.fromkeys(item.cause for item in rivals))[:_MOST_CAUSES]
    first = [next(item for item in rivals if item.cause == cause) for cause in causes]
    if len(first) < 2:
        return tuple(first)
    known = {item.id for item in first}
    forms = [form for item in first if (form := item.sticking()) is not None]
    forms += [item for item in rivals if item.cause in causes and item.id not in known]
    return (*first, *forms[: _MOST_RIVALS - len(first)])


@dataclass(frozen=True)
class Question:
    """What is open after a diagnosis.

    Attributes:
        verdict: of the diagnosis. rivals: what was found first, then those that the data cannot
            tell from it. covered: where its recordings have been. complete: whether it ended.
        not_simulated: what acts and is in no rival, "" where everything is.
        source: diagnosis.json. cautions: what the diagnosis warns of, one sentence each.
        no_interval: why the diagnosis gives no interval of anything, "" where it does.
        unnamed: what is known of something unknown, as clauses; "" where nothing is unknown.
    """

    verdict: str
    rivals: tuple[Hypothesis, ...]
    covered: Covered
    complete: bool
    not_simulated: str
    source: Path
    cautions: tuple[str, ...] = ()
    no_interval: str = ""
    unnamed: str = ""


def read_question(path: str | Path) -> Question:
    """Read a diagnosis.json, or the one of a folder.

    Raises:
        InputError: it is missing, is not a diagnosis, or was made before rivals were kept.
    """
    file = Path(path)
    if file.is_dir():
        file = file / DIAGNOSIS_FILE
    where = Place(file=str(file))
    hint = "give the folder that `eha-bench diagnose --out` wrote"
    content = read_object(file, DIAGNOSIS_FILE, hint)
    if "verdict" not in content:
        raise InputError("this is not a diagnosis.json: it has no verdict", where=where, hint=hint)
    version = content.get("schema_version", SCHEMA_VERSION)
    if version != SCHEMA_VERSION:
        raise InputError(
            f"its schema_version is {version}, and this version reads {SCHEMA_VERSION}",
            where=where,
            hint="run `eha-bench diagnose` again with this version",
        )
    if not content.get("rivals") or not content.get("covered"):
        raise InputError(
            "it holds no rivals to plan an experiment for",
            where=where,
            hint="run `eha-bench diagnose` again with this version; plants of operating points "
            "have no experiments over time",
        )
    try:
        rivals = tuple(_hypothesis(item, file.parent) for item in content["rivals"])
        covered = Covered.from_dict(content["covered"])
        Verdict(content["verdict"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"its rivals cannot be read ({error!r})", where=where) from error
    rivals = _with_doubts(rivals, covered)
    found = [item for item in rivals if item.standing is not Standing.RUNNER_UP]
    unknown = content.get("unknown") or {}
    learned = any("learned" in item.id for item in found)
    return Question(
        str(content["verdict"]),
        tuple(found),
        covered,
        bool(content.get("complete", True)),
        _not_simulated(unknown, content.get("notes") or ()) if unknown and not learned else "",
        file,
        tuple(
            note.removeprefix(_CAUTION)
            for note in content.get("notes") or ()
            if note.startswith(_CAUTION)
        ),
        _why_no_interval(content),
        _unnamed(content),
    )


def _with_doubts(rivals: tuple[Hypothesis, ...], covered: Covered) -> tuple[Hypothesis, ...]:
    """Return rivals with what a dataset's model says of parameters that are outside of `within`.

    The same where the dataset is not there any more, or cannot be read.
    """
    if not (covered.dataset and Path(covered.dataset).is_file()):
        return rivals
    with suppress(InputError):
        beliefs = beliefs_of(load_dataset(covered.dataset).model)
        return tuple(_with_doubt(item, beliefs) for item in rivals)
    return rivals


def _with_doubt(rival: Hypothesis, beliefs: Sequence[Belief]) -> Hypothesis:
    index, declared = rival.model.plant.layout.index, rival.vector.copy()
    for belief in beliefs:
        at = index.get(belief.key)
        if at is not None and abs(declared[at] - belief.value) > belief.within:
            declared[at] = belief.value
    same = np.array_equal(declared, rival.vector)
    return rival if same else replace(rival, doubted=declared)


def _why_no_interval(content: Mapping[str, Any]) -> str:
    """Say why a fit tells no interval of what it found, as a clause; "" where it does."""
    ended = content.get("convergence") or {}
    if not ended.get("converged", True):
        return "its calibration has not converged"
    ratio = float(ended.get("residual_over_floor") or 0.0)
    if ratio <= MOST:
        return ""
    where = (content.get("remainder") or {}).get("equation")
    own = f", in the {where} balance" if where else ""
    return f"its model leaves {ratio:.2g} times the noise unexplained{own}"


def _unnamed(content: Mapping[str, Any]) -> str:
    """Return what a diagnosis says of something unknown, as clauses; "" where nothing is."""
    if content["verdict"] != Verdict.UNKNOWN:
        return ""
    said = [(content.get("unknown") or {}).get("description") or "it was not located"]
    said += [note for note in content.get("notes") or () if note.startswith(MAY_AS_WELL)]
    ratio = float((content.get("convergence") or {}).get("residual_over_floor") or 0.0)
    if ratio > _AT_NOISE:
        said.append(f"the revised model still leaves {ratio:.2g} times the noise")
    return "; ".join(said)


def _not_simulated(unknown: Mapping[str, Any], notes: Sequence[str]) -> str:
    """Say why something unknown is in no rival, and what to do first, as a clause."""
    if any(note.startswith(SHOWN_BY_HELD_OUT) for note in notes):
        return (
            "something shows in held-out runs alone, and no rival can be simulated without a model "
            "of it: use such a run for training"
        )
    where = f" ({unknown['where']})" if unknown.get("where") else ""
    balance = f"the unknown effect in the {unknown.get('equation')} balance"
    if unknown.get("equation") is None:
        why = "the unknown effect was not located"
    elif unknown.get("variables"):
        why = (
            f"{balance} depends on {', '.join(unknown['variables'])}, and its curve was left out, "
            f"as whole runs err more with it{where}"
        )
    else:
        why = (
            f"{balance} follows no curve of one logged channel closely enough for a model of "
            f"it{where}"
        )
    return (
        f"{why}, so no rival can be simulated: declare what the plant lacks, or log more channels"
    )


def _hypothesis(content: Mapping[str, Any], folder: Path) -> Hypothesis:
    covariance = content["covariance"]
    matrix = np.array(covariance["matrix"], dtype=np.float64)
    if not np.isfinite(matrix).all():
        raise ValueError(f"the covariance of '{content['id']}' is not finite")
    if (np.diag(matrix) < 0.0).any():
        raise ValueError(f"the covariance of '{content['id']}' has a negative variance")
    keys = tuple(covariance["parameters"])
    model = load_model(folder / content["model"])
    strange = [key for key in keys if key.partition("[")[0] not in model.plant.layout.index]
    if strange:
        raise ValueError(f"the model of '{content['id']}' has no parameter '{strange[0]}'")
    return Hypothesis(
        content["id"],
        content.get("cause", content["id"]),
        Standing(content["standing"]),
        math.nan if content["behind"] is None else float(content["behind"]),
        model,
        keys,
        matrix.reshape(len(keys), len(keys)),
    )
