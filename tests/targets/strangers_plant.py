"""A plant of somebody else's package, in plain Python: a spool that turns a flap."""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import dedent

import pytest

from eha_bench.core import plugins
from eha_bench.plants.registry import get_plant

FILES = {
    "flap_bench/__init__.py": "",
    "flap_bench/plant.py": '''
        """A spool follows its command with a lag, and the flap turns as fast as it is open."""

        import numpy as np

        from eha_bench.core.errors import InputError
        from eha_bench.plants.layout import Layout
        from eha_bench.plants.parameter import Parameter
        from eha_bench.plants.plant import Plant


        class Flap(Plant):
            id = "flap"
            outputs = ("spool_position", "flap_angle")
            states = ("spool_position", "flap_angle")
            state_places = {"spool_position": 0, "flap_angle": 1}
            inputs = ("valve_command", "wind")
            command = "valve_command"
            units = {"valve_command": "V", "wind": "rad/s", "spool_position": "m",
                     "flap_angle": "rad"}

            def __init__(self):
                self.layout = Layout(self.id, (
                    Parameter("lag", "s", 5e-3, 1e-6, 10.0),
                    Parameter("opening", "m/V", 1e-4, 0.0, 1.0),
                    Parameter("speed", "rad/(s*m)", 5e3, 0.0, 1e9),
                ))

            def command_limit(self, vector):
                return 10.0

            def position_range(self, vector):
                return {"flap_angle": (-1.5, 1.5)}

            def start(self, vector, initial):
                state = np.zeros(2)
                for name, value in initial.items():
                    if name not in self.state_places:
                        raise InputError(f"'{name}' is not a state of {self.id}")
                    state[self.state_places[name]] = value
                return state, np.zeros(1)

            def advance(self, first, last, time, inputs, locked, bypass_open, step, fresh, vector,
                        memory, state, out):
                lag, opening, speed = vector[:3]
                for k in range(first, last + 1):
                    out[k] = state
                    if k < last:
                        span = time[k + 1] - time[k]
                        goal, share = opening * inputs[k, 0], np.exp(-span / lag)
                        begun = state[0]
                        state[0] = goal + (begun - goal) * share
                        # the flap's speed is linear in the spool, whose mean is known exactly
                        opened = goal * span + lag * (begun - state[0])
                        state[1] += speed * opened + inputs[k, 1] * span
    ''',
    "flap_bench-1.0.dist-info/METADATA": """
        Metadata-Version: 2.1
        Name: flap-bench
        Version: 1.0
    """,
    "flap_bench-1.0.dist-info/entry_points.txt": """
        [eha_bench.plants]
        flap = flap_bench.plant:Flap
    """,
}


@contextmanager
def installed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A context in which the package is found, as if pip had installed it into a folder."""
    for name, text in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(dedent(text).lstrip(), encoding="utf-8")
    monkeypatch.syspath_prepend(str(folder))
    caches = (plugins._entry_points, plugins._group, get_plant)
    for cache in caches:
        cache.cache_clear()
    importlib.invalidate_caches()
    yield
    for cache in caches:
        cache.cache_clear()
