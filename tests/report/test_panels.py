"""Which channels are drawn together."""

import numpy as np
from sample_run import SampleRun

from eha_bench.core.recording import Recording
from eha_bench.report.panels import panels_of


def test_the_followed_channel_comes_first_with_its_reference(sample: SampleRun) -> None:
    recording = sample.recordings[("pressure_step-15MPa", 0)]()
    panels = panels_of(recording, "pressure_difference")
    assert [panel.channels for panel in panels] == [
        ("reference", "pressure_difference"),
        ("current_command", "current"),
        ("motor_speed",),
        ("pressure_a", "pressure_b"),
    ]
    assert [panel.unit.symbol for panel in panels] == ["MPa", "A", "rpm", "MPa"]


def test_every_channel_is_drawn_once(sample: SampleRun) -> None:
    recording = sample.recordings[("knee_sine-1Hz", 0)]()
    drawn = [name for panel in panels_of(recording, "joint_angle") for name in panel.channels]
    assert sorted(drawn) == sorted(recording)


def test_current_mode_shows_reference_and_current_together() -> None:
    time = np.arange(10) / 10.0
    names = ("reference", "current_command", "current")
    recording = Recording(time, dict.fromkeys(names, time))
    assert panels_of(recording, "current")[0].channels == ("reference", "current")


def test_unknown_and_empty_channels() -> None:
    time = np.arange(10) / 10.0
    recording = Recording(time, {"mine": time, "hole": np.full(10, np.nan)}, units={"mine": "V"})
    panels = panels_of(recording, "joint_angle")
    assert [panel.channels for panel in panels] == [("mine",)]
    assert panels[0].unit.symbol == "V"


def test_a_channel_keeps_its_colour_from_panel_to_panel() -> None:
    time = np.arange(10) / 10.0
    both = panels_of(Recording(time, {"pressure_a": time, "pressure_b": time}))
    alone = panels_of(Recording(time, {"pressure_b": time}))
    assert both[0].traces[1].colour == alone[0].traces[0].colour
