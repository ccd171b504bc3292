"""Every threshold that a verdict hangs on, in one place: what it decides, and where it is from.

Numbers that only say how far a fit goes, or how many candidates are tried, stand where they are
used. `benchmarks.thresholds` counts how close the figures of diagnoses come to each, and what
happens where one is halved or doubled, and writes `docs/thresholds.md`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from eha_bench.diagnosis.fit.evidence import SOFT_MEAN, Excess, Improvement


def _threshold(value: float, decides: str, source: str) -> float:
    """Return a field with what it decides and where it is from."""
    return field(default=value, metadata={"decides": decides, "source": source})


QUESTIONS: Final[Mapping[str, tuple[str, ...]]] = {
    "Is something missing?": ("rest", "structure", "doubled", "discovery", "bursts", "look"),
    "Is a candidate believed?": (
        "gain", "share", "first", "much", "p_value", "p_hidden", "p_few", "plain",
        "nearly_all", "beside", "runs_better", "p_clear", "worth", "together",
    ),
    "Is another one as good?": ("behind", "behind_share", "chance", "white"),
    "Does an effect stand in the end?": (
        "loose", "little", "form", "likely", "clear", "instant", "narrow", "worse",
    ),
    "Is what was declared to be doubted?": ("declared",),
    "Which verdict?": ("explained", "beaten", "instead", "nothing", "follows"),
    "Do held-out runs agree?": ("windows", "replays"),
}  # fmt: skip
"""Question -> the thresholds that answer it."""


@dataclass(frozen=True)
class Thresholds:
    """When something is missing, a candidate believed, an effect kept, and which verdict follows.

    Every field says what it decides (`decides`) and where it is from (`source`) in its metadata. An
    excess is the cost above the noise's; a cost of 1 is one standard deviation squared.
    """

    rest: float = _threshold(
        0.03,
        "excess up to which nothing is missing, in the noise's cost",
        "chosen on blind rigs: what a nearly right model leaves",
    )
    structure: float = _threshold(
        8.0,
        "structure in time up to which nothing is missing, in standard deviations",
        "chosen on blind rigs",
    )
    doubled: float = _threshold(
        1.0,
        "excess, in the noise's cost, from which a structure of `discovery` is enough, and gain "
        "that is plain, however few the readings are",
        "twice the noise is no nearly right model; `structure` grows with the number of readings, "
        "and a log of 150 reaches 7.7 at four times the noise",
    )
    discovery: float = _threshold(
        5.0,
        "structure in time, in standard deviations, that is enough where that much is missing",
        "convention for a discovery; single outliers among 1,200 readings made 4.1",
    )
    bursts: float = _threshold(
        0.2,
        "excess from which what comes in bursts is missing, in the noise's cost",
        "chosen on blind rigs: single outliers and a wrong level of the noise do not come together",
    )
    look: float = _threshold(
        0.02,
        "excess that is worth another look, in the noise's cost",
        "an effect whose outputs move by a seventh of the noise",
    )
    gain: float = _threshold(
        30.0,
        "least fall of the cost, and half of it on runs left out",
        "a likelihood ratio of 5.5 standard deviations",
    )
    share: float = _threshold(
        0.25,
        "least part of the excess that a cause takes, fitted and left out",
        "record 0060",
    )
    first: float = _threshold(
        0.15,
        "the same where much is missing",
        "of a measured machine much remains, in which one cause shows as a smaller part",
    )
    much: float = _threshold(
        5.0,
        "excess that is much, in the noise's cost",
        "chosen on blind rigs; real seals have 13 and more",
    )
    p_value: float = _threshold(
        1e-3,
        "largest probability that it gains nothing on runs left out",
        "record 0060",
    )
    p_hidden: float = _threshold(
        2e-4,
        "the same where the excess is within `rest`",
        "`p_value` by five: as many are fitted to the end there, and each may gain by chance",
    )
    p_few: float = _threshold(
        0.05,
        "the same where it leaves next to nothing",
        "what acts in few instants shows in few blocks, however sure it is",
    )
    plain: float = _threshold(
        150.0,
        "least fall of the cost there",
        "chosen on blind rigs",
    )
    nearly_all: float = _threshold(
        0.8,
        "part of the excess that leaves next to nothing",
        "chosen on blind rigs: a law of another form leaves as much",
    )
    beside: float = _threshold(
        0.7,
        "part that a further cause takes of what others leave, where that is as little as their "
        "form",
        "as `together`: half of the form of a null leak was an offset of both pressures",
    )
    runs_better: float = _threshold(
        0.5,
        "least part of the runs it changes for which it gains",
        "record 0060",
    )
    p_clear: float = _threshold(
        3.2e-5, "probability that is clear without any share", "four standard deviations"
    )
    worth: float = _threshold(
        0.02, "gain that is worth a cause there, in the noise's cost", "as `look`"
    )
    together: float = _threshold(
        0.7,
        "least part of the excess that two explain that are looked for at once",
        "chosen on blind rigs",
    )
    behind: float = _threshold(
        12.0,
        "fall of the cost from which one is behind another at the noise",
        "3.5 standard deviations",
    )
    behind_share: float = _threshold(
        0.05,
        "part of the other's gain from which it is behind above the noise",
        "chosen on blind rigs",
    )
    chance: float = _threshold(
        0.02,
        "probability from which resampling takes what it is behind by for chance",
        "chosen on blind rigs",
    )
    white: float = _threshold(
        4.0,
        "structure in time, in standard deviations, up to which whole runs decide between causes",
        "half of `structure`: forms that are off leave more, and their gains are no likelihood "
        "ratio",
    )
    loose: float = _threshold(
        5.0,
        "standard deviations of a size up to which the others are asked to do without it",
        "chosen on blind rigs",
    )
    little: float = _threshold(
        0.05,
        "part of the excess up to which runs that disagree speak against it",
        "a form that is off by a fifth leaves as much",
    )
    form: float = _threshold(
        0.005,
        "part of an effect's gain up to which what it leaves is the form of its law, not another "
        "effect on the same term",
        "half of what the smaller of two takes that are ten times apart",
    )
    likely: float = _threshold(
        0.05, "probability from which chance may have made a gain", "convention"
    )
    clear: float = _threshold(
        4.0,
        "standard deviations of a size that is not nothing",
        "what forms within the noise imitate has 2; fresh effects have 8 and more",
    )
    instant: float = _threshold(
        0.05,
        "share of the time between samples below which a delay or lag is none",
        "stamps of a log are no better, nor is when a drive takes a command",
    )
    narrow: float = _threshold(
        1.0,
        "standard deviations of a position's noise below which a play is none",
        "the steps of an encoder, and hysteresis in reading it, make as much",
    )
    worse: float = _threshold(
        1.05, "growth of the error of whole replays that speaks against it", "less is chance"
    )
    declared: float = _threshold(
        0.005,
        "part by which a number of a drawing or a channel's scale is off at least, to be doubted; "
        "a scale also by as much as moves its largest reading by the noise of one",
        "ISO 4409:2007, class A: what the best tests of pumps allow their instruments to be off by",
    )
    explained: float = _threshold(
        0.5,
        "part of the excess from which known effects are the verdict",
        "record 0060",
    )
    beaten: float = _threshold(
        0.5,
        "part of what they explain below which a learned curve is no rival to less than that",
        "chosen on blind rigs",
    )
    instead: float = _threshold(
        0.5,
        "part of what an effect leaves, up to which a curve that leaves so little without it shows "
        "that the effect imitates",
        "half, as `explained`: beside a cause that is there, a curve leaves most of what that does",
    )
    nothing: float = _threshold(
        0.005,
        "part of the excess up to which a curve explains nothing",
        "chosen on blind rigs",
    )
    follows: float = _threshold(
        0.1,
        "part of the excess from which it follows a curve's variable",
        "chosen on blind rigs",
    )
    windows: float = _threshold(
        1.5,
        "growth of an error over windows from training to held-out runs that says something",
        "healthy machines of four plants had at most 1.11",
    )
    replays: float = _threshold(
        5.0, "the same of whole replays, where small errors add up", "healthy ones had 2.4"
    )  # fmt: skip

    def is_unexplained(self, rest: Excess) -> bool:
        """Whether a residual holds more than noise and what a nearly right model leaves.

        So much as `much` is no misjudged noise, also where too few readings show its structure.
        """
        if self.is_much(rest):
            return True
        if rest.relative > self.bursts and rest.bursts > self.structure:
            return True
        return rest.relative > self.rest and self.has_structure(rest)

    def has_structure(self, rest: Excess) -> bool:
        """Whether a residual has structure in time, which a wrong level of the noise has not."""
        least = self.discovery if rest.relative > self.doubled else self.structure
        return rest.significance > least

    def is_worth_a_look(self, rest: Excess) -> bool:
        """Whether enough is left to distinguish another cause from what a fit leaves over.

        Or it left nothing by going far from what is believed of its parameters: they imitate what
        is missing.
        """
        return self.is_seen(rest) or rest.against_beliefs > self.gain

    def is_seen(self, rest: Excess) -> bool:
        """Whether readings hold enough to distinguish another cause from what a fit leaves over."""
        return rest.relative > self.look and self.has_structure(rest)

    def least_share(self, before: Excess) -> float:
        """Return the least share that an effect takes of an excess."""
        return self.first if self.is_much(before) else self.share

    def is_enough(self, found: Improvement, before: Excess, others: int) -> bool:
        """Whether a gain is enough of an excess, or clear where that may be the noise's level.

        Beside another effect it has to be enough: what that leaves is more likely its form. Where
        noise hides all that is missing, the most lucky of several candidates takes all of it.
        """
        if min(found.share, found.share_out) > self.least_share(before):
            return before.relative > self.rest or found.p_value < self.p_hidden
        level = not self.has_structure(before) and not others
        return level and self.is_clear(found, before.size)

    def is_part_of_a_form(self, found: Improvement, left: float) -> bool:
        """Whether a gain is only a part of the little that others leave: how their laws bend.

        Args:
            found: what a cause gains. left: what the others leave of what was missing, as a share.
        """
        return left < self.little and min(found.share, found.share_out) < self.beside

    def is_much(self, missing: Excess) -> bool:
        """Whether so much is missing that a remainder is to be expected."""
        return missing.relative > self.much

    def is_clear(self, found: Improvement, rows: int) -> bool:
        """Whether a gain speaks for itself: four standard deviations, and worth a cause.

        Where outputs move by less than in proportion to a size (a presliding distance), its
        standard deviation is no measure of how far it is from nothing, but the gain is (Hauck,
        Donner, J. Am. Stat. Assoc. 72 (1977) 851, doi:10.1080/01621459.1977.10479969).

        Args:
            found: what a candidate gains. rows: of the residual.
        """
        least = self.worth * SOFT_MEAN * rows
        return found.p_value < self.p_clear and min(found.gain, found.gain_out) > least

    def allow(self, found: Improvement) -> bool:
        """Whether something gains on runs left out as well, and no accident does as much."""
        return (
            found.gain > self.gain
            and found.gain_out > self.gain / 2
            and self.is_sure(found)
            and found.runs_better >= self.runs_better
        )

    def is_sure(self, found: Improvement) -> bool:
        """Whether a gain is no accident, on runs left out."""
        all_of_it = min(found.share, found.share_out) > self.nearly_all
        # a short log holds little cost, however far its errors are above the noise
        plain = min(found.gain, found.gain_out) > self.plain or found.of_noise > self.doubled
        return found.p_value < (self.p_few if all_of_it and plain else self.p_value)

    def still_allow(self, found: Improvement, before: Improvement) -> bool:
        """Whether what gained enough stays where the noise is told otherwise.

        The excess changes with the noise, and a share of it that was just enough may just not be.

        Args:
            found: by the noise as it is told now. before: as it was told.
        """
        if self.allow(found) or not self.allow(before):
            return self.allow(found)
        most = min(found.share, found.share_out) > self.explained
        return most and found.gain > self.gain and found.p_value < self.p_few

    def least_gain(self, left: Excess) -> float:
        """Return the least fall of the cost that is no chance, among what nothing explains.

        What no candidate explains makes chance gain as much more than noise would.
        """
        return self.gain * max(1.0, 1.0 + left.relative)


DEFAULT: Final = Thresholds()
