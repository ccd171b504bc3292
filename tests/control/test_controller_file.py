"""controller.yaml: what it may say, and what it says where it is wrong."""

from pathlib import Path

import pytest

from eha_bench.control.controller import Context
from eha_bench.control.controller_file import load_controllers
from eha_bench.core.errors import InputError
from eha_bench.core.trial import ControlMode

CONTEXT = Context(1e-3, 30.0)
GOOD = """\
pressure:
  controller: pressure_pi
  k_1: 0.9 A/MPa
  k_p: 0.5 A/MPa
  k_i: 20 A/(MPa*s)
  k_2: 0.1 A*s/rad
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "controller.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_gains_come_in_with_their_units(tmp_path: Path) -> None:
    controllers = load_controllers(written(tmp_path, GOOD))
    controller = controllers.make(ControlMode.PRESSURE, CONTEXT)
    reading = {"pressure_difference": 0.0, "motor_speed": 0.0}
    assert controller.step(1e6, reading) == pytest.approx(1.4)


def test_current_needs_no_controller_and_other_modes_do(tmp_path: Path) -> None:
    controllers = load_controllers(written(tmp_path, GOOD))
    assert controllers.make(ControlMode.CURRENT, CONTEXT).step(3.0, {}) == 3.0
    with pytest.raises(InputError, match="no controller for mode 'joint_angle'"):
        controllers.make(ControlMode.JOINT_ANGLE, CONTEXT)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("0.9 A/MPa", "0.9 A", 3, "wrong dimension"),
        ("k_p:", "k_q:", 4, "unknown key 'k_q'|'k_p' is missing"),
        ("pressure_pi", "presure_pi", 2, "presure_pi"),
        ("pressure:", "presure:", 1, "presure"),
        ("  k_2: 0.1 A*s/rad\n", "", 1, "'k_2' is missing"),
        ("pressure_pi", "os:nothing", 2, "os:nothing"),
        ("pressure_pi", "os:getcwd", 2, "not a Controller"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(
    tmp_path: Path, old: str, new: str, line: int, message: str
) -> None:
    path = written(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(InputError, match=message) as caught:
        load_controllers(path)
    assert caught.value.where.file == str(path)
    assert caught.value.where.line == line


def test_a_class_beside_the_file_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "my_law.py").write_text(
        "from eha_bench.control.controller import Controller\n"
        "class Mine(Controller):\n"
        "    def __init__(self, gains, context):\n"
        "        self.limit = context.current_limit\n"
        "    def step(self, reference, reading):\n"
        "        return self.limit / 2\n",
        encoding="utf-8",
    )
    path = written(tmp_path, "pressure: {controller: 'my_law:Mine'}\n")
    controller = load_controllers(path).make(ControlMode.PRESSURE, CONTEXT)
    assert controller.step(0.0, {}) == 15.0
