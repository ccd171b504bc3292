"""Two runs never share a rig, and a rig that was left badly waits for a person."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from eha_bench.core.errors import TargetFault
from eha_bench.targets.can.hold import Hold, RigBusy, RigLatched


def test_a_second_holder_is_refused_until_the_first_lets_go() -> None:
    first, second = Hold("rig"), Hold("rig")
    first.take()
    with pytest.raises(RigBusy, match=f"process {os.getpid()}"):
        second.take()
    Hold("another").take()
    first.let_go()
    second.take()
    second.let_go()


def test_a_latch_survives_its_process_and_only_a_person_takes_it_away(tmp_path: Path) -> None:
    code = (
        "import os; from eha_bench.targets.can.hold import Hold; h = Hold('rig'); h.take(); "
        "h.arm('step'); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", code], check=False)
    hold = Hold("rig")
    hold.take()
    with pytest.raises(RigLatched, match="torque was on, in trial 'step'"):
        hold.check()
    assert "step" in str(hold.clear("Ada"))
    hold.check()
    log = (tmp_path / "state" / "rig.log").read_text(encoding="utf-8")
    assert '"by": "Ada"' in log
    hold.let_go()


def test_disarmed_is_as_if_nothing_had_been() -> None:
    hold = Hold("rig")
    hold.arm("step")
    assert hold.latch is not None
    hold.disarm()
    assert hold.latch is None
    hold.check()


def test_a_damaged_latch_still_latches(tmp_path: Path) -> None:
    hold = Hold("rig")
    (tmp_path / "state" / "rig.latch").write_text("{", encoding="utf-8")
    with pytest.raises(RigLatched):
        hold.check()


def test_a_folder_that_cannot_be_made_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("EHA_BENCH_STATE", str(tmp_path / "file" / "state"))
    with pytest.raises(TargetFault, match="EHA_BENCH_STATE"):
        Hold("rig")
