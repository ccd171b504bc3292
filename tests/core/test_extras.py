"""What a base installation lacks is said before any work, with the way to install it."""

import sys
from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.core.errors import EhaBenchError, InputError, RecordingError
from eha_bench.core.extras import require
from eha_bench.core.recording import Recording
from eha_bench.recordings import export, info
from eha_bench.sweeps.sweep import run_sweep

WAY_OUT = r"pip install 'eha-bench\[parquet\]'"


@pytest.fixture
def no_pyarrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the extra were not installed."""
    for name in [*sys.modules, "pyarrow"]:
        if name.partition(".")[0] == "pyarrow":
            monkeypatch.setitem(sys.modules, name, None)


def recording() -> Recording:
    return Recording(np.arange(20) * 1e-3, {"current": np.zeros(20)})


@pytest.mark.usefixtures("no_pyarrow")
def test_a_parquet_file_is_neither_written_nor_read(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=WAY_OUT):
        export(tmp_path / "log.parquet", recording())
    assert not list(tmp_path.iterdir())
    (tmp_path / "log.parquet").write_bytes(b"PAR1 and more")
    with pytest.raises(EhaBenchError, match=rf"log.parquet: a Parquet file needs.*{WAY_OUT}"):
        info(tmp_path / "log.parquet")


@pytest.mark.usefixtures("no_pyarrow")
def test_predictions_and_sweeps_refuse_before_anything_is_simulated(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"a Parquet file for each run needs.*{WAY_OUT}"):
        eb.predict(tmp_path / "there_is_none.yaml", out=tmp_path / "out")
    with pytest.raises(InputError, match=f"points.parquet, the table.*{WAY_OUT}"):
        run_sweep(None, None, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_is_installed_is_not_refused() -> None:
    require("numpy", "none", "nothing")
    with pytest.raises(InputError, match="this needs a_package_of_nobody"):
        require("a_package_of_nobody", "none", "this")
