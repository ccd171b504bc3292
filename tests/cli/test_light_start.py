"""What a command does not need, it does not import: lists of modules, no clocks."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HEAVY = {
    "can", "cantools", "dask", "fmpy", "jinja2", "joblib", "llvmlite", "matplotlib", "mcap",
    "numba", "pandas", "pint", "pyarrow", "rosbags", "scipy",
}  # fmt: skip
DATASET = """\
model: model.yaml
channels: channels.yaml
inputs: [current_command]
runs: [{log: a.mcap, piston: locked, bypass: closed, use: train}]
"""
CHANNELS = """\
channels:
  current_command: {topic: /drive/current, field: data, unit: A}
  pressure_a: {topic: /block/p_a, field: fluid_pressure, unit: bar}
  motor_speed: {topic: /drive/state, field: "velocity[0]", unit: rpm}
"""


def imported(code: str, *arguments: str) -> set[str]:
    """Top-level names of all modules that a fresh interpreter has after running some code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys\nprint(*sys.modules)", *arguments],
        capture_output=True, text=True, check=True, cwd=ROOT,
    )  # fmt: skip
    return {name.partition(".")[0] for name in done.stdout.splitlines()[-1].split()}


COMMAND = """
from eha_bench.cli.main import main
try:
    main()
except SystemExit as left:
    assert not left.code, left.code
"""


def test_importing_the_package_imports_nothing_else() -> None:
    assert (
        imported("import eha_bench") & (HEAVY | {"numpy", "pydantic", "ruamel", "typer"}) == set()
    )


def test_help_needs_no_numbers() -> None:
    assert imported(COMMAND, "--help") & (HEAVY | {"numpy", "pydantic", "ruamel", "rich"}) == set()


@pytest.mark.parametrize(
    "name", ["paper.yaml", "models/paper.yaml", "models/physical.yaml", "controllers/paper.yaml",
             "targets/paper.yaml"],
)  # fmt: skip
def test_validate_needs_neither_compiler_nor_libraries_of_figures(name: str) -> None:
    assert imported(COMMAND, "validate", f"suites/{name}") & HEAVY == set()


def test_validate_of_a_suite_needs_no_arrays() -> None:
    assert "numpy" not in imported(COMMAND, "validate", "suites/paper.yaml")


def test_a_model_made_in_python_needs_no_compiler() -> None:
    code = "from eha_bench.plants.model import Model\nassert Model('eha_knee').vector().size"
    assert imported(code) & HEAVY == set()


def test_validate_of_a_dataset_needs_no_reader(tmp_path: Path) -> None:
    (tmp_path / "dataset.yaml").write_text(DATASET)
    (tmp_path / "channels.yaml").write_text(CHANNELS)
    (tmp_path / "model.yaml").write_text("model: eha_knee\ncalibrate: [leakage]\n")
    (tmp_path / "a.mcap").write_bytes(b"")
    for name in ("dataset.yaml", "channels.yaml"):
        assert imported(COMMAND, "validate", str(tmp_path / name)) & HEAVY == set()


def test_a_diagnosis_begins_without_what_it_may_never_need() -> None:
    """SciPy's statistics and Arrow took half of the start, which every worker makes anew."""
    code = "import eha_bench.diagnosis.diagnose, sys\nassert 'scipy.stats' not in sys.modules"
    assert "pyarrow" not in imported(code)


def test_the_plants_are_described_without_the_compiler() -> None:
    code = (
        "from eha_bench.plants.registry import get_plant\nassert get_plant('eha_knee').layout.size"
    )
    assert imported(code) & HEAVY == set()
