"""The first channel map of a log: short names, with units at their ends or without."""

from pathlib import Path

import pytest

from eha_bench.recordings.guessing import first_map


@pytest.mark.parametrize(
    ("column", "line"),
    [
        ("p_a", "pressure_a: {column: p_a, unit: Pa}"),
        ("p_b", "pressure_b: {column: p_b, unit: Pa}"),
        ("x_mm", "piston_position: {column: x_mm, unit: mm}"),
        ("motor current_a", 'current: {column: "motor current_a", unit: A}'),
        ("T_c", "{column: T_c, unit: degC}"),
    ],
)
def test_what_a_column_is(tmp_path: Path, column: str, line: str) -> None:
    (tmp_path / "log.csv").write_text(f"t_s,{column}\n0,1\n0.1,2\n0.2,4\n")
    found = first_map(tmp_path / "log.csv")
    assert line in found
    assert "time: {column: t_s, unit: s}" in found


@pytest.mark.parametrize("unit", ["s", "ms", "sec", "min"])
def test_a_clock_in_any_unit_of_time(tmp_path: Path, unit: str) -> None:
    (tmp_path / "log.csv").write_text(f"Time [{unit}],p_a\n0,1\n0.1,2\n0.2,4\n")
    assert f'time: {{column: "Time [{unit}]", unit: {unit}}}' in first_map(tmp_path / "log.csv")
