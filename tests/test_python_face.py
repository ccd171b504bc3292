"""What a person at a prompt meets: names that complete, objects that show themselves, types."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import eha_bench as eb
from eha_bench.core.errors import InputError, MissingChannelError

SUITE = {
    "name": "face",
    "trials": [
        {
            "id": "step",
            "mode": "current",
            "setup": {"piston": "locked"},
            "duration": "0.1 s",
            "repeats": 2,
            "signal": {"kind": "step", "final": "8 A", "at": "10 ms"},
            "accept": {"tracking_max": "<= 1 A", "tracking_rms": "<= 9 A"},
        }
    ],
}


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> eb.Result:
    return eb.run(SUITE, out=tmp_path_factory.mktemp("face") / "out")


def test_names_complete() -> None:
    assert set(eb.__all__) == set(dir(eb))
    code = "import sys, eha_bench as eb; print(len(dir(eb)), 'numpy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )  # fmt: skip
    assert done.stdout.split() == [str(len(eb.__all__)), "False"]
    for name in eb.__all__:
        assert getattr(eb, name) is not None


def test_a_result_tells_what_failed(result: eb.Result) -> None:
    assert repr(result).startswith("<Result of face on simulator: failed, 2 of 4 limits kept, in ")
    missed = result.failed
    assert [(item.trial, item.repeat, item.metric, item.unit) for item in missed] == [
        ("step", 0, "tracking_max", "A"), ("step", 1, "tracking_max", "A"),
    ]  # fmt: skip
    assert missed[0].value > 1.0
    frame = result.to_frame()
    assert set(frame[frame.limit != ""].metric) == {"tracking_max", "tracking_rms"}
    assert frame.value.dtype == np.float64
    html = result._repr_html_()
    assert html.index("<td>failed</td>") < html.index("<td>passed</td>")
    cells = r"<td>step \[0\]</td><td>tracking error, maximum</td><td>\d\.\d+\xa0A</td>"
    assert re.search(cells + "<td>≤\xa01\xa0A</td>", html)
    assert eb.Result.read(result.folder / "result.json").folder == result.folder


def test_a_recording_shows_itself_and_is_drawn(
    result: eb.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    rec = eb.read(result.folder / "recordings" / "step-0.mcap")
    assert "100 samples over 0.099 s at 1000 Hz, reference, " in repr(rec)
    assert re.search(
        r"<td>pressure_a</td><td>[−\d.]+</td><td>[\d.]+</td><td>MPa</td>", rec._repr_html_()
    )
    figure = rec.plot("current")
    assert [axis.get_title(loc="left") for axis in figure.axes] == ["Motor current / A"]
    with pytest.raises(MissingChannelError, match="force"):
        rec.plot("force")
    figure = result.plot("step", repeat=1)
    assert len(figure.axes) >= 3
    with pytest.raises(InputError, match="did you mean 'step'"):
        result.plot("stp")


def test_what_comparing_and_watching_find_shows_itself(result: eb.Result) -> None:
    assert result.folder is not None
    found = eb.compare(result.folder, result.folder)
    assert repr(found).startswith("<Comparison: no regression; ")
    html = found._repr_html_()
    assert "No regression. All " in html
    assert "<td>step</td><td>Tracking error, maximum</td>" in html
    history = eb.history(result.folder.parent)
    assert ": 1 run, " in repr(history)
    assert "too few runs to judge any of them (8 are needed)" in history._repr_html_()


SCRIPT = """
from pathlib import Path

import eha_bench as eb

recording: eb.Recording = eb.read("run.mcap", channels={"channels": {}})
top: float = float(recording["pressure_a"].max())
result: eb.Result = eb.run({"name": "a", "trials": []}, target="physical", out=Path("out"))
frame = result.to_frame()
missed: list[str] = [item.metric for item in result.failed]
status: str = eb.compare("a", Path("b")).status
figure = result.plot("step")
diagnosis = eb.diagnose({"model": "paper", "inputs": ["current_command"], "runs": []})
verdict: str = diagnosis.verdict.value
"""


@pytest.mark.slow
def test_a_users_script_type_checks(tmp_path: Path) -> None:
    from mypy import api

    good, wrong = tmp_path / "good.py", tmp_path / "wrong.py"
    good.write_text(SCRIPT)
    wrong.write_text("import eha_bench as eb\neb.run(3)\neb.read('x').tme\n")
    options = ["--strict", "--follow-imports=silent", "--config-file=", "--cache-dir",
               str(Path(__file__).resolve().parents[1] / ".mypy_cache" / "scripts")]  # fmt: skip
    told, errors, status = api.run([*options, str(good), str(wrong)])
    assert status == 1, told + errors
    assert "good.py" not in told + errors
    assert 'Argument 1 to "run"' in told
    assert '"Recording" has no attribute "tme"' in told
