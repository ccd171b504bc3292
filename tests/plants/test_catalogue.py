"""The pages of effects and of elements say what the code does."""

from collections.abc import Callable
from pathlib import Path

import pytest

from eha_bench.plants.catalogue import effects_page, elements_page
from eha_bench.plants.network.network import element_kinds
from eha_bench.plants.role_catalogue import roles_page


@pytest.mark.parametrize(
    ("name", "page"),
    [("effects", effects_page), ("elements", elements_page), ("roles", roles_page)],
)
def test_a_page_is_what_the_code_says(repository: Path, name: str, page: Callable[[], str]) -> None:
    kept = (repository / "docs" / f"{name}.md").read_text(encoding="utf-8")
    again = f"write it again: python -m eha_bench.plants.catalogue {name} > docs/{name}.md"
    assert kept == page(), again


def test_page_names_every_parameter() -> None:
    page = effects_page()
    for name in ("entrained_air", "learned", "`air_fraction`", "`values`", "0 × 24", "neutral 0"):
        assert name in page


def test_page_of_elements_names_every_kind_with_its_ports_and_parameters() -> None:
    sections = {part.partition("\n")[0]: part for part in elements_page().split("\n## ")}
    for kind in element_kinds().values():
        section = sections[kind.id]
        for port in kind.ports:
            joined = {"first": "`between`, first", "second": "`between`, second"}
            assert joined.get(port.name, f"`{port.name}`") in section
        for parameter in kind.parameters:
            assert f"| `{parameter.name}` |" in section


def test_page_of_elements_tells_inputs_and_channels_of_either_way_to_declare_one() -> None:
    motor = elements_page().partition("\n## motor\n")[2].partition("\n## ")[0]
    for port in ("current", "voltage", "duty", "supply_voltage"):
        assert f"* input `{port}`" in motor
