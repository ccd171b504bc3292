"""Foxglove layouts: every path leads to a field that is there, every panel has its place."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from eha_bench.cli.app import app
from eha_bench.core.channels import CHANNELS
from eha_bench.core.errors import EhaBenchError
from eha_bench.core.recording import Recording
from eha_bench.recordings import write
from eha_bench.report.foxglove import layout_for


def leaves(tree: Any) -> list[str]:
    """Panel ids of a layout's tree, from top to bottom; checks each split."""
    if isinstance(tree, str):
        return [tree]
    assert tree["direction"] in ("row", "column")
    assert 0 < tree["splitPercentage"] < 100
    return leaves(tree["first"]) + leaves(tree["second"])


def paths(layout: dict[str, Any]) -> list[str]:
    panels = [layout["configById"][name] for name in leaves(layout["layout"])]
    return [path["value"] for panel in panels for path in panel.get("paths", ())]


def check(layout: dict[str, Any]) -> None:
    assert json.loads(json.dumps(layout)) == layout
    shown = leaves(layout["layout"])
    assert sorted(shown) == sorted(layout["configById"])
    found = paths(layout)
    assert len(found) == len(set(found))


def test_every_channel_that_we_write_has_its_plot() -> None:
    layout = layout_for()
    check(layout)
    assert sorted(paths(layout)) == sorted(f"/eha_bench/sample.{name}" for name in CHANNELS)
    titles = [panel.get("title") for panel in layout["configById"].values()]
    assert "Chamber pressures / Pa" in titles


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_recordings_paths_are_fields_of_its_messages(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    time = np.arange(20) / 100.0
    values = {name: np.full(20, 3.5) for name in ("reference", "pressure_difference", "Öl Temp/1")}
    units = {"reference": "Pa", "pressure_difference": "Pa", "Öl Temp/1": "K"}
    file = write(tmp_path / "a.mcap", Recording(time, values, units))
    layout = layout_for(file)
    check(layout)
    first = layout["configById"][leaves(layout["layout"])[0]]
    assert first["title"] == "Pressure difference / Pa"  # with the reference, by its unit
    assert len(first["paths"]) == 2
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        schema, channel, _, message = next(iter(reader.iter_decoded_messages()))
    for path in paths(layout):
        topic, _, field = path.partition(".")
        assert topic == channel.topic
        assert getattr(message, field) == 3.5
    text = schema.data.decode()
    assert "float64 pressure_difference # Pa: P1 - P2" in text  # the schema describes the unit


def test_a_suites_modes_stand_beside_the_reference() -> None:
    suite = Path(__file__).resolve().parents[2] / "suites" / "paper.yaml"
    layout = layout_for(suite)
    shown = leaves(layout["layout"])
    titles = [layout["configById"][name].get("title") for name in shown[:2]]
    assert titles == ["Pressure difference / Pa", "Joint angle / rad"]


def test_somebody_elses_topics(tmp_path: Path) -> None:
    file = tmp_path / "channels.yaml"
    file.write_text(
        "channels:\n"
        "  pressure_a: {topic: /block/p_a, field: fluid_pressure, unit: bar}\n"
        '  motor_speed: {topic: /drive/state, field: "velocity[0]", unit: rpm}\n'
    )
    layout = layout_for(file)
    check(layout)
    assert sorted(paths(layout)) == ["/block/p_a.fluid_pressure", "/drive/state.velocity[0]"]
    assert {p["label"] for n in layout["configById"].values() for p in n.get("paths", ())} == {
        "Pressure A / bar", "Motor speed / rpm",
    }  # fmt: skip


def test_columns_of_a_table_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "channels.yaml"
    file.write_text("time: {column: t, unit: s}\nchannels:\n  pressure_a: {column: p, unit: bar}\n")
    with pytest.raises(EhaBenchError, match="names columns of a table"):
        layout_for(file)


def test_the_command_prints_or_writes_it(tmp_path: Path) -> None:
    runner = CliRunner()
    printed = runner.invoke(app, ["layout"])
    assert printed.exit_code == 0
    out = tmp_path / "new" / "foxglove.json"
    written = runner.invoke(app, ["layout", "--out", str(out)])
    assert written.exit_code == 0
    assert out.read_text() == printed.stdout == json.dumps(layout_for(), indent=2) + "\n"
