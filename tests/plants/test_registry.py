"""A plant by its name, and how it travels to another process."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from eha_bench.core.errors import PluginError
from eha_bench.plants.layout import Layout
from eha_bench.plants.network.file import load_plant
from eha_bench.plants.parameter import Parameter
from eha_bench.plants.plant import Plant
from eha_bench.plants.registry import get_plant


class Unregistered(Plant):
    """A plant that no entry point names."""

    id = "unregistered"
    outputs = ("current",)
    states = ()

    def __init__(self) -> None:
        self.layout = Layout(self.id, (Parameter("gain", "A", 2.0, 0.0, 9.0, "", ""),), ())


@pytest.mark.parametrize("name", ["eha_knee", "pump_hold"])
def test_a_plant_with_a_name_is_found_again_by_it(name: str) -> None:
    plant = get_plant(name)
    assert get_plant(name) is plant
    assert pickle.loads(pickle.dumps(plant)) is plant
    assert len(pickle.dumps(plant)) < 20_000


def test_a_plant_of_a_file_travels_as_what_the_file_declares(repository: Path) -> None:
    path = repository / "suites" / "plants" / "valve_cylinder.yaml"
    plant = load_plant(path)
    text = pickle.dumps(plant)
    assert str(path).encode() not in text
    assert pickle.loads(text) is plant


def test_a_plant_that_no_name_leads_to_travels_as_it_is() -> None:
    plant = Unregistered()
    again = pickle.loads(pickle.dumps(plant))
    assert again is not plant
    np.testing.assert_array_equal(again.layout.defaults(), plant.layout.defaults())


def test_a_name_that_there_is_not_gets_the_nearest_one() -> None:
    with pytest.raises(PluginError, match=r"unknown plant 'eha_kne'.*eha_knee"):
        get_plant("eha_kne")
