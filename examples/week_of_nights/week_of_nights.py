"""A week of nights on the played rig, whose pump leaks more every night.

    python examples/week_of_nights/week_of_nights.py [FOLDER] [--nights 7] [--leak 4e-15]
    (default: reports/example_week)

Eight healthy nights come first, as a history has to know what is usual. Each night `eha-bench rig`
plays the machine as it is by then, and the suite is run on it over its CAN bus, as a timer does on
a real bench. In the morning `eha-bench history` says what drifted and which cause is
behind it. Leaves with 1 where the leak is not named.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import eha_bench as eb

HERE = Path(__file__).resolve().parent
MODEL = HERE.parents[1] / "suites" / "models" / "physical.yaml"
CONTROLLER = HERE.parents[1] / "suites" / "controllers" / "physical.yaml"
DRIVE = HERE.parents[1] / "fixtures" / "rig" / "eha_drive.yaml"
HEALTHY = 8
LEAKAGE = 2e-15  # m^3/(s*Pa) of the healthy pump
CHANNELS = ("current", "motor_speed", "pressure_a", "pressure_b", "piston_position",
            "piston_velocity", "joint_angle")  # fmt: skip


def night(folder: Path, number: int, leakage: float) -> str:
    """Play the rig with a leakage, run the suite on it; return how the run ended."""
    machine, target = folder / "machine.yaml", folder / "rig.yaml"
    own = f"parameters:\n  leakage: {leakage} m^3/(s*Pa)"
    machine.write_text(MODEL.read_text("utf-8").replace("parameters:", own), "utf-8")
    words = ["--model", str(machine), "--seed", str(number), "--watchdog", "5 s"]
    rig = subprocess.Popen(
        [sys.executable, "-m", "eha_bench", "rig", str(DRIVE), "--listen", "socket://127.0.0.1:0",
         *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        assert rig.stdout is not None
        channel = rig.stdout.readline().strip()
        # a played rig harms nobody: it may wait for a machine that does other things as well
        limits = "".join(f"  {name}: {{stale: 5 s}}\n" for name in CHANNELS)
        target.write_text(
            f"target: can\nbase: {DRIVE}\nname: week\ncontrol: set-point\n"
            f"model: {MODEL}\ncontroller: {CONTROLLER}\n"
            f"bus: {{interface: slcan, channel: '{channel}'}}\n"
            f"limits:\n{limits}following: {{}}\nbalance: {{over: 5 s}}\n"
            "start: {timeout: 20 s, enable: 10 s}\nloop: {overruns: 1, lost: 1, late: 1}\n",
            "utf-8",
        )
        result = eb.run(HERE / "suite.yaml", target=target, out=folder / "nights" / f"{number:02d}")
        return result.status.value
    finally:
        rig.terminate()
        rig.wait()


def main() -> int:
    """Run the nights, and print what the morning page says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("reports/example_week"))
    parser.add_argument("--nights", type=int, default=7, help="nights on which the leak grows")
    parser.add_argument("--leak", type=float, default=4e-15, help="more of it a night, SI")
    chosen = parser.parse_args()
    folder = chosen.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["EHA_BENCH_STATE"] = str(folder / "state")  # the latch of a rig that is only played
    for number in range(HEALTHY + chosen.nights):
        leakage = LEAKAGE + chosen.leak * max(0, number - HEALTHY + 1)
        print(f"night {number:2d}, leakage {leakage:.2g}: {night(folder, number, leakage)}")
    nights, nightly = folder / "nights", HERE / "nightly.yaml"
    words = ["history", str(nights), "--config", str(nightly)]
    morning = subprocess.run([sys.executable, "-m", "eha_bench", *words], check=False)
    if morning.returncode == 2:
        return 1
    found = json.loads((nights / "history" / "history.json").read_text("utf-8"))
    print("page:", nights / "history" / "index.html")
    return int([wear["cause"] for wear in found["causes"]["wear"]] != ["leakage"])


if __name__ == "__main__":
    sys.exit(main())
