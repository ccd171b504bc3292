"""What a diagnosis left unexplained, as a slow error of what a simulator's sensors read."""

from __future__ import annotations

from collections.abc import Mapping

from eha_bench.targets.sensors import SimulatedSensor
from eha_bench.targets.simulator import Simulator


def with_remainder(simulator: Simulator, remainder: Mapping[str, float]) -> Simulator:
    """Return a simulator whose readings are off by a remainder as well.

    Args:
        simulator: of the model that was left with it. remainder: channel -> its root mean square,
            SI; it stays correlated as long as a sensor's `memory`.
    """
    if not remainder:
        return simulator
    sensors = dict(simulator.sensors)
    for channel, size in remainder.items():
        sensors[channel] = sensors.get(channel, SimulatedSensor()).model_copy(
            update={"wander": size}
        )
    return simulator.varied(sensors=sensors)
