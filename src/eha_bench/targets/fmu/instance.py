"""A running instance of a co-simulation FMU, of FMI 2 or FMI 3."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from ctypes import byref
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eha_bench.core.errors import TargetFault
from eha_bench.targets.fmu.description import Binary, Variable

if TYPE_CHECKING:
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave

_WARNING, _DISCARD, _LONGEST = 1, 2, 3
"""FMI's status from which a log message is worth keeping, and how many are shown."""


class Library:
    """An FMU's binary, loaded once; makes a fresh instance for every run."""

    def __init__(self, binary: Binary, folder: Path) -> None:
        """Load it from the folder that the FMU was unpacked into.

        Raises:
            TargetFault: the binary cannot be loaded.
        """
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        kind = FMU2Slave if binary.version == 2 else FMU3Slave
        self.version, self._once = binary.version, binary.once
        self._messages: list[str] = []
        try:
            self.fmu: FMU2Slave | FMU3Slave = kind(
                guid=binary.guid,
                unzipDirectory=str(folder),
                modelIdentifier=binary.identifier,
                instanceName="eha-bench",
                requireFunctions=False,
            )
        except Exception as error:  # FMPy raises bare exceptions
            raise TargetFault(f"the FMU cannot be loaded: {error}") from error
        self._callbacks = self._logging()
        self._alive = False

    def _logging(self) -> Any:
        """Return callbacks that keep what the FMU says; they live as long as the library."""
        if self.version == 3:
            return lambda _environment, status, _category, text: self._keep(status, text)
        from fmpy.fmi2 import (
            calloc,
            fmi2CallbackAllocateMemoryTYPE,
            fmi2CallbackFreeMemoryTYPE,
            fmi2CallbackFunctions,
            fmi2CallbackLoggerTYPE,
            free,
        )

        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(
            lambda _environment, _name, status, _category, text: self._keep(status, text)
        )
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        try:
            from fmpy.logging import addLoggerProxy

            addLoggerProxy(byref(callbacks))  # fills in what a message leaves to its arguments
        except Exception:  # no proxy for this platform: messages are then shown as they come
            return callbacks
        return callbacks

    def _keep(self, status: int, text: bytes | None) -> None:
        if status >= _WARNING and text:
            self._messages.append(" ".join(text.decode("utf-8", "replace").split()))

    def call(self, what: str, *arguments: Any, time: float | None = None, **named: Any) -> Any:
        """Call FMPy's function; what the FMU reports becomes a sentence.

        Raises:
            TargetFault: the FMU discards the call, or reports an error.
        """
        try:
            return getattr(self.fmu, what)(*arguments, **named)
        except Exception as error:  # FMICallException, or a bare one where it gives no instance
            at = f" at {time:.6g} s" if time is not None else ""
            messages = "; ".join(dict.fromkeys(self._messages[-_LONGEST:]))
            raise TargetFault(
                f"the FMU failed{at}: {error}" + (f" Its message: {messages}" if messages else "")
            ) from error

    def start(self, stop: float, values: Mapping[Variable, float]) -> None:
        """Make an instance with these start values (raw) and bring it to time 0.

        Raises:
            TargetFault: the FMU refuses.
        """
        self._messages.clear()
        if self._alive:
            self.call("reset")
        elif self.version == 2:
            self.call("instantiate", callbacks=self._callbacks, loggingOn=True)
        else:
            self.call("instantiate", logMessage=self._callbacks, loggingOn=True)
        self._alive = True
        self.set(values, 0.0)
        if self.version == 2:
            self.call("setupExperiment", startTime=0.0, stopTime=stop)
            self.call("enterInitializationMode")
        else:
            self.call("enterInitializationMode", startTime=0.0, stopTime=stop)
        self.call("exitInitializationMode")

    def set(self, values: Mapping[Variable, float], time: float) -> None:
        """Set variables to raw values."""
        for kind, group in _by_kind(values):
            raw = [_as_kind(kind, values[variable]) for variable in group]
            setter = "Int64" if kind == "Enumeration" and self.version == 3 else _accessor(kind)
            self.call(f"set{setter}", [v.reference for v in group], raw, time=time)

    def get(self, variables: tuple[Variable, ...], time: float) -> dict[str, float]:
        """Return variables' values in SI, by name."""
        found: dict[str, float] = {}
        for kind, group in _by_kind(variables):
            getter = "Int64" if kind == "Enumeration" and self.version == 3 else _accessor(kind)
            raw = self.call(f"get{getter}", [v.reference for v in group], time=time)
            for variable, value in zip(group, raw, strict=True):
                found[variable.name] = variable.factor * float(value) + variable.offset
        return found

    def tick(
        self,
        values: Mapping[Variable, float],
        time: float,
        length: float,
        count: int,
        variables: tuple[Variable, ...],
    ) -> dict[str, float]:
        """Set inputs (raw), advance by `count` steps of `length` s, return outputs in SI by name.

        Raises:
            TargetFault: the FMU fails.
        """
        self.set(values, time)
        for part in range(count):
            self.step(time + part * length, length)
        return self.get(variables, time + count * length)

    def step(self, time: float, length: float) -> None:
        """Advance by a communication step.

        Raises:
            TargetFault: the FMU fails, or ends its simulation.
        """
        ended = False
        if self.version == 2:
            self.call(
                "doStep",
                currentCommunicationPoint=time,
                communicationStepSize=length,
                time=time,
            )
        else:
            found = self.call("doStep", time, length, time=time)
            ended = bool(found[1])
        if ended:
            raise TargetFault(f"the FMU ended its simulation at {time + length:.6g} s")

    def stop(self) -> None:
        """End the instance; one that may exist only once is kept, to be reset."""
        if not self._alive:
            return
        try:
            self.fmu.terminate()
        except Exception:  # an instance that has failed already cannot be terminated: freed below
            self._messages.append("terminate failed")
        if self._once:
            return
        self._alive = False
        if self.version == 2:
            self.fmu.fmi2FreeInstance(self.fmu.component)
        else:
            self.fmu.fmi3FreeInstance(self.fmu.component)


def _by_kind(variables: Iterable[Variable]) -> list[tuple[str, list[Variable]]]:
    ordered = sorted(variables, key=lambda variable: variable.kind)
    return [(kind, list(group)) for kind, group in groupby(ordered, key=lambda v: v.kind)]


def _accessor(kind: str) -> str:
    """Return the part of FMPy's getter's and setter's name that stands for an FMI type."""
    return "Integer" if kind == "Enumeration" else kind


def _as_kind(kind: str, value: float) -> float | int | bool:
    if kind in ("Real", "Float32", "Float64"):
        return float(value)
    return bool(value) if kind == "Boolean" else round(value)
