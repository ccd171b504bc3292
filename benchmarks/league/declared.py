"""Entrant `declared`: the declared model as it is, and nothing missing. The floor of the league."""

from __future__ import annotations

from benchmarks.league.answer import Answer
from benchmarks.league.question import Question
from benchmarks.league.simulation import predicted

from eha_bench.plants.model import load_model


def enter(question: Question) -> Answer:
    """Name nothing, and predict by the declared model."""
    model = load_model(question.dataset.with_name("model.yaml"))
    return Answer((), (), predicted(question, model))
