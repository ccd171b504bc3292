"""What a metric is: a number with an interval, found in a recording of a trial."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from eha_bench.core.errors import EhaBenchError
from eha_bench.core.metric import METRICS, MetricSpec
from eha_bench.core.recording import Recording
from eha_bench.core.score import Measure
from eha_bench.core.trial import Trial


class NotScored(EhaBenchError):
    """A metric cannot be computed from this recording; the message is the reason that is shown."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class Metric(ABC):
    """One metric; registered by an entry point of group `eha_bench.metrics` that names the class.

    Attributes:
        spec: id, description, unit and default channel.
        by_default: whether it is computed where it was not requested, on every trial it applies to.
    """

    spec: MetricSpec
    by_default: ClassVar[bool] = True

    @abstractmethod
    def applies(self, trial: Trial) -> bool:
        """Whether the trial's signal has the features that this metric is defined on."""

    @abstractmethod
    def measure(self, recording: Recording, trial: Trial, channel: str) -> Measure:
        """Return the value (SI) with its 95 % interval, or NaN with the reason.

        Raises:
            NotScored: instead of NaN with the reason, where that is simpler.
            MissingChannelError: the recording lacks a channel that is needed.
        """


def spec_of(name: str) -> MetricSpec:
    """Return the specification that core holds for a built-in metric."""
    return METRICS[name]
