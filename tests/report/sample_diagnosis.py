"""A made-up diagnosis: every part of its page has something to show, and names are nasty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sample_run import NASTY

from eha_bench.diagnosis.data.dataset import Use
from eha_bench.diagnosis.fit.uncertainty import Estimate
from eha_bench.diagnosis.outcome.diagnosis import Diagnosis, FoundEffect, RankLine, Unknown, Verdict
from eha_bench.diagnosis.replay.error_by_value import errors_by_value
from eha_bench.diagnosis.replay.errors_by_channel import ChannelError
from eha_bench.diagnosis.replay.replay import Replay
from eha_bench.plants.model import DeclaredEffect, Model
from eha_bench.posterior.covered import Covered, CoveredSetup

DECLARED = Model("eha_knee", {"bulk_modulus": 9e8}, ("bulk_modulus",))
NAN = float("nan")


def sample_replay(run: str, use: Use, seed: int) -> Replay:
    """Two seconds in which the recalibrated model is off and the revised one is at the noise."""
    time = np.arange(2000) / 1000.0
    truth = 10e6 + 5e6 * np.sin(2 * np.pi * 2 * time)
    generator = np.random.default_rng(seed)
    measured = {
        "pressure_a": truth + 3e4 * generator.standard_normal(time.size),
        "motor_speed": 20.0 * np.cos(2 * np.pi * 2 * time),
    }
    measured["pressure_a"][700:720] = np.nan

    def simulated(off: float) -> dict[str, np.ndarray]:
        return {"pressure_a": truth + off, "motor_speed": measured["motor_speed"] + off / 1e6}

    models = (simulated(9e5), simulated(5e5), simulated(0.0))
    moved = {"pressure_a": 0.0, "motor_speed": 0.0}
    return Replay(run, use, True, False, time, {}, measured, models, models, moved)


def errors() -> dict[str, ChannelError]:
    return {
        "pressure_a": ChannelError(9e5, 5e5, 3.1e4, 3e4, "Pa", 5e5, 3.1e4, 5e5, 3e4, 0.0),
        "motor_speed": ChannelError(0.9, 0.5, float("inf"), NAN, "rad/s"),
    }


def effect_found() -> Diagnosis:
    """Entrained air was found, and could as well be external leakage."""
    air = FoundEffect(
        "entrained_air",
        "flow",
        {"air_fraction": Estimate(0.025, 0.0249, 0.0251, "")},
        {"word": NASTY},
        1.4,
        1e-9,
    )
    revised = DECLARED.with_effect(DeclaredEffect("entrained_air", {"air_fraction": 0.025}))
    replays = (
        sample_replay(NASTY, Use.HOLDOUT, 0),
        sample_replay("locked_steps", Use.TRAIN, 1),
    )
    covered = CoveredSetup(
        "locked", "closed", {"pressure_a": (9e6, 12e6), "motor_speed": (-10.0, 30.0)}
    )
    return Diagnosis(
        Verdict.EFFECT,
        revised,
        DECLARED,
        (air,),
        equivalent=(("entrained_air", "external_leakage"),),
        separate={"entrained_air": "squeeze it at several pressures", "external_leakage": NASTY},
        ranking=(
            RankLine("entrained_air", 0.99, 1e-9, 1.0, "added"),
            RankLine("external_leakage", 0.42, 0.01, 1.6, f"refitted {NASTY}"),
            *(RankLine(f"candidate_{k}", -0.1, NAN, NAN, "not refitted") for k in range(20)),
        ),
        train=errors(),
        holdout=errors(),
        calibrated={"bulk_modulus": Estimate(9.2e8, -np.inf, np.inf, "Pa")},
        undetermined=("leakage is not determined by these data",),
        notes=(f"run {NASTY} has gaps", "what remains is 0.1 % above the noise"),
        replays=replays,
        error_by_value=errors_by_value(
            replays, Covered(1e3, 2.0, {}, {"pressure_a": 3e4}, {}, (covered,))
        ),
        seconds=12.3,
    )


def nothing_found() -> Diagnosis:
    """The model is complete."""
    return replace(
        effect_found(),
        verdict=Verdict.NONE,
        effects=(),
        equivalent=(),
        revised=DECLARED,
        train={"pressure_a": errors()["pressure_a"]},
        holdout={"pressure_a": errors()["pressure_a"]},
    )


def unknown_found() -> Diagnosis:
    """Something acts in the actuation at certain times."""
    curve = [0.0] * 12 + [5.0] * 12
    learned = DeclaredEffect(
        "learned",
        {
            "scale": 1.0, "equation": "actuation", "form": "additive", "variable": "time",
            "place": "drive", "period": 1.0, "low": 0.0, "high": 1.0, "values": curve,
        },
    )  # fmt: skip
    unknown = Unknown("actuation", ("time",), "", 0.93, 1.0, ((0.5, 0.9), (0.905, 1.0), (1.5, 2.0)))
    return replace(
        effect_found(),
        verdict=Verdict.UNKNOWN,
        effects=(),
        equivalent=(),
        unknown=unknown,
        revised=DECLARED.with_effect(learned),
    )


def interrupted() -> Diagnosis:
    """Stopped while calibrating."""
    unknown = Unknown(None, (), "interrupted, so the verdict is open")
    return Diagnosis(
        Verdict.UNKNOWN, DECLARED, DECLARED, unknown=unknown, notes=("interrupted",), complete=False
    )
