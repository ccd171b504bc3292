"""Play in an elastic coupling that was declared without it: a spline, a belt, a series spring.

    d = x_first - x_second,    s = d - min(max(d, -g/2), g/2),    F = k s + c dd/dt

Within the play g nothing is pushed, and at its ends the coupling only pushes; k and c are as the
coupling declares them. A play in a gear or a joint that the plant takes for rigid is
`gear_backlash`.

Source: Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X.
"""

from __future__ import annotations

from eha_bench.plants.effect import Action, Effect
from eha_bench.plants.parameter import Parameter


def with_play(declared: float, play: float) -> float:
    """Return the coupling's play, m (or rad), from end to end."""
    return declared + play


EFFECT = Effect(
    id="coupling_backlash",
    summary="Play in an elastic coupling that was declared without it.",
    parameters=(Parameter("play", "{play}", 1e-4, 0.0, 0.5, "g", "from end to end"),),
    actions={"elastic_coupling": Action(adjusts={"play": with_play}, same_as="play", plays="play")},
    source="Nordin, Gutman, Automatica 38 (2002) 1633, doi:10.1016/S0005-1098(02)00047-X",
    separate=(
        "hold the load and reverse the drive slowly: with play it turns freely before the coupling "
        "pushes"
    ),
    starts=tuple({"play": 1e-4 * 2.0**k} for k in range(-1, 5)),
    reversing=True,
)
