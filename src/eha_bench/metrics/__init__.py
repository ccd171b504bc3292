"""From a recording of a trial to scores: values with intervals, or reasons why there are none."""

from eha_bench.metrics.acceptance import accepted, judge, judge_repeats
from eha_bench.metrics.metric import Metric, NotScored
from eha_bench.metrics.scoring import all_metrics, metric, score, score_limits

__all__ = [
    "Metric",
    "NotScored",
    "accepted",
    "all_metrics",
    "judge",
    "judge_repeats",
    "metric",
    "score",
    "score_limits",
]
