"""Channels that are computed from others: of a map, and refused with line and key."""

from __future__ import annotations

import numpy as np
import pytest

from eha_bench.core.errors import InputError, Place
from eha_bench.core.recording import Recording
from eha_bench.recordings import load_channel_map, read
from eha_bench.recordings.computed import ComputedChannel, with_computed

MAP = """\
time: {column: t, unit: s}
channels:
  duty:           {column: duty, unit: "%"}
  supply_voltage: {column: supply, unit: mV}
  twice:          {expression: 2 * voltage, unit: V}
  voltage:        {expression: duty * supply_voltage, unit: V}
"""


@pytest.fixture
def folder(tmp_path):
    table = "t,duty,supply\n0,50,12000\n0.1,-25,12000\n0.2,,12000\n"
    (tmp_path / "log.csv").write_text(table)
    (tmp_path / "channels.yaml").write_text(MAP)
    return tmp_path


def test_values_are_computed_in_si_in_any_order(folder):
    found = read(folder / "log.csv", channels=folder / "channels.yaml")
    assert found["voltage"][:2] == pytest.approx([6.0, -3.0])
    assert found["twice"][:2] == pytest.approx([12.0, -6.0])
    assert np.isnan(found["voltage"][2])
    assert found.unit("voltage") == "V"


def test_what_is_computed_from_what_was_resampled_is_so_too():
    metadata = {"resampled": '["duty"]'}
    log = Recording(np.arange(3.0), {"duty": np.ones(3), "supply": np.ones(3)}, metadata=metadata)
    channels = {
        "voltage": ComputedChannel(expression="duty * supply", unit="V"),
        "twice": ComputedChannel(expression="2 * voltage", unit="V"),
        "half": ComputedChannel(expression="supply / 2", unit="V"),
    }
    assert with_computed(log, channels, Place()).resampled == {"duty", "voltage", "twice"}


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "duty * supply_voltage",
            "duty * supply_voltag",
            r":6.*channels\.voltage\.expression.*did you",
        ),
        (
            "duty * supply_voltage",
            "open(duty)",
            r":6.*channels\.voltage\.expression.*unknown function",
        ),
        ("duty * supply_voltage", "twice / 2", r"computed from itself: .*twice.*voltage"),
        (
            "supply_voltage, unit: V",
            "supply_voltage, unit: mV",
            r":6.*voltage\.unit.*worked out in",
        ),
        ("supply_voltage, unit: V", "supply_voltage, unit: A", r":6.*voltage\.unit.*in V, not"),
        ("2 * voltage, unit: V", "2 * voltage", r":5.*twice\.unit.*needs a unit"),
        ("2 * voltage, unit: V", "2 * voltage, unit: V, scale: 2", r":5.*twice\.scale.*no 'scale'"),
    ],
)
def test_mistakes_are_told_with_line_and_key(folder, old, new, says):
    path = folder / "channels.yaml"
    path.write_text(MAP.replace(old, new))
    with pytest.raises(InputError, match=says):
        load_channel_map(path)


def test_a_part_that_the_log_does_not_have_is_told(folder):
    path = folder / "channels.yaml"
    path.write_text(MAP.replace("column: supply, unit: mV", "topic: /supply, field: data, unit: V"))
    with pytest.raises(InputError, match="'voltage' is computed from 'supply_voltage', which is"):
        read(folder / "log.csv", channels=path)
