"""The rig replays the sample recordings down to their noise, each with its stated effect.

The ratios below were found once by least squares on all ten runs. That one set of
equations then leaves nothing but the stated noise, over four seconds of free run,
pins every convention: signs, sampling instants, holds, friction at rest, units.
"""

from pathlib import Path

import numpy as np
import pytest
from fixtures.rig import kernel
from fixtures.rig.commands import Run
from fixtures.rig.mcap_log import _FLOAT, _JOINTS, _PRESSURE
from fixtures.rig.parameters import CALIBRATED, DECLARED
from fixtures.rig.plant import Plant
from fixtures.rig.sensors import FLOOR
from mcap.reader import make_reader

# True over declared, in the order of CALIBRATED.
RATIOS = {
    "A": (0.940514, 0.999702, 1.016251, 0.924587, 0.943691, 1.068515, 0.930539, 0.941668, 1.071732),
    "B": (0.960087, 1.071283, 0.950284, 0.948742, 0.975968, 0.956880, 1.027576, 0.938788, 1.063399),
    "C": (1.058414, 1.056633, 1.049750, 0.961799, 0.932342, 1.071437, 1.017602, 0.921764, 1.065634),
    "D": (1.053043, 0.977624, 1.032423, 1.057612, 1.022603, 1.007731, 1.042108, 1.034374, 0.994748),
    "E": (1.030848, 1.050259, 0.975104, 0.927129, 1.011471, 0.943398, 1.033989, 0.976413, 0.993121),
    "F": (1.010700, 0.988757, 0.935042, 0.975657, 1.019436, 0.923464, 1.059554, 1.057627, 0.927076),
}
HIDDEN = {
    "A": {"air_fraction": 0.025},
    "B": {"pressure_friction": 0.04},
    "C": {"current_lag": 0.002},
    "D": {},
    "E": {"pressure_lag": 0.003},
    "F": {"sag_depth": 0.12, "sag_frequency": 1.3},
}
RUNS = (
    "bypass_ramps", "bypass_sine", "free_sine", "free_steps", "free_swing",
    "locked_multisine", "locked_prbs", "locked_sine", "locked_stairs", "locked_steps",
)  # fmt: skip


def read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reference, command and readings (n, 6) in SI."""
    raw: dict[str, list[bytes]] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            raw.setdefault(channel.topic, []).append(message.data)
    joined = {topic: b"".join(parts) for topic, parts in raw.items()}
    state = np.frombuffer(joined["/drive/state"], _JOINTS)
    pressures = [
        np.frombuffer(joined[topic], _PRESSURE)["fluid_pressure"] * 1e5
        for topic in ("/block/p_a", "/block/p_b")
    ]
    readings = np.column_stack(
        [
            state["effort"][:, 0],
            state["velocity"][:, 0] * np.pi / 30.0,
            *pressures,
            state["position"][:, 1],
            state["velocity"][:, 1],
        ]
    )
    reference = np.frombuffer(joined["/bench/reference"], _FLOAT)["data"]
    command = np.frombuffer(joined["/drive/current_cmd"], _FLOAT)["data"]
    return reference, command, readings


def misfit(sample: str, name: str, data: Path) -> np.ndarray:
    """Mean square of what the replay leaves, in units of the noise, by channel."""
    reference, command, readings = read(data / "rig_samples" / sample / f"{name}.mcap")
    free, bypass = name.startswith("free"), name.startswith("bypass")
    run = Run(
        name,
        not free,
        bypass,
        False,
        kernel.OPEN_LOOP,
        0,
        np.array(reference),
        np.zeros(len(command)),
    )
    scaled = {
        parameter: DECLARED[parameter] * ratio
        for parameter, ratio in zip(CALIBRATED, RATIOS[sample], strict=True)
    }
    replay = Plant({**scaled, **HIDDEN[sample]}).replay(run, np.array(command))
    return np.asarray(np.mean(((replay - readings) / FLOOR) ** 2, axis=0))


@pytest.mark.parametrize("name", ["locked_steps", "bypass_ramps", "free_swing"])
def test_nothing_but_noise_is_left_where_nothing_is_missing(name: str, shared_data: Path) -> None:
    assert misfit("D", name, shared_data).max() < 1.1


@pytest.mark.slow
@pytest.mark.parametrize("sample", sorted(RATIOS))
def test_nothing_but_noise_is_left_once_the_effect_is_in(sample: str, shared_data: Path) -> None:
    left = np.array([misfit(sample, name, shared_data) for name in RUNS])
    assert left.max() < 1.25
    assert left.mean() == pytest.approx(1.0, abs=0.02)


def test_the_effect_is_needed(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(HIDDEN, "A", {})
    assert misfit("A", "locked_steps", shared_data).max() > 50.0
