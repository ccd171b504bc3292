"""An FMU in a trial's closed loop: one command in, one row of readings out, tick by tick."""

from __future__ import annotations

import math

import numpy as np

from eha_bench.core.arrays import FloatArray
from eha_bench.core.errors import TargetFault
from eha_bench.core.linkage import Linkage
from eha_bench.targets.fmu.description import Variable
from eha_bench.targets.fmu.process import Process


class FmuSession:
    """An FMU between two ticks, as `ClosedLoop` sees it."""

    def __init__(
        self,
        library: Process,
        command: Variable,
        outputs: tuple[Variable, ...],
        channels: tuple[str, ...],
        linkage: Linkage | None,
        start: float,
        step: float,
    ) -> None:
        self._library, self._command, self._outputs = library, command, outputs
        self._channels, self._linkage = channels, linkage
        self._start, self._step = start, step
        self._now = 0.0
        self._take(library.get(outputs, 0.0))

    def _take(self, values: dict[str, float]) -> None:
        found = [values[variable.name] for variable in self._outputs]
        for channel, variable, value in zip(self._channels, self._outputs, found, strict=True):
            if not math.isfinite(value):
                raise TargetFault(
                    f"the FMU gives {channel} ('{variable.name}') as {value} at {self._now:.6g} s"
                )
        if self._linkage is not None:
            found.append(self._linkage.angle_at(found[self._channels.index("piston_position")]))
        self._truth: FloatArray = np.array(found)

    @property
    def truth(self) -> FloatArray:
        """What the outputs are now, (channels,), SI."""
        return self._truth

    def advance(self, to: float, command: float) -> None:
        """Set the command and step to a later moment, s on the trial's clock.

        Raises:
            TargetFault: the FMU fails, or an output is not finite.
        """
        now, then = self._now, float(to - self._start)
        count = max(1, math.ceil((then - now) / self._step - 1e-6))
        length = (then - now) / count
        values = {self._command: self._command.raw(command)}
        found = self._library.tick(values, now, length, count, self._outputs)
        self._now = then
        self._take(found)
