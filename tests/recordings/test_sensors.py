"""`resolution` and `uncertainty` of a channel: read, kept in the metadata, and in the intervals."""

import numpy as np
import pytest

from eha_bench.core.errors import InputError
from eha_bench.core.sensor import Sensor, sensors_of
from eha_bench.recordings import read, write

MAP = {
    "sample_rate": "1 kHz",
    "channels": {
        "pressure_a": {"column": "p", "unit": "bar", "resolution": "1 bar", "uncertainty": "0.2 %"},
        "pressure_b": {"column": "p", "unit": "bar", "uncertainty": "0.5 bar"},
        "oil_temperature": {"column": "t", "unit": "degC", "resolution": "0.5 degC"},
        "current": {"column": "t", "unit": "A", "resolution": 0.01},
    },
}


@pytest.fixture
def table(tmp_path):
    file = tmp_path / "log.csv"
    rows = [f"{100 + k % 3},{40 + 0.5 * (k % 2)}" for k in range(200)]
    file.write_text("\n".join(["p,t", *rows]) + "\n", encoding="utf-8")
    return file


def changed(**entry):
    channels = {**MAP["channels"], "pressure_a": {"column": "p", "unit": "bar", **entry}}
    return {**MAP, "channels": channels}


def test_what_the_map_says_is_in_the_metadata_in_si(table):
    metadata = read(table, channels=MAP).metadata
    assert Sensor.of(metadata, "pressure_a") == Sensor(1e5, 0.0, 0.002)
    assert Sensor.of(metadata, "pressure_b") == Sensor(0.0, 5e4, 0.0)
    assert Sensor.of(metadata, "oil_temperature") == Sensor(0.5)
    assert Sensor.of(metadata, "current") == Sensor(0.01)
    assert not any(key.startswith("sensor.force") for key in metadata)


def test_it_survives_being_written_and_read_again(table, tmp_path):
    recording = read(table, channels=MAP)
    write(tmp_path / "kept.mcap", recording)
    again = read(tmp_path / "kept.mcap")
    assert sensors_of(again, "pressure_difference") == {
        "pressure_a": Sensor(1e5, 0.0, 0.002),
        "pressure_b": Sensor(0.0, 5e4, 0.0),
    }


def test_a_map_that_says_nothing_adds_nothing(table):
    assert not any(k.startswith("sensor.") for k in read(table, channels=changed()).metadata
                   if "pressure_a" in k)  # fmt: skip


@pytest.mark.parametrize(
    ("key", "value"),
    [("resolution", "1 mm"), ("resolution", "-1 bar"), ("resolution", "fine"),
     ("uncertainty", "0 %"), ("uncertainty", "2 A"), ("uncertainty", 0.0)],
)  # fmt: skip
def test_what_is_no_size_of_the_channel_is_refused_at_its_key(table, key, value):
    with pytest.raises(InputError) as caught:
        read(table, channels=changed(**{key: value}))
    assert f"channels.pressure_a.{key}" in str(caught.value)


def test_the_resolution_of_a_table_is_in_a_score(table):
    values = read(table, channels=MAP)["pressure_a"]
    assert np.unique(np.round(np.diff(np.unique(values)))).tolist() == [1e5]
